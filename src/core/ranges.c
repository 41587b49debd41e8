/* SPDX-License-Identifier: Apache-2.0 */
#include "ranges.h"

int sg_check_ranges(sg_ctx *ctx, const struct sg_range *r, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (!(r[i].value >= r[i].low && r[i].value <= r[i].high))
            return sg_fail(ctx, SG_ERR_USAGE, "%s: found %g, expected %g to %g", r[i].name,
                           r[i].value, r[i].low, r[i].high);
    return SG_OK;
}

int sg_check_max_gaussians(sg_ctx *ctx, uint64_t n)
{
    if (n && n < 4)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "max-gaussians: found %llu, expected 0 (no limit) or at least 4",
                       (unsigned long long) n);
    return SG_OK;
}
