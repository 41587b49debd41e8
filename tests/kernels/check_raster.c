/* SPDX-License-Identifier: Apache-2.0 */
/* raster, raster_backward (plain and absolute) and raster_count: one tile at a time, over the
 * oracle's lists. */
#include "screen.h"

static const float background[3] = {0.3f, 0.7f, 0.2f};

/* What the kernels and the oracle write for one screen. */
struct frame {
    float *rgb, *alpha, *depth, *gradient, *slots;
    struct ref_image image; /* of the oracle */
    double *image_gradient;
    struct ref_entry *list;
    struct cpu_instance *instances;
    uint16_t *block_mask;
    uint32_t tile_end;
    double *sums; /* per Gaussian: of its slots */
};

static struct frame make_frame(const struct screen *s)
{
    struct frame f = {.rgb = must(3 * s->pixels, sizeof(float)),
                      .alpha = must(s->pixels, sizeof(float)),
                      .depth = must(s->pixels, sizeof(float)),
                      .gradient = random_floats(3 * s->pixels, 17, -1, 1),
                      .slots = must(s->count * CPU_SLOT_FLOATS, sizeof(float)),
                      .image = {s->camera.width, s->camera.height,
                                must(3 * s->pixels, sizeof(double)),
                                must(s->pixels, sizeof(double)), must(s->pixels, sizeof(double)),
                                must(s->pixels, sizeof(int))},
                      .image_gradient = must(3 * s->pixels, sizeof(double)),
                      .list = must(s->count, sizeof(struct ref_entry)),
                      .instances = must(s->count + CPU_PREFETCH, sizeof(struct cpu_instance)),
                      .block_mask = must(s->count, sizeof(uint16_t)),
                      .sums = calloc(s->count * CPU_SLOT_FLOATS, sizeof(double))};
    assert_non_null(f.sums);
    for (size_t i = 0; i < 3 * s->pixels; i++)
        f.image_gradient[i] = (double) f.gradient[i], f.rgb[i] = NAN;
    return f;
}

static void clear_frame(struct frame *f)
{
    void *owned[] = {f->rgb,       f->alpha,     f->depth,       f->gradient,   f->slots,
                     f->image.rgb, f->image.t,   f->image.depth, f->image.last, f->image_gradient,
                     f->list,      f->instances, f->block_mask,  f->sums};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        free(owned[i]);
}

/* What to run on a tile, in this order. */
struct stages {
    bool forward, backward, absolute, count;
    enum sg_hit hit;
};

/* One tile's pixels by the oracle. */
static void oracle_tile(struct screen *s, struct frame *f, int tile, size_t n, struct stages stages)
{
    const int x0 = tile % s->grid_x * SG_TILE, y0 = tile / s->grid_x * SG_TILE;
    for (int y = y0; y < y0 + SG_TILE && y < s->camera.height; y++)
        for (int x = x0; x < x0 + SG_TILE && x < s->camera.width; x++) {
            if (stages.forward)
                ref_pixel_forward(s->splats, f->list, n, x, y, background, &f->image);
            if (stages.backward)
                ref_pixel_backward(s->splats, f->list, x, y, background, &f->image,
                                   f->image_gradient);
            if (stages.count)
                ref_pixel_count(s->splats, f->list, n, x, y, stages.hit);
        }
}

/* The kernels on one tile, whose list is the oracle's. Slots are in another order than the list. */
static void kernel_tile(const struct cpu_kernels *k, const struct screen *s, struct frame *f,
                        int tile, size_t n, struct stages stages, bool auxiliary)
{
    const uint32_t start[2] = {0, (uint32_t) n};
    struct cpu_raster_args a = {.width = s->camera.width,
                                .height = s->camera.height,
                                .grid_x = s->grid_x,
                                .splats = s->records,
                                .instances = f->instances,
                                .tile_start = start,
                                .first_tile = tile,
                                .block_mask = f->block_mask,
                                .tile_end = &f->tile_end,
                                .rgb = f->rgb,
                                .alpha = auxiliary ? f->alpha : NULL,
                                .depth = auxiliary ? f->depth : NULL,
                                .gradient = f->gradient,
                                .slots = f->slots,
                                .hit = stages.hit};
    memcpy(a.background, background, sizeof(background));
    if (stages.forward)
        k->raster(&a, tile);
    if (stages.backward && stages.absolute)
        k->raster_backward_absolute(&a, tile);
    else if (stages.backward)
        k->raster_backward(&a, tile);
    if (stages.count)
        k->raster_count(&a, tile);
}

/* The oracle's list of a tile, and the kernels'. Faint Gaussians are in the first one only. */
static size_t list_tile(const struct screen *s, struct frame *f, int tile, size_t *listed)
{
    const size_t n =
        ref_tile_list(s->splats, s->count, tile % s->grid_x, tile / s->grid_x, f->list);
    size_t m = 0;
    for (size_t i = 0; i < n; i++)
        if (s->splats[f->list[i].id].o >= (double) SG_ALPHA_MIN)
            f->instances[m++].splat = f->list[i].id;
    for (size_t i = 0; i < m; i++)
        f->instances[i].slot = (uint32_t) (m - 1 - i);
    memset(f->instances + m, 0, CPU_PREFETCH * sizeof(*f->instances));
    *listed = n;
    return m;
}

/* All tiles by both. stages: of the kernels; what the backward pass reads is the variant's own. */
static void draw_both(const struct cpu_kernels *k, struct screen *s, struct frame *f,
                      struct stages stages, bool auxiliary)
{
    const int fields = !stages.backward  ? stages.count
                       : stages.absolute ? CPU_SLOT_ABSOLUTE
                                         : CPU_SLOT_USED;
    const int stride = stages.backward ? CPU_SLOT_FLOATS : 1;
    for (int tile = 0; tile < s->grid_x * s->grid_y; tile++) {
        size_t listed;
        const size_t n = list_tile(s, f, tile, &listed);
        for (size_t i = 0; i < n * (size_t) stride; i++)
            f->slots[i] = NAN; /* every slot must be written */
        oracle_tile(s, f, tile, listed, stages);
        kernel_tile(k, s, f, tile, n, stages, auxiliary);
        for (size_t i = 0; i < n; i++)
            for (int j = 0; j < fields; j++)
                f->sums[f->instances[i].splat * CPU_SLOT_FLOATS + (size_t) j] +=
                    (double) f->slots[f->instances[i].slot * (size_t) stride + (size_t) j];
    }
}

/* Scenes: sparse with partial tiles, dense with lists of several batches, a single pixel, empty. */
static const struct scene {
    int width, height;
    size_t count;
    float opacity; /* of all, or 0 */
} scenes[] = {
    {77, 59, 301, 0}, {40, 30, 2000, 0}, {33, 17, 600, -4}, {1, 1, 50, 0}, {20, 20, 0, 0}};
#define SCENES (sizeof(scenes) / sizeof(scenes[0]))

static struct screen scene_screen(const struct scene *c)
{
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, c->count, 1, 50 + c->count);
    for (size_t i = 0; i < c->count && c->opacity != 0; i++)
        *sg_model_at(m, i, SG_P_OPACITY) = c->opacity;
    return make_screen(ctx, m, make_camera(c->width, c->height, 3), 1);
}

/* A pair at a cut-off may be drawn by one and not by the other: such pixels may be off by a
 * little. */
static void check_plane(const struct cpu_kernels *k, const char *what, const float *found,
                        const double *expected, size_t n, double tolerance)
{
    double *values = must(n, sizeof(double));
    for (size_t i = 0; i < n; i++)
        values[i] = (double) found[i];
    assert_close(k->name, what, values, expected, n, tolerance, tolerance, 0.003);
    assert_close(k->name, what, values, expected, n, 0.02, 0.02, 0);
    free(values);
}

static void check_forward(const struct cpu_kernels *k)
{
    for (size_t c = 0; c < SCENES; c++)
        for (int auxiliary = 0; auxiliary < 2; auxiliary++) {
            struct screen s = scene_screen(&scenes[c]);
            struct frame f = make_frame(&s);
            draw_both(k, &s, &f, (struct stages){.forward = true}, auxiliary);
            check_plane(k, "image", f.rgb, f.image.rgb, 3 * s.pixels, 2e-5);
            if (auxiliary) {
                check_plane(k, "depth", f.depth, f.image.depth, s.pixels, 1e-4);
                for (size_t i = 0; i < s.pixels; i++)
                    f.image.t[i] = 1 - f.image.t[i];
                check_plane(k, "alpha", f.alpha, f.image.t, s.pixels, 2e-5);
            }
            clear_frame(&f);
            clear_screen(&s);
        }
}

/* What the sums of a Gaussian's slots are, from the oracle's gradients of its splat. */
static void expected_sums(const struct ref_splat *s, double out[CPU_SLOT_ABSOLUTE])
{
    const double A = s->s.A, B = s->s.B, C = s->s.C, det = A * C - B * B;
    const double sums[CPU_SLOT_ABSOLUTE] = {s->g_o * s->o,
                                            (C * s->g.x - B * s->g.y) / det,
                                            (A * s->g.y - B * s->g.x) / det,
                                            -2 * s->g.A,
                                            -2 * s->g.Bh,
                                            -2 * s->g.C,
                                            s->g_rgb[0],
                                            s->g_rgb[1],
                                            s->g_rgb[2],
                                            s->absolute[0],
                                            s->absolute[1]};
    memcpy(out, sums, sizeof(sums));
}

static void check_gradients(const struct cpu_kernels *k, bool absolute)
{
    const struct stages stages = {.forward = true, .backward = true, .absolute = absolute};
    for (size_t c = 0; c < SCENES; c++) {
        struct screen s = scene_screen(&scenes[c]);
        struct frame f = make_frame(&s);
        draw_both(k, &s, &f, stages, false);
        double *found = must(s.count + 1, sizeof(double)),
               *expected = must(s.count + 1, sizeof(double));
        for (int j = 0; j < (absolute ? CPU_SLOT_ABSOLUTE : CPU_SLOT_USED); j++) {
            double largest = 0;
            size_t n = 0;
            for (size_t i = 0; i < s.count; i++) {
                double sums[CPU_SLOT_ABSOLUTE];
                if (!s.splats[i].visible)
                    continue;
                expected_sums(&s.splats[i], sums);
                expected[n] = sums[j];
                found[n++] = f.sums[i * CPU_SLOT_FLOATS + (size_t) j];
                largest = fmax(largest, fabs(sums[j]));
            }
            char what[64];
            snprintf(what, sizeof(what), "scene %zu, sum %d", c, j);
            assert_close(k->name, what, found, expected, n, 2e-4 * largest, 5e-3, 0.02);
        }
        free(found);
        free(expected);
        clear_frame(&f);
        clear_screen(&s);
    }
}

static void check_backward(const struct cpu_kernels *k)
{
    check_gradients(k, false);
}

static void check_absolute(const struct cpu_kernels *k)
{
    check_gradients(k, true);
}

static void check_count(const struct cpu_kernels *k)
{
    for (size_t c = 0; c < SCENES; c++)
        for (int hit = SG_HIT_PIXELS; hit <= SG_HIT_TRANSMITTANCE; hit++) {
            const struct stages stages = {.count = true, .hit = (enum sg_hit) hit};
            char what[64];
            snprintf(what, sizeof(what), "scene %zu, hits of kind %d", c, hit);
            struct screen s = scene_screen(&scenes[c]);
            struct frame f = make_frame(&s);
            draw_both(k, &s, &f, stages, false);
            double *found = must(s.count + 1, sizeof(double)),
                   *expected = must(s.count + 1, sizeof(double)), sum = 0;
            for (size_t i = 0; i < s.count; i++) {
                found[i] = f.sums[i * CPU_SLOT_FLOATS], expected[i] = s.splats[i].hits;
                sum += expected[i];
            }
            assert_true(sum > 0 || s.count < 100);
            assert_close(k->name, what, found, expected, s.count, 1e-4, 1e-4, 0.02);
            assert_close(k->name, what, found, expected, s.count, 3, 0.02, 0);
            free(found);
            free(expected);
            clear_frame(&f);
            clear_screen(&s);
        }
}

/* The middle tile of a dense scene. The backward pass reads what the forward pass has left. */
static double bench_stage(const struct cpu_kernels *k, struct stages stages)
{
    const struct scene dense = {80, 80, 3000, 0};
    struct screen s = scene_screen(&dense);
    struct frame f = make_frame(&s);
    const int tile = s.grid_x * (s.grid_y / 2) + s.grid_x / 2;
    size_t listed;
    const size_t n = list_tile(&s, &f, tile, &listed);
    struct timing t = {0};
    oracle_tile(&s, &f, tile, listed, (struct stages){.forward = true});
    if (k)
        kernel_tile(k, &s, &f, tile, n, (struct stages){.forward = true}, false);
    while (timing_again(&t))
        if (k)
            kernel_tile(k, &s, &f, tile, n, stages, false);
        else
            oracle_tile(&s, &f, tile, listed, stages);
    clear_frame(&f);
    clear_screen(&s);
    return timing_result(&t, SG_TILE * SG_TILE);
}

static double bench_forward(const struct cpu_kernels *k)
{
    return bench_stage(k, (struct stages){.forward = true});
}

static double bench_backward(const struct cpu_kernels *k)
{
    return bench_stage(k, (struct stages){.backward = true});
}

static double bench_absolute(const struct cpu_kernels *k)
{
    return bench_stage(k, (struct stages){.backward = true, .absolute = true});
}

static double bench_count(const struct cpu_kernels *k)
{
    return bench_stage(k, (struct stages){.count = true});
}

const struct kernel_check check_raster = {"raster", "pixel", false, check_forward, bench_forward};
const struct kernel_check check_raster_backward = {"raster_backward", "pixel", false,
                                                   check_backward, bench_backward};
const struct kernel_check check_raster_backward_absolute = {"raster_backward_absolute", "pixel",
                                                            false, check_absolute, bench_absolute};
const struct kernel_check check_raster_count = {"raster_count", "pixel", false, check_count,
                                                bench_count};
