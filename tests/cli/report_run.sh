# SPDX-License-Identifier: Apache-2.0
# The page of a run has the run's numbers and pictures, and what strangers named is only text.
. "$(dirname "$0")/common.sh"
small_scene
name='run <img src=x>&'
expect 0 train scene/colmap -o "$name" --eval --iterations 60 --log-every 10 --eval-every 30 --max-gaussians 400 --max-memory 1G -q \
    --densify-from-iter 10 --densification-interval 10
expect 0 report "$name" -o page -q
[ ! -s err ] || fail "report -q says something"
[ "$(ls page)" = report.html ] || fail "the folder has $(ls page)"
expect 3 report "$name" -o none --max-memory 1M; says 'expected at least'
[ ! -e none ] || fail "a report without memory left something"
rm page/report.html && mkdir page/report.html
expect 2 report "$name" -o page -q; says 'page/report.html: cannot write: Is a directory'
[ -z "$(find page -name '*.tmp*')" ] || fail "a page without a name is left"
rmdir page/report.html; expect 0 report "$name" -o page -q
page=page/report.html
grep -q '<img src=x' $page && fail "a name is an element"
sed 's/src=x//g' $page | grep -oE '(src|href)=.{12}|@import|url\(' | grep -v 'src="data:image' && fail "the page refers to something elsewhere"
grep -q '<script' $page && fail "a script"
json() { python3 -c 'import json, sys; print(eval("s" + sys.argv[2], {"s": json.load(open(sys.argv[1]))}))' "$name/summary.json" "$1"; }
if command -v python3 >/dev/null; then
    grep -q "Gaussians<td>$(json '["final_gaussians"]')\$" $page || fail "another number of Gaussians"
    grep -q "test views<td>$(printf %.2f "$(json '["psnr"]')") dB" $page || fail "another PSNR"
    grep -q "<th scope=row>Gaussians<td>$(json '["max_gaussians"]')<td>400<td>" $page || fail "no budget of Gaussians"
    grep -q '<th scope=row>memory<td>.*<td>1074 MB' $page || fail "no budget of memory"
fi
page_look $page
[ "$(grep -c '<svg role=img' $page)" -eq 5 ] || fail "not five curves"
if command -v python3 >/dev/null; then # heights of the curve of the memory are those of the log
    python3 - "$name" $page <<'END' || fail "the memory over the iterations"
import json, re, sys
log = [line for line in map(json.loads, open(sys.argv[1] + "/log.jsonl")) if "ledger_bytes" in line]
most = json.load(open(sys.argv[1] + "/summary.json"))["peak_ledger_bytes"]
held = [line["ledger_bytes"] for line in log]
assert len(held) >= 6 and all(0 < h <= most for h in held), (held, most)
figure = re.search('aria-label="Memory of the library.*?</figure>', open(sys.argv[2]).read(), re.S).group()
drawn = re.search('class=curve d="M(.*?)"', figure).group(1).split("L")
assert len(drawn) == len(held), drawn
for point, h in zip(drawn, held): # 210 is 0 and 24 the most
    assert abs((210 - float(point.split()[1])) / 186 - h / max(held)) < 1e-3, (point, h)
END
fi
[ "$(grep -o 'class=mark data-value' $page | wc -l)" -eq 2 ] || fail "not two measurements"
[ "$(grep -o 'data:image/png;base64' $page | wc -l)" -ge 3 ] || fail "no pictures"
grep -q -- '--max-gaussians<td>400<td>0$' $page || fail "an option is missing"
grep -q -- '--eval<td>true<td>false$' $page || fail "a flag is missing"
grep -q -- '--lambda<td>[0-9.]*<td>preset$' $page || fail "a value that the run found looks like a given one"

# Runs next to each other.
expect 0 report "$name" -o loud; says "page of $name written to loud/report.html"
expect 0 compare "$name" "$name" --html both.html -q
[ ! -s err ] || fail "compare -q says something"
expect 0 compare "$name" "$name" --html both.html; says 'page of 2 runs written to both.html'
[ ! -s out ] || fail "compare --html prints too"
grep -q '<img src=x' both.html && fail "a name is an element of the comparison"
[ "$(grep -c '<rect' both.html)" -ge 6 ] || fail "no bars"
expect 0 compare "$name" "$name"
most=$(awk '/^Gaussians, most/ { print $3 }' out)
grep -q "^<tr><th scope=row>Gaussians, most<td>$most<td>$most (1.00x)" both.html || fail "another table than compare prints"

# Views of other sizes are told of, unless all runs are measured on the same.
grep -q warning err && fail "runs of the same views are told apart"
expect 0 train scene/colmap -o small --eval --iterations 2 --downscale 2 -q
expect 0 compare "$name" small; grep -qE '^warning: small: measured on [0-9]+ test views with [1-9][0-9]* pixels, run .* on [0-9]+ with [1-9][0-9]*: --scene measures' err || fail "compare says $(cat err)"
expect 0 compare "$name" small --scene scene/colmap; says 'warning: small: measured on'; says '--downscale N, hold for all runs'
expect 0 compare "$name" small --scene scene/colmap --downscale 1; grep -q warning err && fail "runs that were measured on the same are told apart"
# A run is not measured unnoticed on what it has learned.
expect 0 eval "$name" -q; grep -q learned err && fail "a run's own test views were learned"
expect 0 eval "$name" -q --test-every 2; says 'warning: the run has learned from'
echo '{"psnr": 12}' >small/summary.json
expect 2 compare "$name" small; says 'small/summary.json: found no number iterations, expected the summary of a run'

echo mine >both.html.tmp
expect 0 compare "$name" "$name" --html both.html
grep -q mine both.html.tmp || fail "another's file is gone"
echo mine >mine.html
expect 2 compare "$name" --html mine.html
grep -q mine mine.html || fail "another's file is gone"
expect 1 compare "$name" --html x.html --csv; says 'exclude each other'
page_look both.html

# Ctrl-C leaves nothing.
if [ -z "${SG_TEST_ENGINE-}" ]; then # which is slower to see it
    expect 0 synth -o traced --width 400 --height 300 --train-views 4 --test-views 1 --points 300 --samples 1
    mkdir -p wide/sparse/0 wide/images
    for i in $(seq 48); do
        ln "$(find traced/colmap/images -name '*_0000.png')" "wide/images/$i.png"
        printf '%s 1 0 0 0 0 0 3.%s 1 %s.png\n\n' "$i" "$i" "$i"
    done >wide/sparse/0/images.txt
    echo '1 SIMPLE_PINHOLE 400 300 400 200 150' >wide/sparse/0/cameras.txt
    expect 0 train wide -o one --eval --test-every 2 --iterations 1 --init-points 20000 -q
    "$tool" report one -o stopped >out 2>err &
    interrupt $!
    [ $? -eq 130 ] && grep -q 'cancelled\|interrupted' err || fail "a report was not interrupted"
    [ ! -e stopped ] || fail "an interrupted report left $(ls -A stopped)"
    "$tool" compare one one --scene wide --html stopped.html >out 2>err &
    interrupt $!
    [ $? -eq 130 ] && grep -q 'cancelled\|interrupted' err || fail "a comparison was not interrupted"
    for file in stopped.html*; do [ ! -e "$file" ] || fail "Ctrl-C left $file"; done
    rm -rf traced wide one
fi

# Without its photos; with a log that is damaged, or gone.
mv scene gone
expect 2 report "$name" -o nothing --scene nowhere -q; says 'nowhere: found no folder'
[ ! -e nothing ] || fail "half a report: $(ls -a nothing)"
expect 0 report "$name" -o page -q; says 'the page has no pictures'
grep -q 'data:image' $page && fail "pictures of nothing"
expect 0 report "$name" -o page -q --scene gone/colmap
grep -q 'data:image' $page || fail "no pictures of --scene"
printf '{"iteration": 1e999}\n\377\376\n[]\n{"iteration": "x"}\n{"iteration": 5, "gaussians": 1e300, "loss": null}\n{"itera' >"$name/log.jsonl"
expect 0 report "$name" -o page -q
# Of a long log some iterations are left out, evenly, whatever is logged between them.
awk 'BEGIN { for (i = 1; i <= 2500; i++) printf "{\"filter\": %d}\n{\"iteration\": %d, \"loss\": %f}\n", i, i, 1 / i }' >"$name/log.jsonl"
expect 0 report "$name" -o page -q
points=$(grep -o '<path class=curve d="[^"]*' $page | tr -cd L | wc -c)
[ "$points" -gt 1000 ] || fail "a curve of $points points, expected more than 1000 of 2500"
# Numbers that no axis can have; the size is limited so that an axis without end does not fill the disk.
for psnr in '1e16 10000000000000002' '1e17 1e17' '-1e308 1e308' '5e-324 0'; do
    for number in $psnr; do
        echo "{\"iteration\": 5, \"psnr\": $number, \"loss\": $number}"
    done >"$name/log.jsonl"
    (ulimit -f 20000; timeout 60 "$tool" report "$name" -o page -q) || fail "a PSNR of $psnr"
    grep -qE '[ "=]-?(nan|inf)' $page && fail "PSNR of $psnr: coordinates that are no numbers"
done
rm "$name/log.jsonl"
truncate -s 500M "$name/log.jsonl" # one line, which is not held
if command -v python3 >/dev/null; then
    python3 -c 'import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stderr=subprocess.DEVNULL)
most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
assert most < 300000, "%d KiB" % most' "$tool" report "$name" -o page -q || fail "the memory of a long line"
fi
rm "$name/log.jsonl"
mkfifo "$name/log.jsonl"
timeout 20 "$tool" report "$name" -o page -q || fail "a pipe as log"
rm "$name/log.jsonl"
expect 0 report "$name" -o page -q
grep -q '<svg role=img' $page && fail "curves of nothing"
rm "$name/summary.json"
expect 2 report "$name" -o none; says "$name: found no summary.json: the run is not finished; train --resume continues it"
expect 2 compare "$name"; says 'the run is not finished'
[ ! -e none ] || fail "a report of a run that is not finished left something"
expect 2 compare gone; says 'gone: found no summary.json, expected the folder of a run'
expect 2 compare $page; says "$page: found a file, expected the folder of a run"
expect 2 report gone -o page; says 'gone'
expect 1 report "$name" "$name" -o both; says 'found a folder among several arguments'
mkdir mine && echo mine >mine/report.html
expect 2 report "$name" -o mine
