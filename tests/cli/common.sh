# SPDX-License-Identifier: Apache-2.0
# shellcheck disable=SC2034 # for the scripts that source this
# Sourced by every script: TOOL SOURCE WORK come from CTest. Each script starts in an empty folder.
set -u
tool=$1 source_dir=$2 work=$3
program=$tool # where $tool becomes a script
unset SG_CPU
rm -rf "$work" "$work.tool" && mkdir -p "$work" && cd "$work" || exit 1

# SG_TEST_ENGINE=NAME: commands that draw use that engine instead of the default, unless the script
# names an engine or a CPU variant itself. The tool is then a script that becomes the tool.
if [ -n "${SG_TEST_ENGINE-}" ]; then
    mkdir "$work.tool"
    cat >"$work.tool/splatguard" <<END
#!/bin/sh
measured=- # compare draws with --scene only
case " \$* " in *' --scene '*) measured=compare ;; esac
case "\${1-}" in train | eval | render | attack | "\$measured" | prune | view)
    case " \$* " in *' --engine '* | *' --backend '* | *' --cpu '* | *' --help '*) ;; *) set -- "\$@" --engine '$SG_TEST_ENGINE' ;; esac ;;
esac
exec '$tool' "\$@"
END
    chmod +x "$work.tool/splatguard"
    tool=$work.tool/splatguard
fi
# The same in a plan: its key.
plan_engine=${SG_TEST_ENGINE:+"\"engine\": \"$SG_TEST_ENGINE\", "}

# The tool is built with a sanitizer, which holds memory and addresses of its own.
sanitized() { grep -aqE '__(asan|tsan|msan)_init' "$program"; }

fail() { echo "FAILED: $*" >&2; [ -f err ] && sed 's/^/  stderr: /' err >&2; exit 1; }

# expect CODE ARGUMENTS...: runs the tool; its output goes to the files out and err.
expect() {
    code=$1; shift
    "$tool" "$@" >out 2>err
    got=$?
    [ $got -eq "$code" ] || fail "splatguard $*: exit code $got, expected $code"
}

# says WORDS: the last run's stderr has them.
says() { grep -qF -- "$1" err || fail "stderr does not say: $1"; }

# The name of a browser. None for a tool with sanitizers: they see nothing of what a browser makes of a file.
browser() { ! sanitized && { command -v chromium || command -v google-chrome; }; }

# page_look PAGE: how a page in the test's folder looks, where there are Python and a browser.
page_look() {
    sanitized || ! command -v python3 >/dev/null || python3 "$source_dir/tests/cli/page_look.py" "file://$work/$1" ||
        fail "the look of $1"
}

# dom BROWSER PAGE: what it makes of a page in the test's folder.
dom() {
    timeout -k 5 60 "$1" --headless --no-sandbox --disable-gpu --user-data-dir="$work/browser" \
        --dump-dom "file://$work/$2" 2>browser.err || fail "no page: $(tail -3 browser.err)"
}

# wait_until COMMAND...: tries it until it succeeds.
wait_until() {
    waited=0
    until "$@"; do
        waited=$((waited + 1))
        [ $waited -le 600 ] || fail "not after a minute: $*"
        sleep 0.1
    done
}

# Until a file of a tool in the background has something in it.
wait_for() { wait_until test -s "$1"; }

# Whether a tool in the background has printed its page's address to a file, or has said why there is none.
has_page() { [ -s "$1" ] || grep -q 'no HTTP server' err; }

# Until a tool in the background has a handler for SIGTERM (a bit of SigCgt). Before that, or before the shell has become the
# tool, a signal would be lost.
catches() {
    grep -q '^State:.[^Z]' "/proc/$1/status" 2>/dev/null || fail "process $1 has ended"
    awk '/^Name:/ { name = $2 } /^SigCgt:/ { caught = $2 }
         END { exit !(name == "splatguard" && caught ~ /[4567cdef]...$/) }' "/proc/$1/status"
}
wait_for_handler() { wait_until catches "$1"; }

# interrupt PID: ends a tool in the background as Ctrl-C does, which the shell makes it ignore there, and returns its exit
# code.
interrupt() {
    wait_for_handler "$1"
    kill -TERM "$1"
    wait "$1"
}

# A scene and options with which everything that can happen in a training happens in a second or two.
# With another engine both are smaller: a driver for the CPU takes a hundred times as long.
width=64 height=48 end=120
[ -z "${SG_TEST_ENGINE-}" ] || width=32 height=24 end=60
half=$((end / 2)) size="--width $width --height $height"
small_scene() { expect 0 synth -o scene $size --train-views 6 --test-views 2 --points 300 --samples 1; }
short="--iterations $end --sh-interval $((end / 6)) --densify-from-iter $((end / 12)) --densification-interval $((end / 6)) \
    --opacity-reset-interval $((end * 5 / 12)) --densify-until-iter $((end * 5 / 6)) --log-every $((end / 4)) --quiet"

# once OPTIONS...: where one is there twice, which the tool refuses, only the last stays.
once() {
    printf '%s\n' "$@" | awk '
        /^-[-a-z]/ { name = $0 == "-q" ? "--quiet" : $0; if (!(name in value)) order[++n] = name; value[name] = ""; next }
        { value[name] = " " $0 }
        END { for (i = 1; i <= n; i++) printf "%s%s ", order[i], value[order[i]] }'
}
