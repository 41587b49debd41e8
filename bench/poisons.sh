#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Makes what the audit is measured on: Poison-splat of each scene at epsilon 8, 16 and 24 in each form of total variation, as PNG
# and as JPEG (quality 75, 4:2:0), in OUT/SCENE-EPSILON-FORM[-jpg]. Two attacks run at a time, with a thread each; what is
# there is kept, so a second call goes on. Takes hours.
#     bench/poisons.sh TOOL DATA OUT          DATA has the folders lego, bonsai, train and fox
set -euo pipefail
[ $# = 3 ] || { sed -n '3,6s/^# //p' "$0" >&2; exit 1; }
export tool=$1 data=$2 out=$3
mkdir -p "$out"

# SCENE: its size; schedule of the proxy; schedule of the attack
options() {
    short='--iterations 3000 --densify-until-iter 2000 --position-lr-max-steps 3000'
    case $1 in
    lego) size='--downscale 2' proxy='--iterations 7000' attack='--iterations 3000 --inner 15' ;;
    train) size='--downscale 2' proxy='--iterations 7000' attack='--iterations 1500 --inner 25' ;;
    fox) size='--downscale 2' proxy=$short attack='--iterations 1500 --inner 25' ;;
    bonsai) size='' proxy=$short attack='--iterations 1500 --inner 25' ;;
    esac
}

# SCENE [EPSILON FORM]: the proxy, or a poisoned set
# shellcheck disable=SC2086
poison() {
    options "$1"
    local set=$out/$1${2:+-$2-$3}
    [ ! -e "$set.done" ] || return 0
    if [ $# = 1 ]; then
        "$tool" train "$data/$1" -o "$set" $size $proxy -j 1 --quiet --force
    else
        "$tool" attack "$data/$1" -o "$set" $size $attack --epsilon "$2" --tv "$3" --proxy "$out/$1" --save png -j 1 --quiet --force
        "$tool" attack "$set" -o "$set-jpg" --method noise --epsilon 0 --save jpg --quiet --force # the same photos
    fi
    touch "$set.done"
}
export -f options poison

printf '%s\n' train lego fox bonsai | xargs -P 2 -I{} bash -ec 'poison {}'
for form in vertical2 aniso iso; do
    for epsilon in 8 24 16; do
        printf '%s\n' {train,lego,fox,bonsai}" $epsilon $form"
    done
done | xargs -P 2 -I{} bash -ec 'poison {}'
