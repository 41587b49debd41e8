# SPDX-License-Identifier: Apache-2.0
# A scene written with smoothed photos trains to the model of the filter in the trainer.
. "$(dirname "$0")/common.sh"
small_scene
for filter in gaussian bilateral wavelet; do
    expect 0 smooth scene/blender --smooth $filter -o $filter -q
    [ ! -s err ] || fail "smooth -q says something"
    expect 0 train scene/blender -o run_$filter $short --init-points 200 --smooth $filter
    expect 0 train $filter -o file_$filter $short --init-points 200
    cmp run_$filter/point_cloud/iteration_$end/point_cloud.ply file_$filter/point_cloud/iteration_$end/point_cloud.ply ||
        fail "$filter: file and trainer differ"
done
cmp -s gaussian/train/r_0.png wavelet/train/r_0.png && fail "two filters made the same photo"
cmp -s gaussian/train/r_0.png scene/blender/train/r_0.png && fail "nothing was smoothed"

# The test views of Blender scenes stay as they are, and the copy has them.
cmp gaussian/test/r_0.png wavelet/test/r_0.png || fail "a test view is missing or smoothed"
expect 0 train gaussian -o held_out $(once $short --eval --init-points 200 --iterations 20)

# COLMAP: JPEG, and the test views as they are.
expect 0 smooth scene/colmap --views train --save png -o colmap
says "$(find colmap/images -type f | wc -l) photos written to colmap"
[ -s colmap/images/view_0001.png ] && [ -n "$(ls colmap/sparse/0)" ] || fail "no COLMAP scene"
expect 0 smooth scene/colmap -o jpeg -q
for image in jpeg/images/*.jpg; do
    grep -qaF "${image##*/}" jpeg/sparse/0/images.bin || fail "the model does not name $image"
done
grep -qaF .png jpeg/sparse/0/images.bin && fail "the model names photos that are not there"
expect 0 smooth scene/blender --save png --jpeg-quality 90 -o quality -q
says 'warning: --jpeg-quality has no effect with --save png'
expect 0 smooth scene/blender --jpeg-quality 90 --test-every 2 -o automatic -q
says 'warning: --jpeg-quality has no effect with --save auto, which is PNG for this scene'
says 'warning: --test-every has no effect without --views train'
expect 0 smooth scene/colmap --jpeg-quality 90 --test-every 2 --views train -o views -q
[ ! -s err ] || fail "a warning about options that have an effect: $(cat err)"
expect 1 smooth scene/blender; says 'missing -o SMOOTHED'
expect 1 smooth scene/blender --smooth off -o off; says '--smooth'
expect 2 smooth nothing -o x; says 'nothing'
expect 2 smooth scene/blender -o scene/blender/inside; says 'scene'
expect 2 smooth scene/blender -o gaussian -q; says 'gaussian: found a scene, expected a new folder'
expect 1 smooth scene/blender --smooth median -o x; says '--smooth'
[ ! -e x ] && [ ! -e off ] || fail "a failed smooth left something"

# What is interrupted is no scene, and the same command completes it.
(ulimit -f 4; "$tool" smooth scene/colmap --save png -o cut -q -j 1 2>err; [ $? -eq 2 ]) || fail "a full disk was not noticed"
expect 2 info cut; says 'found no scene'
expect 0 smooth scene/colmap --save png -o cut -q
expect 0 smooth scene/colmap --save png -o uncut -q
diff -r cut uncut || fail "completed, a scene is another one"
