#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# What Mesa's driver for AMD makes of every kernel of the Vulkan engine, for GPUs that need not be there: vector
# registers a lane, shared memory, instructions (also of a row, where a kernel has rows), spilled registers. Writes bench/results/registers.tsv, which is
# committed with the kernels that it is about.
#     bench/registers.sh           needs build/registers and mesa-vulkan-drivers
# vega10 has subgroups of 64; on navi21 and gfx1100 the driver compiles for 64, or for 32 where it is told to.
set -eu
cd "$(dirname "$0")/.."
icd=$(ls /usr/share/vulkan/icd.d/radeon_icd.*.json)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
places=(vega10 navi21 navi21+cswave32 gfx1100 gfx1100+cswave32)
for place in "${places[@]}"; do
    option=${place#"${place%%+*}"}
    RADV_FORCE_FAMILY=${place%%+*} RADV_PERFTEST=${option#+} VK_ICD_FILENAMES=$icd VK_DRIVER_FILES=$icd \
        build/registers >"$work/$place"
done
cd "$work"
awk -F'\t' -v OFS='\t' '
    function value(name,    i) {
        for (i = 3; i <= NF; i++)
            if (index($i, name "=") == 1)
                return substr($i, length(name) + 2)
        return ""
    }
    BEGIN {
        print "kernel", "variant", "shared memory, bytes", "registers: vega10", "navi21", "navi21, 32", "gfx1100", "gfx1100, 32",
              "instructions: vega10", "of navi21, 32", "of a row: vega10", "row of navi21, 32", "row of gfx1100, 32", "spilled"
    }
    /^#/ { next }
    {
        key = $1 OFS $2
        if (FILENAME == ARGV[1])
            order[++n] = key
        shared[key] = value("LDS size")
        registers[key] = registers[key] OFS value("VGPRs")
        spilled[key] += value("Spilled VGPRs") + value("Spilled SGPRs") + value("Scratch size")
        code[key, FILENAME] = value("Instructions")
        row[key, FILENAME] = value("Instructions of a row")
        if (row[key, FILENAME] == "")
            row[key, FILENAME] = "-"
    }
    END {
        for (i = 1; i <= n; i++)
            print order[i], shared[order[i]] registers[order[i]], code[order[i], "vega10"],
                  code[order[i], "navi21+cswave32"], row[order[i], "vega10"], row[order[i], "navi21+cswave32"],
                  row[order[i], "gfx1100+cswave32"], spilled[order[i]]
    }' "${places[@]}" >registers.tsv
mv registers.tsv "$OLDPWD/bench/results/registers.tsv"
