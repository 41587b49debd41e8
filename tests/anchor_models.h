/* SPDX-License-Identifier: Apache-2.0 */
/* Models of anchors with random networks, and engines that draw them. */
#ifndef TESTS_ANCHOR_MODELS_H
#define TESTS_ANCHOR_MODELS_H

#include "math/real_f64.h"

#include "engine/ref/ref_neural.h"
#include "engine/scaffold/scaffold.h"
#include "model/anchors.h"
#include "models.h"

#define PHOTOS 3 /* of which the networks have an appearance */
#define ALL_PARTS (SG_PART_DISTANCE | SG_PART_BANK | SG_PART_APPEARANCE)

static inline struct sg_model *make_anchors(sg_ctx *ctx, size_t n, uint64_t seed)
{
    struct sg_model *m;
    assert_int_equal(sg_model_create(ctx, n, 0, &m), SG_OK);
    assert_int_equal(sg_anchors_add(ctx, m, PHOTOS), SG_OK);
    struct sg_networks *networks = m->columns->networks;
    float *w = (float *) &networks->value;
    for (size_t i = 0; i < n; i++) {
        for (int k = 0; k < 3; k++) {
            *sg_model_at(m, i, SG_P_XYZ + k) = draw(seed, 3 * i + (size_t) k, -0.6f, 0.6f);
            *sg_model_at(m, i, SG_P_SCALE + k) = draw(seed + 1, 3 * i + (size_t) k, -2, -1);
        }
        *sg_model_at(m, i, SG_P_ROT) = 1;
        for (size_t p = 0; p < SG_A_PLANES; p++)
            m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, (int) p)] =
                p < SG_A_SIZE ? draw(seed + 2, SG_A_PLANES * i + p, -1, 1)
                              : draw(seed + 2, SG_A_PLANES * i + p, -2, -1);
    }
    for (size_t i = 0; i < SG_WEIGHTS; i++)
        w[i] = draw(seed + 3, i, -0.3f, 0.3f);
    for (size_t i = 0; i < PHOTOS; i++)
        for (size_t k = 0; k < SG_APPEARANCE; k++)
            networks->appearance[i].value[k] = draw(seed + 4, SG_APPEARANCE * i + k, -1, 1);
    networks->voxel = 0.01f;
    return m;
}

/* All of a model for the oracle. */
static inline void oracle_anchors(const struct sg_model *m, struct ref_anchor *a,
                                  struct ref_weights *w)
{
    const float *from = (const float *) &m->columns->networks->value;
    for (size_t i = 0; i < SG_WEIGHTS; i++)
        ((double *) w)[i] = (double) from[i];
    for (size_t i = 0; i < m->count; i++) {
        for (int k = 0; k < 3; k++) {
            a[i].position[k] = (double) *sg_model_at(m, i, SG_P_XYZ + k);
            a[i].reach[k] = (double) *sg_model_at(m, i, SG_P_SCALE + k);
        }
        for (int p = 0; p < SG_A_PLANES; p++)
            a[i].anchor[p] =
                (double) m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, p)];
    }
}

static inline struct sg_engine *make_scaffold(sg_ctx *ctx, struct engine_case c,
                                              const struct sg_model *m)
{
    struct sg_engine *e;
    assert_int_equal(sg_engine_create(ctx, c.engine, c.variant, &e), SG_OK);
    assert_int_equal(sg_scaffold_wrap(ctx, &e), SG_OK);
    assert_int_equal(sg_engine_upload(e, m, m->columns), SG_OK);
    return e;
}

#endif
