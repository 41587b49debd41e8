# SPDX-License-Identifier: Apache-2.0
# Defended runs, attacks, and runs that move between engines, with SG_TEST_ENGINE: short forms of
# tests/cli/defense.sh and attack.sh, which take too long on a driver for the CPU.
. "$(dirname "$0")/../cli/common.sh"
small_scene
field() { tr -d ' \n' <"$1/summary.json" | grep -o "\"$2\":[^,}]*" | head -n 1 | cut -d: -f2; }

# Defended, in one run and in two: events are counted, and the bytes are the same.
defended="$(once $short --iterations 50 --init-points 500) --defense spectral --preset ns --filter-interval 20 --filter-views 4"
"$tool" train scene/blender -o parts $(once $defended --iterations 20000) 2>err &
pid=$!
wait_for parts/log.jsonl
interrupt $pid
[ $? = 130 ] || fail "an interrupted run has another exit code"
reached=$(sed -n 's/.*"iterations": \([0-9]*\).*/\1/p' parts/summary.json)
end=$((reached + 45))
sed -i "s/\"iterations\": 20000/\"iterations\": $end/" parts/config.json
expect 0 train --resume parts -q
expect 0 train scene/blender -o whole $(once $defended --iterations $end)
[ "$(field whole filter_events)" -ge 2 ] || fail "$(field whole filter_events) events, expected 2 or more"
for stage in anisotropy total_variation count; do
    field whole $stage | grep -q '[1-9]' || fail "no seconds of $stage in the summary"
done
cmp whole/point_cloud/iteration_$end/point_cloud.ply parts/point_cloud/iteration_$end/point_cloud.ply ||
    fail "a run that was resumed at $reached differs"
cmp whole/checkpoint.bin parts/checkpoint.bin || fail "the checkpoints differ"

# Exposures and a tolerance with its low-pass term, and a limit of Gaussians.
expect 0 train scene/blender -o tolerant $(once $short --iterations 40 --init-points 500) --tolerance 16 --exposure
expect 0 train scene/blender -o plain $(once $short --iterations 40 --init-points 500) --exposure
cmp -s tolerant/point_cloud/iteration_40/point_cloud.ply plain/point_cloud/iteration_40/point_cloud.ply &&
    fail "the tolerance has no effect"
expect 0 train scene/blender -o small $(once $short --iterations 40 --init-points 500) --max-gaussians 400
[ "$(field small max_gaussians)" -le 400 ] || fail "$(field small max_gaussians) Gaussians, at most 400 are allowed"
expect 3 train scene/blender -o none $short --max-vram 5M; says 'memory of the device'

# Photos that do not fit on the device come and go. The model is the same.
expect 0 synth -o many --width 64 --height 48 --train-views 80 --test-views 1 --samples 1
many="many/blender --iterations 30 --init-points 300 --max-gaussians 500 --max-memory 400M --quiet"
on_device() { tr -d ' \n' <"$1/summary.json" | sed 's/.*"peak_vram_bytes_by_tag":{[^}]*"images":\([0-9]*\).*/\1/'; }
expect 0 train $many -o roomy
expect 3 train $many -o tight --max-vram 5M
need=$(sed -n 's/.*found a limit of [0-9]* bytes, expected at least \([0-9]*\):.*/\1/p' err)
expect 0 train $many -o tight --max-vram $((need + 100000))
[ "$(on_device tight)" -le $(($(on_device roomy) / 8)) ] || fail "$(on_device tight) bytes of photos, of $(on_device roomy)"
cmp roomy/point_cloud/iteration_30/point_cloud.ply tight/point_cloud/iteration_30/point_cloud.ply ||
    fail "photos that come and go change the model"

# The audit decides on the tolerance, also where the run goes on. A time limit ends the schedule.
expect 0 train scene/blender -o adaptive $(once $short --iterations 20 --init-points 500) --tolerance auto
expect 0 train --resume adaptive --iterations 25 -q
[ -n "$(field adaptive levels)" ] || fail "the summary lacks the tolerance"
expect 0 train scene/blender -o brief --init-points 400 --quiet --iterations 1000000 --max-time 2s
[ "$(field brief iterations)" = 1000000 ] || fail "the schedule did not end"
[ -s brief/point_cloud/iteration_1000000/point_cloud.ply ] || fail "no model of a run with little time"

# A run that the CPU began goes on on the device, and back.
expect 0 train scene/blender -o moved $(once $defended --iterations 20) --engine cpu
expect 0 train --resume moved --iterations 30 -q
expect 0 train --resume moved --iterations 40 -q --engine cpu
[ -s moved/point_cloud/iteration_40/point_cloud.ply ] || fail "a run that moved between engines has no model"

# An attack keeps its bound and has the same bytes in one part and in two.
attack="scene/colmap --proxy-iterations 40 --inner 2 --densification-interval 10 --seed 3 --save png --quiet"
expect 0 attack $attack -o first --iterations 10
grep -q '"linf_max": 16.0' first/poison.json || fail "the bound: $(grep linf_max first/poison.json)"
"$tool" attack $attack -o cut --iterations 20000 --proxy first/attack/proxy 2>err &
pid=$!
wait_for cut/attack/log.jsonl
interrupt $pid
[ $? = 130 ] || fail "an interrupted attack has another exit code"
reached=$(sed -n '$s/{"iteration":\([0-9]*\).*/\1/p' cut/attack/log.jsonl)
sed -i "s/\"iterations\": 20000/\"iterations\": $((reached + 5))/" cut/attack/config.json
expect 0 attack --resume cut --quiet
expect 0 attack $attack -o uncut --iterations $((reached + 5)) --proxy first/attack/proxy
for image in uncut/images/*.png; do
    cmp "$image" "cut/images/${image##*/}" || fail "resumed at $reached, other poisons"
done
expect 0 attack $attack -o again --iterations $((reached + 5)) --proxy first/attack/proxy --threads 1
for image in uncut/images/*.png; do
    cmp "$image" "again/images/${image##*/}" || fail "another number of threads, other poisons"
done
expect 0 train uncut -o victim $(once $short --iterations 20)
expect 0 attack scene/colmap -o anisotropic --method tv-per-view --inner 3 --tv aniso --save png --quiet
expect 0 attack $attack -o spectral --iterations 4 --spectral-weight 2 --proxy first/attack/proxy
cmp -s spectral/images/r_0.png first/images/r_0.png && fail "the spectral term has no effect"
grep -q '"linf_max": 16.0' spectral/poison.json || fail "the bound: $(grep linf_max spectral/poison.json)"
