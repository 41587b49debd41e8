# SPDX-License-Identifier: Apache-2.0
# An interrupted and resumed run ends with the bytes of an uninterrupted one.
. "$(dirname "$0")/common.sh"
small_scene
options=$(once $short --eval --init-points 500 --iterations 6000 --save-every 0 --eval-every 0)

"$tool" train scene/blender -o cut $options 2>err &
pid=$!
wait_for cut/log.jsonl
sleep 0.3
interrupt $pid
code=$?
[ $code = 130 ] || fail "interrupted: exit code $code, expected 130"
says 'train --resume cut'
grep -q '"interrupted": true' cut/summary.json || fail "summary.json does not say interrupted"
[ -s cut/checkpoint.bin ] || fail "nothing saved"
reached=$(sed -n 's/.*"iterations": \([0-9]*\).*/\1/p' cut/summary.json)

# A reader that goes away costs nothing.
"$tool" train scene/blender -o piped ${short% --quiet} --init-points 500 2>&1 | head -n 1 >/dev/null
[ -s piped/summary.json ] || fail "a closed pipe stops training"

# What would change the result is refused.
expect 1 train --resume cut --lambda-dssim 0.5; says '--lambda-dssim: found 0.5, but the run has 0.2'
expect 1 train --resume cut --white-background; says '--white-background: found on, but the run has off'
expect 1 train --resume cut --iterations 50; says '--iterations: found 50, expected at least 6000, those of the run'
expect 1 train --resume cut --force; says 'exclude each other'
expect 1 train --resume cut -o other; says 'found the run cut and -o other'

# The end comes at once from here: both runs stop some iterations later.
sed -i "s/\"iterations\": 6000/\"iterations\": $((reached + half))/" cut/config.json
echo '{"iteration":999999,"loss":0}' >>cut/log.jsonl # as a killed run leaves it
# The first process has had a terabyte.
sed -i 's/"\(peak_[a-z_]*_bytes\|images\)": [0-9]*/"\1": 1000000000000/' cut/summary.json
expect 0 train --resume cut --threads 1 --quiet --seed 42
expect 0 train scene/blender -o whole $(once $options --iterations $((reached + half)) --threads 2)
last=point_cloud/iteration_$((reached + half))/point_cloud.ply
cmp cut/$last whole/$last || fail "the models differ after resuming at $reached"
cmp cut/checkpoint.bin whole/checkpoint.bin || fail "the checkpoints differ"
grep -q 999999 cut/log.jsonl && fail "the log keeps iterations beyond the checkpoint"
for key in max_gaussians final_gaussians psnr; do
    [ "$(grep "\"$key\"" cut/summary.json)" = "$(grep "\"$key\"" whole/summary.json)" ] || fail "$key differs"
done
for key in peak_rss_bytes peak_ledger_bytes images; do
    grep -q "\"$key\": 1000000000000" cut/summary.json || fail "$key forgets the process before"
done

# More iterations can be asked for, and the scene may have moved.
mv scene moved
hint='if it has moved, name its place with -s SCENE'
expect 2 train --resume cut --iterations $((reached + half + 10)) --quiet; says "$hint"
expect 2 eval cut -q; says "$hint"
expect 2 render cut -o images -q; says "$hint"
expect 2 prune cut -o pruned.ply -q; says "$hint"
expect 2 eval cut -q --scene nowhere; grep -qF "$hint" err && fail "a hint at what was named"
expect 2 train --resume cut -s nowhere -q; grep -qF "$hint" err && fail "a hint at what was named"
expect 1 train moved/blender --resume cut
says '--resume: found "moved/blender" and "cut", expected one folder; -s SCENE names the place of a scene that has moved'
expect 1 train moved/blender cut -o x; says 'unexpected argument "cut"'
expect 0 train moved/blender -o cut --resume --iterations $((reached + half + 10)) --quiet
[ -s cut/point_cloud/iteration_$((reached + half + 10))/point_cloud.ply ] || fail "--iterations is not raised"
grep -q "\"iterations\": $((reached + half + 10))" cut/config.json || fail "config.json keeps the old end"
# That is the run that had them from the beginning.
expect 0 train moved/blender -o longer $(once $options --iterations $((reached + half + 10)))
cmp cut/checkpoint.bin longer/checkpoint.bin || fail "a run that was made longer is another one"
for run in cut longer; do
    sed -n 's/^{"iteration":\([0-9]*\),"loss":\([0-9.]*\).*/\1 \2/p' $run/log.jsonl |
        awk -v after="$reached" '$1 > after' >$run.losses # where it was interrupted the log has a line
done
cmp cut.losses longer.losses || fail "the log of a run that was made longer is another one"

# It has that run's totals, also of what its log says only at its end. Killed while it goes on, it is not at its end.
defended=$(once $short --init-points 400 --defense spectral --preset ns --filter-from 1 --filter-interval 5 --log-every 1000000 --save-every 0 | sed 's/--iterations [0-9]* //')
expect 0 train moved/blender -o made-longer $defended --iterations 40
"$program" train --resume made-longer --iterations 2000000 -q 2>/dev/null &
pid=$!
continues() { grep -q '"iterations": 2000000' made-longer/config.json && grep -q '"interrupted": true' made-longer/summary.json; }
wait_until continues
kill -9 $pid
wait $pid 2>/dev/null
sed -i 's/"iterations": 2000000/"iterations": 80/' made-longer/config.json
expect 0 train --resume made-longer -q
expect 0 train moved/blender -o long-made $defended --iterations 80
for key in max_gaussians max_instances filter_events filter_removed; do
    [ "$(grep "\"$key\"" made-longer/summary.json)" = "$(grep "\"$key\"" long-made/summary.json)" ] ||
        fail "of a run that was made longer: $(grep "\"$key\"" made-longer/summary.json long-made/summary.json)"
done

# A run that began with a model begins with its SH degree, and does not need its file again.
expect 0 train moved/blender -o warm $(once $short --iterations 40 --sh-interval 1000 --init cut/$last --save-every 20 --eval)
cp cut/$last first.ply
expect 0 train moved/blender -o again $(once $short --iterations 40 --sh-interval 1000 --init first.ply --save-every 20 --eval)
rm first.ply
expect 0 eval warm --json
psnr=$(sed 's/.*"psnr": \([0-9.]*\).*/\1/' out)
grep -q "\"psnr\": ${psnr%?}" warm/summary.json || fail "eval says $psnr, summary.json $(grep psnr warm/summary.json)"
expect 0 train --resume again --iterations 50 -q
# Another engine goes on from the checkpoint.
expect 0 train --resume again --iterations 52 -q --engine ref
grep -q '"engine": "ref"' again/config.json || fail "config.json has $(grep engine again/config.json)"
# The run goes on with it without being told again, and with what this machine has, where a GPU or kernels were
# chosen that are not here.
goes_on() { # ITERATIONS ENGINE VARIANT: of the configuration
    sed -i "s/\"cpu_variant\": \"[^\"]*\"/\"cpu_variant\": \"$3\"/; s/\"engine\": \"[^\"]*\"/\"engine\": \"$2\"/" again/config.json
    "$program" train --resume again --iterations "$1" -q >out 2>err || fail "a run of engine $2 with $3 does not go on"
}
goes_on 53 ref ref
goes_on 54 ref 'GPU of a test'
goes_on 55 cpu 'GPU of a test'; says 'the run was made with GPU of a test'
goes_on 56 auto 'GPU of a test'; says 'the run was made with GPU of a test'
[ -z "${SG_TEST_ENGINE-}" ] || goes_on 57 "$SG_TEST_ENGINE" 'GPU of a test'

# Another scene of the same size is another scene.
expect 0 synth -o other $size --train-views 6 --test-views 2 --points 300 --samples 1 --seed 5
expect 2 train other/blender -o again --resume --iterations 60 -q; says 'checkpoint.bin: extent: found'

# Damage is found (of several bytes: one might be there already).
printf 'damage' | dd of=cut/checkpoint.bin bs=1 seek=5000 conv=notrunc 2>/dev/null
expect 2 train moved/blender -o cut --resume -q; says checkpoint.bin
sed -i 's/"seed": 42/"sead": 42/' cut/config.json
expect 2 train --resume cut -q; says 'unknown option "sead"'
sed -i 's/"sead": 42/"images": 42/' cut/config.json
expect 2 train --resume cut -q; says config.json
echo '{' >cut/config.json
expect 2 train --resume cut -q; says config.json

# What killed processes left goes, lines that nobody wrote are dropped, and the preset's own value may be asked for again.
small_scene
expect 0 train scene/blender -o run $short --init-points 400 --save-every $half --defense spectral --rho -1
touch run/checkpoint.bin.tmp999 run/point_cloud/iteration_$half/point_cloud.ply.tmp999
head -c 300000 /dev/zero | tr '\0' x >>run/log.jsonl
printf '\na\0b\n{"iteration":1,"kept":true}' >>run/log.jsonl # cut off before the end of the line
mkdir elsewhere && touch elsewhere/thesis.tmp1 && ln -s ../../elsewhere run/point_cloud/iteration_7
expect 0 train --resume run --iterations $((end + 10)) -q --rho -1 --preset auto --filter-frequency 0
find run -name '*.tmp*' | grep -q . && fail "leftovers: $(find run -name '*.tmp*')"
[ "$(grep -cv '^{.*}$' run/log.jsonl)" = 0 ] || fail "the log has other lines"
grep -q '"kept":true}$' run/log.jsonl || fail "a good line is lost, or has others in it"
[ -e elsewhere/thesis.tmp1 ] || fail "a link leads out of the run's folder"
# A finished run is left alone: a tighter limit would only thin its model out.
before=$(cat run/point_cloud/*/* run/summary.json run/checkpoint.bin | cksum)
expect 0 train --resume run -q; says "all $((end + 10)) iterations are done"
[ "$before" = "$(cat run/point_cloud/*/* run/summary.json run/checkpoint.bin | cksum)" ] || fail "a finished run changed"
rm run/checkpoint.bin
expect 2 train --resume run
says 'found no checkpoint'

# Places whose names are no UTF-8: the run knows its scene all the same, byte for byte.
odd=$(printf 'odd \351%%')
cp -r scene/blender "$odd" 2>/dev/null && [ -d "$odd" ] && {
    expect 0 train "$odd" -o oddly $short --init-points 400 --eval
    grep -q '"percent": ".*odd%20%E9%25"' oddly/config.json || fail "config.json says $(grep source-path oddly/config.json)"
    expect 0 train --resume oddly --iterations $((end + 10)) -q
    expect 0 eval oddly --json
}

# Photos that somebody replaced are told of.
expect 0 train scene/colmap -o swapped $short
cp scene/colmap/images/view_0001.png scene/colmap/images/view_0002.png
expect 0 train --resume swapped --iterations $((end + 10)) -q; says 'other photos'

# Interrupted as it begins: a run all the same.
small=$(ls scene/colmap)
"$tool" train scene/colmap -o soon -q --iterations 100000 --max-time 100s &
pid=$!
wait_for soon/config.json
expect 2 eval soon; says 'soon: found a run that has saved no model yet'
interrupt $pid
[ $? = 130 ] || fail "interrupted as it began: another exit code"
expect 0 train --resume soon -q --max-time 3s # there is less time now
grep -q '"max_time": 3\.0' soon/summary.json || fail "the run had $(grep max_time soon/summary.json)"
expect 0 train --resume soon -q --max-time 1h; says 'time was short: '; says 'a longer training begins anew (--force)'

# timeout(1) sends its signal twice, to the process and to its group: that is one interruption. Another one, a second later,
# does not wait for the iteration.
timeout 600 "$tool" train scene/colmap -o timed -q --iterations 100000 &
pid=$!
wait_for timed/log.jsonl
kill -TERM $pid
wait $pid
[ $? = 130 ] || fail "interrupted by timeout: another exit code"
grep -q '"interrupted": true' timed/summary.json || fail "interrupted by timeout: not saved"
"$tool" train scene/blender -o late -q --engine ref --threads 1 --init-points 400000 &
pid=$!
wait_for late/config.json
kill -INT $pid # ignored: the shell asks for that in the background
kill -TERM $pid
sleep 1.2
kill -TERM $pid
wait $pid
[ $? = 143 ] || fail "interrupted again after a second: another exit code"
expect 2 train scene/colmap -o scene/colmap --force -q; says 'found a scene'
[ "$small" = "$(ls scene/colmap)" ] || fail "the scene changed"

# Standard streams that the caller closed, and files that may not grow.
"$tool" train scene/blender -o closed ${short% --quiet} --init-points 400 2>&- || fail "without standard error: exit code $?"
[ "$(grep -cv '^{.*}$' closed/log.jsonl)" = 0 ] || fail "messages are in the log"
(ulimit -f 20; "$tool" train scene/blender -o tight $short --init-points 2000 >out 2>err)
[ $? = 2 ] || fail "a file that may not grow: another exit code"
says 'File too large'
find tight -name '*.tmp*' | grep -q . && fail "leftovers: $(find tight -name '*.tmp*')"
true
