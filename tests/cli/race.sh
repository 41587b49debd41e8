# SPDX-License-Identifier: Apache-2.0
# One owner at a time of a folder: races, and what happens after kill -9.
. "$(dirname "$0")/common.sh"
expect 0 synth -o scene --width 16 --height 16 --train-views 4 --test-views 1 --points 20 --samples 1
pid=
trap '[ -z "$pid" ] || kill -9 "$pid" 2>/dev/null' EXIT
short="--iterations 1 --init-points 8 --quiet --threads 1 --sh-degree 0"

# Started together: one wins, the others say why they do not, and the folder is the winner's.
race() { # FOLDER N ARGUMENTS...
    folder=$1 n=$2 won=0 pids=
    shift 2
    for k in $(seq "$n"); do
        "$tool" "$@" 2>err$k &
        pids="$pids $!"
    done
    k=0
    for one in $pids; do
        k=$((k + 1))
        wait "$one"
        code=$?
        if [ $code = 0 ]; then
            won=$((won + 1))
        else
            [ $code = 2 ] && grep -qE 'in use by|found an earlier|found other files' err$k || fail "exit code $code: $(cat err$k)"
        fi
    done
    [ $won = 1 ] || fail "$won of $n won the race for $folder"
}
for i in $(seq 90); do
    race a/$i 2 train scene/colmap -o a/$i $short
    [ -s a/$i/summary.json ] && [ -s a/$i/point_cloud/iteration_1/point_cloud.ply ] || fail "a/$i: the winner has nothing"
done
for i in $(seq 10); do
    race b/$i/c 3 train scene/blender -o b/$i/c $short
    race p/$i 2 attack scene/colmap -o p/$i --method noise --quiet
    [ -s p/$i/poison.json ] || fail "p/$i: the winner has nothing"
done
[ -z "$(find a b p -name '*.tmp*')" ] || fail "leftovers: $(find a b p -name '*.tmp*')"

# The owner is named; every command that writes a run or an attack is kept out.
"$tool" train scene/colmap -o long --iterations 9000000 --densify-until-iter 0 -q -j1 --save-every 20 2>err &
pid=$!
wait_for long/checkpoint.bin
config=$(cksum <long/config.json)
kept_out() { expect 2 "$@"; says "in use by splatguard $by, process $pid on"; }
by=train
kept_out train scene/colmap -o long $short
kept_out train scene/colmap -o long --force $short
kept_out train --resume long --iterations 9000001 -q
[ "$config" = "$(cksum <long/config.json)" ] || fail "the run in use was changed"
kill -9 $pid
wait $pid 2>/dev/null
pid=
# Its lock is gone with it.
sed -i 's/"iterations": 9000000/"iterations": 1/' long/config.json
"$tool" train --resume long -q >out 2>err; grep -q 'in use' err && fail "a killed owner keeps the folder"
expect 0 train scene/colmap -o long --force $short

"$tool" attack scene/colmap -o poisoned --proxy-iterations 9000000 -q -j1 2>err &
pid=$!
wait_for poisoned/attack/proxy/log.jsonl
by=attack
kept_out attack scene/colmap -o poisoned --quiet
kept_out attack scene/colmap -o poisoned --quiet --force
kept_out attack --resume poisoned -q
by=train
kept_out train --resume poisoned/attack/proxy -q
interrupt $pid
[ $? = 130 ] || fail "interrupted: another exit code"
pid=
"$tool" attack --resume poisoned -q >out 2>err &
pid=$!
wait_for poisoned/attack/proxy/log.jsonl
interrupt $pid
pid=
grep -q 'in use' err && fail "an attack keeps its folder when it has ended"
true
