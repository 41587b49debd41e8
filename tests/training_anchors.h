/* SPDX-License-Identifier: Apache-2.0 */
/* The tiny scene with points, to train anchors on. */
#ifndef TESTS_TRAINING_ANCHORS_H
#define TESTS_TRAINING_ANCHORS_H

#include "model/anchors.h"
#include "train/trainer.h"
#include "training.h"

/* The fixture's photos, and the points of its model. */
static inline struct fixture make_points(int threads)
{
    struct fixture f = make_fixture(threads);
    f.scene.n_points = f.truth->count;
    f.scene.points = malloc(f.truth->count * 3 * sizeof(float));
    f.scene.point_colors = calloc(f.truth->count, 3);
    assert_int_equal(sg_model_get_array(f.ctx, f.truth, "position", f.scene.points, 0), SG_OK);
    return f;
}

static inline void clear_points(struct fixture *f)
{
    free(f->scene.points);
    free(f->scene.point_colors);
    clear_fixture(f);
}

/* Grows at 12, 16, ..., 32. */
static inline struct sg_train_params scaffold_params(void)
{
    struct sg_train_params p = short_params();
    p.model = SG_MODEL_SCAFFOLD;
    p.scaffold.voxel = 0.05f;
    p.scaffold.cells = 4;
    p.scaffold.from = 8;
    p.densify_from_iter = 2;
    p.densification_interval = 4;
    p.densify_grad_threshold = 1e-6f;
    p.position_lr_max_steps = 40;
    return p;
}

static inline void assert_same_anchors(const struct sg_model *a, const struct sg_model *b)
{
    assert_same(a, b);
    for (size_t i = 0; i < a->count; i++)
        for (int p = 0; p < SG_A_PLANES; p++) {
            const size_t at = sg_param_index(SG_A_PLANES, i, p);
            assert_memory_equal(&a->columns->at[SG_C_ANCHOR][at], &b->columns->at[SG_C_ANCHOR][at],
                                sizeof(float));
        }
    const struct sg_networks *n = a->columns->networks;
    assert_memory_equal(n, b->columns->networks, sizeof(*n) + n->photos * sizeof(n->appearance[0]));
}

#endif
