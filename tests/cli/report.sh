# SPDX-License-Identifier: Apache-2.0
# A report's tables and figures have the numbers of its database, and what is in that is only data.
. "$(dirname "$0")/common.sh"
cat >plan.json <<END
{$plan_engine"pictures": true, "train": ["--iterations", "20", "--init-points", "100", "--log-every", "5"],
 "scenes": {"s": {"synth": ["--width", "48", "--height", "36", "--train-views", "4", "--test-views", "2", "--points", "100", "--samples", "1"]}},
 "photos": {"clean": [], "noise": ["--method", "noise", "--epsilon", "16"]},
 "defenses": {"off": [], "lg": {"prune": ["--finetune", "5"]}, "bad": ["--defense", "spectral", "--band-low", "0.9", "--band-high", "0.5"]}, "models": {"default": []},
 "runs": [{"scenes": ["s"], "photos": ["clean", "noise"], "defenses": ["off", "lg", "bad"], "models": ["default"], "seeds": [1, 2]}]}
END
"$tool" bench plan.json -o r.db -q 2>err
if grep -q 'no SQLite' err || ! command -v sqlite3 >/dev/null; then
    echo "skipped: no SQLite"
    exit 77
fi
ask() { sqlite3 r.db "$1"; }
expect 0 report r.db -o page; says 'results of 12 runs written to page/report.html, report.md and results.csv'
expect 0 report r.db -o page -q
[ ! -s err ] || fail "report -q says something"
for file in report.md results.csv report.html; do [ -s page/$file ] || fail "no $file"; done
[ "$(wc -l <page/results.csv)" -eq 13 ] || fail "the CSV has $(wc -l <page/results.csv) lines, expected 13"
mean=$(ask "select printf('%.2f', avg(value)) from metric join cell using(key) where name='eval.psnr' and photos='noise' and defense='off'")
grep -q "^| off | 2 |.* $mean ± " page/report.md || fail "the tables lack $mean: $(cat page/report.md)"
grep -q '^| bad | 0 of 2 | failed |' page/report.md || fail "a cell without a run does not say so"
grep -q 'plan: s, clean, bad, default, seed 1 | failed | splatguard train: --band-high' page/report.md || fail "no reason for a failure"
grep -qE '(src|href)=|@import|fetch\(' page/report.html && fail "the page refers to something elsewhere"

# Ratios are to the clean run of the same seed.
ratio=$(ask "select printf('%.2f', avg(1.0 * a.value / b.value)) from metric a join cell c using(key) join metric b on b.name=a.name
    join cell d on d.key=b.key and d.seed=c.seed where a.name='max_gaussians' and c.photos='noise' and c.defense='off' and d.photos='clean' and d.defense='off'")
grep -q "^| off | 2 | [0-9]* ± [0-9]* | $ratio ± " page/report.md || fail "not $ratio of the clean runs: $(cat page/report.md)"
grep -qF '| off | 1.00 ± 0.00 | '"$ratio ± " page/report.md || fail "no photos side by side: $(cat page/report.md)"
grep -qF 'photos side by side, over 2 of 2 seeds' page/report.md || fail "no word about the seeds: $(cat page/report.md)"
[ "$(grep -c '^| bad | failed | failed |$' page/report.md)" -eq 3 ] || fail "a cell without a result does not say why: $(cat page/report.md)"
cp r.db ratios.db
sqlite3 ratios.db "update metric set value=(select case when seed=2 then 1000 when photos='clean' then 100 else 300 end from cell c where c.key=metric.key)
    where name='max_gaussians' and key in (select key from cell where defense='off')"
expect 0 report ratios.db -o ratios -q
grep -qF '| off | 1.00 ± 0.00 | 2.00 ± 1.41 |' ratios/report.md || fail "side by side a ratio is not the mean of those of single seeds: $(cat ratios/report.md)"
for row in 'bad | --defense spectral --band-low 0.9 --band-high 0.5' 'lg | prune off: --finetune 5' 's | --width 48 --height 36 --train-views 4 --test-views 2 --points 100 --samples 1'; do
    grep -qF "| $row |" page/report.md || fail "the page lacks the plan's $row"
done
grep -q 'Next to the paper' page/report.md && fail "a scene that is made is none of the paper's"
cp r.db other.db && sqlite3 other.db "update plan set text=replace(text, '20', '21')"
expect 2 report r.db other.db -o x; says 'other.db: found another plan "plan"'
sqlite3 other.db "update job set status='failed', message='no luck' where kind='poison'; delete from job where key in (select key from cell where photos='noise' and defense='bad'); update plan set text=json_set(text, '\$.scenes.s', json('{\"path\": \"s\"}'));
    update cell set scene='lego', photos='eps16' where photos='noise'; update cell set scene='lego' where scene='s'; update plan set text=replace(text, '{\"s\":', '{\"lego\":')"
expect 0 report other.db other.db -o other -q
[ "$(grep -c 'no luck' other/report.md)" -eq 1 ] || fail "a poison twice: $(cat other/report.md)"
grep -q '^| poison | failed | no luck | splatguard attack' other/report.md || fail "no word about a poison that failed: $(cat other/report.md)"
grep -q '^| lego, eps16, off | 2 | .* | 2.35 | 1.00 ± 0.00 | 1.00 | ' other/report.md || fail "not next to the paper: $(cat other/report.md)"
grep -q '"paper":{"psnr":null,"growth":2.348' other/report.html || fail "no diamond"

# Times of runs that had the machine to themselves can be compared, unless they differ in what they ran on.
cp r.db times.db
sqlite3 times.db "update job set alone=1"
expect 0 report times.db -o times -q
grep -q 'times can be compared' times/report.md || fail "no word about times: $(head -4 times/report.md)"
one="key=(select min(c.key) from cell c join metric using(key) where name='threads')"
for change in "job set machine='another' where $one" "job set commit_id='another' where $one" "metric set value=2 where name='threads' and $one"; do
    cp times.db differ.db && sqlite3 differ.db "update $change"
    expect 0 report differ.db -o times -q
    grep -q 'different machines, commits or numbers of threads are not comparable' times/report.md || fail "times are comparable after $change"
    grep -q 'times can be compared' times/report.md && fail "times can be compared after $change"
done

# Photos side by side are of the same seeds: here of the first, since a defense lacks the second.
cp r.db seeds.db
sqlite3 seeds.db "delete from job where key in (select key from cell where defense='lg' and photos='noise' and seed=2); update job set status='failed', message='no pictures' where kind='pictures'"
first="select printf('%.2f', value) from metric join cell using(key) where name='eval.psnr' and defense='off' and seed=1 and photos"
expect 0 report seeds.db -o seeds -q
grep -qF "| off | $(ask "$first='clean'") | $(ask "$first='noise'") |" seeds/report.md || fail "not of the first seed: $(cat seeds/report.md)"
grep -qF 'photos side by side, over 1 of 2 seeds' seeds/report.md || fail "no word about the seed: $(cat seeds/report.md)"
grep -q '^| pictures | failed | no pictures |' seeds/report.md || fail "no word about pictures that failed: $(cat seeds/report.md)"

sqlite3 seeds.db "update plan set text=json_remove(text, '\$.pictures')"
expect 0 report seeds.db -o seeds -q
grep -q 'no pictures' seeds/report.md && fail "pictures that the plan does not ask for"

# Without a seed that all have a share is that of the clean run of its own seed, and the heading says so.
cp r.db differ.db
sqlite3 differ.db "delete from job where key in (select key from cell where (defense='lg' and seed=1) or (defense='off' and photos='noise' and seed=2))"
expect 0 report differ.db -o differ -q
grep -q 'photos side by side, of different seeds' differ/report.md || fail "no word about seeds: $(cat differ/report.md)"
share=$(ask "select printf('%.2f', a.value / b.value) from metric a join cell c using(key) join metric b on b.name=a.name join cell d on d.key=b.key and d.seed=c.seed
    where a.name='max_gaussians' and c.photos='noise' and c.defense='off' and c.seed=1 and d.photos='clean' and d.defense='off'")
grep -qF "| off | 1.00 ± 0.00 | $share |" differ/report.md || fail "not $share of the clean run of its seed: $(cat differ/report.md)"

# Means over the scenes of a preset say which have all that they are of. The third scene lacks the clean run.
cp r.db means.db
for scene in s2 s3; do sqlite3 means.db "insert into cell(plan, position, key, kind, scene, photos, defense, model, seed)
    select plan, position + 100 * substr('$scene', 2), key, kind, '$scene', photos, defense, model, seed from cell where scene='s';
    update plan set text=json_set(text, '\$.scenes.s.preset', 'tt', '\$.scenes.$scene', json('{\"preset\": \"tt\"}'))"; done
sqlite3 means.db "update cell set key='gone' where (scene='s3' and photos='clean' and defense='off') or (scene='s2' and photos='noise' and defense='lg')"
expect 0 report means.db -o over -q
grep -q 'means over 2 of 3 scenes of the preset tt, over 2 of 2 seeds' over/report.md || fail "no means over scenes: $(cat over/report.md)"
[ "$(grep -c '^| lg (1 of these scenes) |' over/report.md)" -eq 3 ] || fail "a mean over fewer scenes does not say so: $(cat over/report.md)"

# The same cells of another configuration are left out.
cp r.db keys.db
sqlite3 keys.db "update cell set key='x' || key where kind is not 'audit'; update job set key='x' || key; update metric set key='x' || key"
expect 0 report r.db keys.db -o keys -q; says 'keys.db: 8 results are left out'
cmp keys/results.csv page/results.csv || fail "another configuration's results are in the report"

# The numbers of a cell are all of one database: the first that has a result of it.
cp r.db again.db
sqlite3 again.db "update metric set value=99 where name='eval.psnr'; update job set machine='another'"
expect 0 report r.db again.db -o again -q
cmp again/results.csv page/results.csv || fail "numbers of another database are in the report"

# What a bench stores meanwhile is in the report as a whole or not at all. The large plan is read between jobs and numbers.
cp r.db busy.db
key=$(ask "select c.key from cell c join job using(key) where status='done' limit 1")
sqlite3 busy.db "insert into plan select 'large', '{\"x\": \"' || hex(zeroblob(5000000)) || '\"}'"
echo "pragma synchronous=off; begin immediate; delete from job where key='$key'; delete from metric where key='$key'; commit" >without.sql
echo "pragma synchronous=off; attach 'r.db' as r; begin immediate; insert into job select * from r.job where key='$key'; insert into metric select * from r.metric where key='$key'; commit" >with.sql
echo >turning
for _ in $(seq 2000); do [ -e turning ] || break; for turn in without with; do sqlite3 -cmd '.timeout 10000' busy.db <$turn.sql; sleep 0.02; done; done >/dev/null 2>&1 &
turns=$!
for turn in 1 2 3 4 5 6; do
    "$tool" report busy.db -o busy -q 2>err || { rm turning; fail "of a database that is in use"; }
    grep -q ',not run,.*,[0-9.]*[0-9]$' busy/results.csv && { rm turning; fail "a run is half there: $(cat busy/results.csv)"; }
    grep -q ',done,.*,,,,,,,,$' busy/results.csv && { rm turning; fail "a result without numbers: $(cat busy/results.csv)"; }
done
rm turning && wait "$turns"

# Other reports may be replaced, other files not.
expect 0 report r.db r.db -o page -q
mkdir mine && echo mine >mine/report.md
expect 2 report r.db -o mine
grep -q mine mine/report.md || fail "another's file is gone"
expect 2 report none.db -o x; says 'none.db'
expect 1 report r.db; says 'missing -o DIR'
echo 'no database at all, but long enough to look at: 0123456789012345678901234567890123456789' >no.db
expect 2 report no.db -o x; says 'no.db: file is not a database'
: >empty.db
expect 2 report empty.db -o x; says 'empty.db: found an empty file'
mkfifo pipe.db # which must not be waited for
expect 2 report pipe.db -o x; says 'pipe.db: found what is no file'
expect 2 bench plan.json -o pipe.db -q; says 'pipe.db: found what is no file'
[ ! -e x ] || fail "a failed report left something"

# Nothing in a stranger's database runs.
for trick in "drop table view; create view view as with recursive n(i) as (select 1 union all select i from n) select i, i, i, i from n" \
    "create trigger endless after insert on cell begin select 1; end" \
    "alter table job add column large generated always as (hex(zeroblob(200000000)))" \
    "create index large on cell(length(hex(zeroblob(1000))))" \
    "pragma writable_schema=on; update sqlite_master set sql=replace(sql, 'signal INT', 'signal INT CHECK(length(hex(zeroblob(1000)))>0)') where name='job'" \
    "pragma writable_schema=on; insert into sqlite_master values('table', 'v', 'v', 0, 'CREATE/**/VIRTUAL TABLE v USING fts5(x)')"; do
    cp r.db trick.db && sqlite3 trick.db "$trick" || fail "no such trick: $trick"
    cp trick.db trick.copy
    expect 2 report trick.db -o x; says 'trick.db: found the '
    expect 2 bench plan.json -o trick.db -q; says 'trick.db: found the '
    cmp trick.db trick.copy || fail "a refused database has changed"
done
[ ! -e x ] || fail "a failed report left something"
cp r.db trick.db && sqlite3 trick.db "update cell set scene=zeroblob(70000000) where position=0"
expect 2 report trick.db -o x; says 'trick.db: string or blob too big'

# Nor do many cells of one job, a picture larger than ours or a long text make a large page of a small database.
cp r.db same.db
key=$(ask "select min(of) from picture where what='render'")
add() { echo "with recursive n(i) as (select 1 union all select i + 1 from n where i < $1) insert into cell(plan, position, key, kind, scene, photos, defense, model, seed)
    select plan, position + 1000 * i, key, kind, scene, photos, 'd' || i, model, seed from n, (select * from cell where key='$key')"; }
sqlite3 same.db "update picture set png=randomblob(case of when '$key' then 200000 else 300000 end) where what='render';
    update job set machine=hex(zeroblob(200000)) where key='$key'; $(add 100)"
expect 0 report same.db -o same -q
[ "$(grep -o '"png":"' same/report.html | wc -l)" -eq 10 ] || fail "expected 8 pictures of the job and 2 photos"
[ "$(cat same/* | wc -c)" -lt 4000000 ] || fail "a large report: $(ls -l same)"
cp r.db trick.db && sqlite3 trick.db "$(add 50000)"
"$tool" report trick.db -o x >out 2>err &
interrupt $!
[ $? -eq 130 ] && grep -q 'cancelled\|interrupted' err || fail "a report of many cells was not interrupted"
[ ! -e x ] || fail "an interrupted report left something"

# Numbers that are too large for what they are.
sed 's/^{/{"threads": 4294967297, /' plan.json >wide.json
expect 2 bench wide.json --list; says 'threads: expected a whole number from 1 to 256'
for seed in 4294967297 -1; do
    sed "s/\\[1, 2\\]/[$seed]/" plan.json >wide.json
    expect 2 bench wide.json --list; says 'seeds[0]: expected a whole number from 0 to 2147483647'
done

# Names are neither formulas nor commands of a terminal.
cp r.db sheet.db && sqlite3 sheet.db "update cell set scene='=1+1' || char(155)"
expect 0 report sheet.db -o sheet -q
grep -q "^plan,'=1+1?," sheet/results.csv || fail "a formula in the CSV: $(cat sheet/results.csv)"
for file in report.md results.csv report.html; do
    LC_ALL=C grep -q "$(printf '\302\233')" sheet/$file && fail "control characters in $file"
done

# Nor are a plan's words headings or lists, and no number is shorter than it is.
for about in '# Heading' '   # Heading' '- item' '1. item' '~~~' '---'; do
    cp r.db words.db && sqlite3 words.db "update plan set text=json_set(text, '\$.about', '$about'); update metric set value=1.5e300 where name='eval.psnr'"
    expect 0 report words.db -o words -q
    shown=$(echo "$about" | sed 's/^ *//; s/[#~.-]/\\&/')
    grep -qxF "$shown" words/report.md || fail "of a plan about '$about' there is no '$shown': $(cat words/report.md)"
done
grep -qF '| off | 1.50e+300 ± ' words/report.md || fail "another number than 1.5e300: $(cat words/report.md)"

# A database that an older version made, without pictures.
sqlite3 r.db ".clone old.db" >/dev/null 2>&1
sqlite3 old.db "pragma application_id=$(ask 'pragma application_id'); pragma user_version=1; drop table picture; drop table spectrum; alter table curve drop column ledger_bytes"
expect 0 report old.db -o old -q
grep -q '"pictures"' old/report.html && fail "pictures from nowhere"
grep -q '"pictures"' page/report.html || fail "no pictures"
# `bench` adds to it what it lacks.
log=$(for log in r.db.work/*/run/log.jsonl; do echo "$log"; done | head -1)
key=${log#r.db.work/} key=${key%%/*}
held=$(sed -n 's/{"iteration": *20,.*"ledger_bytes": *\([0-9]*\).*/\1/p' "$log")
[ "$held" -gt 0 ] || fail "the log says that the library holds '$held' bytes"
sqlite3 old.db "delete from job where key='$key'" && ln -s r.db.work old.db.work
expect 2 bench plan.json -o old.db -q; says ' 1 are done now, 0 failed'
for db in r.db old.db; do
    [ "$(sqlite3 $db "select ledger_bytes from curve where iteration=20 and key='$key'")" = "$held" ] || fail "$db has other memory than the log"
done
[ "$(sqlite3 old.db 'select count(distinct key) from curve where ledger_bytes is not null')" -eq 1 ] || fail "memory from nowhere"
expect 0 report old.db -o old -q
embedded=$(grep -o '"png":"' page/report.html | wc -l)
[ "$embedded" -eq "$(ask "select sum(what='render') + 2 from picture")" ] || fail "$embedded pictures on the page, expected those of each model and two photos"
pictures=$(ask "select count(*) from picture")
while [ "$pictures" -gt 0 ]; do
    pictures=$((pictures - 1))
    ask "select writefile('one.png', png) from picture order by of, what limit 1 offset $pictures" >/dev/null
    base64 -w 0 one.png | grep -qFf - page/report.html || fail "picture $pictures of the database is not on the page"
done

# Names of a stranger's database.
name="</script><img src=x onerror=alert(1)>|\`\"'"
printf "update cell set defense='%s' where defense='off'" "$(printf %s "$name" | sed "s/'/''/g")" | sqlite3 r.db
expect 0 report r.db -o hostile -q
grep -q '<img' hostile/report.html && fail "a name is an element of the page"
grep -q '[^\\]<img' hostile/report.md && fail "a name is an element of the Markdown page"
cp r.db keys.db
key=$(ask "select key from curve limit 1")
for table in cell job metric curve; do
    sqlite3 keys.db "update $table set key=cast(x'ff' as text) where key='$key'" || fail "no such key in $table"
done
expect 0 report keys.db -o hostile -q

# The figures, in a browser, against the database.
browser=$(browser) || { echo "figures not looked at: no Chromium, or sanitizers"; exit 0; }
dom "$browser" page/report.html >dom.html
grep -o 'class="mark" data-value="[^"]*"' dom.html | sed 's/.*="\([^"]*\)"/\1/' | sort -g >drawn
{
    for metric in max_gaussians eval.psnr; do
        ask "select avg(value) from metric join cell using(key) where name='$metric' group by photos, defense"
    done
    ask "select value from metric join cell using(key) where name='eval.psnr'"
    ask "select gaussians from curve c join cell using(key) where iteration=20"
    ask "select instances from curve c join cell using(key) where iteration=20"
    ask "select ledger_bytes / 1e6 from curve c join cell using(key) where iteration=20"
    # The photos are those of the runs without a defense.
    shown="from spectrum s join cell on of=key where (what='render' or defense<>'lg') and" # `off` has a stranger's name now
    ask "select log10(value) $shown s.kind='radial' and bin=48"
    ask "select value $shown s.kind='angular' and bin=18"
} >means
sort -g means >expected
[ "$(ask "select count(*) from spectrum where kind='angular' and bin=18")" -eq 8 ] || fail "not all models have spectra"
[ "$(grep -c '<img src="data:image/png;base64,' dom.html)" -ge 1 ] || fail "the page has no crops"
page_look page/report.html
paste drawn expected | awk 'NF != 2 || ($1 - $2) ^ 2 > (1e-4 * $2) ^ 2 { bad = 1; print } END { exit bad }' ||
    fail "the figures have other values than the database"

# With more defenses than colours as many are ticked as there are; a mark for each of those. dB have the whole height.
cp r.db many.db
for i in $(seq 30); do sqlite3 many.db "insert into cell(plan, position, key, kind, scene, photos, defense, model, seed)
    select plan, position + 1000 * $i, key, kind, scene, photos, 'd$i', model, seed from cell where defense='lg'"; done
expect 0 report many.db -o many -q
# Names and numbers of any length are on the page as a whole.
cp r.db wide.db
sqlite3 wide.db "update cell set defense='a-defense-with-a-long-name' where defense='lg'; update curve set iteration=1000 * iteration"
expect 0 report wide.db -o wide -q
page_look wide/report.html
dom "$browser" many/report.html >many.html
command -v python3 >/dev/null && { python3 "$source_dir/tests/cli/report_choose.py" "file://$work/many/report.html" || fail "the choice"; }
figure() { tr -d '\n' <many.html | grep -o "<figure id=\"$1\".*" | sed 's/<\/figure>.*//'; }
[ "$(grep -o '<input type="checkbox"' many.html | wc -l)" -eq 32 ] || fail "not a box for each defense that has results"
[ "$(grep -o 'background: rgb' many.html | sort | uniq -c | awk '{ print $1 }')" -eq 20 ] || fail "not 20 ticked"
[ "$(figure quality | grep -o '<circle' | wc -l)" -eq 40 ] || fail "not a point for each defense that is ticked"
[ "$(figure gaussians | grep -o 'fill: #[0-9a-f]*' | sort -u | wc -l)" -eq 20 ] || fail "two defenses with one colour"
figure quality | grep -o 'cy="[^"]*"' | tr -dc '0-9.\n' | sort -g | awk 'NR == 1 { a = $1 } END { exit $1 - a < 150 }' || fail "dB from 0"

# Names that begin as others do are their own.
cp r.db begin.db
sqlite3 begin.db "update cell set photos='noise, small' where photos='clean'"
expect 0 report begin.db -o begin -q
dom "$browser" begin/report.html >begin.html
for photos in 'noise' 'noise, small'; do
    [ "$(grep -o ">$photos, the photos: " begin.html | wc -l)" -eq 2 ] || fail "not one spectrum of each kind of $photos"
done

# Energies far below 1 stay below the top of the figure.
cp r.db dark.db
sqlite3 dark.db "update spectrum set value=1e-9 * value where kind='radial'"
expect 0 report dark.db -o dark -q
dom "$browser" dark/report.html >dark.html
tr -d '\n' <dark.html | grep -o '<figure id="radial".*' | sed 's/<\/figure>.*//' | grep -o '<path d="M[^"]*" fill="none"' |
    grep -o '[0-9.-]\+ [0-9.-]\+' | awk '{ n++ } $2 < 16 { above++ } END { exit !n || above }' || fail "a curve leaves its figure"

# Curves of more points than a call may have arguments.
cp r.db long.db
sqlite3 long.db "with recursive n(i) as (select 100 union all select i + 1 from n where i < 150000)
    insert into curve select key, i, 5, 1, 20, 5, 1, 5 from n, (select key from curve limit 1)"
expect 0 report long.db -o long -q
dom "$browser" long/report.html >long.html
tr -d '\n' <long.html | grep -q '<figure id="memory"><svg' || fail "no figures of a long run"
