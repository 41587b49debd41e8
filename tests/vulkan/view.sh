# SPDX-License-Identifier: Apache-2.0
# The live view of a run and of a training, with SG_TEST_ENGINE: short forms of tests/cli/view.sh and train_view.sh, which
# take too long on a driver for the CPU.
. "$(dirname "$0")/../cli/common.sh"
command -v python3 >/dev/null || { echo "skipped: no Python"; exit 77; }
shown=
trap '[ -z "$shown" ] || kill "$shown" 2>/dev/null' EXIT
size="--width 64 --height 48" # depth and opacity need some pixels
small_scene

begin() { # ARGUMENTS: the tool in the background, the address of its page in $address
    rm -f address
    "$tool" "$@" >address 2>view.err &
    shown=$!
    until [ -s address ] || grep -q 'no HTTP server' view.err; do sleep 0.1; done
    [ -s address ] || { echo "skipped: no libmicrohttpd"; exit 77; }
    address=$(cat address)
}

# A run: its pictures are those of `render`.
expect 0 train scene/blender -o run --iterations 30 --init-points 3000 -q --eval
mkdir renders
expect 0 render run -o renders/train --split train -q
expect 0 render run -o renders/test --split test -q
begin view run
python3 "$source_dir/tests/cli/view_requests.py" "$address" "$shown" renders scene/blender || fail "requests"
interrupt "$shown" || fail "the view ends with $?: $(cat view.err)"

# A training draws on the device that it learns on: looking on, and a stop, change no byte.
options="scene/colmap $(once $short --eval --defense spectral --rho 0.1 --rho-least 0)"
# shellcheck disable=SC2086
begin train $options -o seen --view
python3 "$source_dir/tests/cli/view_training.py" "$address" look || fail "looking on"
wait "$shown" || fail "the training ends with $?: $(cat view.err)"
# shellcheck disable=SC2086
begin train $options -o stopped --view
python3 "$source_dir/tests/cli/view_training.py" "$address" stop || fail "stopping"
wait "$shown"
[ $? -eq 130 ] || fail "a stopped training does not end with 130"
shown=
expect 0 train --resume stopped -q
for file in point_cloud/iteration_$end/point_cloud.ply checkpoint.bin; do
    cmp seen/$file stopped/$file || fail "$file is another one after a stop"
done
