# SPDX-License-Identifier: Apache-2.0
# The benchmark of stages: every stage has a time, a floor and a row of the CSV file; parts and kernels of a device, and what
# it says where there is no such part; and how the scripts around it are called.  BENCH ENGINE WORK come from CTest.
set -u
bench=$1 engine=$2 work=$3
rm -rf "$work" && mkdir -p "$work" && cd "$work" || exit 1
fail() { echo "FAILED: $*" >&2; sed 's/^/  /' out err >&2; exit 1; }
run() { "$bench" --engine "$engine" --gaussians 400 --side 32 --rounds 1 "$@" >out 2>err; }

run --defense --csv stages.csv || fail "exit status $?"
grep -q '^400 Gaussians, 32x32, .* an iteration, of which the calling thread works' out || fail "no iteration"
grep -qE ': copies of [0-9.]+ GB/s, [0-9]+ G multiply-adds/s' out || fail "no rates"
for stage in project bin raster loss 'raster backward' update statistics anisotropy 'total variation' tolerance hits; do
    # A difference of two times may be negative; all others are not 0, nor is what a stage has to do and its floor.
    awk -F' *[|] *' -v stage="$stage" '$2 == stage { found = 1
            good = ($3 + 0 > 0 || stage == "statistics" || stage == "tolerance") && $4 + 0 > 0 && $5 + 0 > 0 && $8 + 0 > 0
        }
        END { exit !(found && good) }' out || fail "stage $stage"
    awk -F, -v stage="$stage" 'NR == 1 { columns = NF } $6 == stage { found += NF == columns && $8 > 0 && $10 > 0 && $13 > 0 }
        END { exit found != 1 }' stages.csv || fail "stage $stage in the CSV file"
done
[ "$(wc -l <stages.csv)" = 12 ] || fail "$(wc -l <stages.csv) lines of CSV, expected 12"

run --csv no/stages.csv && fail "a CSV file in no folder"
grep -q 'no/stages.csv: ' err || fail "no word about a CSV file in no folder"
if [ -w /dev/full ]; then
    run --csv /dev/full && fail "a CSV file on a full disk"
    grep -q '/dev/full: ' err || fail "no word about a full disk"
fi
timeout 60 "$bench" --quick --csv no/all.csv >out 2>err && fail "a CSV file in no folder"
grep -q 'no/all.csv: ' err || fail "no word about a CSV file in no folder"
for none in "--gaussians 0" "--gaussians -1" "--side 0" "--rounds 0" "--rounds 2x" "--threads -1"; do
    # shellcheck disable=SC2086 # two words
    run $none && fail "$none"
    grep -q '^usage: ' err || fail "no word about $none"
done
for engine_only in "--rounds 1" "--gaussians 400" "--side 32" --defense --parts --kernels "--without raster.pairs"; do
    # shellcheck disable=SC2086 # two words
    timeout 60 "$bench" --quick $engine_only >out 2>err && fail "$engine_only without --engine"
    grep -q '^usage: ' err || fail "no word about $engine_only without --engine"
done

for name in anchors audit formats growth opensplat parity poisons record stages; do
    bash "$(dirname "$0")/../../bench/$name.sh" >out 2>err && fail "$name.sh without arguments"
    grep -q "bench/$name.sh [A-Z]" err || fail "no usage of $name.sh"
done

if [ "${engine%%:*}" != vulkan ]; then
    run || fail "exit status $?"
    ! grep -q '^| hits' out || fail "the defense was not asked for"
    ! run --without raster.pairs && grep -q 'has no kernels that parts can be left out of' err || fail "parts of engine $engine"
    exit 0
fi
! run --without raster.pairs,raster.nothing && grep -q 'found no part "raster.nothing", expected some of: project.colours ' err ||
    fail "a part that is not there"
run --without raster.pairs,learn.steps --parts --kernels || fail "exit status $?"
! grep -q '^| hits' out || fail "the defense was not asked for"
grep -q 'results that are wrong: raster.pairs,learn.steps' out || fail "it does not say that parts are left out"
[ "$(grep -cE '^\| (project|raster|raster_backward|learn)\.[a-z]+ \|' out)" = 9 ] || fail "not all parts"
# 4 + 1 or 2 passes of the sorts, and every kernel takes some time.
awk -F' *[|] *' '/^. kernel/ { table = 1 } table && $2 ~ /^[a-z_]+$/ && $2 != "kernel" { n[$2] = $3; zero += !($4 + 0 > 0) }
    END { exit !(n["raster"] == 1 && n["learn"] == 1 && n["radix_count"] >= 5 && n["radix_count"] <= 6 && !zero) }' out ||
    fail "kernels"
