/* SPDX-License-Identifier: Apache-2.0 */
/* A model on the screen by the oracle in double precision, and the records of it that kernels
 * read. */
#ifndef TESTS_KERNELS_SCREEN_H
#define TESTS_KERNELS_SCREEN_H

#include "math/real_f64.h"

#include "check.h"
#include "engine/ref/render.h"
#include "math/tiles.h"

struct screen {
    sg_ctx *ctx;
    struct sg_model *model;
    struct sg_camera camera;
    struct pinhole view;
    int degree, planes, grid_x, grid_y;
    bool mip; /* with the 2D filter of Mip-Splatting */
    size_t count, pixels;
    double (*params)[SG_PARAMS_MAX];
    struct ref_splat *splats;
    struct cpu_splat *records;
    struct cpu_extent *extents;
};

/* The fields of a kernel's record by their definitions in cpu/kernels.h. */
static inline struct cpu_splat record_of(const struct ref_splat *s)
{
    const double half_log2e = 0.5 / log(2);
    const struct ellipse e = ellipse_make(ellipse_border(s->o, s->s.a, s->s.c, s->s.det),
                                          s->s.b / s->s.c, 1 / s->s.A, s->s.c);
    const double across = sqrt(s->s.A * half_log2e);
    return (struct cpu_splat){
        .x = (float) s->s.x,
        .y = (float) s->s.y,
        .slope = (float) e.slope,
        .reach = (float) e.reach,
        .taper = (float) e.taper,
        .ymax = (float) e.ymax,
        .yright = (float) e.yright,
        .across = (float) across,
        .shear = (float) (across * e.slope),
        .down = (float) sqrt(half_log2e / s->s.c),
        .peak = (float) log2(s->o),
        .r = (float) s->rgb[0],
        .g = (float) s->rgb[1],
        .b = (float) s->rgb[2],
        .z = (float) s->s.z,
    };
}

/* Takes the model. degree: of the colours. */
static inline struct screen make_filtered_screen(sg_ctx *ctx, struct sg_model *model,
                                                 struct sg_camera camera, int degree, bool mip)
{
    struct screen s = {.ctx = ctx, .model = model, .camera = camera, .degree = degree, .mip = mip};
    s.view = view_make_mip(&s.camera, mip ? 0.1f : 0);
    s.planes = sg_param_count(model->sh_degree);
    s.grid_x = (camera.width + SG_TILE - 1) / SG_TILE;
    s.grid_y = (camera.height + SG_TILE - 1) / SG_TILE;
    s.count = model->count;
    s.pixels = (size_t) camera.width * (size_t) camera.height;
    s.params = must(s.count, sizeof(*s.params));
    s.splats = must(s.count, sizeof(*s.splats));
    s.records = must(s.count + 1, sizeof(*s.records));
    s.extents = must(s.count, sizeof(*s.extents));
    for (size_t i = 0; i < s.count; i++) {
        for (int p = 0; p < s.planes; p++)
            s.params[i][p] = (double) *sg_model_at(model, i, p);
        struct ref_splat *r = &s.splats[i];
        ref_project(&s.view, s.params[i], degree, s.grid_x, s.grid_y, r);
        s.records[i] = r->visible ? record_of(r) : (struct cpu_splat){0};
        s.extents[i] = (struct cpu_extent){.x1 = r->visible};
    }
    return s;
}

static inline struct screen make_screen(sg_ctx *ctx, struct sg_model *model,
                                        struct sg_camera camera, int degree)
{
    return make_filtered_screen(ctx, model, camera, degree, false);
}

static inline void clear_screen(struct screen *s)
{
    free(s->params);
    free(s->splats);
    free(s->records);
    free(s->extents);
    sg_model_destroy(&s->model);
    sg_ctx_destroy(&s->ctx);
}

/* Of all values, at most a share may be off by more than absolute + relative x the expected. */
static inline void assert_close(const char *variant, const char *what, const double *found,
                                const double *expected, size_t n, double absolute, double relative,
                                double share)
{
    size_t off = 0, worst = 0;
    double most = -1;
    for (size_t i = 0; i < n; i++) {
        const double d = fabs(found[i] - expected[i]);
        if (!(d <= absolute + relative * fabs(expected[i]))) {
            off++;
            if (!(d <= most))
                most = d, worst = i;
        }
    }
    if ((double) off > share * (double) n)
        fail_msg("%s: %s: %zu of %zu values are off, most at %zu: found %.9g, expected %.9g",
                 variant, what, off, n, worst, found[worst], expected[worst]);
}

#endif
