/* SPDX-License-Identifier: Apache-2.0 */
#include "morton.h"
#include "core/compare.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "splatguard/model.h"

#define SAMPLES 1024
#define AXIS_BITS 10
#define CELLS (1 << AXIS_BITS)

struct item {
    uint32_t key, index;
};

static float position(const struct sg_places *p, size_t place, int axis)
{
    return place < p->count
               ? p->params[sg_param_index(p->planes, place, SG_P_XYZ + axis)]
               : p->rows[sg_param_index(p->row_planes, place - p->count, SG_P_XYZ + axis)];
}

/* The lattice leaves out a fiftieth at each end, so that strays do not push all others into one
 * cell. It spans the Gaussians before the edit, or the items if there were none. */
static void lattice(const struct sg_places *places, const uint32_t *source, size_t n_items,
                    int axis, float *low, float *per_unit)
{
    float sample[SAMPLES];
    size_t n = 0;
    for (size_t k = 0; k < SAMPLES; k++) {
        const float v = position(
            places, places->count ? k * places->count / SAMPLES : source[k * n_items / SAMPLES],
            axis);
        if (isfinite(v))
            sample[n++] = v;
    }
    *low = *per_unit = 0;
    if (!n)
        return;
    qsort(sample, n, sizeof(*sample), sg_float_ascending);
    *low = sample[n / 50];
    const float span = sample[n - 1 - n / 50] - *low;
    *per_unit = span > 0 && isfinite(span) ? CELLS / span : 0;
}

static uint32_t spread(uint32_t v) /* two zeros before each bit of ten */
{
    v = (v | v << 16) & 0x030000ff;
    v = (v | v << 8) & 0x0300f00f;
    v = (v | v << 4) & 0x030c30c3;
    return (v | v << 2) & 0x09249249;
}

int sg_morton_order(sg_ctx *ctx, const struct sg_places *places, const uint32_t *source, size_t n,
                    uint32_t *order)
{
    if (n == 0)
        return SG_OK;
    struct item *from = sg_alloc_raw(ctx, SG_MEM_MODEL, n, sizeof(*from));
    struct item *to = sg_alloc_raw(ctx, SG_MEM_MODEL, n, sizeof(*to));
    int code = SG_ERR_BUDGET;
    if (!from || !to)
        goto done;
    float low[3], per_unit[3];
    for (int axis = 0; axis < 3; axis++)
        lattice(places, source, n, axis, &low[axis], &per_unit[axis]);
    for (size_t i = 0; i < n; i++) {
        uint32_t key = 0;
        for (int axis = 0; axis < 3; axis++) {
            const float v =
                (position(places, source ? source[i] : i, axis) - low[axis]) * per_unit[axis];
            key |= spread((uint32_t) (v > 0 ? v < CELLS - 1 ? v : CELLS - 1 : 0))
                   << axis; /* NaN: 0 */
        }
        from[i] = (struct item){key, (uint32_t) i};
    }
    for (int shift = 0; shift < 3 * AXIS_BITS; shift += AXIS_BITS) {
        uint32_t start[CELLS] = {0}, sum = 0;
        for (size_t i = 0; i < n; i++)
            start[from[i].key >> shift & (CELLS - 1)]++;
        for (int d = 0; d < CELLS; d++) {
            const uint32_t here = start[d];
            start[d] = sum;
            sum += here;
        }
        for (size_t i = 0; i < n; i++)
            to[start[from[i].key >> shift & (CELLS - 1)]++] = from[i];
        struct item *swap = from;
        from = to, to = swap;
    }
    for (size_t i = 0; i < n; i++)
        order[i] = from[i].index;
    code = SG_OK;
done:
    sg_free(from);
    sg_free(to);
    return code;
}
