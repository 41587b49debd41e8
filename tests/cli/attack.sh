# SPDX-License-Identifier: Apache-2.0
# Poisoned scenes: layout, bound, resume, growth, refusals.
. "$(dirname "$0")/common.sh"
small_scene
points=3000 proxy=200 iterations=200 inner=5 interval=20 after=20
[ -z "${SG_TEST_ENGINE-}" ] || points=500 proxy=50 iterations=20 inner=2 interval=10 after=5
options="--proxy-iterations $proxy --iterations $iterations --inner $inner --densification-interval $interval --seed 3 --quiet"

# Blender: PNG within the bound, test photos clean, the scene untouched; it loads like the clean one.
expect 0 train scene/blender -o seed --init-points $points --iterations $proxy -q # attacks train theirs of 100 000
find scene -type f -exec cksum {} + | sort >before
expect 0 attack scene/blender -o poisoned $options --proxy seed --keep-decoy
find scene -type f -exec cksum {} + | sort >after
cmp before after || fail "the scene has changed"
[ -s poisoned/attack/decoy.ply ] || fail "no decoy"
[ ! -e poisoned/attack/checkpoint.bin ] || fail "the checkpoint is left"
grep -q '"linf_max": 16.0' poisoned/poison.json || fail "the bound: $(grep linf_max poisoned/poison.json)"
grep -q '"poisoned_images": 6' poisoned/poison.json && grep -q '"clean_images": 2' poisoned/poison.json || fail "the counts"
expect 0 train poisoned -o victim $(once $short --eval --init-points 500 --iterations 40)
expect 0 train scene/blender -o clean $(once $short --eval --init-points 500 --iterations 40)
cmp victim/cameras.json clean/cameras.json || fail "the cameras differ"

# Golden: the decoy grows as it did, whatever the instruction set. Another engine draws a smaller scene, and the decoy
# grows as with the CPU engine there.
curve_of() { sed -n 's/.*"gaussians":\([0-9]*\).*/\1/p' "$1/attack/log.jsonl" | tr '\n' ' '; }
curve="300 5480 22800 34400 42000" steps=400
if [ -n "${SG_TEST_ENGINE-}" ]; then
    steps=100
    expect 0 attack scene/colmap -o cpu $(once $options --inner 5 --iterations $steps --save png) --engine cpu
    curve=$(curve_of cpu)
fi
expect 0 attack scene/colmap -o golden $(once $options --inner 5 --iterations $steps --save png)
[ -d golden/attack/proxy/point_cloud ] || fail "no proxy"
set -- $(curve_of golden)
[ $# -ge 2 ] && [ "$(($2))" -gt $((2 * $1)) ] || fail "the decoy grows along $*"
for expected in $curve; do
    [ "$1" -ge $((expected * 95 / 100)) ] && [ "$1" -le $((expected * 105 / 100)) ] || fail "the decoy grows along $(curve_of golden), expected $curve"
    shift
done

# The same bytes, also in two parts and with another number of threads.
expect 0 attack scene/blender -o again $options --proxy seed --threads 1
"$tool" attack scene/blender -o cut $(once $options --proxy seed --iterations 20000) --keep-decoy 2>err &
pid=$!
wait_for cut/attack/log.jsonl
interrupt $pid
code=$?
[ $code = 130 ] || fail "interrupted: exit code $code, expected 130"
says 'attack --resume cut'
[ ! -e cut/poison.json ] || fail "an unfinished attack looks finished"
reached=$(sed -n '$s/{"iteration":\([0-9]*\).*/\1/p' cut/attack/log.jsonl)
expect 1 attack --resume cut --epsilon 8; says '--epsilon'
mv scene moved
expect 2 attack --resume cut -q; says 'if it has moved, name its place with -s SCENE'
expect 1 attack moved/blender --resume cut; says '-s SCENE names the place of a scene that has moved'
mv moved scene
sed -i "s/\"iterations\": 20000/\"iterations\": $((reached + after))/" cut/attack/config.json
sed -i '$s/"peak_rss_bytes":[0-9]*/"peak_rss_bytes":123456789012/' cut/attack/log.jsonl # more than the second process has
(cd scene && "$tool" attack --resume ../cut --quiet) || fail "resumed from another folder"
grep -q '"peak_rss_bytes": 123456789012' cut/poison.json || fail "a resumed attack has forgotten its most memory"
[ -s cut/attack/decoy.ply ] || fail "a resumed attack has forgotten --keep-decoy"
cksum cut/train/* cut/attack/log.jsonl >before
expect 0 attack --resume cut --quiet; says 'finished'
cksum cut/train/* cut/attack/log.jsonl | cmp - before || fail "a finished attack was begun anew"
expect 0 attack scene/blender -o whole $(once $options --iterations $((reached + after)) --proxy seed)
for image in poisoned/train/*.png; do
    cmp "$image" "again/train/${image##*/}" || fail "another number of threads, other poisons"
    cmp "cut/train/${image##*/}" "whole/train/${image##*/}" || fail "resumed at $reached, other poisons"
done

# An earlier attack stays until a proxy is trained for the one that replaces it, which continues with the proxy.
expect 0 attack scene/colmap -o early --method noise --quiet
expect 0 info early
echo ply >early.ply
expect 2 attack scene/colmap -o early --force --proxy early.ply --quiet; says 'early.ply'
expect 0 info early
expect 2 attack scene/colmap -o early --force --proxy seed --model scaffold --quiet; says 'seed/point_cloud'
expect 0 info early
replacing=$(once $options --proxy-iterations 20000 --iterations 20)
find early/images early/sparse early/poison.json -type f -exec cksum {} + >before
unchanged() {
    find early/images early/sparse early/poison.json -type f -exec cksum {} + | cmp -s - before || fail "$* took the earlier attack"
    expect 0 info early
}
(trap '' XFSZ; ulimit -f 16; "$tool" attack scene/colmap -o early --force $replacing >out 2>err)
says 'File too large'; unchanged "a proxy that failed"
expect 0 attack --resume early; says 'the attack is finished' # it is the earlier one
grep -q '"method": "noise"' early/attack/config.json || fail "the folder does not say whose it is"
"$tool" attack scene/colmap -o early --force $replacing 2>err &
pid=$!
wait_for early/attack/proxy/log.jsonl
interrupt $pid
[ $? = 130 ] || fail "interrupted in the proxy"
[ -s early/attack/proxy/checkpoint.bin ] || fail "the proxy is not saved"
says 'attack --resume early'
grep -q 'train --resume' err && fail "the proxy's own command continues no attack"
unchanged "an interrupted proxy"
cp -r early taken # which takes another proxy after all
expect 0 attack --resume taken --proxy seed -q
expect 0 attack --resume taken; says 'the attack is finished'
grep -q '"method": "poison-splat"' taken/poison.json || fail "the attack that was replaced is still there"
rm early/attack/proxy/log.jsonl # to see the next one begin
"$tool" attack scene/colmap -o early --force $replacing 2>err &
pid=$!
wait_for early/attack/proxy/log.jsonl
kill -9 $pid 2>/dev/null
wait $pid 2>/dev/null
unchanged "a killed proxy"
rm -r early/attack/proxy # as if it was killed before
sed -i "s/\"proxy-iterations\": 20000/\"proxy-iterations\": $proxy/" early/attack/config.json
expect 0 attack --resume early -q
grep -q '"method": "poison-splat"' early/poison.json || fail "a killed proxy is not continued"
rm early/attack/log.jsonl # to see the next one begin
"$tool" attack scene/colmap -o early --force $(once $options --proxy seed --iterations 20000) 2>err &
pid=$!
wait_for early/attack/log.jsonl
interrupt $pid
expect 2 train early -o none; says 'early: found no scene'

# What cannot be written does not cost the attack.
expect 0 attack scene/blender -o blocked --method noise --quiet
rm blocked/train/r_0.png; mkdir blocked/train/r_0.png
expect 2 attack scene/blender -o blocked $options --force --save-every 0 --proxy seed
says 'r_0.png'; says 'attack --resume blocked'
rmdir blocked/train/r_0.png

# What killed processes left unfinished goes, here and where an attack is replaced.
left() {
    mkdir -p blocked/masks/train
    for file in train/r_0.png test/r_0.png masks/train/r_0.png.png transforms_train.json poison.json attack/config.json attack/decoy.ply; do
        echo x >"blocked/$file.tmp4711"
    done
    echo mine >blocked/train/thesis.tmp1
}
nothing_left() {
    [ "$(find blocked -name '*.tmp*')" = blocked/train/thesis.tmp1 ] || fail "$* leaves $(find blocked -name '*.tmp*')"
}
left
expect 0 attack --resume blocked --quiet
cmp blocked/train/r_0.png poisoned/train/r_0.png || fail "the poison of an attack that could not be written"
nothing_left attack --resume
left
expect 0 attack scene/blender -o blocked --method noise --quiet --force
nothing_left attack --force

# COLMAP: JPEG as published, PNG on request; the cameras name other suffixes.
expect 0 attack scene/colmap -o jpeg $(once $options --epsilon inf --iterations 20)
ls jpeg/images/*.jpg >/dev/null || fail "no JPEG"
[ -s jpeg/sparse/0/points3D.bin ] || fail "no points"
expect 0 train jpeg -o victim $(once $short --force --iterations 20)
expect 0 attack scene/colmap -o png $options --method noise --save png --epsilon 8 --downscale 2 --ratio 0.5 --views train
grep -q '"linf_max": 8.0' png/poison.json || fail "the bound of noise"
grep -q '"poisoned_images": 3' png/poison.json || fail "the ratio: $(grep poisoned_images png/poison.json)"
expect 0 train png -o victim $(once $short --force --iterations 20 --eval)
for threads in 1 5; do
    expect 0 attack scene/colmap -o "png$threads" $options --method noise --save png --epsilon 8 --downscale 2 --ratio 0.5 --views train \
        -j $threads
    grep -v '"threads"\|"peak_rss_bytes"' "png$threads/poison.json" >"of-$threads.json"
done
diff -r png1/images png5/images || fail "images depend on the number of threads that write them"
cmp of-1.json of-5.json || fail "what is said of the images depends on the number of threads"
expect 0 attack scene/colmap -o spared $options --method noise --save png --spare 1
grep -q '"linf_max": 0.0' spared/poison.json || fail "--spare 1 changes photos"
expect 0 attack scene/colmap -o spared $options --method noise --save png --spare 0.5 --force
grep -q '"linf_max": 16.0' spared/poison.json || fail "--spare 0.5 changes nothing"
# Views that are not drawn, and test views, stay as the clean photos of that size, byte for byte.
expect 0 attack scene/colmap -o clean-photos $options --method noise --save png --epsilon 0 --downscale 2 --views train
same=0
for image in clean-photos/images/*; do cmp -s "$image" "png/images/${image##*/}" && same=$((same + 1)); done
[ $same = 4 ] || fail "--ratio 0.5: $same photos of 7 are as they were, expected 4"
# Resized after poisoning: as a victim that resizes the poisoned photos itself. Or compressed.
for layout in golden poisoned; do
    expect 0 attack $layout -o small $options --method noise --epsilon 0 --downscale 2 --save png --force
    expect 0 train small --strict -o victim-small $(once $short --force --iterations 20 --init-points 500)
    expect 0 train $layout --downscale 2 -o victim-large $(once $short --force --iterations 20 --init-points 500)
    cmp victim-small/point_cloud/iteration_20/point_cloud.ply victim-large/point_cloud/iteration_20/point_cloud.ply ||
        fail "$layout: resized before training and by it"
    expect 0 attack $layout -o small $options --method noise --epsilon 0 --save jpg --force
    expect 0 train small -o victim-small $(once $short --force --iterations 20 --init-points 500)
done
# A drift of each photo's own.
expect 0 attack scene/colmap -o drift $options --method drift --save png --epsilon 8
expect 0 attack scene/colmap -o wave $options --method drift --save png --epsilon 8 --wavelength 20.5
grep -q '"linf_max": 8.0' wave/poison.json && grep -q '"wavelength": 20.5' wave/poison.json || fail "a drift"
expect 0 attack scene/colmap -o other $options --method drift --save png --epsilon 8 --threads 1
for image in drift/images/*; do
    cmp "$image" "other/images/${image##*/}" || fail "another number of threads, another drift"
    cmp -s "$image" "wave/images/${image##*/}" && fail "the wavelength has no effect"
done
expect 0 attack scene/colmap -o none $options --method noise --ratio 0
grep -q '"poisoned_images": 0' none/poison.json && [ "$(grep -cE '"(linf_max|psnr_mean|tv_before_mean|tv_after_mean)": null' none/poison.json)" = 4 ] ||
    fail "numbers of no image: $(grep -E 'linf_max|mean' none/poison.json)"
# A bound that follows the texture.
expect 0 attack scene/colmap -o textured $options --method noise --save png --texture 20
grep -q '"texture": 20.0' textured/poison.json || fail "poison.json lacks the texture"
expect 0 attack scene/colmap -o noisy $options --method noise --save png
variation() { sed -n 's/.*"tv_after_mean": \([0-9]*\).*/\1/p' "$1/poison.json"; }
[ "$(variation textured)" -lt "$(variation noisy)" ] || fail "--texture has no effect: $(variation textured), $(variation noisy)"
quality() { sed -n 's/.*"psnr_mean": \([0-9]*\)\.\([0-9]\).*/\1\2/p' "$1/poison.json"; } # of the photos, in tenths of dB
expect 0 attack scene/blender -o followed $options --proxy seed --texture 20
grep -q '"linf_max": 16.0' followed/poison.json || fail "the bound that follows the texture: $(grep linf_max followed/poison.json)"
[ "$(quality followed)" -gt "$(quality poisoned)" ] || fail "--texture has no effect: $(quality followed), $(quality poisoned)"
# With the spectral term the photos are others, within the bound.
expect 0 attack scene/blender -o spectral $options --proxy seed --spectral-weight 2
grep -q '"linf_max": 16.0' spectral/poison.json || fail "the bound: $(grep linf_max spectral/poison.json)"
cmp -s spectral/train/r_0.png poisoned/train/r_0.png && fail "--spectral-weight has no effect"
# Against a tolerance: photos lie further from the clean ones than the decoy shows, within the bound.
for tolerance in 0 12; do
    expect 0 attack scene/blender -o "knows-$tolerance" $options --proxy seed --victim-tolerance $tolerance
done
cmp knows-0/train/r_0.png poisoned/train/r_0.png || fail "a tolerance of 0 is none"
grep -q '"linf_max": 16.0' knows-12/poison.json && grep -q '"victim-tolerance": 12.0' knows-12/poison.json ||
    fail "poison.json of an attack on a tolerance"
[ "$(quality knows-12)" -lt "$(quality knows-0)" ] || fail "--victim-tolerance has no effect"
# Against a budget: growth goes on within the victim's limit.
seeds=$(sed -n 's/^element vertex //p' seed/point_cloud/iteration_*/point_cloud.ply)
for limit in max victim; do
    expect 0 attack scene/blender -o "fills-$limit" $options --proxy seed --keep-decoy --$limit-gaussians "$seeds"
    decoy=$(sed -n 's/^element vertex //p' "fills-$limit/attack/decoy.ply")
    [ "$decoy" -le "$seeds" ] || fail "--$limit-gaussians $seeds: $decoy"
done
[ -s fills-max/train/r_0.png ] && [ -s fills-victim/train/r_0.png ] || fail "no photos"
cmp -s fills-max/train/r_0.png fills-victim/train/r_0.png && fail "--victim-gaussians has no effect"
# What an earlier set left in the folder is not read instead.
expect 0 attack scene/colmap -o png $options --method noise --save jpg --force
expect 0 attack scene/colmap -o png $options --method noise --save png --force
[ -z "$(find png/images -type f ! -name '*.png')" ] || fail "earlier photos: $(ls png/images)"
expect 0 attack scene/blender -o png $options --method noise --force
expect 0 train png -o victim $(once $short --force --iterations 20 --init-points 500); [ ! -e png/sparse/0/cameras.bin ] || fail "earlier cameras"
expect 0 attack scene/colmap -o tv $(once $options --method tv-per-view --inner 3 --tv aniso --save png)
grep -q '"linf_max": 6.0' tv/poison.json || fail "the steps of tv-per-view"

# What cannot work is said before anything is written.
expect 1 attack scene/blender; says 'missing -o POISONED'
expect 1 attack scene/blender -o x --epsilon much; says '--epsilon'
expect 1 attack scene/blender -o x --epsilon 0.5; says 'a whole number'
expect 1 attack scene/blender -o poisoned --force --max-gaussians 3; says '--max-gaussians'; [ -s poisoned/poison.json ] || fail "gone for nothing"
expect 1 attack scene/blender -o x --method noise --epsilon inf; says 'belongs to --method poison-splat'
expect 1 attack scene/blender -o x --wavelength 40
says '--wavelength has no effect with --method poison-splat; it belongs to --method drift'
expect 1 attack scene/blender -o x --method noise --victim-tolerance 8; says '--victim-tolerance has no effect'
expect 0 attack scene/blender -o fills $(once $options --iterations 1) --victim-gaussians 400
grep -q '"max-gaussians": 400' fills/attack/proxy/config.json || fail "the proxy has no limit: $(grep gaussians fills/attack/proxy/config.json)"
expect 1 attack scene/blender -o x --victim-gaussians 900 --max-gaussians 800
says '--max-gaussians: found 800 and victim_gaussians 900, expected one limit'
expect 1 attack scene/blender -o x --method drift --texture 8; says 'poison-splat or noise or tv-per-view'
expect 0 attack scene/colmap -o unused --method noise -q --inner 3 --iterations 9 --feature-lr 0.1
for option in inner iterations feature-lr; do says "warning: --$option has no effect with --method noise"; done
expect 2 attack nowhere -o x --voxel-size 0.1 --proxy seed --proxy-iterations 9 --save png --jpeg-quality 9
says 'warning: --voxel-size has no effect without --model scaffold'; says 'warning: --proxy-iterations has no effect with --proxy'
says 'warning: --jpeg-quality has no effect with --save png'
expect 0 attack scene/blender -o unused --method noise -q --jpeg-quality 9 --test-every 2 --max-vram 1G --engine cpu --force
says 'warning: the quality and chroma of JPEG have no effect with --save auto, which is PNG for this scene'
says 'warning: --test-every has no effect without --views train'; says 'warning: --max-vram has no effect with --engine cpu'
expect 0 attack scene/colmap -o unused --method noise -q --jpeg-quality 9 --test-every 2 --views train --force
[ ! -s err ] || fail "a warning about options that have an effect: $(cat err)"
expect 2 attack nowhere -o x --model scaffold --opacity-lr 0.1; says 'warning: --opacity-lr has no effect with --model scaffold'
expect 0 attack scene/colmap -o unused --method tv-per-view -q --inner 1 --force
[ ! -s err ] || fail "--inner has an effect with tv-per-view"
expect 1 attack scene/blender -o x --epsilon inf --texture 8; says '--texture: found 8 and an epsilon of inf, expected a finite'
expect 2 attack scene/blender -o scene/blender; says 'scene/blender: found a scene, expected a new folder'
expect 2 attack scene/blender -o scene/blender/x; says 'in the scene'
expect 2 attack scene/blender -o scene/blender/x/y/z; says 'in the scene'
expect 2 attack scene/blender -o scene; says 'around the input'
expect 2 attack scene/blender -o poisoned; says 'earlier attack'; says '--force replaces it'
expect 2 attack scene/blender -o victim; says 'other files'
expect 2 attack nowhere -o x; says nowhere; [ ! -e x ] || fail "a folder was made for no scene"
mkdir empty; expect 2 attack empty -o poisoned --force; [ -s poisoned/poison.json ] || fail "a failed attack took the earlier one"
# Links are followed inside the scene, and out of it only with leave. What training does not read does not matter.
cp -r scene/colmap linked; ln -s /etc/passwd linked/poses_bounds.npy; mv linked/sparse/0/cameras.bin linked/cameras
ln -s ../../cameras linked/sparse/0/cameras.bin
expect 0 attack linked -o unlinked --method noise --save png; says 'not copied'
[ ! -e unlinked/poses_bounds.npy ] && cmp linked/cameras unlinked/sparse/0/cameras.bin || fail "links inside the scene"
mv linked/cameras cameras.bin; ln -sf "$PWD/cameras.bin" linked/sparse/0/cameras.bin; rm linked/poses_bounds.npy
expect 2 attack linked -o unlinked --method noise --save png --force; says 'leads out of linked'
[ -s unlinked/poison.json ] || fail "a failed attack took the earlier one"
expect 0 attack linked -o unlinked --method noise --save png --force --follow-links
cmp cameras.bin unlinked/sparse/0/cameras.bin || fail "links out of the scene"
expect 2 attack scene/blender -o x --proxy nowhere.ply; says nowhere.ply
expect 3 attack scene/blender -o x --proxy seed --max-memory 1M # less than the process alone, which varies
limit=$(($(sed -n 's/.*expected at least \([0-9]*\)M for.*/\1/p' err) * 1048576 + 200000))
expect 3 attack scene/blender -o x --proxy seed --max-memory $limit
[ -e x ] && fail "what could not begin left a folder: $(ls -R x)"
[ ! -e scene/blender/x ] || fail "something was written into the scene"

# Runs next to each other.
expect 0 compare clean victim; grep -q 'Gaussians, most' out || fail "compare's table"
expect 0 compare clean victim --json; grep -q '"ratios_to_first"' out || fail "compare's JSON"
expect 0 compare clean victim --csv; [ "$(wc -l <out)" = 3 ] || fail "compare's CSV"
expect 0 compare clean victim --scene scene/blender --quiet
expect 2 compare clean nowhere; says nowhere/summary.json
expect 0 compare clean victim; sed -n 's/^training, s  *\([^ ]*\) .*/\1/p' out | grep -q '[1-9]' || fail "no time: $(grep training out)"
expect 0 compare clean victim --json
for key in max_gaussians final_gaussians peak_rss_bytes peak_ledger_bytes model_bytes instance_bytes image_bytes max_instances; do
    [ "$(grep -cE "^    \"$key\": [0-9]+,\$" out)" = 2 ] || fail "compare's JSON: $(grep $key out)"
done
expect 1 compare clean --json --csv; says 'exclude each other'

# Spectra.
expect 0 spectrum scene/blender/train/r_0.png poisoned/train/r_0.png -o spectrum.png
says 'picture of 2 images written to spectrum.png'
expect 0 spectrum scene/blender/train/r_0.png poisoned/train/r_0.png -o spectrum.png -q
[ ! -s err ] || fail "spectrum -q says something"
grep -q 'anisotropy' out && [ -s spectrum.png ] || fail "spectrum"
expect 0 spectrum spectrum.png --json; grep -q '"band_share"' out || fail "spectrum's JSON"
expect 2 spectrum nowhere.png; says nowhere.png
python3 - <<'END' >wide.png || cp spectrum.png wide.png
import struct, sys, zlib
def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
sys.stdout.buffer.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 20000, 1, 8, 2, 0, 0, 0)) +
                        chunk(b"IDAT", zlib.compress(bytes(60001))) + chunk(b"IEND", b""))
END
if ! cmp -s wide.png spectrum.png; then
    expect 2 spectrum wide.png; says 'wide.png: found 20000 x 1 pixels, expected sides of at most 16384'
fi
expect 1 spectrum spectrum.png -o ./spectrum.png; says 'one of the images'
expect 2 spectrum scene/blender/transforms_train.json; says transforms_train.json
expect 1 spectrum spectrum.png --bins 6; says 'divisible by 4'
expect 1 spectrum spectrum.png -o crop.png --crop 4294967296,0,8,8; says '--crop: found "4294967296,0,8,8"'

# A share of no photo.
expect 0 attack scene/blender -o unpoisoned --method noise --ratio 0; says 'no poisoned image in unpoisoned'
