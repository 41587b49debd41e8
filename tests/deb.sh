#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Builds the Debian packages, installs them into a scratch root with the dependencies of this machine, uses them there, and
# removes them again. Arguments: SOURCE WORK. Exit status 77: dpkg's tools are missing.
set -u
source_dir=$1 work=$2
fail() { echo "FAILED: $*" >&2; exit 1; }
command -v dpkg-shlibdeps >/dev/null || { echo "needs dpkg-dev"; exit 77; }
if [ "$(id -u)" != 0 ]; then # dpkg wants to be root
    command -v fakeroot >/dev/null || { echo "needs root or fakeroot"; exit 77; }
    exec fakeroot bash "$source_dir/tests/deb.sh" "$source_dir" "$work"
fi
rm -rf "$work"
mkdir -p "$work" || exit 1
cd "$work" || exit 1
"$source_dir/scripts/deb" first >list || fail "scripts/deb"
"$source_dir/scripts/deb" second >/dev/null || fail "scripts/deb, again"
mapfile -t packages <list
[ ${#packages[@]} -ge 3 ] || fail "found ${#packages[@]} packages"
for package in "${packages[@]}"; do
    cmp "$package" "second/${package##*/}" || fail "two builds differ"
    dpkg-deb -c "$package" | awk '$2 != "root/root" || ($1 !~ /^l/ && $1 ~ /^.....w|^........w|s/) { print; bad = 1 } END { exit bad }' ||
        fail "owner or mode of a file in $package"
done
if grep -q view_server.c.o "$source_dir/build-deb/build.ninja"; then
    dpkg-deb -f first/splatguard_*.deb Recommends | grep -q '^libmicrohttpd' || fail "the package does not recommend the HTTP server"
fi
for package in first/python3-*.deb; do # its path is the same for all architectures
    [ ! -e "$package" ] || ! dpkg-deb -f "$package" | grep -q '^Multi-Arch' || fail "$package is for several architectures at once"
done
! dpkg-deb -f first/splatguard_*.deb Depends | grep microhttpd || fail "the package depends on the HTTP server"

grep -qF '"-ffile-prefix-map=' "$source_dir/build-deb/build.ninja" || fail "a path with a space would be two words"

# dpkg refuses dependencies that its database lacks: it gets that of this machine.
root=$work/root
mkdir -p "$root"/var/lib/dpkg/{info,updates,triggers}
grep-status() { awk -v RS= -v ORS='\n\n' '!/^Package: (lib|python3-)?splatguard/' /var/lib/dpkg/status; }
grep-status >"$root/var/lib/dpkg/status"
dpkg --root="$root" --no-triggers -i "${packages[@]}" >log 2>&1 || fail "installing: $(tail -n 5 log)"

triplet=$(dpkg-architecture -qDEB_HOST_MULTIARCH)
export LD_LIBRARY_PATH=$root/usr/lib/$triplet
tool=$root/usr/bin/splatguard
ldd "$tool" | grep -q "libsplatguard.*$root/" || fail "the tool does not use the library"
for binary in "$tool" "$LD_LIBRARY_PATH"/libsplatguard.so.*; do
    ! readelf -d "$binary" | grep -E 'RPATH|RUNPATH' || fail "$binary has a path of libraries"
done
"$tool" synth -o scene --width 32 --height 24 --train-views 4 --test-views 1 --points 50 --samples 1 -q || fail "synth"
"$tool" train scene/blender -o run --iterations 3 --init-points 50 -q || fail "train"
[ -s run/point_cloud/iteration_3/point_cloud.ply ] || fail "no model"
zcat "$root/usr/share/man/man1/splatguard-train.1.gz" | grep -q '^.SH OPTIONS' || fail "no man page"
bash -c 'source "$1"; complete -p splatguard' bash "$root/usr/share/bash-completion/completions/splatguard" | grep -q _splatguard ||
    fail "no completion"

export PKG_CONFIG_PATH=$LD_LIBRARY_PATH/pkgconfig
# shellcheck disable=SC2046
cc -o first_program "$source_dir/tests/install/first.c" $(pkg-config --cflags --libs splatguard) || fail "the headers"
./first_program >/dev/null || fail "a program that uses the library"

if [ -d "$root/usr/lib/python3" ]; then
    PYTHONPATH=$root/usr/lib/python3/dist-packages /usr/bin/python3 -c '
import importlib.metadata, sys, splatguard
assert splatguard.__file__.startswith(sys.argv[1]), splatguard.__file__
assert importlib.metadata.version("splatguard") == splatguard.__version__
scene = splatguard.Scene.load(sys.argv[2])
assert len(scene.train) == 4' "$root" scene/blender || fail "the Python package"
fi

mapfile -t names < <(for package in "${packages[@]}"; do dpkg-deb -f "$package" Package; done)
dpkg --root="$root" --no-triggers -P "${names[@]}" >log 2>&1 || fail "removing: $(tail -n 5 log)"
left=$(find "$root" ! -type d ! -path '*/var/lib/dpkg/*')
[ -z "$left" ] || fail "left behind: $left"
