#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Writes a model in every format that can be read back and measures each file on the scene's test views: its size, and
# what its rounding costs. Writes bench/results/formats.tsv.
#     bench/formats.sh TOOL MODEL SCENE MACHINE OPTIONS...
#     MODEL: a run's folder or a model, SCENE: its scene, MACHINE: a name of bench/results/machines.tsv,
#     OPTIONS: how the views are loaded, such as --downscale 2
set -eu
[ $# -ge 4 ] || { sed -n '3,7s/^# //p' "$0" >&2; exit 1; }
tool=$1 model=$2 scene=$3 machine=$4
shift 4
views=("$@")
results=$(dirname "$0")/results
commit=$(git -C "$results" rev-parse --short HEAD)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
reference=

number() { sed -n "s/.*\"$1\": \([-0-9.]*\).*/\1/p" "$work/out"; }

# ENDING OPTIONS...: a row; the first one is the reference.
row() {
    local file=$work/m$1 ending=$1 seconds
    shift
    seconds=$({ TIMEFORMAT=%U && time "$tool" convert "$model" "$file" "$@" -q; } 2>&1)
    "$tool" eval "$file" --scene "$scene" "${views[@]}" --json -q >"$work/out"
    reference=${reference:-$(number psnr)}
    awk -v ending="$ending" -v options="$*" -v bytes="$(stat -c %s "$file")" -v n="$(number gaussians)" \
        -v psnr="$(number psnr)" -v ssim="$(number ssim)" -v reference="$reference" -v seconds="$seconds" \
        -v commit="$commit" -v machine="$machine" 'BEGIN {
            printf "%s\t%s\t%d\t%d\t%.1f\t%.2f\t%.2f\t%.4f\t%.1f\t%s\t%s\n", ending, options, n, bytes, bytes / n,
                psnr, psnr - reference, ssim, seconds, commit, machine }'
    rm "$file"
}

{
    printf 'file\toptions\tGaussians\tbytes\tbytes a Gaussian\tPSNR, dB\tchange, dB\tSSIM\tCPU seconds to write\t'
    printf 'commit\tmachine\n'
    row .ply
    row .compressed.ply
    row .spz --spz-version 2
    row .spz --spz-version 3
    row .spz --spz-version 4
    row .sog
    row .splat
} >"$work/formats.tsv"
mv "$work/formats.tsv" "$results/formats.tsv"
