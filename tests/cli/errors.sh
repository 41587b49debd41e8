# SPDX-License-Identifier: Apache-2.0
# Bad input: exit code 2 or 3, file and place in the message, nothing half-written.
. "$(dirname "$0")/common.sh"
small_scene

expect 2 info nowhere.ply; says nowhere.ply
printf 'ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n' >huge.ply
"$tool" info huge.ply >out 2>err; code=$?
[ $code = 2 ] || [ $code = 3 ] || fail "huge.ply: exit code $code"
says huge.ply
expect 0 train scene/blender -o run $short --init-points 300
model=run/point_cloud/iteration_120/point_cloud.ply
head -c 5000 $model >cut.ply
expect 2 info cut.ply; says cut.ply
expect 2 render cut.ply --scene scene/blender -o images; [ ! -e images ] || fail "images made of a broken model"
expect 2 eval run --scene nowhere; says nowhere
mkdir empty
expect 2 train empty -o r2; says empty
expect 2 eval empty --scene scene/blender; says point_cloud

# A folder that cannot be made, and a disk that is full.
: >file
expect 2 train scene/blender -o file/run $short --init-points 300; says file
expect 2 render run -o file/images; says file
[ -w /dev/full ] && { "$tool" info $model >/dev/full 2>err; [ $? = 2 ] || fail "a full device is not noticed"; }

# Budget: refused with 3, by name, before anything is written for it.
expect 3 train scene/blender -o r3 $short --init-points 300000 --max-memory 20M; says 'limit 20971520'
[ ! -e r3 ] || fail "a run folder was made for a training that cannot start"
: >scene/blender/train/r_3.png
expect 2 train scene/blender -o r4 $short; says r_3.png
[ ! -e r4 ] || fail "a run folder was made for a broken scene"
