#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Plots Gaussians over iterations of training runs:  bench/growth.sh OUT.svg LABEL=RUN...
set -eu
[ $# -ge 2 ] || { sed -n '3,3s/^# //p' "$0" >&2; exit 1; }
out=$1; shift
data=$(mktemp -d)
trap 'rm -rf "$data"' EXIT
plots=
for arg; do
    label=${arg%%=*} run=${arg#*=} file=$data/${#plots}
    sed -n 's/^{"iteration":\([0-9]*\),"loss".*"gaussians":\([0-9]*\),.*/\1 \2/p' "$run/log.jsonl" >"$file"
    plots="$plots${plots:+, }'$file' using (\$1/1000):(\$2/1000) with lines lw 2 title '$label'"
done
gnuplot <<EOF
set terminal svg size 860,420 font 'sans-serif,13' background 'white'
set output '$out'
set xlabel 'iterations, thousands'
set ylabel 'Gaussians, thousands'
set grid lc rgb '#dddddd'
set key outside right center reverse Left samplen 2
set logscale y
set xrange [0:15]
set yrange [10:*]
plot $plots
EOF
