# SPDX-License-Identifier: Apache-2.0
# Train, look at the run folder, measure and render it.
. "$(dirname "$0")/common.sh"
small_scene

expect 0 train scene/blender -o run --eval $short --init-points 500 --save-every $half --eval-every $half
[ ! -s err ] || fail "--quiet is not quiet"
for file in config.json summary.json log.jsonl checkpoint.bin cameras.json input.ply cfg_args \
    point_cloud/iteration_$half/point_cloud.ply point_cloud/iteration_$end/point_cloud.ply; do
    [ -s run/$file ] || fail "run/$file is missing"
done
[ -z "$(find run -name '*.tmp*')" ] || fail "temporary files are left: $(find run -name '*.tmp*')"
for key in max_gaussians final_gaussians iterations train_seconds cpu_seconds iterations_per_second peak_rss_bytes \
    peak_ledger_bytes peak_ledger_bytes_by_tag psnr ssim fps stage_seconds version variant machine threads; do
    grep -q "\"$key\":" run/summary.json || fail "summary.json has no $key"
done
grep -q "\"densification-interval\": $((end / 6))," run/config.json || fail "config.json does not hold the options"
grep -q "^Namespace(.*sh_degree=3, source_path='/.*white_background=False)$" run/cfg_args || fail cfg_args
[ "$(grep -c '"loss"' run/log.jsonl)" = 5 ] || fail "log.jsonl: expected the first iteration and each quarter"

# The measured values of training are those of eval on the saved model.
expect 0 eval run --json
grep -Eq '^\{"psnr": [0-9.]+, "ssim": [0-9.]+, "fps": [0-9.]+, "views": 2, "gaussians": [0-9]+\}$' out || fail "$(cat out)"
psnr=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
grep -q "\"psnr\": ${psnr%?}" run/summary.json || fail "eval says $psnr, summary.json $(grep psnr run/summary.json)"
model=run/point_cloud/iteration_$end/point_cloud.ply
expect 0 eval $model --scene scene/blender --json --per_view
grep -q "\"psnr\": $psnr" out || fail "the PLY alone measures differently: $(cat out), run: $psnr"
expect 0 eval run --iteration $half --json
grep -q "\"psnr\": $psnr" out && fail "--iteration $half measures the newest model"
expect 2 eval run --iteration 41; says iteration_41
expect 1 eval $model; says 'missing --scene'; expect 1 render $model -o x; says '--scene SCENE or --cameras FILE'
# The command line wins over the run's own options.
expect 0 eval run -w --json
grep -q "\"psnr\": $psnr" out && fail "-w made no difference"

expect 0 render run -o images --depth
[ "$(ls images)" = "$(printf 'r_0.png\nr_0_depth.png\nr_1.png\nr_1_depth.png')" ] || fail "rendered: $(ls images)"
expect 0 render run -o both --photo --quiet
[ "$(ls both)" = "$(printf 'r_0.png\nr_0_photo.png\nr_1.png\nr_1_photo.png')" ] || fail "rendered: $(ls both)"
cmp -s both/r_0.png both/r_0_photo.png && fail "a render is its photo"
expect 0 render run -o floats --float --split train --quiet
[ "$(find floats -type f ! -name '.*' | wc -l)" = 6 ] || fail "rendered: $(ls floats)"
[ "$(head -n 2 floats/r_0.pfm | tr "\n" " ")" = "PF $width $height " ] || fail "not a PFM"
[ "$(wc -c <floats/r_0.pfm)" = $((14 + width * height * 12)) ] || fail "PFM of $(wc -c <floats/r_0.pfm) bytes"

# Exposures: a map for each training photo; test views are measured with and without matched colours.
expect 0 train scene/blender -o exposed --eval $short --init-points 500 --exposure --save-every $half
[ "$(grep -c '"r_' exposed/exposure.json)" = 6 ] || fail "exposure.json: $(cat exposed/exposure.json)"
grep -q '"corrected_psnr":' exposed/summary.json || fail "summary.json has no corrected_psnr"
expect 0 eval exposed --json --match-colours --per-view
[ "$(grep -o corrected_psnr out | wc -l)" = 3 ] || fail "$(cat out)"
expect 0 eval exposed --split train --exposure --json
grep -q '"corrected_by": "exposure"' out || fail "$(cat out)"
expect 1 eval exposed --exposure; says 'expected --split train, or a run with --test-halves'
expect 1 eval exposed --split train --exposure --iteration $half; says 'expected the newest model'
expect 1 eval exposed --exposure --match-colours; says 'expected one of them'
expect 1 eval run --split train --exposure; says 'found a run that has learned none, expected one of train --exposure'
grep -q corrected run/summary.json && fail "a run without exposures has matched colours"

# Halves of test photos: their exposures are learned on one half and measured on the other. What
# training says, eval says too.
expect 1 train scene/colmap -o halves --test-halves --exposure $short; says 'train: --test-halves: found it without eval'
expect 2 train scene/blender -o halves --eval --test-halves --exposure $short; says 'test halves: found the layout'
expect 0 train scene/colmap -o halves --eval --test-every 3 --test-halves --exposure $short
[ "$(grep -c '": \[$' halves/exposure.json)" = "$(find scene/colmap/images -type f | wc -l)" ] || fail "exposure.json: $(cat halves/exposure.json)"
grep -q '"corrected_by": "exposure"' halves/summary.json || fail "$(cat halves/summary.json)"
grep -q 'train_test_exp=True' halves/cfg_args || fail "$(cat halves/cfg_args)"
expect 0 eval halves --json --exposure
for key in psnr corrected_psnr; do
    value=$(sed "s/.*\"$key\": \([0-9.]*\).*/\1/" out)
    grep -q "\"$key\": ${value%??}" halves/summary.json || fail "eval says $key $value, summary.json $(grep $key halves/summary.json)"
done
expect 0 eval halves --json --match-colours
grep -q '"corrected_by": "matching"' out || fail "$(cat out)"
expect 0 eval halves --exposure --split train --json
python3 - halves/exposure.json <<'EOF' || fail "cannot write maps"
import json, sys
maps = json.load(open(sys.argv[1]))
name = sorted(maps)[0]
def write(case, value):
    changed = dict(maps, **{name: value} if value is not None else {})
    if value is None:
        del changed[name]
    json.dump(changed, open("maps-" + case, "w"))
write("rows", maps[name][:2])
write("row", [row + [0] for row in maps[name]])
write("huge", [[1e300] * 4] * 3)
write("none", None)
write("many", maps[name])
large = json.load(open("maps-many"))
large.update({"photo %d" % i: maps[name] for i in range(5000)})
json.dump(large, open("maps-many", "w"))
EOF
for case in rows row huge none; do
    cp maps-$case halves/exposure.json
    expect 2 eval halves --exposure; says 'exposure.json'
done
cp maps-many halves/exposure.json # more bytes than other files of a run may have
expect 0 eval halves --exposure --json
expect 1 eval halves/point_cloud/iteration_$end/point_cloud.ply --scene scene/colmap --exposure; says "a run's folder"
# The cfg_args alone, which other trainers write too, say what was held out: halves, ...
whole=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
mv halves/config.json . && expect 0 eval halves --scene scene/colmap --test-every 3 --json
grep -q "\"psnr\": $whole" out || fail "cfg_args: $(cat out), expected $whole"
# ... or nothing. Other trainers know halves of NeRF-Synthetic's layout too, where names are not enough here.
sed -i 's/eval=True/eval=False/' halves/cfg_args
expect 0 eval halves --scene scene/colmap --split train --json
grep -q "\"views\": $(find scene/colmap/images -type f | wc -l)," out || fail "eval=False: $(cat out)"
mv run/config.json run.json && cp run/cfg_args args && sed -i 's/eval=True/eval=True, train_test_exp=True/' run/cfg_args
expect 0 eval run --scene scene/blender; says 'they are measured too'
mv run.json run/config.json && mv args run/cfg_args

# A model with filters against aliasing: eval draws it as training did, also at other sizes.
expect 0 train scene/blender -o mip --eval $short --init-points 500 --model mip
expect 0 eval mip --json
psnr=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
grep -q "\"psnr\": ${psnr%??}" mip/summary.json || fail "eval says $psnr, summary.json $(grep psnr mip/summary.json)"
expect 0 eval mip --json -r 2
expect 0 eval mip/point_cloud/iteration_$end/point_cloud.ply --scene scene/blender --json --mip-kernel 0.1
grep -q "\"psnr\": ${psnr%??}" out || fail "the PLY alone measures differently: $(cat out), run: $psnr"

# Published settings, where no option says otherwise; --preset is the defense's.
has() { grep -q "\"$1\": $2[,}]*\$" published/config.json || fail "$1 is $(grep "\"$1\"" published/config.json), expected $2"; }
brief="--iterations 1 --init-points 40 --force -q"
expect 0 train scene/blender -o published $brief --published ns; has white-background true; has anchor-cells 16
expect 0 train scene/blender -o published $brief --published mip-outdoor --model mip; has resolution 4
expect 0 train scene/blender -o published $brief --published mip-indoor -r 3; has resolution 3
expect 0 train scene/blender -o capped $brief --strategy mcmc --cap-max 4; says 'more than --cap-max, 4, which limits growth alone'
expect 0 train scene/blender -o published $brief --published db --strategy mcmc; has opacity-reg 0.001
expect 0 train scene/blender -o published $brief --published tt --preset ns --defense spectral; has white-background false
expect 0 train scene/blender -o published $brief --published ns --model scaffold; has anchor-cells 4; has voxel-size 0.001
expect 0 train scene/blender -o published $brief --published tt --model scaffold; has voxel-size 0.01; has anchor-cells 16
expect 0 train scene/blender -o published $brief --published db --model scaffold --voxel-size 0.5; has voxel-size 0.5
expect 0 train scene/blender -o published $brief --published poison-splat --model scaffold; has photo-appearance true
expect 0 train scene/blender -o published $brief --published poison-splat --model scaffold --appearance-numbers 16; has appearance-numbers 16
expect 0 train scene/blender -o published $(once $brief --init-points 60) --published bungee --model scaffold; has voxel-size 0.0; has anchor-cells 128
has init-points 60
expect 1 train scene/blender -o none --published bungee; says 'no published settings of 3dgs for BungeeNeRF'
for set in ns poison-splat; do
    expect 0 train scene/blender -o published --iterations 1 --force -q --published $set --model scaffold; has init-points 10000
done
expect 1 train --resume published --published ns; says 'exclude each other'
expect 1 train scene/blender -o none --published tt --model mip; says 'no published settings of mip for Tanks and Temples'

expect 0 info run; grep -q 'SH degree 3' out || fail "$(cat out)"
expect 0 info $model --json; grep -q '"nonfinite": 0' out || fail "$(cat out)"

# An earlier run is never overwritten by accident; --force removes what it left.
expect 2 train scene/blender -o run $short; says 'found an earlier run'; says '--resume continues it'
mv run/checkpoint.bin . # as where the disk was full
expect 2 train scene/blender -o run $short; says '--force replaces it'; ! grep -q resume err || fail "what cannot be resumed"
mv checkpoint.bin run
expect 0 train scene/colmap -o run --force --eval --iterations 20 --quiet
[ "$(ls run/point_cloud)" = iteration_20 ] || fail "--force left $(ls run/point_cloud)"
[ "$(grep -c '"loss"' run/log.jsonl)" = 2 ] || fail "--force left the log"

# Starting from a model; CPU variants and the environment.
expect 0 train scene/blender -o from --init run/point_cloud/iteration_20/point_cloud.ply --iterations 2 -q
cp from/point_cloud/iteration_2/point_cloud.ply by-file.ply
expect 0 train scene/blender -o from --init run --iterations 2 -q --force
cmp by-file.ply from/point_cloud/iteration_2/point_cloud.ply || fail "a run begins another one differently than its file"
SG_CPU=none expect 1 train scene/blender -o base --iterations 2 --init-points 100 -q --engine cpu; says 'train: SG_CPU: found "none"'
expect 1 train scene/blender -o base --iterations 2 --init-points 100 -q --engine cpu --cpu none; says 'train: --cpu: found "none"'
SG_CPU=baseline expect 0 train scene/blender -o base --iterations 2 --init-points 100 -q --engine cpu
grep -q '"cpu_variant": "baseline"' base/config.json || [ "$(uname -m)" != x86_64 ] || fail "SG_CPU is ignored"
for command in 'train scene/blender -o none' 'eval base' 'render base -o none' 'view base'; do
    # shellcheck disable=SC2086
    expect 1 $command --cpu abacus -q
    grep -q 'no HTTP server' err || says "splatguard ${command%% *}: --cpu: found \"abacus\""
done
