#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Milliseconds an iteration next to those of OpenSplat 1.1.5 (CPU build, 2 threads, 2-core AVX-512 machine; full image size
# from the first step), at equal image sizes and Gaussians; then quality after equal iterations. Prints Markdown.
#     bench/opensplat.sh TOOL LEGO FOX        LEGO: NeRF-Synthetic's lego, FOX: instant-ngp's fox
set -eu
tool=$1 lego=$2 fox=$3
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# NAME FROM TO THEIRS_LOW THEIRS_HIGH SCENE OPTIONS...: mean over iterations FROM to TO
row() {
    local name=$1 from=$2 to=$3 low=$4 high=$5
    shift 5
    "$tool" train "$@" -o "$work/run" --force --quiet --threads 2 --iterations "$to" --log-every "$from" \
        --densify-from-iter 100 >/dev/null
    awk -F'[:,]' -v name="$name" -v from="$from" -v to="$to" -v low="$low" -v high="$high" '
        { for (i = 1; i < NF; i++) v[$i] = $(i + 1)
          at[v["{\"iteration\""]] = v["\"train_seconds\""]; n = v["\"gaussians\""] }
        END { ms = 1000 * (at[to] - at[from]) / (to - from)
              printf "| %s | %d | %.1f | %s | %.0fx", name, n, ms, low == high ? low : low " to " high, low / ms
              if (low != high) printf " to %.0fx", high / ms
              print " |" }' "$work/run/log.jsonl"
}

echo '| scene | Gaussians | ms | OpenSplat, ms | ratio |'
echo '|---|---|---|---|---|'
row 'lego 400x400, cube of random points' 50 100 1400 1400 "$lego" --downscale 2 --init-points 10000 --densify-until-iter 0
row 'lego 400x400' 1000 1500 177 177 "$lego" --downscale 2 --init-points 3000 --max-gaussians 3000
row 'lego 400x400' 1000 1500 192 192 "$lego" --downscale 2 --init-points 10000 --max-gaussians 15000
row 'lego 800x800, cube of random points' 50 100 7100 7100 "$lego" --init-points 10000 --densify-until-iter 0
row 'lego 800x800' 1000 1500 700 1100 "$lego" --init-points 10000 --max-gaussians 15000
row 'fox 529x945' 1000 1500 1200 1200 "$fox" --downscale 2 --init-points 10000 --max-gaussians 12000
row 'fox 529x945' 1000 1500 1500 1500 "$fox" --downscale 2 --init-points 10000 --max-gaussians 30000
echo
echo '| lego 400x400, 2 000 iterations from random points | PSNR, dB | seconds | Gaussians |'
echo '|---|---|---|---|'
echo '| OpenSplat 1.1.5 | 24.4 | 805 | |'
for points in 10000 100000; do
    "$tool" train "$lego" -o "$work/run" --force --quiet --threads 2 --iterations 2000 --downscale 2 --eval \
        --init-points $points --position-lr-max-steps 2000 >/dev/null
    awk -F': ' -v points=$points '{ gsub(/,/, "", $2); v[$1] = $2 }
        END { printf "| splatguard, %d points | %.2f | %.0f | %d |\n", points, v["  \"psnr\""], v["  \"train_seconds\""],
                     v["  \"final_gaussians\""] }' "$work/run/summary.json"
done
