#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# hashes.sh PROGRAM FILE: runs the test; the hashes that it prints, of which there are some, go to FILE.
set -u
"$1" >"$2.log"
code=$?
cat "$2.log"
grep '^hash ' "$2.log" >"$2" || exit 1
exit $code
