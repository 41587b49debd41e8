#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What an iteration costs with anchors and networks (Scaffold-GS), next to one of 3DGS that draws as many Gaussians:
#     bench/anchors.sh LEGO MACHINE [ENGINE...]     writes bench/results/variants-cost.tsv
# LEGO: that scene of NeRF-Synthetic. Trains both models to iteration 2200, then takes iterations 2250 to 2300 again and again
# on each engine, in turns, one thread: processor seconds by the log. Nothing else may run. Engines: cpu, where none is named.
set -eu
scene=$(realpath "$1") machine=$2
shift 2
engines=("$@")
[ ${#engines[@]} -gt 0 ] || engines=(cpu)
cd "$(dirname "$0")/.."
splatguard=$PWD/build/splatguard commit=$(git rev-parse --short HEAD) rounds=9 out=$PWD/bench/results/variants-cost.tsv
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

begin() { # NAME OPTIONS: a run that ends at iteration 2300, as it was at 2200
    local name=$1
    shift
    "$splatguard" train "$scene" -o "$name" --downscale 4 --iterations 2300 --save-every 2200 --log-every 1 --threads 1 \
        --densify-from-iter 500 --densify-until-iter 2000 "$@" >"$name.log" 2>&1 &
    while [ ! -f "$name/point_cloud/iteration_2200/point_cloud.ply" ]; do
        kill -0 $! 2>/dev/null || { cat "$name.log" >&2; exit 1; }
        sleep 0.1
    done
    kill -9 $!
    wait $! 2>/dev/null || true
}

measure() { # NAME ENGINE: milliseconds of an iteration, and Gaussians that a view draws
    rm -rf run
    cp -r "$1" run
    "$splatguard" train --resume run --engine "$2" --threads 1 >run.log 2>&1 || { cat run.log >&2; exit 1; }
    awk -F'[:,]' '
        { for (i = 1; i < NF; i++) value[$i] = $(i + 1) }
        /^{"iteration":/ {
            it = value["{\"iteration\""], cpu = value["\"cpu_seconds\""] + 0
            if (it == 2250) first = cpu
            if (it > 2250 && it <= 2300) { drawn += value["\"visible\""]; last = cpu }
        }
        END { print 1000 * (last - first) / 50, drawn / 50 }' run/log.jsonl
}

median() { sort -g | awk '{ a[NR] = $1 } END { print a[int((NR + 1) / 2)] }'; }

begin 3dgs
begin scaffold --model scaffold --anchors-from-iter 500
printf 'engine\tmodel\tdrawn Gaussians\tmilliseconds\tper drawn Gaussian, of 3DGS\tcommit\tmachine\n' >"$out"
for engine in "${engines[@]}"; do
    rm -f ms.* drawn.* ratio
    for ((round = 0; round < rounds; round++)); do
        for model in 3dgs scaffold; do
            read -r ms drawn < <(measure $model "$engine")
            echo "$ms" >>ms.$model
            echo "$drawn" >drawn.$model
        done
        paste ms.3dgs ms.scaffold | tail -n 1 |
            awk -v a="$(cat drawn.3dgs)" -v b="$(cat drawn.scaffold)" '{ print ($2 / b) / ($1 / a) }' >>ratio
    done
    for model in 3dgs scaffold; do
        printf '%s\t%s\t%.0f\t%.1f\t%s\t%s\t%s\n' "$engine" $model "$(cat drawn.$model)" "$(median <ms.$model)" \
            "$([ $model = 3dgs ] || printf %.2f "$(median <ratio)")" "$commit" "$machine" >>"$out"
    done
done
