/* SPDX-License-Identifier: Apache-2.0 */
/* A tiny scene to train on, for the tests of training. */
#ifndef TESTS_TRAINING_H
#define TESTS_TRAINING_H

#include "models.h"

#ifndef SIDE /* of photos, pixels */
#define SIDE 48
#endif
#define VIEWS 6

/* Photos of a known model, rendered by the oracle; the trainer starts from its shaken copy. */
struct fixture {
    sg_ctx *ctx;
    struct sg_scene scene;
    struct sg_view views[VIEWS];
    struct sg_model *truth, *start;
};

static inline struct fixture make_fixture(int threads)
{
    struct fixture f = {.ctx = make_context(threads)};
    f.truth = make_model(f.ctx, 120, 1, 21);
    make_photos(f.ctx, f.truth, SIDE, f.views, VIEWS);
    f.scene =
        (struct sg_scene){.path = (char *) "fixture", .train = NULL, .n_train = VIEWS, .extent = 2};
    assert_int_equal(sg_model_create(f.ctx, f.truth->count, 1, &f.start), SG_OK);
    f.start->active_sh_degree = 0;
    memcpy(f.start->params, f.truth->params,
           f.truth->capacity * (size_t) sg_param_count(1) * sizeof(float));
    for (size_t i = 0; i < f.start->count; i++)
        for (int p = 0; p < SG_P_SH + 3; p++)
            *sg_model_at(f.start, i, p) += draw(4, i * 64 + (size_t) p, -0.15f, 0.15f);
    return f;
}

static inline void clear_fixture(struct fixture *f)
{
    for (int i = 0; i < VIEWS; i++)
        free(f->views[i].rgb);
    sg_model_destroy(&f->truth);
    sg_model_destroy(&f->start);
    sg_ctx_destroy(&f->ctx);
}

/* Densifies from iteration 10 on, resets at 20, ends at 40. */
static inline struct sg_train_params short_params(void)
{
    return (struct sg_train_params){SG_TRAIN_DEFAULTS,
                                    .iterations = 40,
                                    .sh_interval = 8,
                                    .densify_from_iter = 5,
                                    .densification_interval = 5,
                                    .densify_until_iter = 35,
                                    .opacity_reset_interval = 20,
                                    .densify_grad_threshold = 0.0001f};
}

/* For sg_train_params.clock, with a double as its argument. */
static inline double fake_clock(void *now)
{
    return *(double *) now;
}

static inline sg_trainer *resume_training(struct fixture *f, const struct sg_train_params *p,
                                          const char *path)
{
    sg_trainer *t;
    f->scene.train = f->views;
    assert_int_equal(sg_trainer_resume(f->ctx, &f->scene, path, p, &t), SG_OK);
    return t;
}

static inline sg_trainer *begin_training(struct fixture *f, const struct sg_train_params *p)
{
    sg_trainer *t;
    f->scene.train = f->views;
    assert_int_equal(sg_trainer_create(f->ctx, &f->scene, f->start, p, &t), SG_OK);
    return t;
}

static inline struct sg_model *train(struct fixture *f, const struct sg_train_params *p,
                                     int iterations, const char *save_at_20, const char *load,
                                     double *losses)
{
    sg_trainer *t = load ? resume_training(f, p, load) : begin_training(f, p);
    struct sg_model *m;
    while (sg_trainer_iteration(t) < iterations) {
        struct sg_train_step s;
        if (sg_trainer_step(t, &s))
            fail_msg("%s", sg_last_error(f->ctx));
        assert_int_equal(s.gaussians, sg_trainer_gaussians(t));
        if (losses)
            losses[s.iteration - 1] = s.loss;
        if (save_at_20 && s.iteration == 20)
            assert_int_equal(sg_trainer_save(t, save_at_20), SG_OK);
    }
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    sg_trainer_destroy(&t);
    return m;
}

static inline void assert_same(const struct sg_model *a, const struct sg_model *b)
{
    assert_int_equal(a->count, b->count);
    for (size_t i = 0; i < a->count; i++)
        for (int p = 0; p < sg_param_count(a->sh_degree); p++)
            assert_memory_equal(sg_model_at(a, i, p), sg_model_at(b, i, p), sizeof(float));
}

#endif
