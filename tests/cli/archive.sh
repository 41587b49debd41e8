# SPDX-License-Identifier: Apache-2.0
# Every command takes a zip archive of a scene for the scene, with the same results.
. "$(dirname "$0")/common.sh"
small_scene
python3 -c 'import zipfile' 2>/dev/null || { echo "python3 is missing"; exit 77; }
pack() { (cd "$1" && python3 -m zipfile -c "$OLDPWD/$2" "$3"); }
pack scene blender.zip blender
(cd scene/colmap && python3 -m zipfile -c ../../colmap.zip ./*)
if "$tool" audit blender.zip 2>&1 | grep -q 'no zlib\|lacks'; then echo "built without zlib"; exit 77; fi

for kind in blender colmap; do
    for scene in scene/$kind $kind.zip; do
        expect 0 train $scene -o run-"$(basename $scene)" $short --eval --init-points 200
    done
    for file in checkpoint.bin point_cloud/iteration_$end/point_cloud.ply cameras.json input.ply; do
        [ ! -e run-$kind/$file ] || cmp run-$kind/$file run-$kind.zip/$file || fail "$kind: $file differs"
    done
    expect 0 eval run-$kind.zip --json -q; mv out archived
    expect 0 eval run-$kind --json -q
    [ "$(sed 's/"fps.*//' out)" = "$(sed 's/"fps.*//' archived)" ] || fail "$kind: PSNR differs"
    expect 0 smooth $kind.zip -o smooth-$kind-zip
    expect 0 smooth scene/$kind -o smooth-$kind
    diff -r -x .splatguard smooth-$kind smooth-$kind-zip >differs || fail "$kind: copies differ: $(cat differs)"
done

# A run that was interrupted knows its archive.
options=$(once $short --eval --init-points 200 --iterations 6000 --save-every 0 --eval-every 0)
"$tool" train blender.zip -o cut $options 2>err &
pid=$!
wait_for cut/log.jsonl
interrupt $pid
reached=$(sed -n 's/.*"iterations": \([0-9]*\).*/\1/p' cut/summary.json)
sed -i "s/\"iterations\": 6000/\"iterations\": $((reached + 40))/" cut/config.json
expect 0 train --resume cut --quiet
expect 0 train scene/blender -o whole $(once $options --iterations $((reached + 40)))
cmp cut/checkpoint.bin whole/checkpoint.bin || fail "the checkpoints differ after resuming at $reached"

"$tool" view blender.zip --scene scene/blender 2>err && fail "a view of two scenes"
grep -q 'found two scenes\|no HTTP server' err || fail "view says $(cat err)"

# A plan has a scene's archive in place of a folder, and another one if it changes.
if [ -n "$("$tool" bench --help 2>/dev/null)" ]; then
    echo '{"scenes": {"s": {"path": "blender.zip"}}, "photos": {"clean": []}, "defenses": {"off": []}, "models": {"default": []},
        "runs": [{"scenes": ["s"], "photos": ["clean"], "defenses": ["off"], "models": ["default"], "seeds": [1]}]}' >archived.json
    expect 0 bench archived.json --list; cp out jobs
    grep -q train jobs || fail "the jobs of an archive are $(cat jobs)"
    cp blender.zip kept.zip && printf x >>blender.zip
    expect 0 bench archived.json --list; cmp -s out jobs && fail "a changed archive is the same scene"
    mv kept.zip blender.zip
fi

# Archives that are something else than what they are taken for.
cp blender.zip blender.dat
expect 2 info blender.dat; says "the name of a scene's archive ends in .zip"
(cd scene/colmap/images && python3 -m zipfile -c ../../../photos.zip ./*)
expect 2 train photos.zip -o photos; says 'photos.zip: found no scene, looked for '; says 'only an audit needs none'
expect 0 audit photos.zip; cp out of_archive; expect 0 audit scene/colmap/images; cmp out of_archive || fail "another verdict from an archive"
mkdir -p deep/sub && cp scene/colmap/images/* deep && cp scene/colmap/images/* deep/sub && pack . deep.zip deep
expect 0 audit deep.zip; says 'deep.zip: 1 of its entries is not looked at; the first is sub, a folder'

head -c 3000 blender.zip >torn.zip
expect 2 train torn.zip -o torn --quiet; says 'torn.zip: zip: found no directory at its end'
[ ! -e torn ] || fail "a run of a torn archive"
