/* SPDX-License-Identifier: Apache-2.0 */
/* A step up the total variation, a row at a time: sg_tv_gradient_row and the projection of
 * sg_ascend in one pass. */
#include "kernels.h"

#include "math/total_variation.h"

/* LANES pixels of a row with those to their left and right; at the ends of the row, themselves. */
struct run {
    real left, here, right;
};

SIMD struct run load_run(const float *row, int i, int width)
{
    if (i > 0 && i + LANES < width)
        return (struct run){r_load(row + i - 1), r_load(row + i), r_load(row + i + 1)};
    float copy[LANES + 2];
    for (int k = 0; k < LANES + 2; k++) {
        const int at = i + k - 1;
        copy[k] = row[at < 0 ? 0 : at < width ? at : width - 1];
    }
    return (struct run){r_load(copy), r_load(copy + 1), r_load(copy + 2)};
}

SIMD real gradient(enum sg_attack_tv form, struct run above, struct run row, struct run below)
{
    const struct tv_pixels p = {above.here, above.right, row.left,  row.here,
                                row.right,  below.left,  below.here};
    return form == SG_ATTACK_TV_ISO ? tv_iso_gradient(p)
                                    : tv_sign_gradient(p, form == SG_ATTACK_TV_ANISO);
}

SIMD void ascend(const struct sg_ascend *a, size_t r, enum sg_attack_tv form)
{
    const int w = a->width, y = (int) (r % (size_t) a->height);
    const size_t at = r * (size_t) w;
    const float *row = a->from + at, *above = y > 0 ? row - w : row,
                *below = y + 1 < a->height ? row + w : row;
    const float *bound = a->bound ? a->bound + (size_t) y * (size_t) w : NULL;
    for (int i = 0; i < w; i += LANES) {
        const int count = w - i < LANES ? w - i : LANES;
        const struct run x = load_run(row, i, w);
        real g = gradient(form, load_run(above, i, w), x, load_run(below, i, w));
        if (a->extra)
            g += count == LANES ? r_load(a->extra + at + i) : r_load_part(a->extra + at + i, count);
        const real photo =
            count == LANES ? r_load(a->photo + at + i) : r_load_part(a->photo + at + i, count);
        const real epsilon = !bound           ? r_set(a->epsilon)
                             : count == LANES ? r_load(bound + i)
                                              : r_load_part(bound + i, count);
        const real v = tv_step(x.here, g, a->step, photo, epsilon);
        if (count == LANES)
            r_store(a->to + at + i, v);
        else
            r_store_part(a->to + at + i, count, v);
    }
}

void KERNEL(ascend)(const struct sg_ascend *a, size_t row)
{
    switch (a->form) {
    case SG_ATTACK_TV_ISO:
        ascend(a, row, SG_ATTACK_TV_ISO);
        return;
    case SG_ATTACK_TV_ANISO:
        ascend(a, row, SG_ATTACK_TV_ANISO);
        return;
    default:
        ascend(a, row, SG_ATTACK_TV_VERTICAL2);
    }
}
