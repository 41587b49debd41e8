# SPDX-License-Identifier: Apache-2.0
# Trainings that are killed (kill -9) at random moments and resumed end with the bytes of one that ran through.
. "$(dirname "$0")/common.sh"
small_scene
pid=
trap '[ -z "$pid" ] || kill -9 "$pid" 2>/dev/null' EXIT
last=300
options=$(once $short --init-points 300 --iterations $last --densify-until-iter 240 --save-every 50 --eval)

# A moment between 0 and 0.25 seconds.
moment() { od -An -N2 -tu2 /dev/urandom | awk '{ printf "%.3f", $1 / 262144 }'; }

# killed NAME OPTIONS...: what the run is called, and what it trains.
killed() {
    name=$1 kills=0 moments=
    shift
    expect 0 train scene/blender -o $name-whole $options "$@"
    for round in 1 2 3; do
        if [ -s $name-cut/checkpoint.bin ]; then
            "$tool" train --resume $name-cut -q 2>err &
        else
            "$tool" train scene/blender -o $name-cut $options "$@" 2>err &
        fi
        pid=$!
        # The first time once there is something to continue from.
        [ $round != 1 ] || wait_for $name-cut/checkpoint.bin
        after=$(moment)
        moments="$moments $after"
        sleep "$after"
        kill -9 $pid 2>/dev/null && kills=$((kills + 1))
        wait $pid 2>/dev/null
        pid=
    done
    [ $kills -gt 0 ] || fail "$name: nothing was killed"
    expect 0 train --resume $name-cut -q
    for file in checkpoint.bin $(cd $name-whole && find point_cloud -type f); do
        cmp $name-cut/"$file" $name-whole/"$file" || fail "$name: $file differs after kills at$moments"
    done
    [ "$(cd $name-cut && find . -type f | sort)" = "$(cd $name-whole && find . -type f | sort)" ] ||
        fail "$name: other files: $(ls -R $name-cut)"
    for key in max_gaussians final_gaussians psnr; do
        [ "$(grep "\"$key\"" $name-cut/summary.json)" = "$(grep "\"$key\"" $name-whole/summary.json)" ] ||
            fail "$name: $key differs after kills at$moments"
    done
}

killed 3dgs
killed mcmc --strategy mcmc --cap-max 500 --mcmc-until 240 --exposure
killed mip --model mip
killed scaffold --model scaffold --anchors-from-iter 40 --voxel-size 0.02 --anchor-distance --feature-bank \
    --photo-appearance
[ -s scaffold-cut/point_cloud/iteration_$last/networks.safetensors ] || fail "no networks"
