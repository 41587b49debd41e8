# SPDX-License-Identifier: Apache-2.0
# The audit from the command line, and trainings that follow its verdict.
. "$(dirname "$0")/common.sh"
settled() { grep -qF -- "\"$2\": $3" "$1/config.json" || fail "$1 has $(grep -F "\"$2\"" "$1/config.json"), expected $3"; }

# Numbers of every photo, and a page. Photos, not thumbnails: what is fine texture at 64 pixels looks like an attack.
expect 0 synth -o scene --train-views 4 --test-views 1 --points 300 --samples 1
brief=$(once $short --iterations 40 --init-points 400)
expect 0 audit scene/blender --json --report page.html -q
[ ! -s err ] || fail "audit -q says something"
grep -q '"verdict": "clean"' out || fail "the clean scene is not clean: $(head -n 3 out)"
[ "$(grep -c '"name"' out)" = 4 ] || fail "not every photo is listed"
grep -q 'data:image/png;base64,' page.html || fail "no pictures in the report"
grep -q 'prefers-color-scheme: dark' page.html || fail "the report does not follow the reader's theme"
grep -q '[{;]color:#\|fill=#' page.html && fail "a colour of the report is of one theme only: $(grep -n 'color:#\|fill=#' page.html)"
grep -q 'white 32 and more' page.html || fail "heat maps saturate within a bound of 16"
[ "$(grep -o '<svg ' page.html | wc -l)" = 4 ] || fail "not every photo shown has its directions"
cp -r scene/blender odd
first=$(find odd/train -type f -printf '%f\n' | sort | head -n 1)
mv "odd/train/$first" 'odd/train/<img src=x onerror="a()">.png'
sed -i "s|train/${first%.png}\"|train/<img src=x onerror=\\\\\"a()\\\\\">\"|" odd/transforms_train.json
expect 0 audit odd --report odd.html; says '4 photos written to odd.html'
grep -q 'onerror=&#34;a()&#34;&#62;' odd.html || fail "the odd name is not in the report"
grep -q '<img src=x' odd.html && fail "a name became markup"
expect 0 attack scene/blender -o noisy --method noise --epsilon 16 -q
expect 0 audit noisy --json -q
grep -q '"verdict": "poisoned"' out || fail "noise is not found: $(head -n 3 out)"
grep -q 'oscillate' out || fail "no reasons"

# Training takes the verdict into account.
expect 5 train noisy -o refused --audit refuse -q
says 'expected clean ones'
expect 0 train scene/blender -o replaced --audit refuse $brief
expect 5 train noisy -o replaced --resume --iterations 50 -q # photos replaced since
says 'expected clean ones'
[ ! -e refused ] || fail "a refused run has begun"
expect 0 train noisy -o warned $brief --audit warn
says 'the photos look poisoned'
says 'oscillate' # a reason
grep -q '"filter_events"' warned/summary.json && fail "a warning turned the defense on"
settled warned lambda 4.0
expect 0 train noisy -o guarded $(once $brief | sed 's/--quiet//') --audit defend --filter-interval 20
says 'defense: preset auto, rho 0, lambda 6'; says 'tolerance: 4 of 4 photos, at most '
grep -q '"filter_events"' guarded/summary.json || fail "the audit did not turn the defense on"
expect 0 train scene/blender -o trusting $(once $brief | sed 's/--quiet//') --audit defend
says 'defense: none, as the photos look clean'
grep -q '"filter_events"' trusting/summary.json && fail "the audit turned the defense on for clean photos"
expect 0 train noisy -o trusting --resume --iterations 50 -q
settled trusting defense '"off"' # a run keeps what it has
expect 0 train noisy -o moving $brief --strategy mcmc --cap-max 500 --defense spectral # which has no use for the filter
settled moving rho 0.0
settled moving rho-least 0.0

# Photo by photo: auto looks without being asked to, and clean ones have no losses.
brief=$(once $brief --iterations 1)
expect 0 train noisy -o looked $brief --defense spectral
says 'the photos look poisoned'
settled looked lambda 6.0
expect 0 train scene/blender -o calm $brief --defense spectral
grep -q '"anisotropy":null' calm/log.jsonl || fail "a clean photo has a loss: $(head -n 1 calm/log.jsonl)"

# One of five is suspicious: no reason to refuse them, but one to defend.
cp noisy/train/r_0.png scene/colmap/images/view_0001.png
expect 0 train scene/colmap -o doubted $brief --audit refuse
says 'look suspicious'
expect 0 train scene/colmap -o cautious $brief --audit defend
settled cautious defense '"spectral"'
