# SPDX-License-Identifier: Apache-2.0
# Audits of a plan's photos are in its database; their curves have the numbers of a naive computation.
. "$(dirname "$0")/common.sh"
cat >plan.json <<END
{$plan_engine"audit": true, "train": ["--iterations", "10", "--init-points", "50"],
 "scenes": {"a": {"synth": ["--width", "48", "--height", "36", "--train-views", "6", "--test-views", "2", "--points", "50", "--samples", "1"]},
            "b": {"synth": ["--width", "64", "--height", "48", "--train-views", "5", "--test-views", "1", "--points", "50", "--samples", "1"], "size": ["--downscale", "2"]}},
 "photos": {"clean": [], "noise": ["--method", "noise", "--epsilon", "16"]},
 "defenses": {"off": []}, "models": {"default": []},
 "runs": [{"scenes": ["a", "b"], "photos": ["clean", "noise"], "defenses": ["off"], "models": ["default"], "seeds": [1, 2]}]}
END
"$tool" bench plan.json -o r.db -q 2>err
if grep -q 'no SQLite' err || ! command -v sqlite3 >/dev/null; then
    echo "skipped: no SQLite"
    exit 77
fi
says ' 0 failed, 0 need one of these, 0 are left'
ask() { sqlite3 r.db "$1"; }
[ "$(ask "select count(*), count(distinct key), min(defense || model), sum(seed) from cell where kind='audit'")" = '4|4||0' ] || fail "the audits are $(ask "select * from cell where kind='audit'")"
[ "$(ask 'select count(*) from audit')" -eq 22 ] || fail "not the training photos of each kind"
[ "$(ask "select count(*) from metric join cell using(key) where kind='audit' and name='score'")" -eq 4 ] || fail "no scores of sets"
ask "select command from job where kind='audit'" | grep -c -- '--downscale' >scaled
[ "$(cat scaled)" -eq 1 ] || fail "$(cat scaled) audits scale photos, expected the clean ones of b: a poison is small already"
expect 0 report r.db -o page -q
grep -q '^8 of 8 runs are done' page/report.md || fail "audits count as runs: $(head -4 page/report.md)"
grep -q '^| all scenes, noise |' page/report.md || fail "no row of all scenes"

# Of another configuration they are left out, as runs are.
cp r.db other.db
sqlite3 other.db "update cell set key='x' || key where kind='audit'; update job set key='x' || key where kind='audit'; update audit set key='x' || key"
expect 0 report r.db other.db -o other -q; says 'other.db: 4 results are left out'
cmp other/report.md page/report.md || fail "photos count twice: $(grep '^| .*, noise |' other/report.md)"

# The same as the command says; an audit that failed says so.
sed 's/"audit": true/"audit": 1/' plan.json >bad.json
expect 2 bench bad.json -o x.db; says 'audit: expected true or false'
command -v python3 >/dev/null || exit 0
key=$(ask "select key from cell where kind='audit' and scene='a' and photos='noise'")
python3 - r.db "$key" "$tool" <<'END' || fail "the database has something else than audit --json"
import json, sqlite3, subprocess, sys
db = sqlite3.connect(sys.argv[1])
words = db.execute("select command from job where key=?", sys.argv[2:3]).fetchone()[0].split(" ")
said = json.loads(subprocess.run([sys.argv[3], *words[1:]], check=True, stdout=subprocess.PIPE).stdout)
kept = db.execute("select name, score, verdict, tau, tau_error from audit where key=? order by position", sys.argv[2:3]).fetchall()
assert kept == [tuple(i[k] for k in ("name", "score", "verdict", "tau", "tau_error")) for i in said["images"]], kept
END

# Ties, a photo without a score, and photos of both kinds above each other.
ask "update audit set score=(position * 37 % 5) / 4.0, verdict=case when (position * 37 % 5) > 3 then 'poisoned' when (position * 37 % 5) > 1 then 'suspicious' else 'clean' end
     where key in (select key from cell where photos='noise')"
ask "update audit set score=(position % 4) / 4.0, verdict=case when position % 4 > 2 then 'suspicious' else 'clean' end
     where key in (select key from cell where photos='clean')"
ask "update audit set score=null, verdict='unseen' where key='$key' and position=2"
expect 0 report r.db -o page -q
cat >naive.py <<'END'
"""Areas by pairs of photos, and the bootstrap, of each row; with the page's marks: what they say of the shares."""
import json, re, sqlite3, sys

mask = (1 << 64) - 1

def sample(state):
    state[0] = x = (state[0] + 0x9e3779b97f4a7c15) & mask
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9 & mask
    x = (x ^ x >> 27) * 0x94d049bb133111eb & mask
    return (x ^ x >> 31) >> 32

def area(photos, clean):
    return sum((p > c) + (p == c) / 2 for p in photos for c in clean) / (len(photos) * len(clean))

def height(photos, clean, share):
    """The highest point of the curve there: lines between the points of its thresholds."""
    points = [(0, 0)] + [(sum(c >= t for c in clean) / len(clean), sum(p >= t for p in photos) / len(photos))
                         for t in sorted({*photos, *clean}, reverse=True)]
    best = 0
    for (x, y), (u, v) in zip(points, points[1:]):
        if x <= share <= u:
            best = max(best, v if u == x else y + (share - x) / (u - x) * (v - y))
    return best

db = sqlite3.connect(sys.argv[1])
page = open(sys.argv[2] + "/report.html").read()
drawn = {a["scene"]: a for a in json.loads(re.search("id=audits>(.*?)</script>", page).group(1))}
for scene in ("a", "b", "all scenes"):
    lists = {}
    for kind in ("noise", "clean"):
        rows = db.execute("select score, verdict from audit join cell using(key) where photos=? and scene in (?, ?) and score is not null",
                          (kind, *(("a", "b") if scene == "all scenes" else (scene, scene)))).fetchall()
        lists[kind] = sorted((r[0] for r in rows), reverse=True)
        share = lambda *verdicts: sum(r[1] in verdicts for r in rows) / len(rows)
        row = re.search(r"^\| %s, %s \|.*" % (scene, kind), open(sys.argv[2] + "/report.md").read(), re.M).group().split(" | ")
        want = ["%d" % len(rows), *("%.0f" % (100 * share(v)) for v in ("poisoned", "suspicious", "clean"))]
        assert row[2:6] == want, (row, want)
        if scene in drawn:
            got = [m[kind == "noise"] for m in drawn[scene]["marks"]]
            assert max(abs(g - w) for g, w in zip(got, (share("poisoned"), share("poisoned", "suspicious")))) < 1e-6, got
        if kind == "noise":
            said = row[6:]
    photos, clean, state = lists["noise"], lists["clean"], [0]
    samples = []
    for _ in range(1000):
        samples.append(([photos[sample(state) * len(photos) >> 32] for _ in photos],
                        [clean[sample(state) * len(clean) >> 32] for _ in clean]))
    areas = sorted(area(*s) for s in samples)
    want = ["%.3f" % area(photos, clean), "%.3f to %.3f |" % (areas[24], areas[975])]
    assert said == want, (said, want)
    if scene in drawn:
        points = [[sum(x >= t for x in l) / len(l) for l in (clean, photos)] for t in sorted({*photos, *clean}, reverse=True)]
        assert all(abs(g - w) < 1e-6 for a, b in zip(drawn[scene]["points"], [[0, 0], *points]) for g, w in zip(a, b)), drawn[scene]["points"]
        assert len(drawn[scene]["points"]) == len(points) + 1
        for k in range(0, 51, 5):
            heights = sorted(height(*s, k / 50) for s in samples)
            assert all(abs(g - w) < 1e-6 for g, w in zip(drawn[scene]["band"][k], (heights[24], heights[975]))), (k, drawn[scene]["band"][k])
assert len(drawn) == 2
END
python3 naive.py r.db page || fail "other curves than the naive ones"

# Parts of a plan: clean photos can be in another database than the others.
cp r.db noise.db && sqlite3 noise.db "delete from cell where photos='clean'"
cp r.db clean.db && sqlite3 clean.db "delete from cell where photos='noise'"
expect 0 report noise.db clean.db -o parts -q
for folder in page parts; do grep -E '^\| (a|b|all scenes), (clean|noise) \| ' $folder/report.md | sort >$folder.rows; done
[ -s page.rows ] && cmp page.rows parts.rows || fail "parts of a plan have other curves: $(cat parts.rows)"

# Many cells of one audit do not make a large page of a small database: eight have its photos.
cp r.db same.db
sqlite3 same.db "with recursive n(i) as (select 1 union all select i + 1 from n where i < 30)
    insert into cell select plan, position + 1000 * i, key, kind, scene, 'noise' || i, defense, model, seed from cell, n where kind='audit' and photos='noise' and scene='a'"
expect 0 report same.db -o same -q
[ "$(grep -c '^| a, noise[0-9]* | [a-z]* | [1-9]' same/report.md)" -eq 8 ] || fail "not 8 audits with photos: $(grep '^| a, noise' same/report.md)"

# What failed says so, without clean photos there is no curve, and names are only text.
ask "update job set status='failed' where key='$key'; delete from audit where key='$key'"
ask "delete from audit where key in (select key from cell where photos='clean' and scene='b')"
ask "update cell set photos='<img src=x>|' where photos='noise'"
expect 0 report r.db -o failed -q
grep -q '^| a, \\<img src=x\\>\\| | failed |' failed/report.md || fail "a failed audit does not say so"
grep -q '^| b, .*| no clean photos |$' failed/report.md || fail "a comparison without clean photos does not say so"
grep -q '<img src=x' failed/report.html && fail "a name is an element"
ask 'drop table audit'
expect 0 report r.db -o without -q
grep -q 'verdicts of the audit' without/report.md && fail "audits from nowhere"

# Ctrl-C while the bootstrap of many photos takes its time.
cp clean.db many.db
sqlite3 many.db "insert into cell select * from (select plan, position + 1000, key, kind, scene, 'noise', defense, model, seed from cell where kind='audit' and photos='clean');
    with recursive more(n) as (select 1 union all select n + 1 from more where n < 20000)
    insert into audit select key, position + 100 * n, name, score, verdict, tau, tau_error from audit, more"
"$tool" report many.db -o stopped >out 2>err &
interrupt $!
[ $? -eq 130 ] && says 'interrupted' || fail "a report was not interrupted"
[ ! -e stopped ] || fail "an interrupted report left $(ls -A stopped)"

# The figure, in a browser.
browser=$(browser) || { echo "figure not looked at: no Chromium, or sanitizers"; exit 0; }
dom "$browser" page/report.html >dom.html
grep -o '<figure id="roc">.*' dom.html | sed 's/<\/figure>.*//' >figure.html
[ "$(grep -o 'class="mark" data-value' figure.html | wc -l)" -eq 2 ] || fail "not two marks of the audit's thresholds: $(cat figure.html)"
grep -q '<title>noise: 40 % of 5 called poisoned or suspicious, 17 % of 6 clean ones; AUC ' figure.html || fail "the marks say something else: $(cat figure.html)"
page_look page/report.html
