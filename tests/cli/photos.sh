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
says 'warning: my photos: 2 of its entries are not looked at; the first is link.png, a link out of the folder'
expect 2 audit 'my photos' --strict; says 'my photos/link.png: found a link out of the folder, expected photos alone'
expect 0 audit 'my photos' --follow-links --json -q; says 'my photos: 1 of its entries is not looked at; the first is pipe.jpg'
[ "$(scores | wc -l)" -gt "$(wc -l <of_scene)" ] || fail "a link was not followed"
tr -d ' \n' <out | grep -q '"name":"[^"]*\.png"' || fail "photos have other names than their files: $(cat out)"
expect 0 audit 'my photos' --report page.html -q --max-memory 64M --threads 2
grep -q '<img' page.html || fail "a page without photos"
grep -q '<h1>my photos' page.html || fail "the page does not name the folder: $(grep '<h1>' page.html)"
expect 0 audit 'my photos'; says "my photos: $(find 'my photos' -type f -name '*.png' | wc -l) photos without cameras"
grep -q 'memory scene\|extent' err && fail "photos are called a scene"
mkdir one && cp "$(find 'my photos' -type f -name '*.png' | head -n 1)" one/a.png
expect 0 audit one; says 'one: 1 photo without'; grep -q 'training cameras' err && fail "a warning about cameras that are none"
expect 2 audit one/a.png; says 'one/a.png: found no folder or zip archive'
expect 2 audit "$PWD/none such"; says 'none such: found no folder or zip archive'

# They have the size that training would give them.
expect 0 audit scene/blender --downscale 2 --json -q && scores >half_scene
expect 0 audit 'my photos' --downscale 2 --json -q && scores >half_photos
cmp half_scene half_photos || fail "photos alone have another size than those of a scene"
cmp -s half_scene of_scene && fail "--downscale has no effect"

# Photos may hide in sub-folders. A link that stays inside is one more photo.
mkdir one/sub one/.hidden && ln -s a.png one/b.png
expect 0 audit one; says 'warning: one: 1 of its entries is not looked at; the first is sub, a folder'; says 'one: 2 photos without'
expect 2 audit one --strict; says 'one/sub: found a folder'; [ ! -s out ] || fail "a verdict of a part"
rmdir one/sub; expect 0 audit one --strict
# A link that leads out is named, whatever it is called and leads to.
ln -s "$PWD/scene" one/more; ln -s /etc/passwd one/p.dat
expect 0 audit one; says 'warning: one: 2 of its entries are not looked at; the first is more, a link out of the folder'
expect 2 audit one --strict; says 'one/more: found a link out of the folder'
rm one/more one/p.dat

# Training goes by what a file begins with, not by its ending: so does the audit.
cp one/a.png one/photo.dat && cp one/a.png one/no_ending && echo text >one/notes && echo text >one/notes.dat
expect 0 audit one; says 'one: 4 photos without'; grep -q warning err && grep -q notes err && fail "notes are photos: $(cat err)"
cp one/a.png one/.photo; expect 0 audit one; says 'warning: one: 1 of its entries is not looked at; the first is .photo, a hidden photo'
rm one/photo.dat one/no_ending one/notes* one/.photo

# What is no photo is left out, as it is in scenes.
rm 'my photos/link.png' 'my photos/pipe.jpg'
: >'my photos/zz.JPG'
expect 0 audit 'my photos' --json && scores >of_photos
says "warning: 1 of $(find 'my photos' -type f ! -name '*.txt' | grep -c 'JPG$\|png$') photos cannot be decoded and are skipped; the first: my photos/zz.JPG"
cmp of_scene of_photos || fail "a photo that is left out changes scores"
cp one/a.png "$(printf 'my photos/x\ny.png')"
expect 0 audit 'my photos'; says 'my photos: 7 photos without'
rm my*/x*
expect 2 audit 'my photos' --strict; says 'my photos/zz.JPG: found an empty file, expected an image'; [ ! -s out ] || fail "a verdict in spite of --strict"
mkdir none && echo 'no photo' >none/a.png
expect 2 audit none; says 'none/a.png'; [ ! -s out ] || fail "a verdict without photos"

# Ctrl-C is seen while photos are read.
expect 0 synth -o wide --width 400 --height 300 --train-views 4 --test-views 1 --points 300 --samples 1
mkdir many && cp wide/blender/train/*_0.png many/first.png
for i in $(seq 2000); do ln many/first.png "many/$i.png"; done
"$tool" audit many >out 2>err &
interrupt $!
[ $? -eq 130 ] || fail "an audit was not interrupted"
grep -q 'without cameras' err && fail "all photos were read first: $(cat err)"
says 'load: cancelled after'
