# SPDX-License-Identifier: Apache-2.0
# scripts/tables fills pages from TSV files, and notices pages and files that do not fit; bench/overview.py and desk.py.
. "$(dirname "$0")/common.sh"
mkdir -p scripts docs/design bench/results
cp "$source_dir/scripts/tables" scripts
page=docs/page.md

# tables STATUS [--check]
tables() {
    code=$1; shift
    scripts/tables "$@" >out 2>err
    got=$?
    [ $got -eq "$code" ] || fail "scripts/tables $*: exit code $got, expected $code"
}
# marker TEXT: a page with one table
marker() { printf '# Page\n\n<!-- table: %s -->\nold\n<!-- end -->\n\nText.\n' "$1" >$page; }

printf '# Read me\n' >README.md
printf 'name\tGaussians\tPSNR, dB\toptions\tcommit\tmachine\n' >bench/results/runs.tsv
printf 'a\t1234567\t30.1\t\t5252453\tone\nb\t*998\t\t-w\tabc1234\tone\n' >>bench/results/runs.tsv

marker runs
tables 1 --check
grep -q '^old$' $page || fail "--check changed the page"
tables 0
cat >expected <<'END'
# Page

<!-- table: runs -->

| name | Gaussians | PSNR, dB | options | commit | machine |
|---|---:|---:|---|---|---|
| a | 1 234 567 | 30.1 |  | 5252453 | one |
| b | **998** |  | `-w` | abc1234 | one |

<!-- end -->

Text.
END
cmp $page expected || fail "the table is not as expected"
tables 0 --check
sed -i 's/30.1/30.2/' bench/results/runs.tsv
tables 1 --check
grep -q "$page" out || fail "--check does not name the page"

marker 'runs: PSNR, dB; name; machine'
tables 0
grep -qF '| PSNR, dB | name | machine |' $page || fail "the columns are not those asked for"

marker 'runs: PSNR'
tables 1
says 'no column "PSNR"'
marker runs
printf 'c\t1\n' >>bench/results/runs.tsv
tables 1
says 'runs.tsv:4: found 2 cells, expected 6'
sed -i '$d' bench/results/runs.tsv
sed -i '/end -->/d' $page
tables 1
says 'no <!-- end -->'
grep -q '^Text.$' $page || fail "a page without an end lost its text"
marker other
tables 1
says 'cannot read bench/results/other.tsv'
grep -q 'runs.tsv: no page shows it' out || fail "a file that no page shows is not reported"

# The tables that set measurements side by side are of the rows that are committed.
if command -v python3 >/dev/null; then
    mkdir side
    cp "$source_dir"/bench/overview.py side
    mkdir side/results
    for table in evening tolerance desk desk-limits; do
        cp "$source_dir/bench/results/$table.tsv" side/results
    done
    python3 side/overview.py || fail "bench/overview.py failed"
    for table in side/results/*-*.tsv; do
        cmp "$table" "$source_dir/bench/results/${table##*/}" || fail "bench/overview.py writes another $table"
    done

    # bench/desk.py puts the runs of a database into the tables.
    mkdir -p side/plans side/data/made
    cp "$source_dir/bench/desk.py" side
    rm side/results/*
    cat >side/plans/desk.json <<'end'
{"scenes": {"made": {"path": "made"}}, "photos": {"clean": [], "eps8": []}, "defenses": {"off": [], "cap": [], "half": []},
 "runs": [{"photos": ["clean", "eps8"], "defenses": ["off", "cap"]}, {"photos": ["clean"], "defenses": ["off"]},
          {"photos": ["clean"], "defenses": ["half"]}]}
end
    python3 - <<'end'
import sqlite3

db = sqlite3.connect("side/results.db")
db.execute("CREATE TABLE job(key, kind, status, commit_id)")
db.execute("CREATE TABLE cell(key, scene, photos, defense, seed)")
db.execute("CREATE TABLE metric(key, name, value)")
for key, photos, defense, seed, status, values in (
        ("a", "clean", "off", 1, "done", (100, 90, 30.0, 0.9, 2e6, 50)),
        ("b", "clean", "off", 2, "done", (300, 110, 31.0, 0.8, 4e6, 50)),
        ("c", "eps8", "off", 1, "done", (400, 400, 20.0, 0.5, 8e6, 50)),
        ("d", "eps8", "cap", 1, "done", (200, 200, 21.0, 0.5, 8e6, 20)),
        ("e", "clean", "half", 1, "done", (100, 100, 29.0, 0.9, 8e6, 50)),
        ("f", "clean", "cap", 1, "failed", ())):
    db.execute("INSERT INTO job VALUES(?, 'train', ?, '0123456789')", (key, status))
    db.execute("INSERT INTO cell VALUES(?, 'made', ?, ?, ?)", (key, photos, defense, seed))
    names = ("max_gaussians", "final_gaussians", "eval.psnr", "eval.ssim", "peak_ledger_bytes", "steps")
    for name, value in (*zip(names, values), ("iterations", 50)):
        db.execute("INSERT INTO metric VALUES(?, ?, ?)", (key, name, value))
db.commit()
end
    for time in first second; do
        python3 side/desk.py side/results.db here side/data || fail "bench/desk.py failed the $time time"
        sed 1d side/results/desk.tsv | tr '\t' ';' >got
        cat >expected <<'end'
made;clean;off;2;200;1.00;100;30.50;;0.850;3;0123456;here
made;eps8;off;1;400;2.00;400;20.00;;*0.500;8;0123456;here
made;eps8;cap;1;200;1.00;200;*21.00;;*0.500;;0123456;here
end
        cmp expected got || fail "bench/desk.py wrote the $time time: $(cat got)"
        [ "$(sed 1d side/results/desk-limits.tsv | cut -f 2,3,6,8)" = "$(printf 'clean\thalf\t0.50\t29.00')" ] ||
            fail "bench/desk.py wrote: $(cat side/results/desk-limits.tsv)"
    done
    cp side/results/desk.tsv whole
    python3 -c 'import sqlite3; db = sqlite3.connect("side/results.db"); db.execute("DELETE FROM cell WHERE key != ?", "d"); db.commit()'
    python3 side/desk.py side/results.db here side/data || fail "bench/desk.py knows no clean count"
    cmp whole side/results/desk.tsv || fail "bench/desk.py loses rows of which a database has no runs"
    rm side/results/*
    python3 side/desk.py side/results.db here side/data 2>err && fail "bench/desk.py made up a clean count"
    says 'found a run of made, eps8, cap'
fi
