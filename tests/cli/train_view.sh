# SPDX-License-Identifier: Apache-2.0
# train --view: the page pauses, stops and looks on, and the result has the bytes of a training without it.
. "$(dirname "$0")/common.sh"
train=
trap '[ -z "$train" ] || kill "$train" 2>/dev/null' EXIT
small_scene
last=600
[ -z "${SG_TEST_ENGINE-}" ] || last=60
options="scene/colmap --eval --iterations $last --sh-interval 20 --densify-from-iter 10 --densification-interval 20 \
    --opacity-reset-interval $((last / 3)) --densify-until-iter $((last * 5 / 6)) --defense spectral --rho 0.1 --rho-least 0 -q"
expect 1 train scene/blender -o run --port 8000; says '--port'
# shellcheck disable=SC2086
"$tool" train $options -o seen --view >address 2>err &
train=$!
wait_until has_page address
[ -s address ] || { echo "skipped: no libmicrohttpd"; exit 77; }
command -v python3 >/dev/null || { echo "skipped: no Python"; exit 77; }
look() { python3 "$source_dir/tests/cli/view_training.py" address "$@"; }
look look || fail "looking on"
wait $train || fail "the training ends with $?"

# shellcheck disable=SC2086
expect 0 train $options -o plain
for file in point_cloud/iteration_$last/point_cloud.ply checkpoint.bin; do
    cmp plain/$file seen/$file || fail "$file is another one with the view"
done

# Of anchors, which have no scores.
rm address looker
anchors="scene/blender $(once $short --iterations $((last * 3 / 2)) --init-points 200 --model scaffold --anchors-from-iter 40 --voxel-size 0.02)"
# shellcheck disable=SC2086
look look --anchors & # first: the training takes a second
looker=$!
wait_for looker
"$tool" train $anchors -o anchors-seen --view >address 2>err &
train=$!
wait $looker || fail "looking on anchors"
wait $train || fail "the training of anchors ends with $?"
# shellcheck disable=SC2086
expect 0 train $anchors -o anchors-plain
cmp anchors-plain/checkpoint.bin anchors-seen/checkpoint.bin || fail "another checkpoint of anchors with the view"

# Stopped by the page, with everything saved.
rm address looker
# shellcheck disable=SC2086
look stop &
looker=$!
wait_for looker
"$tool" train $options -o stopped --view >address 2>err &
train=$!
wait $looker || fail "stopping"
wait $train
[ $? -eq 130 ] || fail "a stopped training does not end with 130"
says 'train --resume stopped'
expect 0 train --resume stopped -q
for file in point_cloud/iteration_$last/point_cloud.ply checkpoint.bin; do
    cmp plain/$file stopped/$file || fail "$file is another one after a stop"
done
