/* SPDX-License-Identifier: Apache-2.0 */
/* Shared by the tests of rendering and training: contexts, cameras, random models. */
#ifndef TESTS_MODELS_H
#define TESTS_MODELS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "engine/ops.h"
#include "core/rng.h"
#include "params.h"

static inline sg_ctx *make_context(int threads)
{
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads}), SG_OK);
    return ctx;
}

/* Random in [low, high), the k-th of a test's seed. */
static inline float draw(uint64_t seed, uint64_t k, float low, float high)
{
    return low + (high - low) * sg_rng_uniform(seed, SG_RNG_SYNTH, 77, k);
}

/* Looks at the origin from a distance, slightly turned. */
static inline struct sg_camera make_camera(int width, int height, double distance)
{
    const double a = 0.3, b = -0.2;
    const double R[9] = {cos(a),           0,      sin(a),
                         sin(a) * sin(b),  cos(b), -cos(a) * sin(b),
                         -sin(a) * cos(b), sin(b), cos(a) * cos(b)};
    struct sg_camera c = {.width = width,
                          .height = height,
                          .fx = 0.9 * width + 5,
                          .fy = 0.9 * width + 9,
                          .cx = 0.5 * width + 0.7,
                          .cy = 0.5 * height - 0.4,
                          .t = {0.05, -0.03, distance}};
    memcpy(c.R, R, sizeof(R));
    return c;
}

/* Gaussians in [-1, 1]^3 of assorted shapes, opacities and colours. */
static inline struct sg_model *make_model(sg_ctx *ctx, size_t n, int degree, uint64_t seed)
{
    struct sg_model *m;
    assert_int_equal(sg_model_create(ctx, n, degree, &m), SG_OK);
    uint64_t k = 0;
    for (size_t i = 0; i < n; i++)
        for (int p = 0; p < sg_param_count(degree); p++) {
            float v;
            if (p < SG_P_OPACITY)
                v = draw(seed, k++, -1, 1);
            else if (p == SG_P_OPACITY)
                v = draw(seed, k++, -4, 5);
            else if (p < SG_P_ROT)
                v = draw(seed, k++, -5, -1.5f);
            else if (p < SG_P_SH)
                v = draw(seed, k++, -1, 1);
            else
                v = p < SG_P_SH + 3 ? draw(seed, k++, -1.8f, 2.5f) : draw(seed, k++, -0.3f, 0.3f);
            *sg_model_at(m, i, p) = v;
        }
    return m;
}

/* Square photos of a model by the oracle, from n places. The caller frees each rgb. */
static inline void make_photos(sg_ctx *ctx, const struct sg_model *m, int side,
                               struct sg_view *views, int n)
{
    const size_t values = 3 * (size_t) side * (size_t) side;
    sg_renderer *r;
    assert_int_equal(sg_renderer_create(ctx, "ref", NULL, m, NULL, &r), SG_OK);
    float *rgb = malloc(values * sizeof(float));
    for (int i = 0; i < n; i++) {
        struct sg_view *v = &views[i];
        v->name = (char *) "view";
        v->camera = make_camera(side, side, 2.6 + 0.2 * i);
        v->camera.t[0] += 0.15 * (i - 2);
        v->rgb = malloc(values);
        assert_int_equal(sg_render(r, &v->camera, rgb, NULL, NULL, NULL), SG_OK);
        sg_quantise(rgb, side, side, v->rgb);
    }
    free(rgb);
    sg_renderer_destroy(&r);
}

/* What an engine holds, in one: the model and the state of its optimiser. */
struct held {
    struct sg_model *m;
    struct sg_columns o;
};

static inline struct held held_by(sg_ctx *ctx, struct sg_engine *e, int degree)
{
    struct held h;
    assert_int_equal(sg_model_create(ctx, sg_engine_count(e), degree, &h.m), SG_OK);
    assert_int_equal(sg_columns_create(ctx, sg_engine_count(e), degree, SG_COLUMN_SAVED, &h.o),
                     SG_OK);
    assert_int_equal(sg_engine_download(e, h.m, &h.o), SG_OK);
    return h;
}

static inline void forget(struct held *h)
{
    sg_model_destroy(&h->m);
    sg_columns_clear(&h->o);
}

/* Engines share their device with those that are there already: one that is there until the end
 * saves the others the time to open it and to compile its kernels. */
static struct sg_engine *kept_engine;

static inline void drop_kept_engine(void)
{
    if (!kept_engine)
        return;
    sg_ctx *ctx = sg_engine_ctx(kept_engine);
    sg_engine_destroy(&kept_engine);
    sg_ctx_destroy(&ctx);
}

static inline void keep_engine(const char *name)
{
    if (!name || kept_engine)
        return;
    assert_int_equal(sg_engine_create(make_context(1), name, NULL, &kept_engine), SG_OK);
    atexit(drop_kept_engine);
}

/* Every engine and variant in host memory that this machine runs; the oracle is the last. Where
 * SG_TEST_ENGINE names an engine ("vulkan:llvmpipe"), that one and the oracle. */
struct engine_case {
    const char *engine, *variant; /* variant NULL: the engine has none */
};
#define ENGINE_CASES 16

static inline int engine_cases(struct engine_case out[ENGINE_CASES])
{
    const char *engines[SG_ENGINES], *variants[SG_ENGINE_VARIANTS];
    const char *only = getenv("SG_TEST_ENGINE");
    int n = 0;
    keep_engine(only);
    if (only)
        out[n++] = (struct engine_case){only, NULL};
    for (int i = 0, count = sg_engine_names(engines); i < count; i++) {
        if (!strcmp(engines[i], "vulkan") || (only && strcmp(engines[i], "ref")))
            continue;
        const int of_it = sg_engine_variants(engines[i], variants);
        for (int v = 0; v < of_it || v == 0; v++)
            out[n++] = (struct engine_case){engines[i], of_it ? variants[v] : NULL};
    }
    return n;
}

/* The engine that is tested; its best variant. */
static inline const char *main_engine(void)
{
    const char *only = getenv("SG_TEST_ENGINE");
    keep_engine(only);
    return only ? only : "cpu";
}

static inline const char *case_name(struct engine_case c)
{
    return c.variant ? c.variant : c.engine;
}

/* An engine that holds m, and o where it is not NULL. variant: as sg_engine_create's. */
static inline struct sg_engine *make_engine(sg_ctx *ctx, const char *name, const char *variant,
                                            const struct sg_model *m, const struct sg_columns *o)
{
    struct sg_engine *b;
    assert_int_equal(sg_engine_create(ctx, name, variant, &b), SG_OK);
    assert_int_equal(sg_engine_upload(b, m, o), SG_OK);
    return b;
}

/* What an engine holds: its model and the columns of a checkpoint. */
static inline void download(sg_ctx *ctx, struct sg_engine *e, int degree, struct sg_model **m,
                            struct sg_columns *o)
{
    const size_t n = sg_engine_count(e);
    assert_int_equal(sg_model_create(ctx, n, degree, m), SG_OK);
    assert_int_equal(sg_columns_create(ctx, n, degree, SG_COLUMN_SAVED, o), SG_OK);
    assert_int_equal(sg_engine_download(e, *m, o), SG_OK);
}

/* A photometric loss and its target. */
struct loss_case {
    float lambda_dssim, tolerance;
    const uint8_t *target, *mask; /* as of a photo; target NULL: planes */
    const float *planes;          /* as of struct sg_target */
    float low_pass;
};

/* Of the view that the engine has drawn, and dL/dimage. */
static inline struct sg_photometric_value lose(struct sg_engine *b, const struct loss_case *c)
{
    struct sg_step step;
    struct sg_target target = {.planes = c->planes};
    const struct sg_loss loss = {
        SG_LOSS_PHOTOMETRIC, 1, {.photometric = {c->lambda_dssim, c->tolerance, c->low_pass}}};
    uint8_t *unused = calloc(3 * (size_t) b->width, (size_t) b->height);
    if (c->target || c->mask)
        assert_int_equal(sg_engine_photo_add(b, b->width, b->height, c->target ? c->target : unused,
                                             c->mask, &target.photo),
                         SG_OK);
    assert_int_equal(sg_engine_losses(b, &target, &loss, 1), SG_OK);
    assert_int_equal(sg_engine_read_step(b, &step), SG_OK);
    sg_engine_photo_drop(b, target.photo);
    free(unused);
    return step.photometric;
}

static inline struct sg_render_stats stats_of(struct sg_engine *b)
{
    struct sg_step step;
    assert_int_equal(sg_engine_read_step(b, &step), SG_OK);
    return step.stats;
}

#endif
