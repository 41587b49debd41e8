# SPDX-License-Identifier: Apache-2.0
# Completions of shells have every command and option, and offer what the option tables say.
. "$(dirname "$0")/common.sh"
for shell in bash zsh fish; do
    expect 0 help --completion $shell
    mv out $shell
done
expect 1 help --completion tcsh; says 'found "tcsh", expected bash, zsh or fish'
expect 1 help --completion; says 'found "", expected bash, zsh or fish'
expect 1 help --man trian; says 'unknown command "trian"; did you mean train?'

# One line "COMMAND OPTION" for each, from the page of options.
expect 0 help --markdown
sed -n -e 's/^## splatguard //p' -e 's/^| `--\([-a-z0-9]*\).*/--\1/p' out | awk '/^--/ { print command, $0; next } { command = $0 }' >options
[ "$(wc -l <options)" -gt 300 ] || fail "the page of options has $(wc -l <options)"
{ cat options; cut -d ' ' -f 1 options | sort -u | awk '{ print $1, "--help"; print $1, "--help-all" }'; } | sort >expected
awk '/^    [a-z]+\)$/ { command = substr($1, 1, length($1) - 1) }
    /^        options=/ { gsub(/options=|\047/, ""); for (i = 1; i <= NF; i++) print command, $i }' bash | sort >found_bash
awk '/^    \([a-z]+\)$/ { command = substr($1, 2, length($1) - 2) }
    /^            \047/ { while (match($0, /--[-a-z0-9]+=?[[}]/)) {
        print command, substr($0, RSTART, RLENGTH); $0 = substr($0, RSTART + RLENGTH) } }' zsh | sed 's/=*[[}]$//' | sort >found_zsh
sed -n "s/.*seen_subcommand_from \([a-z]*\)' -l \([-a-z0-9]*\) .*/\1 --\2/p" fish | sort >found_fish
for shell in bash zsh fish; do
    diff expected found_$shell || fail "$shell: other options than splatguard has"
done

# What a shell offers at the end of a command line, sorted.
: >a_file
mkdir a_folder
bash_offers() {
    bash -c 'compopt() { :; }; source ./bash; read -ra COMP_WORDS <<<"$1"; [[ $1 != *" " ]] || COMP_WORDS+=("")
        COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _splatguard; printf "%s\n" "${COMPREPLY[@]}"' bash "$1" | sort | paste -sd ' ' -
}
# shellcheck disable=SC2016
fish_offers() { fish -c 'source fish; complete -C $argv[1]' "$1" | cut -f 1 | sort | paste -sd ' ' -; }
offers() { # LINE WORDS
    got=$(bash_offers "$1")
    [ "$got" = "$2" ] || fail "bash offers \"$got\" after \"$1\", expected \"$2\""
    command -v fish >/dev/null || return 0
    got=$(fish_offers "$1")
    [ "$got" = "$2" ] || fail "fish offers \"$got\" after \"$1\", expected \"$2\""
}
offers 'splatguard tr' train
offers 'splatguard train --strat' --strategy
offers 'splatguard train --strategy ' 'default lightgaussian mcmc'
offers 'splatguard train --strategy m' mcmc
offers 'splatguard train --engine v' vulkan
offers 'splatguard train --iterations ' ''
offers 'splatguard help aud' audit
[ "$(bash_offers 'splatguard train --strategy = l')" = lightgaussian ] || fail "bash does not complete --strategy=l"
[ "$(bash_offers 'splatguard train a_')" = 'a_file a_folder' ] || fail "bash offers no files"
[ "$(bash_offers 'splatguard train -o a_fo')" = a_folder ] || fail "bash offers no files for an option"
if command -v zsh >/dev/null; then
    zsh -f -c 'autoload -Uz compinit && compinit -D -u && source ./zsh && [[ $_comps[splatguard] = _splatguard ]]' 2>err || fail "zsh"
    [ ! -s err ] || fail "zsh complains"
fi

# A man page for each command.
cut -d ' ' -f 1 options | sort -u | while read -r command; do
    expect 0 help --man "$command"
    grep -q '^\.SH OPTIONS' out || fail "no man page of $command"
    tr -d '\134' <out | sed -n 's/^fB.*\(--[-a-z0-9]*\)fR .*/\1/p' | sort >found
    awk -v command="$command" '$1 == command { print $2 }' options | sort | diff - found || fail "the man page of $command"
    if command -v groff >/dev/null; then
        complaints=$(groff -man -Tutf8 -wall out 2>&1 >/dev/null | head -5)
        [ -z "$complaints" ] || fail "groff: $command: $complaints"
    fi
done || exit 1
