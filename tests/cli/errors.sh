# SPDX-License-Identifier: Apache-2.0
# Bad input: exit code 2, file and place in the message, nothing half-written.
. "$(dirname "$0")/common.sh"
small_scene

expect 2 info nowhere.ply; says nowhere.ply
printf 'ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n' >huge.ply
"$tool" info huge.ply >out 2>err; code=$?
[ $code = 2 ] || fail "huge.ply: exit code $code"
says huge.ply
expect 0 train scene/blender -o run $short --init-points 300
model=run/point_cloud/iteration_$end/point_cloud.ply
head -c 5000 $model >cut.ply
expect 2 info cut.ply; says cut.ply
expect 2 render cut.ply --scene scene/blender -o images; [ ! -e images ] || fail "images made of a broken model"
expect 2 eval run --scene nowhere; says nowhere
mkdir empty
expect 2 train empty -o r2; says empty
expect 2 eval empty --scene scene/blender; says point_cloud

# A folder that cannot be made, and a disk that is full.
: >file
expect 2 train scene/blender -o file/run $short --init-points 300; says 'file: found something else, expected a folder'
expect 2 train scene/blender -o "new/deep/$(printf '%0300d' 0)" $short; says 'cannot create the folder'
[ ! -e new ] || fail "folders are left on the way to one that cannot be made"
mkdir gone
(cd gone && rmdir ../gone && "$tool" train ../scene/blender -o run $short 2>../err; [ $? = 2 ]) || fail "a folder that is gone is no input"
says 'run: cannot find the folder it is in'
expect 2 train scene/colmap --images "$PWD/scene/colmap/images" -o r2 $short; says "expected the name of a folder below the scene's"
expect 2 train scene/colmap --images images_9 -o r2 $short; says 'scene/colmap/images_9: found no such folder'
expect 2 train scene/blender --masks /tmp -o r2 $short; says 'scene/blender: masks: found "/tmp"'
mv scene/blender/transforms_test.json .
expect 2 eval run --scene scene/blender; says 'scene/blender: found no transforms_test.json'
mv transforms_test.json scene/blender
expect 2 render run -o file/images; says file
[ -w /dev/full ] && { "$tool" info $model >/dev/full 2>err; [ $? = 2 ] || fail "a full device is not noticed"; says 'No space left'; }
# A reader that goes away, as head does, needs no message.
(sleep 0.5; "$tool" help --markdown 2>err; echo $? >status) | true
[ "$(cat status)" = 2 ] && [ ! -s err ] || fail "a closed pipe: exit code $(cat status), $(cat err)"

# Photos are never overwritten, nor other people's folders used.
sum=$(cat scene/blender/*/*.png | cksum)
expect 2 render run --split train -o scene/blender/train; says 'in the scene'
expect 2 train scene/blender -o scene/colmap $short; says 'scene/colmap: found a scene'
[ "$sum" = "$(cat scene/blender/*/*.png | cksum)" ] || fail "the photos changed"

# Pictures that would have one name.
cp -r scene/blender twins
for name in a a_photo; do
    next=$(cd twins && find train -name '*.png' ! -name 'a*' | sort | head -n 1)
    mv "twins/$next" twins/train/$name.png && sed -i "s|${next%.png}|train/$name|" twins/transforms_train.json
done
expect 2 render run --scene twins --split train -o pictures --photo; says 'a_photo: found two pictures of that name'
[ -z "$(find pictures -name '*.png')" ] || fail "some pictures were written"
expect 0 render run --scene twins --split train -o pictures

# What a file says cannot steer the terminal.
printf 'ply\nformat \033[31mred 1.0\n' >colour.ply
expect 2 info colour.ply; says 'format ?[31mred'
grep -q "$(printf '\033')" err && fail "control characters of a file reach the terminal"

first=$(cd scene/blender && find train -name '*.png' | sort | head -n 1)
cp -r scene/blender named && mv "named/$first" "$(printf 'named/train/a\302\233\177.png')"
sed -i "s|${first%.png}|$(printf 'train/a\302\233\177')|" named/transforms_train.json
expect 0 audit named --json --report named.html -q
grep -qF 'a\u009B\u007f' out || fail "no such name: $(cat out)"
LC_ALL=C grep -q "$(printf '\302\233\|\177')" out named.html && fail "control characters of a name reach the terminal or the page"

# Nor can the name of a stranger's folder, as runs/* may have it; what a column has room for are whole characters.
strange=$(printf 'a\303\244456789012345\033[31m\nx')
cp -r run "$strange"
expect 0 info "$strange"; grep -q "$(printf '\033')" out && fail "control characters of a folder reach the terminal"
expect 0 compare run "$strange"; head -n 1 out | LC_ALL=C grep -q '   456789012345?\[31m?x$' || fail "compare prints $(head -n 1 out | cat -v)"
cp -r run '=1+1,"'
expect 0 compare '=1+1,"' "$strange" --csv
sed -n 2p out | grep -q "^\"'=1+1,\"\"\",[0-9]" && ! grep -q "$(printf '\033')" out || fail "compare --csv prints $(cat -v out)"

mkdir hostile; mkfifo hostile/summary.json hostile/config.json hostile/report
expect 2 compare hostile; says 'hostile/summary.json'
expect 2 train --resume hostile; says 'hostile/config.json'
expect 2 audit scene/blender --report hostile/report; says 'hostile/report'; [ -p hostile/report ] || fail "a pipe was replaced"
expect 2 compare nowhere; says 'No such file'
rm hostile/config.json; printf '{"options": {"\\u001b[31m": 1}}' >hostile/config.json
expect 2 train --resume hostile; grep -q "$(printf '\033')" err && fail "control characters of options reach the terminal"

# A disk that fills up on the way, by a limit on the size of files.
small_disk() { # BLOCKS ARGUMENTS...
    (trap '' XFSZ; ulimit -f "$1" || exit 77; shift; "$tool" "$@" >out 2>err)
    code=$?
    [ $code = 77 ] && return
    [ $code = 2 ] || fail "full disk: splatguard $2: exit code $code, expected 2"
    says 'File too large'
    [ -z "$(find . -name '*.tmp*' -o -name '*.png' -path './full*' -o -name '*.ply' -path './full*/point_cloud/*')" ] ||
        fail "a full disk leaves something half-written"
}
small_disk 16 train scene/blender -o full $short --init-points 300
expect 2 info full; says full
# Models that no longer fit leave no folder beside those that did.
small_disk 400 train scene/blender -o later $short --init-points 300 --save-every 30
[ -s later/point_cloud/iteration_30/point_cloud.ply ] || fail "no model of the time before the disk was full"
[ -z "$(find later -type d -empty)" ] || fail "a full disk leaves $(find later -type d -empty)"
# What failed before there was anything to keep works again with the same command, wherever it failed.
for blocks in 1 4 8 12 16; do
    small_disk $blocks train scene/blender -o "tight$blocks" $short --init-points 300
    [ ! -e "tight$blocks" ] || fail "a failed run left $(find "tight$blocks")"
done
expect 0 train scene/blender -o tight1 $short --init-points 300
mkdir mine
small_disk 16 train scene/blender -o mine $short --init-points 300
rmdir mine || fail "a folder of the user's is not as it was"
for method in noise poison-splat; do
    small_disk 4 attack scene/colmap -o "half-$method" --method $method --proxy-iterations 30 --iterations 10 -q
    expect 0 attack scene/colmap -o "half-$method" --method $method --proxy-iterations 30 --iterations 10 -q
done
"$tool" train scene/blender -o killed -q --iterations 100000 --init-points 300 &
pid=$!
wait_for killed/log.jsonl
kill -9 $pid
wait $pid
expect 0 train scene/blender -o killed $short --init-points 300
[ "$(ls killed/point_cloud)" = iteration_$end ] || fail "the run after a killed one: $(ls killed/point_cloud)"
expect 2 train scene/blender -o killed $short --init-points 300; says 'found an earlier run'
rm killed/checkpoint.bin
expect 2 train scene/blender -o killed $short --init-points 300; says 'found an earlier run'
small_disk 1 render run --scene scene/blender -o full_pictures -q
small_scene_of="$size --train-views 4 --test-views 2 --points 300 --samples 1"
small_disk 1 synth -o full_scene $small_scene_of
[ ! -e full_scene ] || fail "a failed scene left $(find full_scene)"
expect 0 synth -o full_scene $small_scene_of

# What was found is shown, whatever it is.
printf '\377\330\377\340 a photo' >photo.ply
expect 2 info photo.ply; says 'line 1: found "???? a photo", expected "ply"'
: >empty.ply
expect 2 info empty.ply; says 'found "", expected "ply"'
for value in '"wide":the string "wide"' '[1, 2]:an array of 2' '{}:an object' 'true:true'; do
    mkdir -p lens && printf '{"fl_x": %s, "frames": [{}]}' "${value%%:*}" >lens/transforms.json
    expect 2 train lens -o lens_run; says "\"fl_x\": found ${value#*:}, expected a number"
done
printf '{"camera_model": 7, "frames": [{}]}' >lens/transforms.json
expect 2 train lens -o lens_run; says '"camera_model": found the number 7, expected a string'
for value in '3:the number 3' '["r_0.png", 4.5]:the number 4.5'; do
    printf '{"fl_x": 50, "w": 64, "h": 48, "train_filenames": %s, "frames": [{"file_path": "x.png",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}' "${value%%:*}" >lens/transforms.json
    expect 2 train lens -o lens_run --eval; says "found ${value#*:}, expected"
done
cp -r tight1 other
sed -i 's/"seed": 42/"seed": [42]/' other/config.json
expect 2 train --resume other; says 'option "seed": found an array of 1, expected a number'
cp tight1/config.json other/config.json
printf 'a text that is no checkpoint, and long enough to be one if it were: %0600d' 0 >other/checkpoint.bin
expect 2 train --resume other --iterations 200; says 'byte 0: found "a text ", expected "SGCKPT"'
printf 'SGCKPT\0\001%0600d' 0 >other/checkpoint.bin
expect 2 train --resume other --iterations 200; says 'byte 7: found version 1, expected version'
printf 'SGCKPT' >other/checkpoint.bin
expect 2 train --resume other --iterations 200; says 'expected a checkpoint'

# Budget: refused with 3, by name, before anything is written for it.
expect 3 train scene/blender -o r3 $short --init-points 300000 --max-memory 20M; says 'expected at least'
[ ! -e r3 ] || fail "a run folder was made for a training that cannot start"
: >scene/blender/train/r_3.png
expect 2 train scene/blender -o r4 $short --strict; says r_3.png
[ ! -e r4 ] || fail "a run folder was made for a broken scene"

# One photo that cannot be read does not stop the others.
expect 0 train scene/blender -o r4 $short; says '1 of '; says 'r_3.png: found an empty file'
grep -q '"r_3"' r4/cameras.json && fail "a photo that cannot be read was trained on"
expect 0 train --resume r4 --iterations 130 -q
expect 0 attack scene/blender -o poisoned --proxy r4 --iterations 2 --inner 2 -q; says 'r_3.png'
expect 0 smooth scene/blender -o smoothed --smooth gaussian -q; says 'r_3.png'
expect 0 audit scene/blender -q; says 'r_3.png'
for f in scene/blender/train/*.png; do : >$f; done
expect 2 train scene/blender -o r5 $short; says 'train/r_0.png: found an empty file'
[ ! -e r5 ] || fail "a run folder was made for a scene without photos"
