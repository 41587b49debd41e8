# SPDX-License-Identifier: Apache-2.0
# scripts/tables fills pages from TSV files, and notices pages and files that do not fit; bench/overview.py.
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
    cp "$source_dir"/bench/results/evening.tsv "$source_dir"/bench/results/tolerance.tsv side/results
    python3 side/overview.py || fail "bench/overview.py failed"
    for table in side/results/*-*.tsv; do
        cmp "$table" "$source_dir/bench/results/${table##*/}" || fail "bench/overview.py writes another $table"
    done
fi
