/* SPDX-License-Identifier: Apache-2.0 */
#include "screen.h"

#define FIELDS (sizeof(struct cpu_splat) / sizeof(float))

static const char *const fields[FIELDS] = {"x",      "y",     "slope",  "reach", "taper", "ymax",
                                           "yright", "spare", "across", "shear", "down",  "peak",
                                           "r",      "g",     "b",      "z"};

/* Whether the oracle draws any pixel of a tile, by a margin that rounding cannot cross. */
static bool draws(const struct screen *s, const struct ref_splat *r, int tx, int ty)
{
    for (int y = ty * SG_TILE; y < (ty + 1) * SG_TILE && y < s->camera.height; y++)
        for (int x = tx * SG_TILE; x < (tx + 1) * SG_TILE && x < s->camera.width; x++) {
            double dx, dy, gauss, alpha;
            if (ref_pair(r, x, y, &dx, &dy, &gauss, &alpha) &&
                alpha > 1.001 * (double) SG_ALPHA_MIN)
                return true;
        }
    return false;
}

static bool lists(const struct cpu_extent *e, int tx, int ty)
{
    if (tx < e->x0 || tx >= e->x1 || ty < e->y0 || ty >= e->y1)
        return false;
    const int width = e->x1 - e->x0;
    return width * (e->y1 - e->y0) > CPU_MASK_TILES ||
           (e->tiles >> ((ty - e->y0) * width + tx - e->x0) & 1);
}

/* All tiles that are drawn in are listed, and none beyond the oracle's rectangle; with
 * reference_tiles, the whole rectangle. Returns the number of Gaussians that differ. */
static size_t wrong_extents(const struct screen *s, const struct cpu_extent *extents, bool whole)
{
    size_t wrong = 0;
    for (size_t i = 0; i < s->count; i++) {
        const struct ref_splat *r = &s->splats[i];
        bool good = (r->visible) == (extents[i].x1 > 0);
        for (int ty = 0; ty < s->grid_y; ty++)
            for (int tx = 0; tx < s->grid_x; tx++) {
                const bool listed = extents[i].x1 > extents[i].x0 && lists(&extents[i], tx, ty);
                const bool inside = r->visible && tx >= r->rect.x0 && tx < r->rect.x1 &&
                                    ty >= r->rect.y0 && ty < r->rect.y1;
                if (whole && r->o >= (double) SG_ALPHA_MIN)
                    good &= listed == inside;
                else
                    good &= listed ? inside : !inside || !draws(s, r, tx, ty);
            }
        wrong += !good;
    }
    return wrong;
}

static void check_records(const char *variant, const struct screen *s,
                          const struct cpu_splat *found, const struct cpu_extent *extents)
{
    double *a = must(s->count, sizeof(double)), *b = must(s->count, sizeof(double));
    for (size_t f = 0; f < FIELDS; f++) {
        const bool colour = f >= 12 && f < 15; /* kernels keep black, but not clamped, above 0 */
        size_t n = 0;
        for (size_t i = 0; i < s->count; i++) {
            if (!s->splats[i].visible || extents[i].x1 <= extents[i].x0)
                continue; /* records of what is not drawn are undefined */
            a[n] = (double) ((const float *) &found[i])[f];
            b[n] = (double) ((const float *) &s->records[i])[f];
            n++;
        }
        char what[64];
        snprintf(what, sizeof(what), "degree %d, field %s", s->degree, fields[f]);
        assert_close(variant, what, a, b, n, colour ? 2e-6 : 1e-5, 2e-4, 0);
    }
    free(a);
    free(b);
}

typedef void (*project_kernel)(const struct cpu_project_args *, size_t, size_t);

static project_kernel project_by(const struct cpu_kernels *k, bool mip)
{
    return mip ? k->project_mip : k->project;
}

static void check_model(const struct cpu_kernels *k, struct screen *s)
{
    struct cpu_splat *splats = must(s->count, sizeof(*splats));
    struct cpu_extent *extents = must(s->count + 1, sizeof(*extents));
    for (int whole = 0; whole < 2; whole++) {
        const struct cpu_project_args a = {.params = s->model->params,
                                           .count = s->count,
                                           .planes = s->planes,
                                           .degree = s->degree,
                                           .camera = &s->camera,
                                           .mip_kernel = s->mip ? 0.1f : 0,
                                           .grid_x = s->grid_x,
                                           .grid_y = s->grid_y,
                                           .reference_tiles = whole,
                                           .splats = splats,
                                           .extents = extents};
        memset(extents, 0xaa, (s->count + 1) * sizeof(*extents));
        const struct cpu_extent beyond = extents[s->count];
        const size_t blocks = (s->count + SG_LANES - 1) / SG_LANES;
        project_by(k, s->mip)(&a, blocks / 2, blocks); /* any range of blocks */
        project_by(k, s->mip)(&a, 0, blocks / 2);
        assert_memory_equal(&extents[s->count], &beyond, sizeof(beyond));
        const size_t wrong = wrong_extents(s, extents, whole);
        if (wrong > s->count / 200) /* a rectangle's edge may round to either side */
            fail_msg("%s: %zu Gaussians, degree %d%s: the tiles of %zu are wrong", k->name,
                     s->count, s->degree, whole ? ", whole rectangles" : "", wrong);
        check_records(k->name, s, splats, extents);
    }
    free(splats);
    free(extents);
}

static void check_by(const struct cpu_kernels *k, bool mip)
{
    static const size_t counts[] = {1, 15, 16, 17, 301};
    for (int degree = 0; degree <= 3; degree++)
        for (size_t c = 0; c < sizeof(counts) / sizeof(counts[0]); c++) {
            sg_ctx *ctx = make_context(1);
            struct sg_model *m = make_model(ctx, counts[c], 3, 40 + (uint64_t) degree);
            if (counts[c] > 100)
                for (size_t i = 0; i < 20; i++) { /* behind the camera, all over the image, faint */
                    *sg_model_at(m, i, SG_P_XYZ + 2) = i < 10 ? -4 : 0;
                    *sg_model_at(m, i, SG_P_SCALE) = i < 15 ? 0.5f : -3;
                    *sg_model_at(m, i, SG_P_OPACITY) = i % 2 ? 2 : -6;
                }
            struct screen s = make_filtered_screen(ctx, m, make_camera(150, 110, 3), degree, mip);
            check_model(k, &s);
            clear_screen(&s);
        }
}

static void check(const struct cpu_kernels *k)
{
    check_by(k, false);
}

static void check_mip(const struct cpu_kernels *k)
{
    check_by(k, true);
}

static double bench_by(const struct cpu_kernels *k, bool mip)
{
    enum { N = 16384 };
    sg_ctx *ctx = make_context(1);
    struct screen s =
        make_filtered_screen(ctx, make_model(ctx, N, 3, 40), make_camera(800, 600, 3), 3, mip);
    struct cpu_splat *splats = must(N, sizeof(*splats));
    struct timing t = {0};
    const struct cpu_project_args a = {.params = s.model->params,
                                       .count = N,
                                       .planes = s.planes,
                                       .degree = 3,
                                       .camera = &s.camera,
                                       .mip_kernel = mip ? 0.1f : 0,
                                       .grid_x = s.grid_x,
                                       .grid_y = s.grid_y,
                                       .splats = splats,
                                       .extents = s.extents};
    while (timing_again(&t))
        if (k)
            project_by(k, mip)(&a, 0, N / SG_LANES);
        else
            for (size_t i = 0; i < N; i++)
                ref_project(&s.view, s.params[i], 3, s.grid_x, s.grid_y, &s.splats[i]);
    free(splats);
    clear_screen(&s);
    return timing_result(&t, N);
}

static double bench(const struct cpu_kernels *k)
{
    return bench_by(k, false);
}

static double bench_mip(const struct cpu_kernels *k)
{
    return bench_by(k, true);
}

const struct kernel_check check_project = {"project", "Gaussian", false, check, bench};
const struct kernel_check check_project_mip = {"project_mip", "Gaussian", false, check_mip,
                                               bench_mip};
