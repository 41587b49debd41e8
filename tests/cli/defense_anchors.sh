# SPDX-License-Identifier: Apache-2.0
# Anchors with all of the defense: the audit, preset auto, the filter and the losses, with one noisy photo among clean ones.
. "$(dirname "$0")/common.sh"
small_scene
expect 0 attack scene/blender -o noisy --method noise -q
cp noisy/train/r_0.png scene/blender/train
defended="$(once $short --init-points 200 --model scaffold --anchors-from-iter $((end / 3)) --voxel-size 0.02 --log-every 1) \
    --audit warn --defense spectral --filter-interval $((end / 6)) --filter-views 4"
number() { tr -d ' \n' <"$1/summary.json" | grep -o "\"$2\":[^,}]*" | head -n 1 | cut -d: -f2; }
for size in neural anchor; do
    expect 0 train scene/blender -o $size $defended --filter-anchors $size
done
cmp -s neural/point_cloud/iteration_$end/point_cloud.ply anchor/point_cloud/iteration_$end/point_cloud.ply &&
    fail "the filter removes the same anchors by either size"
[ "$(number neural photos)" -ge 1 ] && [ -n "$(number neural verdict)" ] || fail "the audit found no photo to tolerate"
# What is removed is a share of the anchors, of which each is ten Gaussians.
awk -F '[:,]' '/^{"filter":/ { events++; removed += $8; bad = bad || $8 <= 0 || $8 != 10 * int($4 * $6 / 10) }
    END { print events + 0, removed + 0, bad + 0 }' neural/log.jsonl >sums
[ "$(cat sums)" = "$(number neural filter_events) $(number neural filter_removed) 0" ] && [ "$(number neural filter_events)" -ge 1 ] ||
    fail "events and what they removed: found $(cat sums), the summary has $(grep filter_ neural/summary.json)"
# The noisy photo is tolerated and only gets smoother; others have both losses.
awk '/^{"iteration":/ {
        sub(/"defense_seconds".*/, "")
        tv = match($0, /"total_variation":0\.0*[1-9]/); both = tv && match($0, /"anisotropy":0\.0*[1-9]/)
        if (/"view":"r_0"/) noisy[tv && !both]++; else others[both > 0]++
    }
    END { exit !(noisy[1] && !noisy[0] && others[1]) }' neural/log.jsonl || fail "losses of photos: $(head -n 20 neural/log.jsonl)"
