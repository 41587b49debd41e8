/* SPDX-License-Identifier: Apache-2.0 */
/* Values of anchors from their blocks to other blocks. Items that ascend come from few blocks, so a
 * whole row of each is read, and its values are moved to their lanes at once. */
#include "kernels.h"

#include "engine/scaffold/neural.h"

#if LANES == SG_LANES
/* What is read of one block. */
struct part {
    const float *row;
    ireal from; /* of each lane */
    mask lanes;
};

SIMD void copy_rows(const struct part *part, int parts, int count, float (*out)[SG_LANES])
{
    for (int p = 0; p < count; p++) {
        real value = r_set(0);
        for (int k = 0; k < parts; k++)
            value =
                r_move_if(part[k].lanes, r_load(part[k].row + p * SG_LANES), part[k].from, value);
        r_store(out[p], value);
    }
}

void KERNEL(pick)(const float *column, int planes, int first, int count, const uint32_t *item,
                  float (*out)[SG_LANES])
{
    struct part part[SG_LANES];
    int32_t from[SG_LANES];
    uint32_t last = SG_NOWHERE;
    int parts = 0;
    for (int lane = 0; lane < SG_LANES; lane++) {
        from[lane] = (int32_t) (item[lane] % SG_LANES);
        if (item[lane] == SG_NOWHERE)
            continue;
        if (!parts || item[lane] / SG_LANES != last) {
            last = item[lane] / SG_LANES;
            part[parts].row =
                column + ((size_t) last * (size_t) planes + (size_t) first) * SG_LANES;
            part[parts++].lanes = 0;
        }
        part[parts - 1].lanes |= (mask) (1u << lane);
    }
    for (int k = 0; k < parts; k++)
        memcpy(&part[k].from, from, sizeof(part[k].from));
    /* With a number that the compiler knows, parts stay in registers. */
    if (parts == 1)
        copy_rows(part, 1, count, out);
    else if (parts == 2)
        copy_rows(part, 2, count, out);
    else if (parts == 3)
        copy_rows(part, 3, count, out);
    else
        copy_rows(part, parts, count, out);
}
#else
void KERNEL(pick)(const float *column, int planes, int first, int count, const uint32_t *item,
                  float (*out)[SG_LANES])
{
    for (int lane = 0; lane < SG_LANES; lane++) {
        const bool nowhere = item[lane] == SG_NOWHERE;
        const float *from = nowhere ? NULL : column + sg_param_index(planes, item[lane], first);
        for (int p = 0; p < count; p++)
            out[p][lane] = nowhere ? 0 : from[p * SG_LANES];
    }
}
#endif
