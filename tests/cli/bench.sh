# SPDX-License-Identifier: Apache-2.0
# Plans: stopped and gone on with, changed, with runs that fail; databases that cannot be used.
. "$(dirname "$0")/common.sh"
ask() { sqlite3 "$1" "$2"; }
plan() { # FILE TRAIN-ITERATIONS MORE-DEFENSES: a plan of one scene
    cat >"$1" <<END
{${plan_engine}"timeout": "60s", "train": ["--iterations", "$2", "--init-points", "200", "--densify-until-iter", "30", "--save-every", "20"],
 "scenes": {"s": {"synth": ["--width", "48", "--height", "36", "--train-views", "5", "--test-views", "2", "--points", "200", "--samples", "1"], "size": ["--downscale", "2"]}},
 "photos": {"clean": [], "noise": ["--method", "noise", "--epsilon", "16"]},
 "defenses": {"off": [], "half": ["--max-gaussians", "{clean*0.5}"], "lg": {"prune": ["--finetune", "5", "--trained", "60"]}$3},
 "models": {"default": []},
 "runs": [{"scenes": ["s"], "photos": ["clean", "noise"], "defenses": ["off", "half", "lg"$(echo "$3" | sed -n 's/.*"\(bad\)".*/, "\1"/p')], "models": ["default"], "seeds": [1]}]}
END
}
child_of() { # PID: the process that it has started
    grep -l "^PPid:[[:space:]]*$1\$" /proc/[0-9]*/status 2>/dev/null | sed 's,/proc/,,; s,/status,,' | grep .
}
n=60
if [ -n "${SG_TEST_ENGINE-}" ] || sanitized; then n=20; fi
plan plan.json $n ''
if "$tool" bench plan.json -o scene/none.db 2>&1 | grep -q 'no SQLite' || ! command -v sqlite3 >/dev/null; then
    echo "skipped: no SQLite"
    exit 77
fi
expect 0 bench plan.json -o once.db -q
says '0 jobs were done before, 8 are done now, 0 failed'
[ "$(ask once.db 'select count(*) from view')" -eq 12 ] || fail "no metrics of the views"
scale="select json_extract(run_config, '\$.options.downscale') from job join cell using(key) where defense='off' order by photos"
[ "$(ask once.db "$scale" | tr '\n' ' ')" = "2.0 1.0 " ] || fail "photos are scaled by $(ask once.db "$scale"), expected 2 and 1: a poison is small already"
[ "$(ask once.db 'select count(distinct key) from curve')" -eq 4 ] || fail "no curves"
half="select m.value from metric m join cell c using(key) where c.defense='half' and c.photos='noise' and m.name='max_gaussians'"
[ "$(ask once.db "$half")" = 100.0 ] || fail "half of the clean count is $(ask once.db "$half")"
expect 0 bench plan.json -o once.db -q
says '8 jobs were done before, 0 are done now'

# Results stay without the folders of their jobs, which are made again for those that need them.
cp once.db gone.db
expect 0 bench plan.json -o gone.db -q
says '8 jobs were done before, 0 are done now'
ask gone.db "delete from job where key in (select key from cell where defense='lg' and photos='noise')"
expect 0 bench plan.json -o gone.db -q
says ' 4 are done now, 0 failed' # the scene, its poison, the run, and what is pruned of it
[ "$(ask gone.db "select count(*) from job where status='done'")" -eq 8 ] || fail "not all jobs have a result"

# A training whose result was not stored yet is of what trained, also where another version measures it.
cp -r once.db.work lost.db.work
sed -i 's/"commit":"[^"]*"/"commit":"earlier"/; s/"machine":"[^"]*"/"machine":"another"/' lost.db.work/*/by
expect 0 bench plan.json -o lost.db -q
trained="select count(*) from job where kind='train' and commit_id='earlier' and machine='another' and command like 'splatguard train %splatguard eval %'"
[ "$(ask lost.db "$trained")" -eq 4 ] || fail "trainings of another version: $(ask lost.db 'select kind, commit_id, machine, command from job')"
[ "$(ask lost.db "select count(*) from job where kind='prune' and commit_id='earlier'")" -eq 0 ] || fail "a pruning that ran again is of an earlier version"

# One of these that fails now keeps the result that it had.
cp once.db kept.db
ask kept.db "delete from job where key in (select key from cell where defense='lg')"
cat >tiny-memory.json <<END
$(sed 's/"timeout": "60s"/"memory": "1M"/' plan.json)
END
expect 2 bench tiny-memory.json -o kept.db -q
says 'took more memory than the limit of 1048576 bytes'
[ "$(ask kept.db "select count(distinct key) from cell join job using(key) join metric using(key) where defense='off' and status='done' and name='eval.psnr'")" -eq 2 ] || fail "a result is lost"

expect 0 report kept.db -o kept -q
grep -q '^| scene | not again | took more memory than the limit' kept/report.md || fail "no word about what runs wait for: $(cat kept/report.md)"

# A pruned model is measured as its run was: here on white.
sed 's/"--iterations"/"-w", &/; s/"--finetune", "5"/"--finetune", "0", "--ratio", "0"/' plan.json >white.json
expect 0 bench white.json -o white.db -q
[ "$(ask white.db "select count(distinct round(value, 9)) from metric join cell using(key) where defense in ('off', 'lg') and photos='clean' and name='eval.psnr'")" -eq 1 ] || fail "on white a pruned model is measured on another background"

# Stopped while it does so, it does not take half a run for a whole one.
plan long.json $((n * n)) '' # long enough to be stopped
expect 0 bench long.json -o half.db -q
ask half.db "delete from job where key in (select key from cell where defense='lg')"
psnr=$(ask half.db "select value from metric join cell using(key) where defense='off' and photos='clean' and name='eval.psnr'")
rm -r half.db.work
"$tool" bench long.json -o half.db -q --jobs 2 2>err &
pid=$!
two_begin() { [ "$(find half.db.work -name log.jsonl 2>/dev/null | wc -l)" -eq 2 ]; }
wait_until two_begin
sleep 0.3
interrupt $pid
mkdir other-disk && mv half.db half.db.work other-disk # where its runs go on
expect 0 bench long.json -o other-disk/half.db -q --jobs 1
mv other-disk/* .
for run in half.db.work/*/run; do
    grep -q '"interrupted": false' "$run/summary.json" || fail "$run was not finished"
done
[ "$(ask half.db "select count(*) from job where status='done'")" -eq 8 ] && [ "$psnr" = "$(ask half.db "select value from metric join cell using(key) where defense='off' and photos='clean' and name='eval.psnr'")" ] || fail "other results"

# That two ran at a time once counts, although they ended one after the other.
[ "$(ask half.db "select count(*) from job join cell using(key) where defense='off' and beside=2 and alone=0")" -eq 2 ] || fail "of shared runs $(ask half.db "select kind, beside, alone from job")"

# Killed at any time: nothing is lost, nothing is done twice. SG_TEST_KILLS says how often, SG_TEST_SEED at which moments.
results="select key, name, value from metric where name in ('eval.psnr', 'eval.ssim', 'final_gaussians') order by 1, 2"
kills=${SG_TEST_KILLS-5} killed=0 whole=0 tried=0
while [ $killed -lt "$kills" ]; do
    : >seen
    while [ $killed -lt "$kills" ]; do
        "$tool" bench plan.json -o "killed-$whole.db" -q 2>/dev/null &
        pid=$!
        tried=$((tried + 1))
        sleep "$(awk -v seed=$((${SG_TEST_SEED-0} + tried)) 'BEGIN { srand(seed); print 0.02 + 0.8 * rand() }')"
        kill -KILL $pid 2>/dev/null
        wait $pid 2>/dev/null
        case $? in
        0) break ;; # it has finished before
        137) ;;
        *) fail "a bench after $killed kills failed" ;;
        esac
        killed=$((killed + 1))
        ask "killed-$whole.db" 'select key, started, seconds from job' >>seen 2>/dev/null
        sleep 0.3 # its processes save and end
    done
    expect 0 bench plan.json -o "killed-$whole.db" -q
    ask "killed-$whole.db" 'select key, started, seconds from job' >end
    while read -r row; do grep -qF "$row" end || fail "a job ran twice: $row"; done <seen
    [ "$(ask "killed-$whole.db" "$results")" = "$(ask once.db "$results")" ] || fail "a stopped plan has other results"
    whole=$((whole + 1))
done
echo "killed $killed times while it ran $whole whole plans"

# A training that memory ends early is no result.
cat >grow.json <<END
{${plan_engine}"train": ["--iterations", "400", "--init-points", "2000", "--densify-from-iter", "10", "--densification-interval", "5", "--densify-grad-threshold", "1e-9"],
 "scenes": {"s": {"synth": ["--width", "48", "--height", "36", "--train-views", "5", "--test-views", "2", "--points", "200", "--samples", "1"]}},
 "photos": {"clean": []}, "defenses": {"off": []}, "models": {"default": []},
 "runs": [{"scenes": ["s"], "photos": ["clean"], "defenses": ["off"], "models": ["default"], "seeds": [1]}]}
END
if [ -z "${SG_TEST_ENGINE-}" ] && ! sanitized; then
    (ulimit -v 200000; "$tool" bench grow.json -o grow.db -q 2>err; [ $? -eq 2 ]) || fail "a model of few Gaussians is a result"
    says 'for lack of memory'
    [ "$(ask grow.db "select status from job where kind='train'")" = memory ] || fail "a training without memory is $(ask grow.db 'select kind, status, message from job')"
fi

# Names are names, also where SQLite or a shell would take them for something else.
expect 0 bench grow.json -o :memory: --list
mkdir 'a b;c' && expect 0 synth -o 'a b;c/scene' --width 48 --height 36 --train-views 4 --test-views 2 --points 200 --samples 1
mv 'a b;c/scene/blender/train/r_0.png' 'a b;c/scene/blender/train/desk_photo.png'
sed -i 's,train/r_0",train/desk_photo",' 'a b;c/scene/blender/transforms_train.json'
cat >names.json <<END
{${plan_engine}"pictures": true, "train": ["--iterations", "5", "--init-points", "50"], "scenes": {"s": {"path": "a b;c/scene/blender"}},
 "photos": {"clean": []}, "defenses": {"off": [], "lg": {"prune": ["--finetune", "2"]}}, "models": {"default": []},
 "runs": [{"scenes": ["s"], "photos": ["clean"], "defenses": ["off"], "models": ["default"], "seeds": [1]}]}
END
expect 0 bench names.json -o :memory: -q # the photo of no view is "desk"
[ -s ./:memory: ] || fail "no database :memory:"
[ "$(ask ./:memory: "select count(*) from job where kind='train' and command like '%/a b;c/scene/blender''%'")" -eq 1 ] || fail "not for a shell: $(ask ./:memory: 'select command from job')"

# Pictures stay where their run is made again for another job.
[ "$(ask ./:memory: 'select count(distinct of) from picture')" -eq 1 ] || fail "no pictures"
rm -r ./:memory:.work
sed 's/"defenses": \["off"\]/"defenses": ["off", "lg"]/' names.json >more.json
expect 0 bench more.json -o :memory: -q
[ "$(ask ./:memory: 'select count(distinct of) from picture')" -eq 2 ] && [ "$(ask ./:memory: 'select count(distinct of) from spectrum')" -eq 2 ] || fail "pictures are lost"

# One scene of two names is trained once, and has both in the report.
sed 's/"scenes": {/&"t": {"path": ".\/a b;c\/scene\/blender"}, /; s/"scenes": \["s"\]/"scenes": ["s", "t"]/' more.json >twice.json
expect 0 bench twice.json -o :memory: -q
says ' 0 are done now, 0 failed'
[ "$(ask ./:memory: "select count(*), count(distinct scene), count(distinct key) from cell where plan='twice'")" = '4|2|2' ] || fail "cells of one scene by two names: $(ask ./:memory: 'select * from cell')"

# Ctrl-C lets the runs save.
plan long.json 100000 ''
"$tool" bench long.json -o long.db -q --jobs 1 2>err &
pid=$!
trains() { ls long.db.work/*/run/log.jsonl >/dev/null 2>&1; }
wait_until trains
# One bench at a time writes a database, whatever its folder of work is.
for folder in long.db.work other.work; do
    "$tool" bench long.json -o long.db --work $folder -q 2>second
    [ $? -eq 2 ] && grep -q "long.db.*: in use by another bench" second || fail "two benches on one database: $(cat second)"
done
# A result that is stored while a bench waits for the database stays, although its own job has failed.
{
    printf '.timeout 5000\nbegin immediate;\n'
    echo "insert or replace into job(key, kind, status) select key, kind, 'done' from cell;"
    while sqlite3 long.db 'begin immediate; rollback' 2>/dev/null; do sleep 0.1; done
    kill -KILL "$(child_of $pid | head -1)"
    sleep 1
    echo 'commit;'
} | sqlite3 long.db
one_failed() { status=$(ask long.db "select status from job where message like 'ended by signal 9%'" 2>/dev/null) && [ -n "$status" ]; }
wait_until one_failed
[ "$status" = "done" ] || fail "a result has gone: $(ask long.db 'select status, message from job')"
interrupt $pid
[ $? -eq 130 ] || fail "an interrupted bench did not exit with 130"
says 'the same command continues'

# A run whose checkpoint is damaged, or of another version, begins anew when it is repeated.
plan stuck.json $((n * n)) ''
sed -i 's/"photos": \["clean", "noise"\], "defenses": \["off", "half", "lg"\]/"photos": ["clean"], "defenses": ["off"]/' stuck.json
saves_begin() { ls "$stopped".db.work/*/run/checkpoint.bin >/dev/null 2>&1; }
stop_at_checkpoint() { # NAME OPTIONS...: the plan NAME.json, whose results go to NAME.db
    stopped=$1; shift
    "$tool" bench "$stopped.json" -o "$stopped.db" -q "$@" 2>err &
    pid=$!
    wait_until saves_begin
    interrupt $pid
}
stop_at_checkpoint stuck
for checkpoint in stuck.db.work/*/run/checkpoint.bin; do echo damaged >"$checkpoint"; done
expect 2 bench stuck.json -o stuck.db -q; says 'checkpoint.bin: found less than'
# One that is killed has not said what its process before did.
stop_at_checkpoint stuck --retry
"$tool" bench stuck.json -o stuck.db -q --retry 2>err &
pid=$!
wait_until child_of $pid >child
kill -KILL "$(cat child)"
wait $pid
[ "$(ask stuck.db "select status, message from job where kind='train'")" = 'crashed|ended by signal 9 without a word' ] || fail "of a crash: $(ask stuck.db "select status, message from job")"
expect 0 bench stuck.json -o stuck.db -q --retry

# What a training says that fails, not where the model is that it has saved before.
"$tool" bench stuck.json -o disk.db -q 2>err &
pid=$! stopped=disk
wait_until saves_begin
for checkpoint in disk.db.work/*/run/checkpoint.bin; do # the place of the next one
    until mkdir "$checkpoint" 2>/dev/null; do rm -f "$checkpoint"; done
done
wait $pid
[ $? -eq 2 ] && grep -q 'the model of iteration' disk.db.work/*/err.0 || fail "a training that cannot save: $(cat disk.db.work/*/err.0)"
[ "$(ask disk.db "select count(*) from job where status='failed' and message like '%/checkpoint.bin: %'")" -eq 1 ] || fail "why a training has failed: $(ask disk.db 'select status, message from job')"

# A scene that is reached by a link: runs that go on and prunes may follow it too.
mkdir by-link && cp -r once.db.work/*/scene/blender/* by-link 2>/dev/null
mv by-link/train photos-elsewhere && ln -s "$PWD/photos-elsewhere" by-link/train
plan link.json $((n * n)) ''
sed -i 's/"synth": \[[^]]*\], "size": \[[^]]*\]/"path": "by-link", "options": ["--follow-links"]/; s/"photos": \["clean", "noise"\], "defenses": \["off", "half", "lg"\]/"photos": ["clean"], "defenses": ["off", "lg"]/' link.json
stop_at_checkpoint link
grep -q '"interrupted": true' link.db.work/*/run/summary.json || fail "the run of a linked scene had ended: $(cat err)"
mkdir moved && mv by-link moved # where it goes on
expect 0 bench link.json -o link.db -q --data moved
[ "$(ask link.db "select count(*) from job where kind='train' and command like '%--resume%/moved/by-link%'")" -eq 1 ] || fail "the run of a scene that moved: $(ask link.db 'select command from job')"
[ "$(ask link.db "select json_extract(config, '$.path') from job where kind='scene'")" = "$PWD/by-link" ] || fail "no place of the scene that was done before"
mv moved/by-link .
expect 0 bench link.json -o link.db -q
says ' 0 are done now, 0 failed'

# All jobs are of the program that began, also where its file is replaced meanwhile.
if [ "$tool" = "$program" ]; then
    cp "$program" replaced
    ./replaced bench link.json -o replaced.db -q 2>err &
    pid=$!
    wait_until test -d replaced.db.work
    printf '#!/bin/sh\nexit 1\n' >other && chmod +x other && mv other replaced
    wait $pid || fail "a bench whose program was replaced: $(cat err)"
fi

# What changed runs; what fails is a row.
plan plan.json $n ', "bad": ["--defense", "spectral", "--band-low", "0.9", "--band-high", "0.5"]'
expect 2 bench plan.json -o once.db -q
says '8 jobs were done before, 0 are done now, 2 failed'
grep -q 'have failed before' err && fail "what failed now has not failed before"
[ "$(ask once.db "select count(*) from job where status='failed' and exit_status=1 and message like '%--band-high%'")" -eq 2 ] || fail "no row for a failure"
expect 2 bench plan.json -o once.db -q
says '0 failed'; says '2 jobs have failed before; --retry runs them again'
# A scene in another layout is another scene, with other runs.
sed 's/"synth": /"layout": "colmap", &/; s/"runs": .*/"runs": [{"scenes": ["s"], "photos": ["clean"], "defenses": ["off"], "models": ["default"], "seeds": [1]}]}/' plan.json >layout.json
cp once.db layout.db
expect 0 bench layout.json -o layout.db -q
says '0 jobs were done before, 2 are done now'
sed 's/"timeout": "60s"/"timeout": "1s"/; s/"'$n'"/"90000"/' plan.json >slow.json
expect 2 bench slow.json -o slow.db -q --jobs 8
[ "$(ask slow.db "select count(*) from job where status='timeout'")" -ge 1 ] || fail "no row for a timeout"

# An engine for all that draw, unless a defense has its own.
other=${SG_TEST_ENGINE:-ref}
sed 's/"engine": "[^"]*", //; s/"timeout"/"engine": "'"$other"'", &/; s/"half", "lg"/"half"/; s/"'$n'"/"4"/; s/\["--max-gaussians", "{clean\*0.5}"\]/["--engine", "cpu"]/' plan.json >engine.json
expect 2 bench engine.json -o engine.db -q
engines="select group_concat(distinct engine) from job join cell using(key) where defense"
of_off=$(ask engine.db "$engines='off'") of_half=$(ask engine.db "$engines='half'")
[ "$of_off" != "$of_half" ] && { [ "$other" != ref ] || [ "$of_off" = ref ]; } &&
    [ "$(ask engine.db "select count(*) from job where kind='train' and status='done' and command like '%--engine $other%'")" -ge 2 ] ||
    fail "the plan's engine is $of_off, a defense's own $of_half"

# Options in other forms are the same options.
sed 's/"--method", "noise"/"--method=noise"/; s/"--init-points", "200"/"--init_points=200"/; s/"--max-gaussians", "{clean\*0.5}"/"--max-gaussians={clean*0.5}"/' plan.json >forms.json
expect 0 bench forms.json --list && sort out >forms
cmp -s plan.json forms.json && fail "the plan has the forms that it had"
expect 0 bench plan.json --list && sort out | cmp - forms || fail "other jobs: $(cat forms)"
sed 's/"-w"/"--white-background"/' white.json >forms.json
expect 0 bench forms.json --list && cp out forms
expect 0 bench white.json --list && cmp out forms || fail "by its letter an option is another one: $(cat out)"

# A scene is the same one however its path is spelled.
mkdir spelled && echo >spelled/photo
sed 's/"synth": \[[^]]*\]/"path": "spelled"/' plan.json >spelled.json
expect 0 bench spelled.json --list && cp out spelled.jobs
expect 0 bench "$PWD/spelled.json" --list --data ./../"${PWD##*/}"/. && cmp -s out spelled.jobs || fail "other jobs: $(cat out)"

# Where its path cannot be kept, it is refused before its jobs fail.
latin=$(printf 'd\351') && mkdir -p "$latin/spelled" && echo >"$latin/spelled/photo"
expect 2 bench spelled.json --list --data "$latin"; says '/spelled: expected a path in UTF-8'

# And however often it is copied, unless a photo or its name changes.
mkdir copied && mv spelled/photo copied/ && cp copied/photo spelled/ && touch -d '2001-02-03' spelled/photo
expect 0 bench spelled.json --list && cmp -s out spelled.jobs || fail "a copied scene has other jobs: $(cat out)"
mkdir elsewhere && cp -r spelled elsewhere
expect 0 bench spelled.json --list --data elsewhere && cmp -s out spelled.jobs || fail "a scene in another place has other jobs: $(cat out)"
sed 's/"s"/"other"/g' spelled.json >renamed.json
expect 0 bench renamed.json --list && sed 's/ other / s /' out | cmp -s - spelled.jobs || fail "a scene of another name has other jobs: $(cat out)"
# Two whose test views are read with other options are two, also where they are trained with the same ones.
sed 's/"train": \["--iterations"/"train": ["--downscale", "2", "--iterations"/; s/"scenes": {/&"t": {"path": "spelled"}, /; s/"scenes": \["s"\]/"scenes": ["s", "t"]/' spelled.json >two.json
expect 0 bench two.json --list
[ "$(grep -c 'train  [st] clean off' out)" -eq 2 ] || fail "two scenes of the same files are one: $(cat out)"
printf . >spelled/photo # as many bytes
expect 0 bench spelled.json --list && ! cmp -s out spelled.jobs || fail "a changed photo has the same jobs"
mv copied/photo spelled/photo.png && rm spelled/photo
expect 0 bench spelled.json --list && ! cmp -s out spelled.jobs || fail "a photo of another name has the same jobs"

# What bench writes is not in a scene, which would be another one then.
mkdir spelled/below
expect 2 bench spelled.json -o spelled/x.db; says "spelled/x.db: found it in the folder of scene s, expected it outside of $PWD/spelled"
expect 2 bench spelled.json -o x.db --work spelled/below/work; says 'spelled/below/work: found it in the folder of scene s'
[ -z "$(find x.db spelled -name 'x.db*' -o -name work 2>/dev/null)" ] || fail "a refused bench has left $(find x.db spelled)"

# The proxy sees no photos that the attack does not.
sed 's/"--method", "noise"/"--iterations", "9", "--views", "train"/' plan.json >views.json
expect 2 bench views.json -o views.db -q
[ "$(ask views.db "select count(*) from job where kind='proxy' and status='done' and command like '%--eval%'")" -eq 1 ] || fail "the proxy has seen all photos"

# Links in a scene's folder that lead around in circles are not followed.
mkdir around && echo >around/photo && for i in 1 2 3 4 5 6 7 8 9; do ln -s . around/$i; done
sed 's/"synth": \[[^]]*\]/"path": "around"/' plan.json >around.json
timeout 30 "$tool" bench around.json --list >out || fail "links in a scene: exit status $?"
grep -q train out || fail "jobs of a folder with links are $(cat out)"
rm around/photo && ln -s "$PWD/plan.json" around/photo # a scene may be made of links
expect 0 bench around.json --list

# A scene with links is another one where they lead to others, or what they lead to changes.
mkdir linked linked/images_2 linked/.images_4 outside && echo 2 >linked/images_2/photo && echo 4 >linked/.images_4/photo && echo 1 >outside/photo
ln -s images_2 linked/images
sed 's/"path": "around"/"path": "linked"/; s/"--downscale", "2"/&, "--follow-links"/' around.json >follows.json
sed 's/"path": "around"/"path": "linked"/' around.json >stays.json
jobs_of() { expect 0 bench $1.json --list && mv out $1.$2; }
other_jobs() { ! cmp -s $1.$2 $1.$3 || fail "$1.json has the same jobs as $2 and as $3"; }
for plan in follows stays; do jobs_of $plan first; done
ln -sfn .images_4 linked/images
for plan in follows stays; do jobs_of $plan relinked && other_jobs $plan first relinked; done
echo 5 >linked/.images_4/photo
for plan in follows stays; do jobs_of $plan hidden && other_jobs $plan relinked hidden; done
rm linked/images && ln -s "$PWD/outside" linked/images
for plan in follows stays; do jobs_of $plan outside && other_jobs $plan hidden outside; done
echo 6 >outside/photo
for plan in follows stays; do jobs_of $plan changed; done
other_jobs follows outside changed
cmp -s stays.outside stays.changed || fail "what links lead to is read without --follow-links"
expect 2 bench follows.json -o outside/x.db; says "outside/x.db: found it in the folder of scene s, expected it outside of $PWD/outside"
rm linked/images && ln -s a/b/c/d/e/f/g/h linked/images && ln -s .. linked/up && ln -s /proc/self linked/process
mkdir -p linked/a/b/c/d/e/f/g/h && echo 7 >linked/images/photo
timeout 60 "$tool" bench follows.json --list >out || fail "links out of a scene: exit status $?"
rm linked/process
jobs_of follows deep && jobs_of follows again && cmp -s follows.deep follows.again || fail "a scene changes by itself"
echo 8 >linked/images/photo && jobs_of follows deeper && other_jobs follows deep deeper

# Parts of a plan are all of it; a script for a cluster.
plan plan.json $n ''
for i in 1 2 3; do "$tool" bench plan.json --list --shard $i/3; done | grep -c half >parts
[ "$(cat parts)" -eq 2 ] || fail "the parts have $(cat parts) of 2 cells"
expect 0 bench plan.json -o cluster.db --slurm 3
grep -q 'array=1-3' out && grep -q -- '--shard ..\?SLURM_ARRAY_TASK_ID/3\|--shard .SLURM_ARRAY_TASK_ID/3' out || fail "the script is $(cat out)"
[ ! -e cluster.db ] || fail "a script made a database"
for i in 1 2; do [ "$("$tool" bench plan.json --list --shard $i/2 | grep -c train)" -ge 2 ] || fail "part $i of 2 has less than half"; done
# What a block at the end adds moves nothing that is done to another part.
sed 's/"clean": \[\]/&, "blur": ["--method", "noise", "--epsilon", "4"]/; s/^ "runs": \[\({.*}\)\]}/ "runs": [\1, \1]}/' plan.json >added.json
sed -i 's/\(.*\)"clean", "noise"/\1"clean", "blur", "noise"/' added.json # the second block
for i in 1 2; do
    "$tool" bench plan.json --list --shard $i/2 | sort >before
    "$tool" bench added.json --list --shard $i/2 | sort | comm -23 before - >moved-away
    [ ! -s moved-away ] || fail "part $i of 2 has lost $(cat moved-away)"
done
[ "$("$tool" bench added.json --list | grep -c 'poison s blur')" -eq 1 ] || fail "the plan has no block more: $(cat added.json)"
for shard in 4/3 4294967297/1; do
    expect 1 bench plan.json -o x.db --shard $shard; says '--shard'
done
expect 1 bench plan.json -o x.db --shard 1/3 --slurm 2; says 'exclude each other'
expect 0 bench plan.json -o part1.db -q --shard 1/2 --work shards
expect 0 bench plan.json -o part2.db -q --shard 2/2 --work shards
expect 0 report part1.db part2.db -o parts-page
[ "$(ask part1.db 'select count(*) from cell')" -lt 6 ] && [ "$(wc -l <parts-page/results.csv)" -eq 7 ] || fail "of two shards the report has $(cat parts-page/*.csv)"
cp once.db all.db
expect 2 bench plan.json -o all.db --shard 1/2; says 'found all of the plan plan, expected a database of its own for shard 1/2'
cmp once.db all.db || fail "a database of other cells has changed"
expect 1 bench plan.json -o x.db --slurm 0; says 'slurm: found "0", expected a whole number from 1 to 10000'
expect 1 bench plan.json -o x.db --max-memory 1G; says 'found a plan without'
expect 0 bench plan.json -o "it's.db" --slurm 2
grep -qF "'it'\\''s.db'" out && sh -n out || fail "a quote in a name breaks the script: $(cat out)"

grep -q '^#SBATCH --cpus-per-task=1$' out || fail "the script asks for no CPUs: $(cat out)"
sed 's/^{/{"memory": "1G", /' plan.json >memory.json
expect 0 bench memory.json -o c.db --slurm 2 --jobs 3 --max-memory 4G --retry --keep -q
grep -q -- '--jobs 3 --max-memory 4[0-9]* --retry --keep --quiet$' out || fail "the script lacks options: $(cat out)"

# A folder of jobs that cannot be locked.
expect 0 bench plan.json -o lock.db -q
rm lock.db
for lock in lock.db.work/*.lock; do ln -sf nowhere "$lock"; done
expect 2 bench plan.json -o lock.db -q; says '.lock: Too many levels of symbolic links'

# Databases that cannot be used stay as they are.
expect 2 bench plan.json -o nowhere/x.db; says 'nowhere/x.db: cannot make the database: No such file or directory'
expect 2 report missing.db -o x; says 'missing.db: No such file or directory, expected a database of splatguard bench or a run'
[ ! -e x ] || fail "a report of nothing left something"
echo 'this is no database, but a file that somebody needs, and it is long enough to be looked at....' >file.db
cp file.db copy.db
expect 2 bench plan.json -o file.db; says 'file.db: file is not a database'
cmp file.db copy.db || fail "a file that is no database has changed"
ask foreign.db 'create table mine(x); insert into mine values(1)'
expect 2 bench plan.json -o foreign.db; says 'not of this version of splatguard bench'
[ "$(ask foreign.db 'select * from mine')" = 1 ] || fail "another's database has changed"
ask tables.db 'create table mine(x); drop table mine'
cp tables.db copy.db
expect 2 bench plan.json -o tables.db; says 'tables.db: found a database that is not of this version of splatguard bench'
cmp tables.db copy.db || fail "another's database without tables has changed"
sqlite3 log.db 'pragma journal_mode=wal' 'create table mine(x)' ".shell kill -KILL \$PPID" >/dev/null 2>&1
[ -s log.db-wal ] || fail "no log is left"
cp log.db copy.db
expect 2 bench plan.json -o log.db; says 'not of this version of splatguard bench'
cmp log.db copy.db && [ -s log.db-wal ] || fail "another's database with a log has changed"
expect 0 bench plan.json -o used.db -q
: >zero.db
expect 0 bench plan.json -o zero.db --work used.db.work -q
ask zero.db 'pragma journal_mode=wal' >/dev/null
expect 0 bench plan.json -o zero.db --work used.db.work -q
[ ! -s zero.db-wal ] || fail "bench leaves results in a log beside its database"
cp used.db copy.db
chmod 444 used.db
if ! [ -w used.db ]; then # root may write it all the same
    expect 2 bench plan.json -o used.db -q; says 'used.db: attempt to write a readonly database'
    cmp used.db copy.db || fail "a read-only database has changed"
fi
chmod 644 used.db
{
    printf '.timeout 60000\nbegin exclusive;\n'
    n=0
    until [ -e released ] || [ $n -gt 1500 ]; do n=$((n + 1)); sleep 0.2; done
} | sqlite3 used.db >/dev/null 2>&1 &
while sqlite3 used.db 'begin immediate; rollback' 2>/dev/null; do sleep 0.2; done # until it is locked
expect 2 report used.db -o locked; says 'used.db: database is locked'
expect 2 bench plan.json -o used.db -q; says 'used.db: database is locked'
[ ! -e locked ] || fail "a failed report left something"
: >released
wait $!
cmp used.db copy.db || fail "a locked database has changed"
# Killed while it wrote, which the next one undoes. The shell of .shell is a child of what it kills.
cp copy.db cut.db
sqlite3 cut.db 'pragma cache_size=1' 'begin immediate' \
    "with recursive n(i) as (select 1 union all select i + 1 from n where i < 5000) insert into metric select i, 'cut', 1 from n" \
    ".shell kill -KILL \$PPID" >/dev/null 2>&1
[ -s cut.db-journal ] || fail "no journal is left"
cp cut.db cut.copy
expect 2 report cut.db -o locked; says 'cut.db: found a change that was half done when a bench was killed'
cmp cut.db cut.copy || fail "a report has changed its database"
expect 0 bench plan.json -o cut.db --work used.db.work -q; says ' 0 are done now, 0 failed'
expect 0 report cut.db -o cut -q
[ "$(ask cut.db "select count(*) from metric where name='cut'")" -eq 0 ] || fail "half a change is left"
(ulimit -f 4; "$tool" bench plan.json -o full.db -q 2>err; [ $? -eq 2 ]) || fail "a full disk was not noticed"
says 'full.db'
[ ! -e full.db ] && [ ! -e full.db-journal ] || fail "a full disk leaves a database without anything"
dd if=/dev/urandom of=once.db bs=1024 seek=4 count=4 conv=notrunc 2>/dev/null
cp once.db torn.db
expect 2 bench plan.json -o once.db; says 'once.db: database disk image is malformed'
cmp once.db torn.db || fail "a damaged database has changed"

# Plans with mistakes: what sed makes of the plan, and what is said.
mistake() { sed "$1" plan.json >bad.json; expect 2 bench bad.json -o x.db; says "$2"; }
expect 2 bench . -o x.db; says '.: found a folder, expected the file of a plan'
echo '{"scenes": 3' >bad.json; expect 2 bench bad.json -o x.db; says 'bad.json: line'
mistake 's/"off", "half"/"off", "helf"/' 'runs[0].defenses[1]: found helf, expected a name of defenses'
mistake 's/"timeout"/"timeuot"/' 'found "timeuot"'
mistake 's/"engine": "[^"]*", //; s/"timeout"/"engine": 1, &/' 'engine: expected a text'
mistake 's/"synth": *\[[^]]*\]/"path": "x", "layout": "colmap"/' 'scenes.s.layout: found it with path'
mistake 's/"synth"/"layout": "colmap3", &/' 'scenes.s.layout: expected "blender" or "colmap"'
mistake 's/"timeout"/"alone": "yes", &/' 'alone: expected true or false'
mistake 's/"synth".*/"path": "nowhere"}},/' 'scenes.s: found no file in ./nowhere, expected the scene below the plan'; says 'that of --data'
mistake 's/"train": \["--iterations"/"train": ["--iteration"/' 'train[0]: found --iteration, expected an option of train; did you mean --iterations?'
mistake 's/"--epsilon", "16"/"--eps=16", "-Z"/' 'photos.noise[2]: found --eps, expected an option of attack; did you mean --epsilon?'
mistake 's/"--finetune", "5"/"--cap-max", "5"/' 'defenses.lg.prune[0]: found --cap-max, expected an option of prune'
mistake 's/"size": \[/&"--smooth", "gaussian", /' 'scenes.s.size: found --smooth, expected an option of eval too'
mistake 's/"size"/"options": ["-w"], &/' 'scenes.s.options: found --white-background, expected an option of attack too'
mistake 's/"clean": \[\]/"clean": [], "bad": ["--epsilon", "{clean*2}"]/' 'photos.bad[1]: found {clean*2}, which only defenses can have'
for limit in '{clean*-1}' '{clean*nan}' '{clean*0.5' '{claen}'; do
    sed "s/{clean\*0.5}/$limit/" plan.json >bad.json
    expect 2 bench bad.json -o x.db; says "found $limit, expected {clean}"
done
mistake 's/"lg": {/"lg": {"train": [], /' 'defenses.lg: expected either train or prune'
mistake 's/"off": \[\]/"off": ["--max-gaussians", "{clean}"]/' 'defenses.off: expected []'
# Values too, before weeks of jobs begin.
mistake 's/\["--method", "noise", "--epsilon", "16"\]/["--method"]/' 'photos.noise[0]: --method: found no value, expected'
mistake 's/"--epsilon", "16"/"--epsilon=1O"/' 'photos.noise[2]: --epsilon: found "1O", expected a whole number of grey levels'
mistake 's/"--iterations", "[0-9]*"/"--iterations", "--seed"/' 'train[0]: --iterations: found no value, expected'
mistake 's/"--init-points"/"--eval", &/' 'train[2]: found --eval, which is for bench itself to give'
mistake 's/"--epsilon", "16"/"--proxy", "m.ply"/' 'photos.noise[2]: found --proxy, which is for bench itself to give'
mistake 's/"--finetune", "5"/"-j", "2"/' 'defenses.lg.prune[0]: found --threads, which is for bench itself to give'
mistake 's/"--iterations", "[0-9]*"/"--iterations", 60/' 'train[1]: expected a text'
mistake 's/"--points", "200"/"--points"/' 'scenes.s.synth[8]: --points: found no value'
mistake 's/"--finetune", "5"/"--finetune", "5", "10"/' 'defenses.lg.prune[2]: found 10, expected an option of prune'
mistake 's/"size": \[/&"--test-halves=yes", /' 'scenes.s.size[0]: --test-halves takes no value'
mistake 's/"engine": "[^"]*", //; s/"timeout"/"engine": "cpuu", &/' 'engine: found "cpuu", expected one of cpu|'
mistake 's/"--trained", "60"/"--trained", "{preset}"/' 'scenes.s: found no preset, expected one for {preset}'
mistake 's/"--trained", "60"/"--trained", "{preset}"/; s/"synth"/"preset": "sixty", &/' 'scenes.s.preset: found "sixty", which prune --trained does not take, expected a whole number'
mistake 's/"--downscale", "2"/"--downscale", "{preset}"/; s/"synth"/"preset": "2", &/' 'scenes.s.size[1]: found {preset}, expected a value'
for plan in "$source_dir"/bench/plans/*.json; do
    "$tool" bench "$plan" --list --data "$work" >out 2>err || says 'found no file in'
done
[ ! -e x.db ] || fail "a bad plan made a database"
expect 1 bench plan.json; says 'missing -o DB'
