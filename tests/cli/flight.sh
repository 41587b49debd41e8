# SPDX-License-Identifier: Apache-2.0
# Flights through a scene: their frames, what is refused, and Ctrl-C in the middle of one.
. "$(dirname "$0")/common.sh"
small_scene
expect 0 train scene/blender -o run --iterations 1 --init-points 500 --quiet
rm run/checkpoint.bin
expect 0 render run --split train -o around --path ellipse --frames 5
says '5 frames rendered'
[ "$(cd around && echo *.png)" = "frame_0000.png frame_0001.png frame_0002.png frame_0003.png frame_0004.png" ] ||
    fail "frames: $(ls around)"
expect 0 render run --split train -o between --path interpolate --frames 6 --depth -q # six views: a frame a view
expect 0 render run --split train -o views -q
[ "$(find between -name 'frame_000?_depth.png' | wc -l)" -eq 6 ] || fail "depths: $(ls between)"
same=0
for view in views/*.png; do
    cmp -s "$view" between/frame_000$same.png && same=$((same + 1))
done
[ $same -ge 5 ] || fail "$same of 6 frames are the views that the flight leads through"

expect 0 render run --split train -o around --path ellipse --frames 6 -q # again, and longer
expect 2 render run --split train -o around --path ellipse --frames 3
says 'around/frame_0003.png: found a frame of a longer flight'
expect 1 render run -o photos --path ellipse --photo; says '--photo: found --path too'
expect 1 render run -o photos --frames 3; says '--frames: found no --path'
expect 1 render run -o photos --path spiral; says spiral
expect 1 render run -o photos --path ellipse --frames 0; says frames
[ ! -e photos ] || fail "a folder of a refused flight"

# Without the scene and its photos: the cameras that the run has kept.
mv scene moved
expect 2 render run -o kept; says '--cameras run/cameras.json needs no scene'
expect 0 render run --cameras run/cameras.json -o kept -q
for view in views/*.png; do
    cmp "$view" "kept/$(basename "$view")" || fail "a camera of cameras.json draws another picture"
done
expect 0 render run --cameras run/cameras.json -o turned --path ellipse --frames 2 -q
expect 1 render run --cameras run/cameras.json -o none --photo; says '--photo: found --cameras too'
expect 1 render run --cameras run/cameras.json -o none --split test; says '--split: found --cameras too'
expect 1 render run --cameras run/cameras.json -o none --scene moved; says '--scene: found --cameras too'
expect 1 render run --cameras run/cameras.json -o none --masks masks; says '--masks: found --cameras too'
expect 2 render run --cameras run/config.json -o none; says 'run/config.json: found 0 cameras'
expect 2 render run --cameras run/cameras.json -o run; says 'around the input'
[ ! -e none ] || fail "a folder of a refused render"
mv moved scene
# A training and a test photo of one name.
expect 0 train scene/blender -o both --eval --iterations 1 --init-points 500 --quiet
expect 0 render both --cameras both/cameras.json -o all -q
[ "$(find all -name '*.png' | wc -l)" -eq 8 ] || fail "not a picture of each camera: $(ls all)"

# What cannot end well is refused before the photos are read.
refused() { expect 2 "$@"; grep -q 'scene, .* views' err && fail "photos were read in vain: $*"; }
refused render run -o run
refused render run -o run/config.json
refused attack scene/blender -o none --proxy nowhere
refused train scene/blender -o none --init nowhere
refused train --resume run # with no checkpoint
[ ! -e none ] || fail "something was left"

"$tool" render run --split train -o long --path ellipse --frames 10000 -q 2>err &
pid=$!
wait_for long/frame_0001.png
interrupt $pid && fail "a flight was not interrupted"
[ $? -eq 130 ] || fail "interrupted: $(cat err)"
[ -z "$(find long -name '*.tmp*')" ] || fail "Ctrl-C left $(ls long)"
