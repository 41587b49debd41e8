#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# How well the audit tells poisoned sets and photos from clean ones. Prints Markdown and both areas under the ROC curve.
#     bench/audit.sh TOOL CLEAN... -- POISONED...        each a scene's folder, with options after a comma: lego,--downscale,2
set -euo pipefail
export LC_ALL=C
[[ $# -ge 4 && " ${*:2} " == *' -- '* && $2 != -- && ${!#} != -- ]] || { sed -n '3,4s/^# //p' "$0" >&2; exit 1; }
tool=$1; shift
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# SET LABEL
row() {
    local options
    IFS=, read -ra options <<<"$1"
    "$tool" audit "${options[@]}" --json --quiet >"$work/audit.json"
    tr -d ' \n' <"$work/audit.json" >"$work/flat"
    grep -o '"score":[^,}]*,"verdict":"[a-z]*"' "$work/flat" | tr -d '"' | tr ':' ' ' | tr ',' ' ' >"$work/scores"
    sed -n 's/^{\(.*\)"images".*/\1/p' "$work/flat" | grep -o '"score":[^,}]*' | cut -d: -f2 >"$work/score"
    awk -v label="$2" '{ print label, $2 }' "$work/scores" >>"$work/photos"
    echo "$2 $(cat "$work/score")" >>"$work/sets"
    awk -v set="${1//,/ }" -v score="$(cat "$work/score")" '{ n[$4]++ }
        END { printf "| %s | %.3f | %d | %d | %d |\n", set, score, n["clean"], n["suspicious"], n["poisoned"] }' "$work/scores"
}

# Share of the pairs of a clean and a poisoned one in which the poisoned one scores higher; equals count half.
area() {
    sort -g -k 2 "$1" | awk '
        { value[NR] = $2; poisoned[NR] = $1; n[$1]++ }
        END { for (i = 1; i <= NR; i = j) {
                  p = c = 0
                  for (j = i; j <= NR && value[j] == value[i]; j++) { p += poisoned[j]; c += !poisoned[j] }
                  sum += p * (below + c / 2); below += c }
              printf "%.4f", sum / (n[0] * n[1]) }'
}

echo '| set | score | clean | suspicious | poisoned |'
echo '|---|---|---|---|---|'
label=0
for set; do
    [ "$set" = -- ] && { label=1; continue; }
    row "$set" "$label"
done
sets=$(area "$work/sets") photos=$(area "$work/photos")
printf '\nROC AUC: sets %s, single photos %s.\n' "$sets" "$photos"
