# SPDX-License-Identifier: Apache-2.0
# The command line itself: spellings, ranges, hints, exit codes.
. "$(dirname "$0")/common.sh"

expect 1
expect 0 --help
expect 0 help train
for word in help version; do # which completions offer too
    expect 0 help $word; grep -q '^  splatguard train ' out || fail "help $word: no list of commands"
done
expect 0 --version
grep -q '^splatguard [0-9]' out || fail "--version prints $(cat out)"
for command in train attack eval render synth info compare spectrum audit; do
    expect 0 $command --help
    grep -q "^splatguard $command " out || fail "$command --help"
    awk 'length > 100 { exit 1 }' out || fail "$command --help is wider than 100 columns"
    shown=$(grep -cE '^ {2}(-.,| {3}) --' out || true)
    [ "$shown" -le 30 ] || fail "$command --help lists $shown options"
    hidden=$(sed -n "s/^splatguard $command --help-all lists \([0-9]*\) more options.*/\1/p" out)
    expect 0 $command --help-all
    all=$(grep -cE '^ {2}(-.,| {3}) --' out || true)
    [ "$((shown + ${hidden:-0}))" = "$all" ] || fail "$command: $shown options and $hidden more, not $all"
done
expect 0 -V
grep -q '^splatguard [0-9]' out || fail "-V prints $(cat out)"
expect 1 trian; says 'unknown command "trian"; did you mean train?'
expect 1 help evl; says 'did you mean eval?'
expect 1 rend; says 'did you mean render?'
expect 2 train nowhere -o none --eval-every 5; says 'warning: --eval-every has no effect without --eval'
expect 2 train nowhere -o none --test-every 5 --max-vram 1G --cpu baseline
says 'warning: --test-every has no effect without --eval'; says 'warning: --max-vram has no effect with --cpu'
for command in 'eval nowhere' 'render nowhere -o none' 'compare nowhere -s nowhere' 'view nowhere' 'prune nowhere -s nowhere -o none.ply'; do
    # shellcheck disable=SC2086 # several words
    expect 2 $command --engine ref --max-vram 1G; says 'warning: --max-vram has no effect with --engine ref'
done
expect 2 eval nowhere --max-vram 1G
grep -q 'warning' err && fail "--max-vram with --engine auto warns: $(cat err)"
expect 2 train nowhere -o none --strategy mcmc --cap-max 90 --densify-until-iter 5
says 'warning: --densify-until-iter has no effect with --strategy mcmc, which has --mcmc-until'
expect 2 train nowhere -o none --sh-interval 5 --opacity-reset-interval 5 --model scaffold
says 'warning: --sh-interval has no effect with --model scaffold'
says 'warning: --opacity-reset-interval has no effect with --model scaffold'
expect 2 train nowhere -o none --sh-interval 5 --opacity-reset-interval 5 --strategy mcmc
says 'warning: --opacity-reset-interval has no effect with --strategy mcmc'
! grep -q 'sh-interval' err || fail "--sh-interval with --strategy mcmc warns: $(cat err)"
expect 2 train nowhere -o none --eval-every 5 --eval
grep -q 'warning' err && fail "--eval-every with --eval warns: $(cat err)"
expect 1 train nowhere -o none --save_iterations 7000; says 'unknown option --save_iterations; --save-every N'
expect 1 frobnicate; says 'unknown command "frobnicate"; splatguard --help'

expect 1 train scene -o run --iteration 5; says 'did you mean --iterations?'
expect 1 convert a b -o c; says 'unknown option -o; OUT is named without an option: convert RUN|MODEL OUT'
expect 1 train --hlep; says 'unknown option --hlep; did you mean --help?'
expect 1 train --xyz; says 'unknown option --xyz'; ! grep -q 'did you mean' err || fail "a name is suggested that is like none"
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

# What is said twice cannot both be meant.
expect 1 train scene -s other -o run; says 'found two scenes, scene and --source-path other'
expect 1 attack scene -s other -o run; says 'found two scenes'
expect 1 train -o run --resume scene -s other; says 'found two scenes'
expect 1 train scene -o run -m run; says 'found --output and --model-path, which mean the same'
expect 1 train scene -o run --seed 1 --seed 1; says '--seed: found twice'
expect 1 train scene -o run --engine cpu --backend ref; says '--engine, also called --backend: found twice'
expect 1 train scene -o run --lambda_dssim 0.1 --lambda-dssim=0.2; says '--lambda-dssim: found twice'
expect 1 train scene -o run -j2 --threads 3; says '--threads: found twice'
for command in "train scene -o run" "attack scene -o run" "eval run" "render run -o images" "audit scene"; do
    expect 1 $command -q --quiet; says '--quiet: found twice'
done
for command in "info model.ply" "compare run" "spectrum a.png"; do
    expect 1 $command --json --json; says '--json: found twice'
done
expect 1 synth -o scene -o other; says '--output: found twice'
: >model.ply
expect 1 eval model.ply --scene scene --iteration 3; says "--iteration: found with the model model.ply, expected a run's folder"
expect 1 spectrum a.png --crop 0,0,8,8; says '--crop: found without a picture'
for option in '--split train' '--iteration 3' '--downscale 2' '--mip-kernel 0.1' '--engine ref' '--threads 2' '--max-memory 1G'; do
    expect 1 compare run $option; says "${option% *}: found without effect, expected --scene with it"
done
expect 1 info model.ply --downscale 2; says '--downscale: found without effect on model.ply, expected a scene'
expect 1 info --devices --downscale 2; says '--downscale: found without effect on --devices, expected a scene'
expect 1 report model.ply -o page --scene scene; says '--scene: found without effect on a database'
expect 1 report model.ply -o page --max-memory 1G; says '--max-memory: found without effect on a database'
mkdir photos
expect 1 view photos --iteration 3; says '--iteration: found without effect on the scene photos'

# Ranges are those of the option that a value came from.
expect 1 train scene -o run -r 0; says '--resolution: found "0", expected a whole number from -1 to 16384, but not 0'
expect 1 train scene -o run --rho 2; says '--rho: found "2", expected a number from 0 to 0.5, growth:X with X up to 0.9, or preset'
expect 2 train nowhere -o run --smooth gaussian; says nowhere
expect 1 train scene -o run --preset ns --rho=-0.95; says '--rho: found "-0.95", expected'
expect 2 train nowhere -o run --rho preset --rho-least=-1 --filter-frequency 0 --defense spectral; says nowhere
expect 1 train scene -o run --band-low 0.9 --band-high 0.5 --defense spectral; says '--band-high: found 0.5, expected 0.9 to 1'
expect 1 spectrum a.png --low 0.9 --high 0.1; says '--low: found 0.9, expected less than --high, 0.1'
expect 0 train --help-all; tr '\n' ' ' <out | tr -s ' ' | grep -q 'at a time, 0 to 0.5; growth:X' || fail "--rho has no range"

# Sizes and times. A size that is too small for the process is said in bytes.
for size in 1K:1024 1k:1024 1KiB:1024 1kB:1000 1.5M:1572864 2MB:2000000 2mb:2000000 2MiB:2097152 0.25MiB:262144 \
    0.001G:1073741 0.002GB:2000000 0.001GiB:1073741 300000:300000 300000B:300000 0.000001T:1099511 0.00001TB:10000000; do
    expect 3 audit scene --max-memory "${size%:*}"; says "found ${size#*:} bytes"
done
for size in 1.5 1.5B .5M 1.M 5X 5Gi 5GBB 5G5 G -1G 1e6 '1 G' 1,5G 99999999T 17179869184G 1..5G; do
    expect 1 audit scene --max-memory "$size"; says "found \"$size\", expected a size from 0 to"
done
for time in 1h30 30m1h 1h1h 2x 1d- 1h-30m '1h 30m' m 1hm 1h1e999m -1s; do
    expect 1 train scene -o run --max-time "$time"; says "found \"$time\", expected a time from 0 to"
done
expect 0 synth -o scene --width 32 --height 24 --train-views 4 --test-views 1 --points 50 --samples 1
for time in 90:90 90s:90 1.5h:5400 1h30m:5400 1d:86400 1d2h3m4.5s:93784.5 2m:120; do
    expect 0 train scene/blender -o run --force --iterations 1 --init-points 10 -q --max-time "${time%:*}"
    grep -Eq "\"max-time\": ${time#*:}(\.0)?,?\$" run/config.json || fail "$time: $(grep max-time run/config.json)"
done
rm -r scene run model.ply
expect 1 train --resume; says "needs the run's folder"
expect 1 render model.ply --scene scene; says 'missing -o DIR'
expect 1 synth; says 'missing -o DIR; usage: splatguard synth -o DIR'

# Spellings of the reference reach the same options: everything parses, and the scene is missing.
expect 2 train -s nowhere -m run -i images_4 -r 2 -w --densify_grad_threshold=0.0003 --sh_degree 2 -j2
says nowhere
expect 2 train nowhere -o run --backend ref; says nowhere # the older name of --engine
[ ! -e run ] || fail "a run folder was made for a scene that is not there"
expect 2 train nowhere -o run --resume; says run/config.json

# Every command that works for a while can be quiet and takes a number of threads.
expect 0 synth -q -j 1 -o quiet --width 16 --height 16 --train-views 4 --test-views 1 --points 10 --samples 1
[ ! -s err ] || fail "synth -q says something"

# Ctrl-C cancels what is not saved in steps: it ends at once and leaves nothing.
"$tool" synth -o cancelled --train-views 400 -q 2>err &
interrupt $!
[ $? = 130 ] || fail "synth, interrupted: another exit code"
says 'synth: cancelled after'
[ ! -e cancelled ] || fail "synth, interrupted: left $(ls cancelled)"
