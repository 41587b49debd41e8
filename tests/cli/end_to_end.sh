# SPDX-License-Identifier: Apache-2.0
# A known-good training: from photos of the synthetic scene to the PSNR of views it has not seen. The bounds are what the
# first release reached, less half a decibel.
. "$(dirname "$0")/common.sh"
expect 0 synth -o scene --width 120 --height 90 --train-views 32 --test-views 8 --points 3000 --samples 2
schedule="--iterations 800 --sh-interval 200 --densify-from-iter 200 --densify-until-iter 600 --position-lr-max-steps 800"

reaches() { # PSNR SCENE OPTIONS...
    bound=$1 scene=$2
    shift 2
    expect 0 train "$scene" -o run --force --eval --quiet $schedule "$@"
    psnr=$(sed -n 's/.*"psnr": \([0-9.]*\).*/\1/p' run/summary.json)
    awk "BEGIN { exit !($psnr >= $bound) }" || fail "$scene $*: PSNR $psnr, expected at least $bound"
    echo "$scene $*: PSNR $psnr"
}

reaches 23.6 scene/colmap
reaches 23.6 scene/colmap --cpu baseline
reaches 20.0 scene/blender -w --init-points 5000
