# SPDX-License-Identifier: Apache-2.0
# The command line itself: spellings, ranges, hints, exit codes.
. "$(dirname "$0")/common.sh"

expect 1
expect 0 --help
expect 0 help train
expect 0 --version
grep -q '^splatguard [0-9]' out || fail "--version prints $(cat out)"
for command in train eval render synth info; do
    expect 0 $command --help
    grep -q "^splatguard $command " out || fail "$command --help"
    awk 'length > 100 { exit 1 }' out || fail "$command --help is wider than 100 columns"
done
expect 1 trian; says 'unknown command "trian"'

expect 1 train scene -o run --iteration 5; says 'did you mean --iterations?'
expect 1 train scene -o run --densify_grad_treshold 5; says 'did you mean --densify-grad-threshold?'
expect 1 train scene -o run --iterations 0; says 'found "0", expected a whole number from 1 to 10000000'
expect 1 train scene -o run --iterations=12x; says 'found "12x"'
expect 1 train scene -o run --lambda-dssim nan; says 'found "nan", expected a number from 0 to 1'
expect 1 train scene -o run --seed -1; says 'found "-1"'
expect 1 train scene -o run --seed 99999999999999999999; says 'found "99999999999999999999"'
expect 1 train scene -o run --format tiff; says 'expected one of auto|blender|colmap|nerfstudio'
expect 1 train scene -o run --max-memory 5X; says 'found "5X"'
expect 1 train scene -o run --eval=yes; says 'takes no value'
expect 1 train scene -o run --seed; says 'found no value'
expect 1 train scene -o ''; says 'expected a name'
expect 1 train ''; says 'empty argument'
expect 1 train scene; says 'missing -o RUN'
expect 1 train -o run; says 'missing SCENE'
expect 1 train scene other -o run; says 'unexpected argument "other"'
expect 1 train --resume; says "needs the run's folder"
expect 1 render model.ply --scene scene; says 'missing -o DIR'
expect 1 synth; says 'missing -o DIR'

# Spellings of the reference reach the same options: everything parses, and the scene is missing.
expect 2 train -s nowhere -m run -i images_4 -r 2 -w --densify_grad_threshold=0.0003 --sh_degree 2 -j2
says nowhere
expect 2 train nowhere -o run --backend ref; says nowhere # the older name of --engine
[ ! -e run ] || fail "a run folder was made for a scene that is not there"
expect 2 train nowhere -o run --resume; says run/config.json
