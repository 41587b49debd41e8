#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Runs the benchmark and keeps what it says, with command, commit and machine, in bench/results/NAME.{md,csv,svg}.
#     bench/record.sh NAME [BENCH-OPTIONS...]          needs a built tree; the plot needs gnuplot
set -eu
[ $# -ge 1 ] || { sed -n '3,4s/^# //p' "$0" >&2; exit 1; }
cd "$(dirname "$0")/.."
name=$1
shift
out=bench/results/$name
git diff --quiet HEAD -- src include bench cmake ':!bench/results' || { echo 'commit first: results name a commit' >&2; exit 1; }
{
    echo "# Benchmark: $name"
    echo
    echo "- command: \`build/bench ${*:+$* }--csv $out.csv\`"
    echo "- commit: $(git rev-parse --short HEAD)"
    echo "- machine: $(nproc) CPUs, $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -n 1), $(free -g | awk '/^Mem/ {print $2}') GiB, $(. /etc/os-release && echo "$PRETTY_NAME"), $(gcc --version | head -n 1)"
    echo "- date: $(date -u +%F), load before: $(cut -d' ' -f1 /proc/loadavg)"
    echo
    build/bench "$@" --csv "$out.csv"
} >"$out.md.new"
mv "$out.md.new" "$out.md"
if grep -q '^pixels' "$out.csv" && command -v gnuplot >/dev/null; then
    gnuplot -e "csv='$out.csv'; svg='$out.svg'" bench/scaling.gp
fi
cat "$out.md"
