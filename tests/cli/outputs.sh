# SPDX-License-Identifier: Apache-2.0
# No output replaces an input or a file that the tool did not make: every command with an output, at every kind of place.
. "$(dirname "$0")/common.sh"
expect 0 synth -o scene --width 16 --height 16 --train-views 4 --test-views 1 --points 20 --samples 1
short="--iterations 1 --init-points 20 --quiet --threads 1"
mkdir scene/colmap/masks scene/colmap/images/empty
cp scene/colmap/images/view_0001.png scene/colmap/masks/
expect 0 train scene/colmap -o run $short
expect 0 attack scene/colmap -o poisoned --method noise --quiet
expect 0 render run --split train -o renders -q
expect 0 render run --split train -o floats --float -q
expect 0 audit scene/blender -q --report page.html
model=run/point_cloud/iteration_1/point_cloud.ply
mkdir -p theirs/point_cloud/iteration_1 notes photos held # another trainer's run, loose files
cp $model theirs/point_cloud/iteration_1/; echo '{"options":{}}' >theirs/config.json; echo x >theirs/checkpoint.bin
echo thesis >notes/thesis.txt; cp scene/colmap/images/view_0001.png photos/view_0001.png; cp $model held/model.ply
mkdir linked; ln -s ../scene/colmap/images linked/photos; ln -s ../photos/view_0001.png linked/photo; ln -s ../notes linked/notes
ln -s nowhere linked/dangling
cp -r scene/colmap forged; cp run/config.json forged # a scene that says it is a run
mkdir half; ln -s ../notes half/attack; mkdir notes/proxy; echo mine >notes/proxy/config.json

# All files and links with their content, times aside.
snapshot() { find . -name before -o -name after -o -name out -o -name err -o -type l -print -exec readlink {} \; -o -type d -print -o -type f -exec cksum {} + | sort; }

refused() { # ARGUMENTS...
    "$tool" "$@" >out 2>err
    got=$?
    [ $got = 1 ] || [ $got = 2 ] || fail "splatguard $*: exit code $got, expected a refusal"
}

# unchanged WHERE: not a byte, file or folder is other than before.
unchanged() { snapshot >after; cmp -s before after || fail "$1: changed $(diff before after)"; }

snapshot >before
for place in scene/colmap scene/colmap/images scene/colmap/images/view_0001.png scene/colmap/images/empty scene/colmap/images/new/run \
    scene/colmap/masks scene/colmap/masks/view_0001.png scene/colmap/sparse/0 scene/colmap/sparse/0/cameras.bin \
    scene/blender/transforms_train.json scene/blender/train/new.png scene . .. / /etc/passwd $model run/checkpoint.bin \
    run/point_cloud theirs theirs/point_cloud/iteration_1 theirs/checkpoint.bin notes notes/thesis.txt photos \
    photos/view_0001.png held held/model.ply linked linked/photos linked/photo linked/notes linked/dangling \
    poisoned/images poisoned/masks/new half forged; do
    refused train scene/colmap -o $place $short
    refused train scene/colmap -o $place $short --force
    refused attack scene/colmap -o $place --method noise --quiet
    refused attack scene/colmap -o $place --method noise --quiet --force
    refused render run --split train -o $place -q
    refused render $model --scene scene/blender --split train -o $place -q --float --depth
    refused synth -o $place --width 16 --height 16 --train-views 4 --samples 1
    refused audit scene/blender --report $place -q
    refused spectrum scene/colmap/images/view_0001.png -o $place
    unchanged $place
done
for place in run poisoned renders floats; do # made by the tool, but by another command, or not to be replaced
    [ $place = run ] || refused train scene/colmap -o $place $short --force
    [ $place = poisoned ] || refused attack scene/colmap -o $place --method noise --quiet --force
    [ $place = renders ] || [ $place = floats ] || refused render run --split train -o $place -q
    refused train scene/colmap -o $place $short
    refused attack scene/colmap -o $place --method noise --quiet
    refused synth -o $place --width 16 --height 16 --train-views 4 --samples 1
    refused audit scene/blender --report $place -q
    refused spectrum scene/colmap/images/view_0001.png -o $place
    unchanged $place
done
# What is read lies in what would be replaced.
refused train scene/colmap -o run --force $short --init $model; says 'around the input'
refused attack poisoned -o poisoned --force --method noise --quiet; says 'around the input'
refused train scene/blender -o nowhere/../scene/blender/run $short; says 'after a folder that does not exist'
[ ! -e nowhere ] || fail "an output that was refused has made a folder on its way"
refused attack scene/colmap -o poisoned --force --quiet --proxy poisoned
refused spectrum renders/view_0001.png -o renders/view_0001.png; says 'one of the images'
unchanged inputs

# A link in a stranger's run leads no output to another folder; nor does a mark that is something else.
expect 0 train scene/colmap -o strange $short
mkdir models; mv strange/point_cloud/iteration_1 models; rmdir strange/point_cloud; ln -s ../models strange/point_cloud
mkdir marked hard; ln -s ../notes/thesis.txt marked/.splatguard; ln notes/thesis.txt hard/.splatguard
mkdir other; echo mine >other/.splatguard
snapshot >before
refused train --resume strange --iterations 2 -q; says 'found a link'
refused train scene/colmap -o strange --force $short; says 'found a link'
refused train scene/colmap -o marked $short; says marked/.splatguard
refused train scene/colmap -o hard $short; says hard/.splatguard
refused train scene/colmap -o other $short; says other/.splatguard
unchanged links
# Nor is another file read in place of the run's.
reads() { expect 2 "$@"; says 'found a link that leads out of foreign'; }
cp -r run foreign
model=$(cd foreign && ls point_cloud/*/point_cloud.ply)
for file in config.json checkpoint.bin log.jsonl "$model"; do
    mv "foreign/$file" held/file; ln -s "$PWD/held/file" "foreign/$file"
    case $file in
    *.ply) reads info foreign; reads eval foreign --scene scene/colmap ;;
    *) reads train --resume foreign --iterations 200 -q ;;
    esac
    rm "foreign/$file"; mv held/file "foreign/$file"
done
mv foreign/summary.json held/summary; ln -s "$PWD/held/summary" foreign/summary.json
reads compare foreign run
rm -r foreign held/summary

ln -s ../notes poisoned/attack/proxy
snapshot >before
refused attack scene/colmap -o poisoned --force --method noise -q; says 'found a link'
unchanged poisoned
rm poisoned/attack/proxy

# What worked still works: the tool's own outputs are replaced, added to and continued; the inputs stay.
find scene notes photos held theirs models -type f -exec cksum {} + | sort >before
expect 0 train scene/colmap -o run --force $short
expect 0 train --resume run --iterations 2 -q
expect 0 train scene/colmap -o linked/run $short; ln -s linked/run alias
expect 0 train scene/colmap -o alias --force $short
rm run/.splatguard; expect 0 train scene/colmap -o run --force $short # by an earlier version
expect 0 attack scene/colmap -o poisoned --force --method noise --quiet
expect 0 render run --split train -o renders -q --depth
expect 0 render run --split test -o renders -q
expect 0 render run --split train -o floats -q --float
expect 0 audit scene/blender -q --report page.html
expect 0 spectrum photos/view_0001.png -o spectrum.png
expect 0 spectrum scene/colmap/images/view_0001.png -o spectrum.png
expect 2 spectrum photos/view_0001.png -o page.html/no
long=$(printf '%0250d' 0).html # 255 bytes, the most
expect 0 compare run --html $long -q; [ -s $long ] || fail "no page of a long name"
for wait in 0.02 0.03 0.04 0.05 0.06 0.07 0.08 0.09 0.1 0.11 0.12 0.13 0.15 0.17 0.2 0.25; do # interrupted, it leaves its picture whole or not at all
    timeout -s INT $wait "$tool" spectrum scene/colmap/images/view_000[01].png -q -o cut.png --json >/dev/null 2>&1
    [ -z "$(find . -maxdepth 1 -name '*.tmp*')" ] || fail "interrupted after $wait s, spectrum leaves $(find . -name '*.tmp*')"
done
mkdir void; expect 2 train nowhere -o void/a/b $short; [ -z "$(ls -A void)" ] || fail "a failed run leaves $(find void)"
expect 2 train scene/blender -o void --init nowhere.ply $short; [ -z "$(ls -A void)" ] || fail "a failed run leaves a mark"
# A photo that somebody put among the renders, and one that a scene leads to.
cp photos/view_0001.png renders/view_0001.png
expect 2 render run --split train -o renders -q; says 'expected a new name: only pictures and pages'
cmp photos/view_0001.png renders/view_0001.png || fail "a photo among the renders is gone"
rm renders/view_0001.png; expect 0 render run --split train -o renders -q
cp photos/view_0001.png renders/view_0001_photo.png
expect 2 render run --split train -o renders -q --photo; says 'expected a new name: only pictures and pages'
rm renders/view_0001_photo.png
cp -r scene/colmap led; rm -r led/images led/masks; ln -s ../renders led/images
expect 2 render run --scene led --follow-links --split train -o renders -q; says 'found the photo'
find scene notes photos held theirs models -type f -exec cksum {} + | sort >after
cmp before after || fail "an input changed"

# Engines and variants, as a table and as JSON: one variant is chosen, and a training can be told to take it.
expect 0 info --devices
grep -q '^ref ' out && grep -q '^cpu .*; chosen$' out || fail "info --devices lists no engines"
chosen=$(sed -n 's/^cpu  *\([a-z0-9]*\) .*; chosen$/\1/p' out)
for useless in '--threads 2' '--max-memory 1G'; do
    expect 1 info --devices $useless; says "${useless% *}: found without effect on --devices"
done
expect 0 info --devices --json
grep -q "\"variant\": *\"$chosen\"" out || fail "info --devices --json lacks $chosen"
# Devices: none where no driver is found, which is said, also to who asks for one; else with driver and memory.
(
    export VK_ICD_FILENAMES=/dev/null VK_DRIVER_FILES=/dev/null
    expect 0 info --devices
    grep -q '^vulkan - .*; this machine lacks ' out || fail "info --devices does not say what is missing: $(cat out)"
    grep -q '^vulkan:' out && fail "info --devices finds a device without a driver: $(cat out)"
    expect 0 info --devices --json
    tr -d ' \n' <out | grep -q '"engine":"vulkan","variant":null,[^}]*"available":false,"chosen":false,"missing":"[a-zA-Z]' ||
        fail "info --devices --json does not say what is missing: $(cat out)"
    expect 1 train scene/blender -o none --engine vulkan
    grep -q 'this program lacks a build with Vulkan' err ||
        { says 'this machine lacks a Vulkan driver that starts' && says docs/gpu.md; }
    [ ! -e none ] || fail "a run without an engine has a folder"
) || exit 1
if [ -n "${SG_TEST_ENGINE-}" ]; then
    expect 0 info --devices
    grep -Eq '^vulkan:[0-9]+ .+, driver .+, [0-9.]+ GB, [0-9.]+ free' out || fail "info --devices lists no device: $(cat out)"
    ! grep '^vulkan:.* llvmpipe' out | grep -qv '; on the CPU: used by name only$' || fail "llvmpipe is taken for a GPU"
    expect 0 info --devices --json
    tr -d ' \n' <out | grep -Eq '"number":0,"name":"[^}]+","driver":"[^}]+"available":(true|false)' ||
        fail "info --devices --json lists no device: $(cat out)"
fi
expect 1 info --devices model.ply; says 'expected one of them'
expect 1 info; says 'missing argument'
