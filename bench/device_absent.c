/* SPDX-License-Identifier: Apache-2.0 */
/* In builds without an engine that has a device. */
#include "device.h"

bool device_has(const struct sg_engine *e)
{
    (void) e;
    return false;
}

int device_rates(struct sg_engine *e, struct rates *out)
{
    (void) e, (void) out;
    return SG_ERR_INTERNAL;
}

uint64_t device_dispatches(const struct sg_engine *e)
{
    (void) e;
    return 0;
}

int device_parts(const struct device_part **out)
{
    *out = NULL;
    return 0;
}

int device_leave_out(struct sg_engine *e, unsigned parts)
{
    (void) e, (void) parts;
    return SG_ERR_INTERNAL;
}

int device_profile_begin(struct sg_engine *e)
{
    (void) e;
    return SG_ERR_INTERNAL;
}

void device_profile_print(struct sg_engine *e, int iterations)
{
    (void) e, (void) iterations;
}
