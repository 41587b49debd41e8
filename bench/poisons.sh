#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Makes what the audit is fitted to and measured on, each set as PNG and as JPEG (quality 75, 4:2:0; NAME-jpg), in OUT:
#   SCENE-EPSILON-FORM             Poison-splat at epsilon 8, 16 and 24 in each form of total variation
#   tv-SCENE-EPSILON-FORM[-SPARE]  tv-per-view at epsilon 8 and 16; at 16 also with 30 and 50 % of each photo spared
# Two at a time, with a thread each; what is there is kept, so a second call goes on. Takes hours.
#     bench/poisons.sh TOOL DATA OUT          DATA has the folders lego, bonsai, train and fox
set -euo pipefail
[ $# = 3 ] || { sed -n '3,7s/^# //p' "$0" >&2; exit 1; }
export tool=$1 data=$2 out=$3
mkdir -p "$out"

short='--iterations 3000 --densify-until-iter 2000 --position-lr-max-steps 3000'
declare -A size=([train]='--downscale 2' [lego]='--downscale 2' [fox]='--downscale 2' [bonsai]='')
declare -A proxy=([train]='--iterations 7000' [lego]='--iterations 7000' [fox]=$short [bonsai]=$short)
declare -A attack=([train]='--iterations 1500 --inner 25' [lego]='--iterations 3000 --inner 15'
    [fox]='--iterations 1500 --inner 25' [bonsai]='--iterations 1500 --inner 25')
scenes='train lego fox bonsai'

# COMMAND NAME SCENE OPTIONS...
make_set() {
    local set=$out/$2
    [ ! -e "$set.done" ] || return 0
    "$tool" "$1" "$data/$3" -o "$set" "${@:4}" -j 1 --quiet --force
    if [ "$1" = attack ]; then # again, without a change, for the JPEG files
        "$tool" attack "$set" -o "$set-jpg" --method noise --epsilon 0 --save jpg -j 1 --quiet --force
    fi
    touch "$set.done"
}
export -f make_set
two_at_a_time() { xargs -P 2 -I{} bash -euc 'make_set {}'; }

for scene in $scenes; do
    echo "train $scene $scene ${size[$scene]} ${proxy[$scene]}"
done | two_at_a_time
for form in vertical2 aniso iso; do
    for epsilon in 8 24 16; do
        for scene in $scenes; do
            echo "attack $scene-$epsilon-$form $scene ${size[$scene]} ${attack[$scene]} --epsilon $epsilon --tv $form" \
                "--proxy $out/$scene --save png"
        done
    done
done | two_at_a_time
for form in vertical2 aniso; do
    for kind in 8 16 16-0.3 16-0.5; do
        for scene in $scenes; do
            spare=${kind#*-}
            echo "attack tv-$scene-${kind%%-*}-$form$([ "$spare" = "$kind" ] || echo "-$spare") $scene ${size[$scene]}" \
                "--method tv-per-view --epsilon ${kind%%-*} --tv $form --save png" \
                "$([ "$spare" = "$kind" ] || echo "--spare $spare")"
        done
    done
done | two_at_a_time
