# SPDX-License-Identifier: Apache-2.0
# The live view: whom it answers, what it draws, what strangers cost it, and its page in a browser.
. "$(dirname "$0")/common.sh"
view=
trap '[ -z "$view" ] || kill "$view" 2>/dev/null' EXIT
# shellcheck disable=SC2034 # for small_scene
size="--width 64 --height 48" # depth and opacity need some pixels
small_scene
points=100000
[ -z "${SG_TEST_ENGINE-}" ] || points=3000
expect 0 train scene/blender -o run --iterations 30 --init-points $points -q --eval
"$tool" view run >out 2>err &
view=$!
wait_until has_page out
[ -s out ] || { echo "skipped: no libmicrohttpd"; exit 77; }
interrupt "$view" || fail "the view ends with $?"
! ldd "$program" | grep microhttpd || fail "every command loads the HTTP server"
mkdir broken # what has none of its functions
ln -s "$(ldd "$program" | awk '/libm\.so/ { print $3 }')" broken/libmicrohttpd.so.12
LD_LIBRARY_PATH=$PWD/broken:${LD_LIBRARY_PATH:-} expect 1 view run; says 'no HTTP server'; says 'MHD_'
# Ctrl-C is caught before anything is made that it would leave behind: here while the server's library is opened.
rm broken/libmicrohttpd.so.12 && mkfifo broken/libmicrohttpd.so.12
LD_LIBRARY_PATH=$PWD/broken:${LD_LIBRARY_PATH:-} "$program" view run 2>err &
view=$!
wait_for_handler "$view"
kill -TERM "$view"
: >broken/libmicrohttpd.so.12 # lets it go on
wait "$view"; [ $? = 1 ] || fail "the view ends with another status"
says 'no HTTP server'
view=
rm broken/libmicrohttpd.so.12 && ln -s "$(ldd "$program" | awk '/libm\.so/ { print $3 }')" broken/libmicrohttpd.so.12
mkdir unread && echo '{' >unread/transforms_train.json
LD_LIBRARY_PATH=$PWD/broken:${LD_LIBRARY_PATH:-} expect 1 view unread; says 'no HTTP server' # before anything is read
expect 2 view unread
rm broken/libmicrohttpd.so.12 && : >broken/libmicrohttpd.so.12
LD_LIBRARY_PATH=$PWD/broken:${LD_LIBRARY_PATH:-} expect 1 train scene/blender -o unseen --view; says 'no HTTP server'
[ ! -e unseen ] || fail "a training that nobody can look at has begun"
command -v python3 >/dev/null || { echo "skipped: no Python"; exit 77; }
if [ -w /dev/full ]; then # nobody would know the address
    for arguments in "view run" "train scene/blender -o unseen -q --view"; do
        timeout 60 "$tool" $arguments >/dev/full 2>err
        [ $? = 2 ] || fail "$arguments: goes on without having printed its address"
        [ "$(grep -c 'standard output: cannot write: No space left' err)" = 1 ] || fail "not said once"
    done
    [ ! -e unseen ] || fail "a training that nobody can look at has begun"
fi
expect 1 view; says 'missing argument'
expect 1 view run --port 70000; says '--port'
expect 1 view scene/blender --scene scene/blender; says 'found two scenes'
expect 1 view run/point_cloud/iteration_30/point_cloud.ply --iteration 3; says '--iteration'
expect 2 view none.ply; says 'none.ply'
expect 2 view run --scene none; says 'none'

begin() { # ARGUMENTS: a view in the background, its address in $address
    rm -f address
    "$tool" view "$@" >address 2>view.err &
    view=$!
    wait_for address
    address=$(cat address)
}
end() {
    interrupt "$view" || fail "the view ends with $?: $(cat view.err)"
    view=
}

begin run
port=${address#*1:}
expect 2 view run --port "${port%%/*}"; says 'cannot listen'
mkdir renders
expect 0 render run -o renders/train --split train -q
expect 0 render run -o renders/test --split test -q
python3 "$source_dir/tests/cli/view_requests.py" "$address" "$view" renders scene/blender || fail "requests"
# What a browser does is the same for all engines.
[ -n "${SG_TEST_ENGINE-}" ] || python3 "$source_dir/tests/cli/view_page.py" "$address" || fail "the page"
end

# Test photos are those that the run has not learned from. Scenes of Blender have theirs in any case.
for of in "colmap train" "blender test train"; do
    expect 0 train "scene/${of%% *}" -o "all-${of%% *}" --iterations 5 --init-points 50 -q
    begin "all-${of%% *}"
    splits=$(python3 -c 'import json, sys, urllib.request
print(*sorted({v["split"] for v in json.load(urllib.request.urlopen(sys.argv[1] + "scene"))["views"]}))' "$address")
    [ "$splits" = "${of#* }" ] || fail "a training of ${of%% *} without --eval shows photos as $splits"
    end
done

# Drawn by the browser, from a file without a name.
mkdir tmp
TMPDIR=$work/tmp begin run
[ -z "$(ls tmp)" ] || fail "left behind: $(ls tmp)"
[ -n "${SG_TEST_ENGINE-}" ] || python3 "$source_dir/tests/cli/view_draw.py" "$address" || fail "drawn by the browser"
end
TMPDIR=$work/none begin run
if grep -q 'PlayCanvas Engine v' "$program"; then
    grep -q 'the browser gets pictures' view.err || fail "no word about a missing TMPDIR: $(cat view.err)"
fi
python3 "$source_dir/tests/cli/view_requests.py" "$address" --draws || fail "a view without TMPDIR"
end

# A browser that xdg-open runs in the foreground keeps neither the page from its pictures nor a terminal's Ctrl-C for itself.
mkdir browser
cat >browser/xdg-open <<'END'
#!/bin/sh
cp "$1" redirect
ps -o pgid= -p $$ >group
awk '/^SigIgn:/ { print $2 }' /proc/$$/status >ignored
echo $$ >browser.pid
exec sleep 60
END
chmod +x browser/xdg-open
XDG_RUNTIME_DIR=$work PATH=$work/browser:$PATH begin run --open
wait_for browser.pid
python3 "$source_dir/tests/cli/view_requests.py" "$address" --draws || fail "a page that a browser has opened"
grep -qF "url=$address" redirect || fail "the browser gets another address: $(cat redirect)"
[ "$(cat group)" -eq "$(cat browser.pid)" ] || fail "the browser is in the view's process group"
[ $((0x$(cat ignored) & 0x1001000)) -eq 0 ] || fail "the browser ignores SIGPIPE or SIGXFSZ: $(cat ignored)"
end
kill "$(cat browser.pid)"
ls splatguard-*.html 2>/dev/null && fail "the address is left behind"

# Anchors, with the appearances of the photos.
expect 0 train scene/blender -o anchors --eval $short --init-points 200 --model scaffold --anchors-from-iter 40 \
    --voxel-size 0.02 --photo-appearance
mkdir looks
expect 0 render anchors -o looks/train --split train -q
expect 0 render anchors -o looks/test --split test --appearance mean -q
begin anchors
python3 "$source_dir/tests/cli/view_requests.py" "$address" --anchors looks || fail "a run of anchors"
end

# A model alone, a scene alone, and a run whose scene has gone.
begin run/point_cloud/iteration_30/point_cloud.ply
python3 "$source_dir/tests/cli/view_requests.py" "$address" --draws || fail "a model alone"
end
printf '\0\0\0\0\0\0\0\0\0\0\240@\315\314L>\315\314L>\315\314L>\377\200@\377\377\200\200\200' >one.splat
begin one.splat
python3 "$source_dir/tests/cli/view_requests.py" "$address" --draws || fail "a model of one Gaussian"
end
begin scene/colmap
python3 "$source_dir/tests/cli/view_requests.py" "$address" --draws || fail "a scene alone"
end
mv scene gone
begin run
grep -q 'the photos are not shown' view.err && grep -q 'if it has moved, name its place with -s SCENE' view.err ||
    fail "no word about the lost scene: $(cat view.err)"
python3 "$source_dir/tests/cli/view_requests.py" "$address" --draws || fail "a run without its scene"
end
