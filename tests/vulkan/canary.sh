#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# canary.sh PROGRAM WHAT WORD: what the program prints, if WORD is there. Ends with 0 in any case: CTest takes the words
# of the validation layer for a failure, and this test for passed if it did.
said=$("$1" "$2" 2>&1)
case $said in *"$3"*) echo "$said" ;; *) echo "the validation layer does not say so" ;; esac
exit 0
