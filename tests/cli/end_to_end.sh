# SPDX-License-Identifier: Apache-2.0
# A known-good training: from photos of the synthetic scene to the PSNR of views it has not seen. The bounds are what the
# first release reached, less half a decibel. Another engine draws a smaller scene, as well as the CPU engine to 0.1 dB.
. "$(dirname "$0")/common.sh"
if [ -n "${SG_TEST_ENGINE-}" ]; then
    expect 0 synth -o scene --width 48 --height 36 --train-views 40 --test-views 16 --points 1000 --samples 1
    schedule="--iterations 200 --sh-interval 50 --densify-from-iter 40 --densification-interval 20 --densify-until-iter 140 \
        --densify-grad-threshold 0.002 --opacity-reset-interval 100000 --position-lr-max-steps 200 --quiet"
    psnr() { sed -n 's/.*"psnr": \([0-9.]*\).*/\1/p' "$1/summary.json"; }
    engine() { sed -n 's/.*"variant": "\(.*\)".*/\1/p' "$1/summary.json"; }
    compare() { # RUN OTHER: they have ended on the same engine
        [ "$(engine "$1")" = "$(engine "$2")" ] || fail "$1 ended on $(engine "$1"), expected $(engine "$2")"
        awk "BEGIN { d = $(psnr "$1") - $(psnr cpu); exit !(d * d <= 0.01 && $(psnr cpu) > 16) }" ||
            fail "$1: PSNR $(psnr "$1"), expected $(psnr cpu) to 0.1 dB, and more than 16"
        echo "$1: PSNR $(psnr "$1"), on the CPU $(psnr cpu)"
    }
    expect 0 train scene/colmap -o cpu --eval --engine cpu $schedule
    expect 0 train scene/colmap -o device --eval $schedule
    [ "$(engine device)" != "$(engine cpu)" ] || fail "both ran on $(engine cpu)"
    compare device device
    # Halves on either engine.
    expect 0 train scene/colmap -o from_cpu --eval --engine cpu $(once $schedule --iterations 100)
    expect 0 train --resume from_cpu --iterations 200 -q
    compare from_cpu device
    expect 0 train scene/colmap -o to_cpu --eval $(once $schedule --iterations 100)
    expect 0 train --resume to_cpu --iterations 200 -q --engine cpu
    compare to_cpu cpu
    exit 0
fi
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
