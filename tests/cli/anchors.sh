# SPDX-License-Identifier: Apache-2.0
# Models of anchors (Scaffold-GS): train, measure, export, and what is refused.
. "$(dirname "$0")/common.sh"
small_scene

# Eval and render make the Gaussians with the networks beside the model.
expect 0 train scene/blender -o anchors --eval $short --init-points 200 --model scaffold --anchors-from-iter 40 \
    --voxel-size 0.02
expect 0 eval anchors --json
psnr=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
grep -q "\"psnr\": ${psnr%??}" anchors/summary.json || fail "eval says $psnr, summary.json $(grep psnr anchors/summary.json)"
gaussians=$(sed 's/.*"gaussians": \([0-9]*\).*/\1/' out)
grep -q "\"final_gaussians\": $gaussians" anchors/summary.json || fail "eval says $gaussians Gaussians"
expect 0 info anchors --json; grep -q "\"anchors\": ${gaussians%0}[,}]" out || fail "$(cat out)"
anchors=anchors/point_cloud/iteration_$end/point_cloud.ply
expect 0 eval $anchors --scene scene/blender --json
grep -q "\"psnr\": ${psnr%??}" out || fail "the files alone measure differently: $(cat out), run: $psnr"
expect 0 export anchors baked.ply --view-independent; grep -q '^lost: ' out || fail "$(cat out)"
baked=$(sed -n "s/.*: \([0-9]*\) Gaussians, the mean of those that 6 views made of ${gaussians%0} anchors$/\1/p" out)
[ "$baked" -gt 0 ] && [ "$baked" -lt "$gaussians" ] || fail "export says $(cat out), of $gaussians"
expect 0 eval baked.ply --scene scene/blender --json # what is lost
grep -q "\"views\": 2, \"gaussians\": $baked}" out || fail "$(cat out), expected $baked Gaussians"
grep -q "\"psnr\": ${psnr%??}" out && fail "what depends on the view is not lost: $(cat out)"
expect 1 export anchors other.ply; says view-independent
for option in --engine=cpu --cpu=baseline --max-vram=1G --mip-kernel=0.1 --reference-tiles --white-background; do
    expect 1 export anchors other.ply --view-independent $option; says "${option%=*}" # nothing is drawn
done
expect 1 export nowhere other.xyz --view-independent; says 'other.xyz: found no known ending' # before anything is read
expect 0 train scene/blender -o run --iterations 5 --init-points 100 -q
expect 2 export run other.ply --view-independent
says 'run: found Gaussians, expected anchors (train --model scaffold); convert writes such a model'
# Compared with another run, as measured by eval.
expect 0 compare anchors run --scene scene/blender --json
tr -d ' \n' <out | grep -q "^\[{\"run\":\"anchors\",\"max_gaussians\":[0-9]*,\"final_gaussians\":$gaussians,.*\"psnr\":${psnr%??}[0-9]*,.*\"run\":\"run\"" ||
    fail "compare says $(cat out), eval $psnr dB of $gaussians"
expect 0 compare anchors run --html both.html
grep -q "^<tr><th scope=row>Gaussians, final<td>$gaussians<td>100 " both.html || fail "the page: $(grep -F 'Gaussians, final' both.html)"
[ ! -e other.ply ] || fail "export left a file"
expect 2 convert anchors anchors.ply; says 'found anchors of Scaffold-GS'
expect 2 train scene/blender -o none --init $anchors; says 'found anchors of Scaffold-GS'
expect 1 train scene/blender -o none --model scaffold --strategy mcmc; says 'found scaffold with another strategy'
# Options of another model or strategy, and what an audit may turn on, are refused before work begins.
expect 1 train scene/blender -o none --anchor-offsets 5; says '--anchor-offsets: found without effect, expected --model scaffold'
expect 1 train scene/blender -o none --model scaffold --opacity-lr 0.1; says '--opacity-lr: found without effect'
for option in sh-degree percent-dense position-lr-init; do
    expect 1 train scene/blender -o none --model scaffold --$option 1; says "--$option: found without effect, expected another model than scaffold"
done
expect 1 train scene/blender -o none --exposure-lr-init 0.1; says '--exposure-lr-init: found without effect, expected --exposure'
expect 1 train scene/blender -o none --at-limit stop; says '--at-limit: found without effect, expected --max-gaussians'
expect 1 train scene/blender -o none --at-limit universal --max-memory 1G; says '--at-limit: found universal, expected --max-gaussians with it'
expect 1 train scene/blender -o none --strategy mcmc --cap-max 900 --percent-dense 0.1; says '--percent-dense: found without effect'
expect 1 train scene/blender -o none --mip-kernel 0.2; says 'expected --model mip'
expect 1 train scene/blender -o none --cap-max 90; says 'expected --strategy mcmc'
expect 1 train scene/blender -o none --strategy mcmc --cap-max 90 --absgrad; says 'expected another strategy'
expect 1 train scene/blender -o none --strategy mcmc --cap-max 90 --audit defend --rho 0.1; says '--rho: found'
expect 1 train scene/blender -o none --model scaffold --filter-unit gaussian --audit defend; says '--rho: found'
[ ! -e none ] || fail "a refused run left something"
mv anchors/point_cloud/iteration_$end/networks.safetensors .
expect 2 eval anchors; says "point_cloud.ply: found anchors of Scaffold-GS alone"; says networks.safetensors
mv networks.safetensors anchors/point_cloud/iteration_$end
expect 0 train scene/blender -o looks --eval $short --init-points 300 --model scaffold --voxel-size 0.02 \
    --photo-appearance
expect 0 eval looks --json
psnr=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
grep -q "\"psnr\": ${psnr%??}" looks/summary.json || fail "eval says $psnr, summary.json $(grep psnr looks/summary.json)"
expect 0 eval looks --json --appearance mean
grep -q "\"psnr\": ${psnr%??}" out || fail "the default is not the mean of the appearances: $(cat out)"
expect 0 eval looks --json --appearance index
grep -q "\"psnr\": ${psnr%??}" out && fail "the mean of the appearances measures like the first two: $(cat out)"
expect 0 eval looks --json --split train
own=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
expect 0 eval looks --json --split train --appearance index
grep -q "\"psnr\": $own" out || fail "training views do not have their own appearances: $own, $(cat out)"
for photo in 0 1 index; do
    expect 0 render looks -o looks-$photo --appearance $photo -q
done
cmp looks-0/r_0.png looks-index/r_0.png || fail "the first view does not have the appearance of photo 0"
cmp looks-1/r_1.png looks-index/r_1.png || fail "the second view does not have the appearance of photo 1"
cmp -s looks-0/r_0.png looks-1/r_0.png && fail "photos 0 and 1 have the same appearance"
expect 0 export looks looks.ply --view-independent
for look in index zero 1; do
    expect 0 export looks look-$look.ply --view-independent --appearance $look -q
    cmp -s looks.ply look-$look.ply && [ $look != index ] && fail "--appearance $look exports what the views' own do"
done
cmp looks.ply look-index.ply || fail "the training views do not have their own appearances"
expect 1 export looks none.ply --view-independent --appearance 6; says '--appearance: found 6, expected a photo from 0 to 5'
expect 1 eval anchors --appearance 0; says '--appearance: found 0, expected none'
expect 0 eval looks --scene scene/colmap --split train --test-every 2; says 'the model has the appearances of 6 photos'
# Training views have their own appearances also in a run that held nothing out, and so have test
# views whose left halves were trained on.
expect 0 train scene/colmap -o all $short --model scaffold --voxel-size 0.02 --photo-appearance
expect 0 eval all --split train --per-view --json; cp out own
expect 0 eval all --split train --per-view --json --appearance 1
second() { tr -d ' \n' <"$1" | grep -o '"name":"view_0001","psnr":[0-9.]*'; }
[ -n "$(second out)" ] && [ "$(second out)" = "$(second own)" ] || fail "view 1: $(second own), with appearance 1 $(second out)"
expect 0 train scene/colmap -o halves --eval --test-halves $short --model scaffold --voxel-size 0.02 --photo-appearance
expect 0 eval halves --json
psnr=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
grep -q "\"psnr\": ${psnr%??}" halves/summary.json || fail "eval says $psnr, summary.json $(grep psnr halves/summary.json)"
expect 0 eval halves --json --appearance mean
grep -q "\"psnr\": ${psnr%??}" out && fail "test views have the mean of the appearances, not their own"
# An appearance that is asked for is the one of renders, also where exposures are applied.
mean=$(sed 's/.*{"psnr": \([0-9.]*\).*/\1/' out)
python3 - scene/colmap/images halves/exposure.json <<'EOF' || fail "cannot write maps"
import json, os, sys
one = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
json.dump({name.split(".")[0]: one for name in os.listdir(sys.argv[1])}, open(sys.argv[2], "w"))
EOF
expect 0 eval halves --json --appearance mean --exposure
grep -q "{\"psnr\": $mean" out || fail "--exposure changes the appearance: $(cat out), expected $mean"
# A decoy of anchors grows, and the poison stays within the bound.
options="--model scaffold --anchors-from-iter 40 --voxel-size 0.02 --densification-interval 10 --densify-grad-threshold 1e-6
    --iterations 20 --inner 3 --proxy-iterations 60 --save png --quiet"
expect 0 attack scene/colmap -o poisoned $options --keep-decoy
grep -q '"linf_max": 16.0' poisoned/poison.json && grep -q '"model": "scaffold"' poisoned/poison.json || fail "poison.json"
proxy=$(sed -n 's/.*"proxy_gaussians": \([0-9]*\).*/\1/p' poisoned/poison.json)
decoy=$(sed -n 's/.*"decoy_max_gaussians": \([0-9]*\).*/\1/p' poisoned/poison.json)
[ "$decoy" -gt $((proxy * 5 / 4)) ] || fail "the decoy has $decoy Gaussians, the proxy $proxy"
expect 0 info poisoned/attack/decoy.ply --json; grep -q "\"anchors\": ${decoy%0}[,}]" out || fail "decoy: $(cat out)"
expect 0 train poisoned -o victim $(once $short --iterations 20 --model scaffold --voxel-size 0.02)
expect 2 attack scene/colmap -o plain --proxy poisoned/attack/proxy -q; says 'point_cloud.ply: header: found anchors of Scaffold-GS'
expect 2 attack scene/colmap -o other $options --proxy run; says 'point_cloud.ply: found Gaussians, expected anchors'
expect 2 attack scene/colmap -o other $options --proxy poisoned/attack/proxy --feature-bank; says 'point_cloud.ply: found networks with no optional part, expected the feature bank'
expect 1 attack scene/colmap -o other $options --scale-floor 0.1; says '--scale-floor: found 0.1'
expect 0 train scene/blender -o anchors --force --iterations 20 --init-points 200 -q
[ "$(find anchors -name '*.safetensors')" = "" ] || fail "--force left networks"
