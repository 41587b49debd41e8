/* SPDX-License-Identifier: Apache-2.0 */
/* What the thread sanitizer, which makes everything ten times slower, need not repeat. */
#ifndef SG_TESTS_RACES_H
#define SG_TESTS_RACES_H

#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

/* At the start of a test with one thread, or whose threads do only what they do in another test of
 * the same file. */
static inline void skip_without_races(void)
{
#ifdef SG_SANITIZE_THREAD
    skip();
#endif
}

#endif
