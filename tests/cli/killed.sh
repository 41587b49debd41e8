# SPDX-License-Identifier: Apache-2.0
# Trainings that are killed (kill -9) at random moments and resumed end with the bytes of one that ran through.
. "$(dirname "$0")/common.sh"
small_scene
pid=
trap '[ -z "$pid" ] || kill -9 "$pid" 2>/dev/null' EXIT
last=$((end * 5 / 3))
options=$(once $short --init-points 300 --iterations $last --densify-until-iter $((end * 4 / 3)) --save-every $((end / 4)) --eval)

# killed NAME OPTIONS...: what the run is called, and what it trains. Kills count where there is something to continue from.
killed() {
    name=$1 kills=0 moments=
    shift
    begin=$(date +%s%N)
    expect 0 train scene/blender -o $name-whole $options "$@"
    whole=$(($(date +%s%N) - begin))
    for round in $(seq 40); do
        if [ -s $name-cut/checkpoint.bin ]; then
            "$tool" train --resume $name-cut -q 2>err &
        else
            rm -rf $name-cut
            "$tool" train scene/blender -o $name-cut $options "$@" 2>err &
        fi
        pid=$!
        after=$(od -An -N2 -tu2 /dev/urandom | awk -v whole=$whole '{ printf "%.3f", $1 / 65536 * whole / 1e9 }')
        sleep "$after"
        kill -9 $pid 2>/dev/null
        wait $pid 2>/dev/null
        code=$?
        [ $code = 0 ] || [ $code = 137 ] || fail "$name: exit code $code after kills at$moments"
        if [ $code = 0 ]; then # it was faster
            rm -rf $name-cut
        elif [ -s $name-cut/checkpoint.bin ]; then
            kills=$((kills + 1))
            moments="$moments $after"
        fi
        pid=
        [ $kills -lt $wanted ] || break
    done
    [ $kills = $wanted ] || fail "$name: found $kills kills that left a checkpoint after $round trials, expected $wanted"
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

wanted=2
[ -z "${SG_TEST_ENGINE-}" ] || options="$options --max-gaussians 600" # a driver for the CPU is slow
killed 3dgs
[ -z "${SG_TEST_ENGINE-}" ] || wanted=1
killed mcmc --strategy mcmc --cap-max 500 --mcmc-until $((end * 4 / 3)) --exposure
killed mip --model mip
killed scaffold --model scaffold --anchors-from-iter 40 --voxel-size 0.02 --anchor-distance --feature-bank \
    --photo-appearance
[ -s scaffold-cut/point_cloud/iteration_$last/networks.safetensors ] || fail "no networks"
