# SPDX-License-Identifier: Apache-2.0
# On a terminal a stage that takes longer than a second shows how far it is, in one line; --quiet and other places show nothing.
. "$(dirname "$0")/common.sh"
command -v script >/dev/null || { echo "skipped: no command script"; exit 77; }
long="synth -o made --width 200 --height 150 --train-views 4000 --test-views 1 --samples 4"
count='synth [0-9]*/[0-9]*'

# on_terminal ARGUMENTS...: what a terminal shows in the first 3 seconds.
on_terminal() {
    script -qefc "timeout --foreground --preserve-status -s TERM 3 '$program' $*" shown </dev/null >/dev/null
    got=$?
    [ $got -eq 130 ] || fail "an interrupted synth exited with $got: $(cat -v shown)"
    rm -rf made
}

# shellcheck disable=SC2086 # words of a command
on_terminal $long
grep -q "$(printf '\r\033\[K')$count" shown || fail "no count: $(cat -v shown)"
[ "$(grep -c "$count" shown)" -eq 1 ] || fail "more than a line: $(cat -v shown)"
# shellcheck disable=SC2086
on_terminal $long --quiet
grep -q "$count" shown && fail "a count in spite of --quiet"
# shellcheck disable=SC2086
timeout --preserve-status -s TERM 3 "$program" $long >out 2>err
[ $? -eq 130 ] || fail "an interrupted synth without a terminal"
grep -q "$count" err && fail "a count where there is no terminal"
exit 0
