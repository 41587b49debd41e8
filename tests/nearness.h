/* SPDX-License-Identifier: Apache-2.0 */
/* The anisotropy loss of an image that is continued to a quick size, next to that of its exact
 * size. */
#ifndef SG_TEST_NEARNESS_H
#define SG_TEST_NEARNESS_H

#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <setjmp.h>
#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "spectral/anisotropy.h"
#include "params.h"

struct nearness {
    double loss, cosine, length; /* ratio; of the two gradients; ratio of their lengths */
};

/* x: 3 planes of h x w. */
static inline struct nearness against_exact(sg_ctx *ctx, int w, int h, const float *x)
{
    const size_t n = 3 * (size_t) w * (size_t) h;
    double loss[2], dot = 0, norm[2] = {0};
    float *g[2];
    for (int exact = 0; exact < 2; exact++) {
        struct sg_anisotropy *a;
        g[exact] = calloc(n, sizeof(float));
        assert_int_equal(
            sg_anisotropy_create(ctx, w, h, sg_anisotropy_params(.exact_size = exact), NULL, &a),
            SG_OK);
        loss[exact] = sg_anisotropy_loss(a, x, 1, g[exact]);
        sg_anisotropy_destroy(&a);
    }
    for (size_t i = 0; i < n; i++) {
        dot += (double) g[0][i] * (double) g[1][i];
        for (int e = 0; e < 2; e++)
            norm[e] += (double) g[e][i] * (double) g[e][i];
    }
    free(g[0]), free(g[1]);
    return (struct nearness){loss[0] / loss[1], dot / sqrt(norm[0] * norm[1]),
                             sqrt(norm[0] / norm[1])};
}

#endif
