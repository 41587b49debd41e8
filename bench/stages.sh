#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What an iteration on a Vulkan device costs, with command, commit and machine: writes bench/results/vulkan-host.tsv (the
# thread that records, by size), vulkan-stages.tsv (each stage next to what the device could do) and vulkan-parts.tsv (times
# without parts of kernels). Needs a built tree and a machine with nothing else to do: it takes five minutes on a driver for
# the CPU.
#     bench/stages.sh DEVICE MACHINE [GAUSSIANS:SIDE:ROUNDS...]
#     DEVICE: as in --engine vulkan:DEVICE     MACHINE: its name in bench/results/machines.tsv
#     sizes: 500:48:31 5000:128:15 20000:256:5 50000:512:3 by default; stages are of the one before the last, parts of the second
set -eu
[ $# -ge 2 ] || { sed -n '3,9s/^# //p' "$0" >&2; exit 1; }
cd "$(dirname "$0")/.."
engine=vulkan:$1 machine=$2
shift 2
[ $# -gt 0 ] || set -- 500:48:31 5000:128:15 20000:256:5 50000:512:3
[ $# -ge 2 ] || { echo 'found one size, expected at least two' >&2; exit 1; }
git diff --quiet HEAD -- src include bench cmake ':!bench/results' || { echo 'commit first: results name a commit' >&2; exit 1; }
commit=$(git rev-parse --short HEAD)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
stages_of=${*: -2:1} parts_of=$2
echo "load before: $(cut -d' ' -f1 /proc/loadavg)" >&2

device=
for size; do
    IFS=: read -r gaussians side rounds <<<"$size"
    options=()
    [ "$size" != "$stages_of" ] || options+=(--defense)
    [ "$size" != "$parts_of" ] || options+=(--parts)
    build/bench --engine "$engine" --gaussians "$gaussians" --side "$side" --rounds "$rounds" "${options[@]}" \
        --csv "$work/csv" >"$work/md"
    if [ -z "$device" ]; then # its name and driver, without what is in brackets
        name=$(awk -F, 'NR == 2 { gsub(/;/, ",", $2); print $2 }' "$work/csv")
        device=$(build/splatguard info --devices | grep -F " $name, driver " | head -n 1 |
            sed 's/^[^ ]* //; s/, [0-9.]* [kMGT]*B, .*//; s/ *([^)]*)//g')
        tail="$device	$commit	$machine"
        printf 'Gaussians\tpixels\tms an iteration\tms of the thread\tshare, %%\tdevice\tcommit\tmachine\n' >"$work/host"
        printf 'Gaussians\tpixels\tstage\tms\tof\tMB\tM operations\tdispatches\tfloor, ms\tby\treached, %%\tdevice\tcommit\tmachine\n' >"$work/stages"
        printf 'Gaussians\tpixels\twithout\tstage\tms\twith it, ms\tless by, %%\tdevice\tcommit\tmachine\n' >"$work/parts"
    fi
    at="$gaussians	${side}x$side"
    sed -n 's/.*\*\*\([0-9.]*\) ms\*\* an iteration, .* works \([0-9.]*\) ms (\([0-9.]*\) %).*/\1\t\2\t\3/p' "$work/md" |
        sed "s|^|$at	|; s|\$|	$tail|" >>"$work/host"
    # Rows of Markdown tables: a cell and a name that only the rows of this table have.
    rows() { sed -n "s/^| \($1\) |/\1 |/; T; s/ *| */	/g; s/	\$//; p" "$work/md" | sed "s|^|$at	|; s|\$|	$tail|"; }
    [ "$size" != "$stages_of" ] ||
        rows 'project\|bin\|raster\|loss\|raster backward\|update\|statistics\|anisotropy\|total variation\|tolerance\|hits' >>"$work/stages"
    [ "$size" != "$parts_of" ] || rows '[a-z_]*\.[a-z]*' >>"$work/parts"
    cat "$work/md"
done
for kind in host stages parts; do
    mv "$work/$kind" "bench/results/vulkan-$kind.tsv"
done
