# SPDX-License-Identifier: Apache-2.0
# The plan `smoke` from nothing to its page: every kind of job and defense.
. "$(dirname "$0")/common.sh"
plan=$source_dir/bench/plans/smoke.json
if [ -n "${SG_TEST_ENGINE-}" ]; then # smaller and shorter
    sed 's/"about"/'"$plan_engine"'&/; s/"96"/"32"/; s/"72"/"24"/; s/"--iterations", "60"/"--iterations", "6"/; s/"300"/"40"/g
        s/"--sh-interval", "60"/"--sh-interval", "8"/; s/"200"/"28"/; s/"--opacity-reset-interval", "100"/"--opacity-reset-interval", "14"/
        s/"--densify-from-iter", "30", "--densification-interval", "20"/"--densify-from-iter", "6", "--densification-interval", "4"/
        s/"--finetune", "60"/"--finetune", "12"/' "$plan" >smoke.json
    plan=smoke.json
fi
"$tool" bench "$plan" -o smoke.db -q 2>err
if grep -q 'no SQLite' err; then
    echo "skipped: no SQLite"
    exit 77
fi
says ' 0 failed, 0 need one of these, 0 are left'
expect 0 report smoke.db -o page -q
grep -q '^21 of 21 runs are done' page/report.md || fail "not all runs are done: $(head -5 page/report.md)"
for defense in off ut cap-random smooth-gaussian lightgaussian pup spectral tolerance; do
    [ "$(grep -c "^| $defense | [12] | [1-9]" page/report.md)" -ge 2 ] || fail "no result of $defense"
done
grep -q '^| 0.50, cap-random, eps16 | 1 |' page/report.md || fail "no table of limits"
for photos in eps16 noise16; do
    grep -qE "^\| room, $photos \| (clean|suspicious|poisoned) \| 12 \|.* [01]\.[0-9]{3} \| [01]\.[0-9]{3} to [01]\.[0-9]{3} \|\$" page/report.md || fail "no audit of $photos"
done
# The other plans can be read; they need photos.
for plan in attackers desk evening paper times tolerance; do
    expect 2 bench "$source_dir/bench/plans/$plan.json" --data . --list; says 'found no file in'
done
