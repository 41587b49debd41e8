# SPDX-License-Identifier: Apache-2.0
# The defense and the budgets from the command line.
. "$(dirname "$0")/common.sh"
small_scene
points=2000 every=20
[ -z "${SG_TEST_ENGINE-}" ] || points=500 every=10
settled() { grep -qF -- "\"$2\": $3" "$1/config.json" || fail "$1 has $(grep -F "\"$2\"" "$1/config.json"), expected $3"; }
field() { tr -d ' \n' <"$1/summary.json" | grep -o "\"$2\":[^,}]*" | head -n 1 | cut -d: -f2; }

# Defended: events are logged and counted; interrupted and resumed, the same bytes.
defended="--defense spectral --preset ns --filter-interval $every --filter-views 4"
expect 0 train scene/blender -o plain $short --init-points $points
expect 0 train scene/blender -o defended $short --init-points $points $defended
events=$(grep -c '"filter":' defended/log.jsonl)
[ "$events" = 4 ] || fail "$events events are logged, expected 4"
[ "$(field defended filter_events)" = 4 ] && [ "$(field defended filter_removed)" -gt 0 ] || fail "the defense's totals"
automatic="--defense spectral --filter-interval $every --filter-views 4 --densify-until-iter 1400"
"$tool" train scene/blender -o parts $(once $short --init-points $points $automatic --iterations 15000) 2>err &
pid=$!
wait_for parts/log.jsonl
interrupt $pid
[ $? = 130 ] || fail "interrupting a defended run"
last=$(($(field parts iterations) + 3 * every)) # of both runs
sed -i "s/\"iterations\": 15000/\"iterations\": $last/" parts/config.json
before=$(field parts count)
expect 0 train --resume parts --quiet
awk "BEGIN { exit !($(field parts count) > $before) }" || fail "the resumed run's counting took less than its beginning"
expect 0 train scene/blender -o whole $(once $short --init-points $points $automatic --iterations $last)
cmp parts/point_cloud/iteration_$last/point_cloud.ply whole/point_cloud/iteration_$last/point_cloud.ply ||
    fail "a resumed run differs"
for part in anisotropy total_variation count prune; do
    field parts $part | grep -q '[1-9]' || fail "no seconds of $part in the resumed run's summary"
done
# One that the CPU engine began goes on on another, and back: as one that stayed there, but for rounding.
if [ -n "${SG_TEST_ENGINE-}" ]; then
    last=$((4 * every))
    for run in stayed moved; do
        between=
        [ $run = moved ] || between="--engine cpu"
        expect 0 train scene/blender -o $run $(once $short --init-points $points $defended --iterations $((2 * every))) --engine cpu
        expect 0 train --resume $run --iterations $((3 * every)) -q $between
        expect 0 train --resume $run --iterations $last -q --engine cpu
    done
    cmp -s moved/point_cloud/iteration_$last/point_cloud.ply stayed/point_cloud/iteration_$last/point_cloud.ply &&
        fail "a run that moved has the bytes of one that stayed on the CPU"
    loss() { sed -n "s/^{\"iteration\":$last,\"loss\":\([0-9.]*\).*/\1/p" "$1/log.jsonl"; }
    awk "BEGIN { d = $(loss moved) / $(loss stayed) - 1; exit !(d * d <= 1e-6) }" ||
        fail "loss $(loss moved) of a run that moved between engines, expected $(loss stayed) to 0.1 %"
fi
expect 1 train --resume parts --rho 0.2
says 'rho'
expect 0 train scene/blender -o starved $short --init-points 400 --defense spectral --rho 0.2 --filter-interval $((every / 4)) \
    --densify-grad-threshold 1
says 'rho is too high'

# With auto, rho is never the growth itself, and the frequency is of the scene's units, also where it only ranks.
expect 0 train scene/colmap -o auto $short --defense spectral --filter-interval $every
[ "$(field auto filter_events)" = 4 ] || fail "auto does not filter"
settled auto filter-frequency 9.82
expect 0 train scene/colmap -o ranked $(once $short --iterations 1 --max-gaussians 100)
settled ranked filter-frequency 9.82
# The paper's own numbers.
for preset in "ns 0.03 4.0" "tt 0.045 4.0" "mip 0.05 5.0"; do
    set -- $preset
    expect 0 train scene/blender -o "$1" $(once $short --iterations 1 --init-points 10 --defense spectral --preset "$1")
    settled "$1" rho "$2"
    settled "$1" lambda "$3"
    settled "$1" filter-frequency 8.0
done

# Tolerance: with and without the defense, and a model of its own.
expect 0 train scene/blender -o tolerant $short --init-points $points --tolerance 16
settled tolerant tolerance 16.0
cmp -s tolerant/point_cloud/iteration_*/point_cloud.ply plain/point_cloud/iteration_*/point_cloud.ply &&
    fail "the tolerance has no effect"
expect 1 train scene/blender -o refused --tolerance-low-pass 0; says '--tolerance-low-pass: found without a defense'
expect 1 train scene/blender -o refused --tolerance 0 --tolerance-tv 1; says '--tolerance-tv: found without a defense'
expect 0 train scene/blender -o tolerant-plain $short --init-points $points --tolerance 16 --tolerance-low-pass 0
settled tolerant-plain tolerance-low-pass 0.0
expect 1 train scene/blender -o refused --tolerance 256
says '0 to 255 or one of auto|preset'
# auto: the audit decides, with the defense unless told otherwise, and the same where the run is resumed.
expect 0 train scene/blender -o adaptive $short --init-points $points --tolerance auto
settled adaptive tolerance '"auto"'
[ -n "$(field adaptive levels)" ] || fail "the summary lacks the tolerance"
expect 0 train --resume adaptive --iterations $((end + 5))
settled adaptive tolerance '"auto"'
expect 0 train scene/blender -o given $(once $short --iterations 1 --init-points 10 --defense spectral --tolerance 0)
settled given tolerance 0.0
# Without a tolerance the filter answers what the tolerance would.
expect 0 attack scene/blender -o grainy --method noise --epsilon 16 -q
for tolerance in 0 auto; do
    expect 0 train grainy -o "grainy-$tolerance" $(once $short --iterations 1 --init-points 10 --defense spectral --tolerance $tolerance)
done
rho() { sed -n 's/.*"rho": \([-0-9.]*\).*/\1/p' "$1/config.json"; }
awk "BEGIN { exit !($(rho grainy-0) < $(rho grainy-auto) - 0.1) }" ||
    fail "without a tolerance the filter removes $(rho grainy-0), with it $(rho grainy-auto) of growth"

# What a look changes is said. It needs photos with parts that are quiet.
expect 0 synth -o large --width 128 --height 96 --train-views 4 --test-views 1 --points 300 --samples 1
expect 0 attack large/blender -o large-noisy --method noise --epsilon 6 -q
expect 0 train large-noisy -o large-looked ${short% --quiet} --init-points $points --tolerance auto --tolerance-smooth 1
look=$(grep '"noise":' large-looked/log.jsonl | head -n 1)
change=$(printf '%s\n' "$look" | sed 's/.*"level":\([0-9.]*\),"before":\([0-9.]*\).*/\2 \1/' |
    awk '{ printf "%s from %.1f to %.1f", ($2 > $1 ? "raised" : "lowered"), $1, $2 }')
photos=$(printf '%s\n' "$look" | sed 's/.*"compared":\([0-9]*\),"photos":\([0-9]*\).*/\2 of \1/')
says "tolerance $change grey levels, as $photos photos show"

# Photos that agree too little for a tolerance are smoothed, which is said too.
expect 0 synth -o larger --width 192 --height 144 --train-views 4 --test-views 1 --points 300 --samples 1
expect 0 attack larger/blender -o larger-noisy --method noise --epsilon 16 -q
expect 0 train larger-noisy -o smoothed ${short% --quiet} --init-points $points --tolerance auto --tolerance-smooth 0
says 'are smoothed from here on, against noise of '
grep '"noise":' smoothed/log.jsonl | grep -q '"smooths":true' || fail "the log does not say so"
tr -d ' \n' <smoothed/summary.json | grep -q '"tolerance":{"photos":0,"levels":0[.0]*,"smoothed":[1-4]' ||
    fail "the summary does not count smoothed photos: $(cat smoothed/summary.json)"
[ "$(grep -c '"noise":' smoothed/log.jsonl)" -eq 1 ] || fail "a second look after smoothing"
expect 0 train larger-noisy -o limited $short --init-points $points --tolerance auto --tolerance-smooth 0 --max-memory 2G
cmp smoothed/point_cloud/iteration_$end/point_cloud.ply limited/point_cloud/iteration_$end/point_cloud.ply ||
    fail "another limit on memory, another model of smoothed photos"

# Gaussians.
expect 0 train scene/blender -o few $short --init-points 400 --max-gaussians 500 --densify-grad-threshold 0.00001
[ "$(field few max_gaussians)" -le 500 ] || fail "more Gaussians than allowed"
grep -q '"gaussians"' few/summary.json || fail "the summary does not say what was binding"
expect 0 train scene/blender -o fewer $short --init-points 400 --max-gaussians 100
[ "$(field fewer max_gaussians)" -le 100 ] || fail "more Gaussians than allowed from the start"

# Memory: of the whole process, which has the driver's and the device's too where the device is the CPU. There it is the
# memory of the device that is binding.
most=62914560
budget=max-memory peak=peak_rss_bytes poisoning="--proxy-iterations 100 --iterations 24 --inner 4"
sanitized && most=69206016
[ -z "${SG_TEST_ENGINE-}" ] || most=8388608 budget=max-vram peak=peak_vram_bytes poisoning="--proxy seed --iterations 10 --inner 2"
[ -z "${SG_TEST_ENGINE-}" ] || expect 0 train scene/blender -o seed -q --init-points 500 --iterations 50 # else of 100 000
expect 0 train scene/blender -o lean $(once $short --init-points 400 --$budget $most --densify-grad-threshold 0.0000001 --eval \
    --densification-interval 5)
sanitized ||
    [ "$(field lean $peak)" -le $most ] || fail "peak $(field lean $peak) bytes, allowed $most"
grep -q '"memory"' lean/summary.json || fail "the summary does not say that memory was binding"
grep -q "\"$budget\": $most" lean/config.json || fail "a resumed run would not know its limit on memory"
expect 0 attack scene/blender -o unbounded --epsilon inf $poisoning -q
for defense in off "spectral --filter-interval $every --filter-views 4"; do
    expect 0 train unbounded -o held $(once $short --force --init-points 400 --$budget $most --densification-interval 5 \
        --densify-grad-threshold 0.0000001 --defense $defense)
    sanitized || [ "$(field held $peak)" -le $most ] || fail "$defense: peak $(field held $peak)"
    grep -q '"memory"' held/summary.json || fail "$defense: memory was not binding"
done
expect 3 train scene/blender -o none $short --resolution 800 --max-memory 1M # less than the process alone, which varies
limit=$(($(sed -n 's/.*expected at least \([0-9]*\)M for.*/\1/p' err) * 1048576 + 2000000))
expect 3 train scene/blender -o none $short --resolution 800 --max-memory $limit
says 'expected at least'
says "the limit is --max-memory, $limit bytes, less"
[ ! -e none/summary.json ] || fail "a run that cannot fit has begun"

# Photos that do not fit on the device come and go. The model is the same.
if [ -n "${SG_TEST_ENGINE-}" ]; then
    expect 0 synth -o many --width 64 --height 48 --train-views 80 --test-views 1 --samples 1
    many="many/blender --iterations 30 --init-points 300 --max-gaussians 500 --max-memory 400M --quiet"
    on_device() { tr -d ' \n' <"$1/summary.json" | sed 's/.*"peak_vram_bytes_by_tag":{[^}]*"images":\([0-9]*\).*/\1/'; }
    expect 0 train $many -o roomy
    expect 3 train $many -o tight --max-vram 5M; says 'memory of the device'
    need=$(sed -n 's/.*found a limit of [0-9]* bytes, expected at least \([0-9]*\):.*/\1/p' err)
    expect 0 train $many -o tight --max-vram $((need + 100000))
    [ "$(on_device tight)" -le $(($(on_device roomy) / 8)) ] || fail "$(on_device tight) bytes of photos, of $(on_device roomy)"
    cmp roomy/point_cloud/iteration_30/point_cloud.ply tight/point_cloud/iteration_30/point_cloud.ply ||
        fail "photos that come and go change the model"
# Those that do not fit into the memory of the host are read again. The model is the same, and one that changes ends the
# run. What reads them is the same for all engines.
elif ! sanitized; then
    large="--iterations 20 --resolution 800 --init-points 300 --max-gaussians 500 -q"
    expect 0 train scene/blender -o roomy $large
    expect 3 train scene/blender -o tight $large --max-memory 60M; says 'M has room for what is expected'
    need=$(sed -n 's/.*expected at least \([0-9]*\):.*/\1/p' err)
    own=$(sed -n 's/.*less \([0-9]*\) for the process.*/\1/p' err)
    limit=$((need + own + 1000000)) # for the process, which varies
    expect 0 train scene/blender -o tight $large --max-memory $limit; says 'bytes of the photos stay in memory; the other photos are read again'
    model=point_cloud/iteration_20/point_cloud.ply
    cmp roomy/$model tight/$model || fail "reading photos again changes the model"
    cp -r scene/blender moving
    "$tool" train moving -o changed $(once $large --iterations 100000 --log-every 1 --max-memory $limit) 2>err &
    wait_for changed/log.jsonl
    for photo in moving/train/*; do # at once, and different from what it was
        cp scene/blender/test/r_0.png "$photo.new" && mv "$photo.new" "$photo"
    done
    wait $! && fail "a photo that changed was trained on"
    [ $? = 2 ] || fail "a photo that changed: exit code $?"
    says 'found another photo or mask than when the scene was loaded'; says moving/train/r_; says 'is saved in changed'
fi

# Time: less than asked for, a model at the end.
expect 0 train scene/blender -o brief --init-points 400 --quiet --iterations 1000000 --max-time 2s
[ "$(field brief iterations)" = 1000000 ] || fail "the schedule did not end"
grep -q '"time"' brief/summary.json || fail "the summary does not say that time was binding"
[ -s brief/point_cloud/iteration_1000000/point_cloud.ply ] || fail "no model"
expect 1 train scene/blender -o brief2 --max-time 2x
says 'found "2x"'

# Values out of range, before anything is read.
for bad in "--rho 1" "--rho -0.95" "--lambda -0.5" "--max-gaussians 3" "--band-low 0.9 --band-high 0.3" "--bins 255" "--bins 7" "--filter-views 0" "--max-time -1"; do
    expect 1 train nowhere -o bad --defense spectral $bad
    says 'expected'
done
# What would have no effect.
for vain in "--rho 0.03" "--preset mip" "--filter-views 3" "--lambda 2 --audit warn"; do
    expect 1 train nowhere -o bad $vain
    says 'expected --defense spectral'
done
for fixed in "--preset ns" "--rho 0" "--rho 0.2"; do
    expect 1 train nowhere -o bad --defense spectral --rho-least 0.1 $fixed
    says 'expected preset auto or'
done
expect 2 train nowhere -o bad --defense spectral --rho-least 0.1
expect 2 train nowhere -o bad --defense spectral --rho-least 0.1 --rho -0.2 --preset ns
expect 2 train nowhere -o bad --filter-views 3 --max-gaussians 100 # who stays at the limit
expect 2 train nowhere -o bad --filter-views 3 --max-memory 4G
expect 2 train nowhere -o bad --rho 0.03 --audit defend
expect 1 train nowhere -o bad --defense off --audit defend
says 'exclude each other'
