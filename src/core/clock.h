/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_CORE_CLOCK_H
#define SG_CORE_CLOCK_H

#include <time.h>

/* Seconds since a fixed moment; never goes backwards. */
static inline double sg_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

#endif
