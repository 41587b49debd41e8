/* SPDX-License-Identifier: Apache-2.0 */
/* For qsort of plain numbers. */
#ifndef SG_CORE_COMPARE_H
#define SG_CORE_COMPARE_H

static inline int sg_float_ascending(const void *a, const void *b)
{
    const float x = *(const float *) a, y = *(const float *) b;
    return (x > y) - (x < y);
}

static inline int sg_float_descending(const void *a, const void *b)
{
    return sg_float_ascending(b, a);
}

static inline int sg_double_ascending(const void *a, const void *b)
{
    const double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

#endif
