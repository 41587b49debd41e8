#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# widths.sh TEST_VULKAN: a trained model has the same bytes for subgroups of 4, 8 and 16.
set -eu
expected=
for width in 128 256 512; do
    found=$(LP_NATIVE_VECTOR_WIDTH=$width "$1" | grep '^model ')
    echo "width $width: $found"
    [ "${expected:=$found}" = "$found" ] || { echo "FAILED: expected $expected"; exit 1; }
done
