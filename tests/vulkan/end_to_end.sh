# SPDX-License-Identifier: Apache-2.0
# A training that densifies reaches the quality of the CPU's on views that it has not seen, to 0.1 dB: on the engine of
# SG_TEST_ENGINE.
. "$(dirname "$0")/../cli/common.sh"
expect 0 synth -o scene --width 48 --height 36 --train-views 40 --test-views 16 --points 1000 --samples 1
schedule="--iterations 200 --sh-interval 50 --densify-from-iter 40 --densification-interval 20 --densify-until-iter 140 \
    --densify-grad-threshold 0.002 --opacity-reset-interval 100000 --position-lr-max-steps 200 --quiet"
psnr() { sed -n 's/.*"psnr": \([0-9.]*\).*/\1/p' "$1/summary.json"; }
expect 0 train scene/colmap -o cpu --eval --engine cpu $schedule
expect 0 train scene/colmap -o device --eval $schedule
awk "BEGIN { d = $(psnr device) - $(psnr cpu); exit !(d * d <= 0.01 && $(psnr cpu) > 16) }" ||
    fail "PSNR $(psnr device), expected $(psnr cpu) to 0.1 dB, and more than 16"
echo "PSNR $(psnr device), on the CPU $(psnr cpu)"
