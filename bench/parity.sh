#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# How far every variant of the CPU engine, and the Vulkan engine on Mesa's driver for the CPU at its three vector widths,
# are from the oracle in the tests that compare them, in millionths: the largest differences, and what the
# tests allow. Writes bench/results/vulkan-parity.tsv.
#     bench/parity.sh MACHINE [NAME=FILE...]      needs the tests in build/ and mesa-vulkan-drivers
#     NAME=FILE: a column NAME from what the same tests left in SG_PARITY=FILE on another machine, by SG_TEST_ENGINE
set -eu
[ $# -ge 1 ] || { sed -n '3,7s/^# //p' "$0" >&2; exit 1; }
cd "$(dirname "$0")/.."
machine=$1
shift
icd=$(ls /usr/share/vulkan/icd.d/lvp_icd.*.json)
commit=$(git rev-parse --short HEAD)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
tests=(test_engine test_operations test_changes test_views test_anisotropy test_scaffold)
for test in "${tests[@]}"; do
    SG_PARITY=$work/cpu "build/$test" >&2
done
for width in 128 256 512; do
    for test in "${tests[@]}"; do
        SG_PARITY=$work/$width SG_TEST_ENGINE=vulkan:llvmpipe LP_NATIVE_VECTOR_WIDTH=$width VK_ICD_FILENAMES=$icd \
            VK_DRIVER_FILES=$icd "build/$test" >&2
    done
    sed "s/\tvulkan:llvmpipe\t/\tlavapipe $width\t/" "$work/$width" >>"$work/cpu"
done
for other; do
    awk -F'\t' -v OFS='\t' -v name="${other%%=*}" '$2 != "ref" { $2 = name; print }' "${other#*=}" >>"$work/cpu"
done
awk -F'\t' -v OFS='\t' -v commit="$commit" -v machine="$machine" '
    function shown(x) { x *= 1e6; return x < 0.005 || x >= 99.5 ? sprintf("%.0f", x) : sprintf(x < 1 ? "%.2f" : "%.1f", x) }
    !($1 in bound) { quantity[++rows] = $1; bound[$1] = $4 }
    !($2 in seen) { seen[$2]; engine[++engines] = $2 }
    !(($1, $2) in most) || $3 + 0 > most[$1, $2] { most[$1, $2] = $3 + 0 }
    END {
        printf "quantity\tbound"
        for (k = 1; k <= engines; k++)
            printf "\t%s", engine[k]
        print "", "commit", "machine"
        for (i = 1; i <= rows; i++) {
            printf "%s\t%s", quantity[i], shown(bound[quantity[i]])
            for (k = 1; k <= engines; k++)
                printf "\t%s", shown(most[quantity[i], engine[k]])
            print "", commit, machine
        }
    }' "$work/cpu" >bench/results/vulkan-parity.tsv
