/* SPDX-License-Identifier: Apache-2.0 */
/* The engines and variants of a program whose tests all run on each, found once. */
#ifndef TESTS_ENGINE_CASES_H
#define TESTS_ENGINE_CASES_H

#include "models.h"

static struct engine_case cases[ENGINE_CASES]; /* the oracle is the last */
static int case_count;

/* A group's setup. */
static inline int find_cases(void **state)
{
    (void) state;
    case_count = engine_cases(cases);
    return 0;
}

#endif
