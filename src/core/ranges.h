/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_CORE_RANGES_H
#define SG_CORE_RANGES_H

#include "internal.h"

struct sg_range {
    const char *name;
    double value, low, high;
};

/* SG_ERR_USAGE for the first value that is not from low to high. */
int sg_check_ranges(sg_ctx *ctx, const struct sg_range *ranges, size_t n);

/* 0, or as many as a model needs. */
int sg_check_max_gaussians(sg_ctx *ctx, uint64_t n);

#endif
