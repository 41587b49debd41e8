#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Milliseconds per iteration next to those of OpenSplat 1.1.5 (CPU build, 2 threads, 2-core AVX-512 machine; full image
# size from the first step), at equal image sizes and numbers of Gaussians; then quality after equal iterations. Writes
# bench/results/opensplat.tsv and opensplat-quality.tsv.
#     bench/opensplat.sh TOOL LEGO FOX MACHINE
#     LEGO: NeRF-Synthetic's lego, FOX: instant-ngp's fox, MACHINE: a name of bench/results/machines.tsv
set -eu
[ $# = 4 ] || { sed -n '3,7s/^# //p' "$0" >&2; exit 1; }
tool=$1 lego=$2 fox=$3 machine=$4
results=$(dirname "$0")/results
commit=$(git -C "$results" rev-parse --short HEAD)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# SCENE SIZE START FROM TO THEIRS_LOW THEIRS_HIGH FOLDER OPTIONS...: mean over iterations FROM to TO
row() {
    local name=$1 size=$2 start=$3 from=$4 to=$5 low=$6 high=$7
    shift 7
    "$tool" train "$@" -o "$work/run" --force --quiet --threads 2 --iterations "$to" --log-every "$from" \
        --densify-from-iter 100 >/dev/null
    awk -F'[:,]' -v name="$name" -v size="$size" -v start="$start" -v from="$from" -v to="$to" -v low="$low" -v high="$high" \
        -v commit="$commit" -v machine="$machine" '
        { for (i = 1; i < NF; i++) v[$i] = $(i + 1)
          at[v["{\"iteration\""]] = v["\"train_seconds\""]; n = v["\"gaussians\""] }
        END { ms = 1000 * (at[to] - at[from]) / (to - from)
              printf "%s\t%s\t%s\t%d\t%.1f\t%s\t%.0fx", name, size, start, n, ms, low == high ? low : low " to " high, low / ms
              if (low != high) printf " to %.0fx", high / ms
              printf "\t%s\t%s\n", commit, machine }' "$work/run/log.jsonl"
}

{
    printf 'scene\tsize\tstart\tGaussians\tms\tOpenSplat, ms\tratio\tcommit\tmachine\n'
    cube='cube of random points'
    row lego 400x400 "$cube" 50 100 1400 1400 "$lego" --downscale 2 --init-points 10000 --densify-until-iter 0
    row lego 400x400 '' 1000 1500 177 177 "$lego" --downscale 2 --init-points 3000 --max-gaussians 3000
    row lego 400x400 '' 1000 1500 192 192 "$lego" --downscale 2 --init-points 10000 --max-gaussians 15000
    row lego 800x800 "$cube" 50 100 7100 7100 "$lego" --init-points 10000 --densify-until-iter 0
    row lego 800x800 '' 1000 1500 700 1100 "$lego" --init-points 10000 --max-gaussians 15000
    row fox 529x945 '' 1000 1500 1200 1200 "$fox" --downscale 2 --init-points 10000 --max-gaussians 12000
    row fox 529x945 '' 1000 1500 1500 1500 "$fox" --downscale 2 --init-points 10000 --max-gaussians 30000
} >"$work/opensplat.tsv"
{
    printf 'program\tstart\tPSNR, dB\tseconds\tGaussians, end\tcommit\tmachine\n'
    printf 'OpenSplat 1.1.5\t\t24.4\t805\t\t\t%s\n' "$machine"
    for points in 10000 100000; do
        grouped=${points%000}" 000"
        "$tool" train "$lego" -o "$work/run" --force --quiet --threads 2 --iterations 2000 --downscale 2 --eval \
            --init-points $points --position-lr-max-steps 2000 >/dev/null
        awk -F': ' -v points="$grouped" -v commit="$commit" -v machine="$machine" '{ gsub(/,/, "", $2); v[$1] = $2 }
            END { printf "splatguard\t%s random points\t%.2f\t%.0f\t%d\t%s\t%s\n", points, v["  \"psnr\""],
                         v["  \"train_seconds\""], v["  \"final_gaussians\""], commit, machine }' "$work/run/summary.json"
    done
} >"$work/opensplat-quality.tsv"
mv "$work"/*.tsv "$results"
"$results/../../scripts/tables"
