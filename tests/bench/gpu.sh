# SPDX-License-Identifier: Apache-2.0
# bench/gpu, as it will run on a GPU: a minute of it on the engine's driver for the CPU, and what it says of tests that fail
# or whose bytes differ.  SOURCE BUILD DEVICE WORK come from CTest.
set -u
source_dir=$1 build=$2 device=$3 work=$4
rm -rf "$work" && mkdir -p "$work" && cd "$work" || exit 1
fail() { echo "FAILED: $*" >&2; tail -n 20 out >&2; exit 1; }
gpu() { env -u SG_TEST_ENGINE bash "$source_dir/bench/gpu" "$@" >out 2>&1; }
# Every row of a table has as many cells as its header.
whole() { awk -F'\t' 'NR == 1 { cells = NF } NF != cells { bad = 1 } END { exit bad || NR < 2 }' "$1" || fail "rows of $1: $(cat "$1")"; }

BUILD=$build gpu "$device" dry --dry-run || fail "exit status $?"
whole dry/tests.tsv
whole dry/runs.tsv
# Two rounds of programs with bytes, one of scripts.
awk -F'\t' 'NR > 1 { n[$2]++; bad += $4 != 0; bytes[$2] = $5 }
    END { exit !(n["changes"] == 2 && n["devices"] == 2 && n["exit_status.sh"] == 1 && !bad &&
                 bytes["changes"] ~ /^[0-9a-f]+$/ && length(bytes["changes"]) == 16) }' dry/tests.tsv || fail "$(cat dry/tests.tsv)"
[ "$(cut -f 1 dry/runs.tsv | tr '\n' ' ')" = 'run short-1 short-2 dry dry-defended dry-device dry-cpu ' ] || fail "$(cat dry/runs.tsv)"
grep -q '^| raster backward |' dry/stages.md && [ -s dry/stages.csv ] || fail "no stages"
grep -Eq '^dry-defended: [0-9.]+ times the seconds of dry$' dry/summary.txt || fail "no time of a defense: $(cat dry/summary.txt)"
grep -Eq '^nothing: [0-9.]+ s, [0-9.]+ times dry, exit status 0' dry/summary.txt || fail "no ratio: $(cat dry/summary.txt)"
grep -Eq '^PSNR after 12 iterations, device less CPU: -?0\.0[0-9]+ dB' dry/summary.txt || fail "no difference: $(cat dry/summary.txt)"
grep -q '^all equal, nothing failed' dry/summary.txt && [ -s dry/beside-nothing.log ] || fail "$(cat dry/summary.txt)"

# Every test that the build lists is there.
while IFS="$(printf '\t')" read -r name path; do
    [ -x "$build/$path" ] || [ -f "$source_dir/$path" ] || fail "test $name: no $path"
done <"$build/device-tests"

# A build in which one test has other bytes each time, one fails in the second round, and one is skipped.
mkdir fake
cat >fake/splatguard <<'END'
#!/bin/sh
[ "$1" != info ] || echo 'vulkan:0 fake'
END
echo 'echo "9 Gaussians, fake: 1 ms an iteration"' >fake/bench
echo 'date "+bytes %s%N of 3 results"' >fake/test_drifts
cat >fake/test_breaks <<'END'
echo >>again
echo "bytes abc of 3 results"
[ "$(wc -l <again)" -lt 2 ]
END
echo 'exit 77' >fake/test_skips
printf 'drifts\ttest_drifts\nbreaks\ttest_breaks\nskips\ttest_skips\n' >fake/device-tests
chmod +x fake/*
! BUILD=fake gpu 0 differs --rounds 2 || fail "exit status 0 for tests that fail"
whole differs/tests.tsv
grep -q '^FAILED: drifts in round 2: bytes [0-9]*, before [0-9]*$' out || fail "other bytes"
grep -q '^FAILED: breaks in round 2: exit status 1, see failed-2-breaks.log$' out && [ -f differs/failed-2-breaks.log ] || fail "a failure"
[ "$(grep -c '^FAILED' out)" = 2 ] || fail "found $(grep -c '^FAILED' out) failures, expected 2"
! grep -q 'nothing failed' differs/summary.txt || fail "nothing failed"
! BUILD=fake gpu 0 differs || fail "a folder that is there"
! BUILD=fake gpu 0 other --tests || fail "an option without a value"
