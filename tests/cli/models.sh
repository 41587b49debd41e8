# SPDX-License-Identifier: Apache-2.0
# Models that cannot be used, and limits on memory for every command that reads files of others.
. "$(dirname "$0")/common.sh"
small_scene

# ply N VALUES: an ASCII model whose N rows are the values.
ply() {
    printf 'ply\nformat ascii 1.0\nelement vertex %d\n' "$1"
    for name in x y z opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2; do
        echo "property float $name"
    done
    echo end_header
    shift
    printf '%s\n' "$@"
}
good='0 0 0 0 -3 -3 -3 1 0 0 0 0 0 0'
ply 1 "$good" >good.ply
ply 3 "$good" '0 0 0 0 -3 inf -3 1 0 0 0 0 0 0' 'nan 0 0 0 -3 -3 -3 1 0 0 0 0 0 0' >broken.ply
ply 1 'nan nan nan nan nan nan nan nan nan nan nan nan nan nan' >nothing.ply
expect 0 info good.ply
expect 2 info broken.ply; says 'broken.ply: Gaussian 1: found scale_1 inf, expected a finite number'
grep -q '2 Gaussians hold a NaN or an infinity, the first is Gaussian 1 (scale_1)' out || fail "info says $(cat out)"
expect 2 info broken.ply --json
grep -q '"first_nonfinite": {"gaussian": 1, "property": "scale_1"}' out || fail "info --json says $(cat out)"
expect 2 info nothing.ply
grep -q 'no position is finite' out || fail "info says $(cat out)"
grep -q 'inf \.\.' out && fail "info prints bounds that are none: $(cat out)"
expect 2 info nothing.ply --json
grep -q '"min": \[null, null, null\]' out || fail "info --json says $(cat out)"
# Of a scene: what train would load.
expect 0 info scene/colmap --downscale 2
for line in 'layout     colmap' 'views      6 to train on, 1 for tests' 'photos     7 of ' ', used at ' 'points     300, x -1' 'extent 4.67'; do
    grep -qF -- "$line" out || fail "info does not say \"$line\": $(cat out)"
done
mkdir -p masked && cp -r scene/colmap/. masked && mkdir masked/masks
cp "$(find masked/images -type f | sort | head -n 1)" masked/masks
rm "$(find masked/images -type f | sort | tail -n 1)"
expect 0 info masked --json; says 'are skipped'
grep -q '"format": "colmap", "train_views": 5, "test_views": 1' out || fail "info --json says $(cat out)"
grep -q '"photos": 6}\], .*"masked": 1, "undistorted": 0, "lossy": 0, "points": 300' out || fail "info --json says $(cat out)"
# A photo of which nothing is used is not measured.
echo iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg== | base64 -d >masked/masks/view_0002.png
expect 0 eval good.ply --scene masked --split train --per-view -q
grep -q '^view_0002 .*not measured: its mask hides all of it' out || fail "of a masked photo eval says $(cat out)"
rm masked/masks/view_0002.png
truncate -s 100 "$(find masked/images -type f | sort | tail -n 1)"
expect 0 info masked; says 'warning: refused with --eval: '; says 'end of stream; with test views (eval) it is not skipped'
grep -q 'views      5 to train on, 0 for tests' out || fail "info does not say what training takes: $(cat out)"
expect 2 info masked --strict; says 'found 6 of 7 photos'
mkdir empty && expect 2 info empty; says 'empty: found no scene'
for command in "eval broken.ply --scene scene/blender" "render broken.ply --scene scene/blender -o images" \
    "train scene/blender -o run $short --init broken.ply" \
    "attack scene/blender -o poisoned --proxy broken.ply --iterations 2 --inner 2 -q"; do
    expect 2 $command; says 'broken.ply: Gaussian 1: found scale_1 inf'
done
[ ! -e images ] && [ ! -e run ] || fail "something was made of a broken model"

# A scene of one view can be looked at and measured, though not trained on with --eval.
mkdir -p one/sparse/0 one/images
cp scene/colmap/images/view_0001.png one/images/a.png
echo '1 SIMPLE_PINHOLE 64 48 60 32 24' >one/sparse/0/cameras.txt
printf '1 1 0 0 0 0 0 3 1 a.png\n\n' >one/sparse/0/images.txt
expect 0 render good.ply --scene one -o view -q; [ -s view/a.png ] || fail "no image of the only view"
grep -q 'train' err && fail "render warns about training: $(cat err)"
expect 0 eval good.ply --scene one -q
expect 2 train one -o run $short --eval; says 'no view to train on'

# The same limit, and the same exit status, everywhere.
awk 'BEGIN { print "ply\nformat binary_little_endian 1.0\nelement vertex 1000000" }' >large.ply
for name in x y z opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2; do
    echo "property float $name"
done >>large.ply
echo end_header >>large.ply
truncate -s $(($(wc -c <large.ply) + 56000000)) large.ply 2>/dev/null || exit 0
expect 0 info large.ply
expect 3 info large.ply --max-memory 80M; says 'large.ply: memory: found 1000000 Gaussians of 56 bytes'; says '--max-memory'
expect 0 train scene/blender -o run $short --init-points 300
big="--resolution 6000 --max-memory 100M"
expect 3 eval large.ply --scene scene/blender --max-memory 80M; says 'large.ply'
expect 3 render large.ply --scene scene/blender -o images --max-memory 80M; says 'large.ply'
expect 3 compare run --scene scene/blender $big
expect 3 audit scene/blender $big
expect 3 render run -o images $big
[ ! -e images ] || fail "images without memory for them"
printf '\211\120\116\107\015\012\032\012\000\000\000\015\111\110\104\122\000\000\076\200\000\000\076\200\010\002\000\000\000\316\034\110\211\000\000\000\011\111\104\101\124\170\234\143\000\000\000\001\000\001\136\377\175\371' >large.png # its header tells of 16000 x 16000 pixels
expect 3 spectrum large.png --max-memory 100M; says '--max-memory'
expect 0 spectrum scene/blender/train/r_0.png --max-memory 100M
