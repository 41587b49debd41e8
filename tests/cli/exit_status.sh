# SPDX-License-Identifier: Apache-2.0
# Exit statuses are stable, each says one thing, and --help, the man page and the guides list the same ones.
. "$(dirname "$0")/common.sh"
expect 0 --help
sed -n '/^Exit status:/,$ s/^ *\([0-9][0-9]*\)  */\1|/p' out >statuses
[ "$(cut -d '|' -f 1 statuses | tr '\n' ' ')" = '0 1 2 3 4 5 6 130 ' ] || fail "--help lists $(cat statuses)"
expect 0 help --man; tr -d '\134' <out >page
while IFS='|' read -r status meaning; do
    grep -A 1 "^\.B $status\$" page | grep -qF -- "$meaning" || fail "the man page lacks $status: $meaning"
    for guide in options user-guide; do
        grep -qF -- "| $status | $meaning" "$source_dir/docs/$guide.md" || fail "docs/$guide.md lacks $status: $meaning"
    done
done <statuses

expect 0 synth -o scene --width 264 --height 200 --samples 1 --train-views 5 --test-views 1 --points 300
clean=scene/blender
expect 0 attack $clean -o poisoned --method noise --epsilon 16 -q
expect 0 attack $clean -o doubtful --method noise --epsilon 16 -q --ratio 0.2
for scene in $clean:0:clean poisoned:5:poisoned doubtful:6:suspicious; do
    folder=${scene%%:*} verdict=${scene##*:} status=${scene#*:}; status=${status%:*}
    expect 0 audit "$folder" -q; grep -q "^$verdict: score" out || fail "$folder is $(cat out)"
    expect "$status" audit "$folder" -q --exit-code
    expect "$status" audit "$folder" -q --exit-code --json --report page.html
    grep -q "\"verdict\": \"$verdict\"" out || fail "the status is told instead of the verdict"
    [ -s page.html ] || fail "no page beside the status"
done
expect 5 train poisoned -o run --audit refuse -q; [ ! -e run ] || fail "a refused run has begun"
expect 2 audit nowhere --exit-code
expect 2 audit poisoned --exit-code --report nowhere/page.html

# Of what masks leave out nothing is said.
black=iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg==
mkdir $clean/masks
photos=$(sed -n 's|.*"file_path": "\(.*train/[^"]*\)".*|\1|p' $clean/transforms_train.json)
first=${photos%%
*}
echo $black | base64 -d >"$clean/masks/${first##*/}.png"
expect 0 audit $clean -q --exit-code
grep -q ' 4 clean, 1 unseen' out || fail "one photo is masked: $(cat out)"
expect 0 audit $clean -q --json --report page.html
grep -q '"unseen": 1' out && grep -q '"verdict": "unseen"' out || fail "one photo is masked: $(head -n 12 out)"
grep -q '1 unseen' page.html || fail "the page does not say what it did not see"
for photo in $photos; do
    echo $black | base64 -d >"$clean/masks/${photo##*/}.png"
done
for status in '' --exit-code; do
    expect 2 audit $clean -q $status; says 'masks leave nothing to look at'
    [ ! -s out ] || fail "a verdict on nothing: $(cat out)"
done
expect 2 train $clean -o run -q --audit refuse; says 'masks leave nothing'

# Scores of small photos mean little, also of clean ones.
expect 0 synth -o small --width 160 --height 160 --samples 1 --train-views 4 --test-views 1 --points 300
expect 0 audit small/blender -q; says 'fewer than 200 pixels on a side'
expect 0 audit poisoned -q; [ ! -s err ] || fail "a warning for large photos"
