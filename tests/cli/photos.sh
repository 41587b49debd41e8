# SPDX-License-Identifier: Apache-2.0
# An audit of photos that no scene names.
. "$(dirname "$0")/common.sh"
small_scene
scores() { tr -d ' \n' <out | grep -o '"score":[0-9.e-]*' | sort; }
expect 0 audit scene/blender --json -q && scores >of_scene
mkdir 'my photos' && cp scene/blender/train/*.png 'my photos'
ln -s "$PWD/scene/blender/test/"*_0.png 'my photos/link.png'
mkfifo 'my photos/pipe.jpg'
echo notes >'my photos/notes.txt'
expect 0 audit 'my photos' --json -q && scores >of_photos
cmp of_scene of_photos || fail "scores of photos alone differ from those of their scene"
tr -d ' \n' <out | grep -q '"name":"[^"]*\.png"' || fail "photos have other names than their files: $(cat out)"
expect 0 audit 'my photos' --report page.html -q --max-memory 64M
grep -q '<img' page.html || fail "a page without photos"
grep -q '<h1>my photos' page.html || fail "the page does not name the folder: $(grep '<h1>' page.html)"
expect 0 audit 'my photos'; says "my photos: $(find 'my photos' -type f -name '*.png' | wc -l) photos without cameras"
grep -q 'memory scene\|extent' err && fail "photos are called a scene"
mkdir one && cp "$(find 'my photos' -type f -name '*.png' | head -n 1)" one/a.png
expect 0 audit one; says 'one: 1 photo without'; grep -q 'training cameras' err && fail "a warning about cameras that are none"
expect 2 audit one/a.png; says 'one/a.png: found a photo, expected a scene or a folder of photos'
expect 1 audit 'my photos' --downscale 2; says '--downscale: found without effect on my photos'
echo 'no photo' >'my photos/zz.JPG'
expect 2 audit 'my photos'; says 'my photos/zz.JPG'
: >'my photos/zz.JPG'
expect 2 audit 'my photos'; says 'my photos/zz.JPG: found an empty file, expected an image'
[ ! -s out ] || fail "a verdict in spite of a photo that cannot be read"
