#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# models.sh TEST_VULKAN FILE: runs the test; the hashes of the models that it trains go to FILE.
set -u
"$1" >"$2.log"
code=$?
cat "$2.log"
grep '^model ' "$2.log" >"$2"
exit $code
