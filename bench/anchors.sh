#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What an iteration costs with anchors and networks (Scaffold-GS), next to one of 3DGS that draws about as many Gaussians:
# adds rows to bench/results/variants-cost.tsv, and replaces those of the same engine and machine.
#     bench/anchors.sh LEGO MACHINE [ENGINE [ROUNDS]]
#     LEGO: that scene of NeRF-Synthetic     MACHINE: its name in bench/results/machines.tsv     ENGINE: cpu by default
# Trains both models to iteration 2200 on the CPU, then takes iterations 2250 to 2300 in ROUNDS (9 by default), both models in
# turns, with one worker thread. Needs a built tree and a machine with nothing else to do.
set -eu
[ $# -ge 2 ] || { sed -n '3,8s/^# //p' "$0" >&2; exit 1; }
scene=$(realpath "$1") machine=$2 engine=${3:-cpu} rounds=${4:-9}
cd "$(dirname "$0")/.."
git diff --quiet HEAD -- src include cmake || { echo 'commit first: results name a commit' >&2; exit 1; }
splatguard=$PWD/build/splatguard commit=$(git rev-parse --short HEAD) out=$PWD/bench/results/variants-cost.tsv
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
echo "load before: $(cut -d' ' -f1 /proc/loadavg)" >&2
cd "$work"

# NAME OPTIONS: a run of 2300 iterations, cut off after the checkpoint at 2200
begin() {
    local name=$1
    shift
    "$splatguard" train "$scene" -o "$name" -r 4 --engine cpu --iterations 2300 --save-every 2200 --log-every 1 --threads 1 \
        --densify-until-iter 2000 "$@" >"$name.log" 2>&1 &
    until grep -qs '^{"iteration":2210,' "$name/log.jsonl"; do
        kill -0 $! 2>/dev/null || { cat "$name.log" >&2; exit 1; }
        sleep 0.1
    done
    kill -9 $!
    wait $! 2>/dev/null || true
}

# NAME: milliseconds by the clock and of processors in an iteration, and Gaussians that a view draws
measure() {
    rm -rf run
    cp -r "$1" run
    "$splatguard" train -o run --resume --engine "$engine" --threads 1 >run.log 2>&1 || { cat run.log >&2; exit 1; }
    awk -F'[:,]' '
        /^{"iteration":/ {
            for (i = 1; i < NF; i++) value[$i] = $(i + 1) + 0
            if ($2 == 2250) { seconds = value["\"train_seconds\""]; cpu = value["\"cpu_seconds\""] }
            if ($2 > 2250 && $2 <= 2300) { drawn += value["\"visible\""]; n++ }
        }
        END { print 1000 * (value["\"train_seconds\""] - seconds) / n, 1000 * (value["\"cpu_seconds\""] - cpu) / n, drawn / n }
        ' run/log.jsonl
}

median() { sort -g | awk '{ a[NR] = $1 } END { print a[int((NR + 1) / 2)] }'; }

begin 3dgs
begin scaffold --model scaffold --anchors-from-iter 500
for ((round = 0; round < rounds; round++)); do
    measure 3dgs >>3dgs.ms
    measure scaffold >>scaffold.ms
done
head='engine	model	drawn Gaussians	ms by the clock	ms of processors	of 3DGS, per drawn Gaussian	least to most	rounds	commit	machine'
[ ! -f "$out" ] || grep -v "^engine	\|^$engine	.*	$machine\$" "$out" >rows || true
{
    echo "$head"
    [ ! -f rows ] || cat rows
    paste 3dgs.ms scaffold.ms | awk '{ print ($5 / $6) / ($2 / $3) }' | sort -g >ratios
    for model in 3dgs scaffold; do
        of=
        [ $model = 3dgs ] || of=$(printf '%.2f' "$(median <ratios)")
        spread=
        [ $model = 3dgs ] || spread=$(printf '%.2f to %.2f' "$(head -n 1 ratios)" "$(tail -n 1 ratios)")
        printf '%s\t%s\t%.0f\t%.1f\t%.1f\t%s\t%s\t%d\t%s\t%s\n' "$engine" $model "$(awk 'END { print $3 }' $model.ms)" \
            "$(awk '{ print $1 }' $model.ms | median)" "$(awk '{ print $2 }' $model.ms | median)" "$of" "$spread" "$rounds" \
            "$commit" "$machine"
    done
} >table
mv table "$out"
cat "$out"
