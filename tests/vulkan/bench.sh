# SPDX-License-Identifier: Apache-2.0
# Plans and reports with SG_TEST_ENGINE, as `engine` of a plan: a short form of tests/cli/bench.sh, smoke.sh and report.sh,
# which take too long on a driver for the CPU.
. "$(dirname "$0")/../cli/common.sh"
cat >plan.json <<END
{"engine": "$SG_TEST_ENGINE", "pictures": true, "audit": true,
 "train": ["--iterations", "12", "--init-points", "100", "--log-every", "4"],
 "scenes": {"s": {"synth": ["--width", "32", "--height", "24", "--train-views", "4", "--test-views", "2", "--points", "100", "--samples", "1"]}},
 "photos": {"clean": [], "eps16": ["--epsilon", "16", "--iterations", "4", "--inner", "2"]},
 "defenses": {"off": [], "lg": {"prune": ["--finetune", "4", "--trained", "12"]}, "cpu": ["--engine", "cpu"]},
 "models": {"default": []},
 "runs": [{"scenes": ["s"], "photos": ["clean", "eps16"], "defenses": ["off"], "models": ["default"], "seeds": [1]},
          {"scenes": ["s"], "photos": ["eps16"], "defenses": ["lg", "cpu"], "models": ["default"], "seeds": [1]}]}
END
if "$tool" bench plan.json -o scene/none.db 2>&1 | grep -q 'no SQLite' || ! command -v sqlite3 >/dev/null; then
    echo "skipped: no SQLite"
    exit 77
fi
expect 0 bench plan.json -o r.db -q; says ' 0 failed, 0 need one of these, 0 are left'
engines() { sqlite3 r.db "select count(*) from job where kind in ('proxy', 'poison', 'train', 'prune', 'pictures') and command like '%--engine $1%'"; }
[ "$(engines "$SG_TEST_ENGINE")" -eq 10 ] && [ "$(engines cpu)" -eq 1 ] ||
    fail "$(engines "$SG_TEST_ENGINE") jobs have the plan's engine, expected 10, and $(engines cpu) their own, expected 1"
ran() { sqlite3 r.db "select engine from job join cell using(key) where defense='$1' and photos='eps16'"; }
[ "$(ran cpu)" != "$(ran off)" ] || fail "the database has the engine $(ran off) for both"
expect 0 bench plan.json -o r.db -q; says ' 0 are done now'
expect 0 report r.db -o page -q
grep -q '^4 of 4 runs are done' page/report.md || fail "not all runs are done: $(head -5 page/report.md)"
