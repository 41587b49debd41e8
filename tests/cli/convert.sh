# SPDX-License-Identifier: Apache-2.0
# Converts a model to every format and back; every command that takes a model takes each.
. "$(dirname "$0")/common.sh"
small_scene
fewer=
[ -z "${SG_TEST_ENGINE-}" ] || fewer="--init-points 2000" # a driver for the CPU is slow
expect 0 train scene/blender -o run $short $fewer
model=run/point_cloud/iteration_$end/point_cloud.ply
number() { sed -n "s/.*\"$1\": \([-0-9.]*\).*/\1/p" out; }
expect 0 eval $model --scene scene/blender --json -q
reference=$(number psnr)
if "$tool" convert run try.spz 2>&1 | grep -q 'no zlib'; then formats="splat compressed.ply"; else formats="splat compressed.ply spz sog"; fi
rm -f try.spz
for ending in $formats; do
    expect 0 convert run "m.$ending"
    grep -q "m.$ending: [0-9]* of [0-9]* Gaussians" out || fail "convert says $(cat out)"
    expect 0 info "m.$ending" --json
    expect 0 eval "m.$ending" --scene scene/blender --json -q
    # SH of this short run are small, so that .splat, which has none, is close too.
    awk -v a="$reference" -v b="$(number psnr)" 'BEGIN { exit !(a - b < 0.5 && b - a < 0.5) }' ||
        fail "$ending: PSNR $(number psnr), expected about $reference"
    expect 0 render "m.$ending" --scene scene/blender -o "images.$ending" -q
    expect 0 train scene/blender -o "run.$ending" --init "m.$ending" --iterations 2 --quiet
    expect 0 convert "m.$ending" "back.$ending.ply" -q
done
expect 0 convert run m.glb
[ "$(head -c 4 m.glb)" = glTF ] || fail "m.glb is no glTF"
expect 2 info m.glb; says 'm.glb: found glTF, expected'
# PLY to PLY keeps every bit of the values: the same PSNR, and the same file but for nothing.
expect 0 convert run same.ply -q
cmp same.ply $model || fail "a model that was read and written differs"

# Ctrl-C leaves no file, whole or in part.
if [ "$formats" != "splat compressed.ply" ] && [ -z "${SG_TEST_ENGINE-}" ]; then
    expect 0 train scene/blender -o large --init-points 200000 --iterations 1 --quiet
    "$tool" convert large large.sog >out 2>err &
    interrupt $!
    status=$?
    if [ $status -ne 0 ]; then # 0: it was done before
        [ $status -eq 130 ] && grep -q 'cancelled after\|interrupted' err || fail "interrupted: $status, $(cat err)"
        for file in large.sog*; do [ ! -e "$file" ] || fail "Ctrl-C left $file"; done
    fi
    rm -rf large large.sog
fi

# Selections.
count() { expect 0 info "$1" --json; number gaussians; }
all=$(count $model)
expect 0 convert run half.ply --crop=-9,-9,-9,0,9,9 -q
expect 0 convert run other.ply --crop=0,-9,-9,9,9,9 -q
[ $(($(count half.ply) + $(count other.ply))) -eq "$all" ] || fail "two halves have not $all Gaussians"
expect 0 convert run opaque.ply --min-opacity 0.015 --sh-degree 0 -q
[ "$(count opaque.ply)" -lt "$all" ] || fail "no Gaussian was left out"
expect 0 info opaque.ply --json; [ "$(number sh_degree)" = 0 ] || fail "degree $(number sh_degree)"
expect 2 convert run none.ply --crop 50,50,50,51,51,51; says "$model: found none of $all Gaussians"
[ ! -e none.ply ] || fail "a file of no Gaussian"

# What is wrong is said before anything is read.
expect 1 convert run m.xyz; says 'm.xyz: found no known ending'
expect 1 convert run m.ksplat; says 'only read'
expect 1 convert run m.ply --crop 1,2,3; says '--crop: found "1,2,3", expected six numbers'
expect 1 convert run m.ply --spz-version 3; says "--spz-version: found without effect on the format ply, expected spz"
expect 1 convert run m.ply --crop 1,2,3,0,5,6; says '--crop'
expect 1 convert $model m.ply --iteration 120; says "expected a run's folder"
expect 2 convert missing.ply m.ply; says 'missing.ply'
head -c 40 m.splat >cut.splat
expect 2 convert cut.splat c.ply; says 'cut.splat: found 40 bytes, expected a multiple of 32'
{ head -c 12 m.splat; printf '\0\0\300\177'; tail -c +17 m.splat | head -c 16; } >nan.splat
expect 2 convert nan.splat nan.spz; says 'nan.splat: Gaussian 0: found scale_0 nan'
[ ! -e nan.spz ] || fail "a failed convert left something"
echo precious >kept.splat
expect 2 convert run kept.splat; says 'kept.splat: found an existing file'
[ "$(cat kept.splat)" = precious ] || fail "a file of others was replaced"
expect 2 convert run scene/blender/m.splat; says 'in the scene'
