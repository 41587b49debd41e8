# SPDX-License-Identifier: Apache-2.0
# docs/options.md and the man page say what the option tables say.
. "$(dirname "$0")/common.sh"
expect 0 help --markdown
cmp out "$source_dir/docs/options.md" || fail "docs/options.md is out of date: splatguard help --markdown >docs/options.md"
expect 0 help --man train
for option in iterations densify grad scene per split; do
    grep -q "$option" out || fail "the man page lacks $option"
done
expect 0 help --man
sed -n '/^\.SH SYNOPSIS/,/^\.SH COMMANDS/p' out | tr -d '\134' >synopsis
listed=0
for arguments in 'train SCENE -o RUN' 'eval RUN|MODEL --scene SCENE' 'render RUN|MODEL --scene SCENE -o DIR' 'synth -o DIR' \
    'info RUN|MODEL' 'attack SCENE -o POISONED' 'compare RUN...' 'spectrum IMAGE...' 'audit SCENE' 'prune RUN|MODEL' 'convert RUN|MODEL OUT' 'smooth SCENE -o SMOOTHED' 'bench PLAN.json -o DB' 'report RUN|DB... -o DIR' 'view RUN|MODEL|SCENE' 'export RUN|MODEL OUT' 'help [COMMAND]'; do
    tr '\n' ' ' <synopsis | grep -qF -- ".B splatguard $arguments" || fail "the man page's SYNOPSIS lacks: $arguments"
    listed=$((listed + 1))
done
[ $listed -eq $(($(grep -c '^## splatguard ' "$source_dir/docs/options.md") + 1)) ] || fail "this test lists $listed commands, help among them"
if command -v man >/dev/null 2>&1 && command -v groff >/dev/null 2>&1; then
    cp out splatguard.1
    [ -z "$(groff -man -Tutf8 -wall splatguard.1 2>&1 >/dev/null)" ] || fail "groff complains: $(groff -man -Tutf8 -wall splatguard.1 2>&1 >/dev/null | head -5)"
fi
