#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# examples.sh TOOL FOLDER: runs the programs of examples/, which are in the folder.
set -eu
tool=$1
programs=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() {
    echo "FAILED: $*" >&2
    exit 1
}
"$tool" synth -o "$work/scene" --width 32 --height 24 --train-views 4 --test-views 1 --points 50 -q >"$work/log" 2>&1 ||
    fail "synth: $(cat "$work/log")"

"$programs/train" "$work/scene/colmap" "$work/model.ply" 20 >"$work/out" 2>"$work/err" || fail "train: $(cat "$work/err")"
grep -q 'model.ply: [0-9]* Gaussians' "$work/out" || fail "train says $(cat "$work/out")"
"$tool" info "$work/model.ply" >/dev/null || fail "train wrote no model"
if "$programs/train" "$work/nowhere" "$work/model.ply" 2>"$work/err"; then fail "train takes a scene that is not there"; fi
grep -q nowhere "$work/err" || fail "train names no scene: $(cat "$work/err")"

"$programs/audit" "$work/scene/colmap" >"$work/out" 2>"$work/err" || [ $? = 5 ] || fail "audit: $(cat "$work/err")"
grep -q 'of 5 photos poisoned' "$work/out" || fail "audit says $(cat "$work/out")"

"$programs/render_from_memory" "$work/picture.ppm" || fail "render_from_memory"
[ "$(head -c 15 "$work/picture.ppm" | tr '\n' ' ')" = "P6 160 120 255 " ] || fail "render_from_memory wrote no picture"
[ "$(tail -c +16 "$work/picture.ppm" | tr -d '\000' | wc -c)" -gt 10000 ] || fail "render_from_memory wrote a black picture"

"$programs/scene_from_memory" "$work/ball.ply" >"$work/out" 2>"$work/err" || fail "scene_from_memory: $(cat "$work/err")"
psnr=$(sed -n 's/.*PSNR \([0-9]*\)\..*/\1/p' "$work/out")
[ "${psnr:-0}" -ge 20 ] || fail "scene_from_memory says $(cat "$work/out")"
