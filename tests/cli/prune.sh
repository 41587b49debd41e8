# SPDX-License-Identifier: Apache-2.0
# Pruning a model of a run, or a PLY with the scene named, by each method.
. "$(dirname "$0")/common.sh"
small_scene
expect 0 train scene/blender -o run $short --init-points 300 --eval

gaussians() { expect 0 info "$1" --json; sed -n 's/.*"gaussians": \([0-9]*\).*/\1/p' out | head -1; }
model=run/point_cloud/iteration_$end/point_cloud.ply
before=$(gaussians $model)
for method in lightgaussian pup spectral; do
    expect 0 prune run --method $method --ratio 0.5 --finetune 20 --trained $end -o $method.ply -q
    [ ! -s out ] && [ ! -s err ] || fail "prune -q says $(cat out)"
    left=$(gaussians $method.ply)
    [ "$left" -le $((before - before / 2)) ] && [ "$left" -ge 1 ] || fail "$method left $left of $before"
    expect 0 eval $method.ply --scene scene/blender -q
done
cmp -s lightgaussian.ply pup.ply && fail "two methods made the same model"
expect 0 prune run --ratio 0.5 --finetune 20 --trained $end -o same.ply -q --threads 1
cmp lightgaussian.ply same.ply || fail "another number of threads, another model"

expect 0 prune run --ratio 0.5 --finetune 0 -o small.splat -q
[ $(($(wc -c <small.splat) % 32)) -eq 0 ] && expect 0 info small.splat || fail "the format is not that of the ending"
expect 1 prune run --ratio 0.5 --finetune 0 -o small.ksplat -q; says 'only read'
expect 1 prune run --ratio 0.5 --finetune 0 -o small.xyz -q; says 'small.xyz: found no known ending'
[ ! -e small.xyz ] || fail "a model in a format that nobody named"

# A run brings what the command line does not say.
expect 0 prune run --ratio 0.5 --finetune 20 -o own.ply -q
cmp lightgaussian.ply own.ply || fail "a run does not know how long it was trained"
expect 0 train scene/blender -o smooth $short --init-points 300 --eval --smooth gaussian
expect 0 prune smooth --finetune 5 -o smooth.ply -q
grep -q warning err && fail "a warning about a run without defense: $(cat err)"
expect 0 prune smooth --finetune 5 -o sharp.ply -q --smooth off
cmp -s smooth.ply sharp.ply && fail "the run's --smooth does not count"
expect 0 prune smooth/point_cloud/iteration_$end/point_cloud.ply --scene scene/blender --eval \
    --smooth gaussian --trained $end --finetune 5 -o asked.ply -q
cmp smooth.ply asked.ply || fail "the run's photos are smoothed in another way"

expect 0 train scene/blender -o defended $short --init-points 300 --eval --tolerance 8
expect 0 prune defended --finetune 5 -o defended.ply -q; says 'warning: the run was trained with a'
expect 0 prune defended --finetune 0 -o untrained.ply -q
grep -q warning err && fail "a warning without fine-tuning: $(cat err)"

# A PLY brings no scene options: --eval says what the run has said.
expect 0 prune $model --scene scene/blender --ratio 0.5 --finetune 20 --trained $end --eval -o ply.ply -q
cmp lightgaussian.ply ply.ply || fail "the model and its run differ"
expect 0 prune $model --scene scene/blender --finetune 0 --json -o bare.ply -q
grep -q "\"rounds\": \[{\"before\": $before, \"removed\": " out || fail "prune --json says $(cat out)"
expect 0 prune run --method pup --finetune 0 -o two.ply
[ "$(grep -c '^of [0-9]* Gaussians [0-9]* removed' err)" -eq 2 ] || fail "pup says $(cat err), expected two rounds"
[ "$(cat out)" = "two.ply: $(gaussians two.ply) Gaussians" ] || fail "prune prints $(cat out)"

expect 0 train scene/blender -o mip --iterations 1 --init-points 50 --model mip -q
expect 2 prune mip --finetune 0 -o x.ply; says 'mip: found a run of another --model'

# Nothing is half-written or lost.
expect 2 prune run --finetune 0 -o scene/blender/out.ply; says 'scene'
echo mine >mine.ply
expect 2 prune run --finetune 0 -o mine.ply; says 'mine.ply'
grep -q mine mine.ply || fail "another's file is gone"
expect 1 prune $model -o x.ply; says 'missing --scene SCENE'
expect 1 prune run; says 'missing -o OUT.ply'
expect 1 prune $model --scene scene/blender --iteration 5 -o x.ply; says "expected a run's folder"
expect 1 prune run --ratio 2 -o x.ply; says '--ratio'
expect 1 prune run --ratio -1 -o x.ply; says '--ratio: found "-1", expected a number from 0 to 1 or "published"'
expect 1 prune run --second-ratio -1 -o x.ply; says '--second-ratio: found "-1"'
expect 1 prune run --method magic -o x.ply; says '--method'
expect 1 prune run --reduce 2 -o x.ply; says '--reduce: found with --method lightgaussian, expected --method pup'
# What is given beside an option that takes its place.
expect 0 prune run --max-gaussians 50 --ratio 0.5 --second-ratio 0 --finetune 0 --trained 20 --seed 2 \
    --global-score count --volume-power 0.2 --global-weight transmittance -o idle.ply -q
for option in ratio second-ratio trained seed volume-power global-weight; do
    says "warning: --$option has no effect with"
done
[ "$(grep -c warning err)" -eq 6 ] || fail "expected six warnings: $(cat err)"
expect 0 prune run --max-gaussians 50 --finetune 2 --trained 20 --seed 2 --volume-power 0.2 -o busy.ply -q
grep warning err && fail "a warning about options that have an effect: $(cat err)"
expect 1 prune run --method pup --volume-clip -o x.ply; says 'expected --method lightgaussian'
expect 2 prune nothing.ply --scene scene/blender -o x.ply; says 'nothing.ply'
printf 'ply\nformat ascii 1.0\nelement vertex 1\nend_header\n' >bad.ply
expect 2 prune bad.ply --scene scene/blender -o x.ply; says 'bad.ply'
expect 3 prune run --max-memory 1M -o x.ply; says 'max-memory'
[ ! -e x.ply ] || fail "a failed prune wrote a model"

# Ctrl-C leaves no file.
"$tool" prune run --finetune 1000000 -o x.ply 2>err &
wait_for err
interrupt $!
[ $? -eq 130 ] || fail "an interrupted prune did not exit with 130"
[ ! -e x.ply ] || fail "an interrupted prune wrote a model"
