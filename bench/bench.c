/* SPDX-License-Identifier: Apache-2.0 */
/* What an iteration costs, stage by stage, next to what the machine could do. Prints Markdown;
 * sweeps go to a CSV file too.
 *
 *     bench [--quick] [--threads T] [--cpu VARIANT] [--model MODEL.ply] [--csv FILE]
 *     bench --engine ENGINE [--quick | --rounds N] [--threads T] [--cpu VARIANT] [--gaussians N]
 *         [--side N] [--model MODEL.ply] [--defense] [--without PART,...] [--parts] [--kernels]
 *         [--csv FILE]
 *
 * The second form measures one size on any engine: what its calling thread works, and each stage
 * next to what the engine's device could do; --defense: those of the defense too. Of an engine with
 * a device, --without measures the stages with parts of their kernels left out, --parts does so for
 * one part after the other, and --kernels measures each kernel.
 *
 * Without --model the Gaussians lie on the surfaces of our own making: flat, overlapping discs of
 * the size that training leaves, seen whole in a square image. */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "engine/cpu/dispatch.h"
#include "model/morton.h"
#include "core/clock.h"
#include "core/context.h"
#include "core/rng.h"
#include "measure.h"
#include "roofline.h"
#include "stages.h"
#include "splatguard/splatguard.h"

#define STAGES 6
enum { ANISOTROPY = STAGES, TOTAL_VARIATION, COUNT, TIMES };
static const char *const stage_names[STAGES] = {"project",         "bin",   "raster", "loss",
                                                "raster backward", "update"};

struct result {
    size_t gaussians;
    int side, threads;
    double total, stage[TIMES]; /* median seconds */
    double caller;              /* of the calling thread's processor time */
    struct sg_render_stats stats;
};

/* A copy in the order in which training keeps its Gaussians. */
static struct sg_model *ordered(sg_ctx *ctx, struct sg_model *m)
{
    const int planes = sg_param_count(m->sh_degree);
    uint32_t *source = malloc(2 * m->count * sizeof(*source)), *order = source + m->count;
    struct sg_model *out;
    for (size_t i = 0; i < m->count; i++)
        source[i] = (uint32_t) i;
    if (sg_morton_order(ctx, &(struct sg_places){m->params, m->count, NULL, planes, 0}, source,
                        m->count, order) ||
        sg_model_create(ctx, m->count, m->sh_degree, &out))
        bench_fail(ctx, "order");
    for (size_t i = 0; i < m->count; i++)
        for (int p = 0; p < planes; p++)
            *sg_model_at(out, i, p) = *sg_model_at(m, order[i], p);
    free(source);
    sg_model_destroy(&m);
    return out;
}

/* Discs on three nested spheres and a ground plane, scaled to cover the surface a few times. */
static struct sg_model *surface_model(sg_ctx *ctx, size_t n)
{
    struct sg_model *m;
    if (sg_model_create(ctx, n, 3, &m))
        bench_fail(ctx, "model");
    static const float radius[] = {1.0f, 0.7f, 0.45f};
    const float spacing = sqrtf(25.0f / (float) n);
    for (size_t i = 0; i < n; i++) {
        float u[12];
        for (int k = 0; k < 12; k++)
            u[k] = sg_rng_uniform(1, SG_RNG_INIT, i, (uint64_t) k);
        const float z = 2 * u[0] - 1, a = 6.2831853f * u[1], s = sqrtf(1 - z * z),
                    r = radius[(int) (u[2] * 3)];
        const bool ground = u[3] < 0.3f;
        const float normal[3] = {ground ? 0 : s * cosf(a), ground ? -1 : s * sinf(a),
                                 ground ? 0 : z};
        const float p[3] = {ground ? 2.4f * u[0] - 1.2f : r * normal[0],
                            ground ? 0.9f : r * normal[1],
                            ground ? 2.4f * u[1] - 1.2f : r * normal[2]};
        for (int k = 0; k < 3; k++) {
            *sg_model_at(m, i, SG_P_XYZ + k) = p[k];
            *sg_model_at(m, i, SG_P_SH + k) = 3 * u[4 + k] - 1.5f;
        }
        /* The turn that takes z to the normal. */
        const float w = 1 + normal[2];
        *sg_model_at(m, i, SG_P_ROT) = w;
        *sg_model_at(m, i, SG_P_ROT + 1) = -normal[1];
        *sg_model_at(m, i, SG_P_ROT + 2) = normal[0];
        const float size = logf(spacing * (0.25f + 0.5f * u[7]));
        *sg_model_at(m, i, SG_P_SCALE) = size;
        *sg_model_at(m, i, SG_P_SCALE + 1) = size - 1.2f * u[8];
        *sg_model_at(m, i, SG_P_SCALE + 2) = size - 2.5f;
        *sg_model_at(m, i, SG_P_OPACITY) = 6 * u[9] - 3;
        for (int k = 3; k < 48; k++)
            *sg_model_at(m, i, SG_P_SH + k) =
                0.1f * (sg_rng_uniform(2, SG_RNG_INIT, i, (uint64_t) k) - 0.5f);
    }
    return ordered(ctx, m);
}

static double thread_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Of noise. The caller frees its pixels. */
static struct sg_view make_view(int side)
{
    struct sg_view view = {.name = (char *) "bench",
                           .camera = {.width = side,
                                      .height = side,
                                      .fx = 1.39 * side,
                                      .fy = 1.39 * side,
                                      .cx = 0.5 * side,
                                      .cy = 0.5 * side,
                                      .R = {1, 0, 0, 0, 0.94, -0.342, 0, 0.342, 0.94},
                                      .t = {0, 0, 3.6}}};
    view.rgb = malloc(3 * (size_t) side * (size_t) side);
    for (size_t i = 0; i < 3 * (size_t) side * (size_t) side; i++)
        view.rgb[i] = (uint8_t) (i * 2654435761u >> 13);
    return view;
}

#define VIEWS 8 /* all alike */

/* Median times of whole training iterations (degree 3, no densification). With a filter it counts
 * in each, in VIEWS views, and removes nothing. */
static struct result measure(const struct sg_model *model, int side, int threads,
                             const char *engine, const char *cpu, int rounds,
                             const struct sg_defense_params *defense)
{
    sg_ctx *ctx;
    sg_trainer *t;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads}))
        bench_fail(NULL, "context");
    struct sg_view view = make_view(side);
    struct sg_view views[VIEWS];
    for (int i = 0; i < VIEWS; i++)
        views[i] = view;
    struct sg_scene scene = {
        .path = (char *) "bench", .train = views, .n_train = VIEWS, .extent = 4};
    struct sg_train_params params = {SG_TRAIN_DEFAULTS, .engine = engine, .cpu = cpu,
                                     .sh_interval = 1, .densify_until_iter = 0};
    params.defense = *defense;
    if (sg_trainer_create(ctx, &scene, model, &params, &t))
        bench_fail(ctx, "trainer");
    struct result r = {.gaussians = model->count, .side = side, .threads = threads};
    double *total = malloc((size_t) rounds * sizeof(double)), *stage[TIMES];
    double *caller = malloc((size_t) rounds * sizeof(double));
    for (int k = 0; k < TIMES; k++)
        stage[k] = malloc((size_t) rounds * sizeof(double));
    for (int i = -5; i < rounds; i++) { /* five to warm up, with rising degree */
        struct sg_train_times before, after;
        struct sg_train_step step = {0};
        sg_trainer_times(t, &before);
        const double start = sg_seconds(), worked = thread_seconds();
        if (sg_trainer_step(t, engine ? NULL : &step)) /* NULL: nobody waits for a device */
            bench_fail(ctx, "step");
        const double spent = sg_seconds() - start;
        sg_trainer_times(t, &after);
        r.stats = step.render;
        if (i < 0)
            continue;
        total[i] = spent;
        caller[i] = thread_seconds() - worked;
        stage[0][i] = after.project - before.project;
        stage[1][i] = after.bin - before.bin;
        stage[2][i] = after.raster - before.raster;
        stage[3][i] = after.loss - before.loss;
        stage[4][i] = after.raster_backward - before.raster_backward;
        stage[5][i] = after.update - before.update;
        stage[ANISOTROPY][i] = after.anisotropy - before.anisotropy;
        stage[TOTAL_VARIATION][i] = after.total_variation - before.total_variation;
        stage[COUNT][i] = after.count - before.count;
    }
    r.total = median(total, rounds);
    r.caller = median(caller, rounds);
    for (int k = 0; k < TIMES; k++) {
        r.stage[k] = median(stage[k], rounds);
        free(stage[k]);
    }
    free(total);
    free(caller);
    free(view.rgb);
    sg_trainer_destroy(&t);
    sg_ctx_destroy(&ctx);
    return r;
}

static int by_total(const void *a, const void *b)
{
    return sg_double_ascending(&((const struct result *) a)->total,
                               &((const struct result *) b)->total);
}

static struct result middle(struct result r[3])
{
    qsort(r, 3, sizeof(*r), by_total);
    return r[1];
}

static void print_stages(const struct result *r, const struct roofline *m)
{
    const double pixels = (double) r->side * r->side, pairs = (double) r->stats.pairs,
                 t = r->threads;
    const double n = (double) r->gaussians;
    printf("\n%zu Gaussians, %dx%d, %d threads: **%.1f ms** an iteration. %.1f evaluated pairs per "
           "pixel, %.2f instances per Gaussian, longest tile list %llu.\n\n",
           r->gaussians, r->side, r->side, r->threads, 1e3 * r->total, pairs / pixels,
           (double) r->stats.instances / n, (unsigned long long) r->stats.max_tile);
    printf("| stage | ms | share | rate | roofline | of it |\n|---|---|---|---|---|---|\n");
    const double bytes[STAGES] = {
        n * (59 * 4 + 64 + 12),
        (double) r->stats.instances * 8 + n * 40,
        0,
        0,
        0,
        n * (59 * 4 * 6 + 64) + (double) r->stats.instances * 48,
    };
    for (int k = 0; k < STAGES; k++) {
        printf("| %s | %.2f | %.0f %% |", stage_names[k], 1e3 * r->stage[k],
               100 * r->stage[k] / r->total);
        if (k == 2 || k == 4) {
            const double rate = pairs / r->stage[k] / t, best = k == 2 ? m->forward : m->backward;
            printf(" %.2f G pairs/s a core | %.2f full lanes | %.0f %% |\n", 1e-9 * rate,
                   1e-9 * best, 100 * rate / best);
        } else if (k == 3) {
            /* 7 windowed maps of 2 x 11 taps, 3 channels */
            const double flops = pixels * 3 * 7 * 44 / r->stage[k] / t;
            printf(" %.1f GFLOP/s a core | %.0f FMA peak | %.0f %% |\n", 1e-9 * flops,
                   1e-9 * m->flops, 100 * flops / m->flops);
        } else {
            const double rate = bytes[k] / r->stage[k];
            printf(" %.1f GB/s | %.1f stream | %.0f %% |\n", 1e-9 * rate, 1e-9 * m->bandwidth,
                   100 * rate / m->bandwidth);
        }
    }
}

static void print_engine(const struct result *r, const char *engine)
{
    printf("%zu Gaussians, %dx%d, %s: **%.2f ms** an iteration, of which the calling thread works "
           "%.3f ms (%.2f %%).\n",
           r->gaussians, r->side, r->side, engine, 1e3 * r->total, 1e3 * r->caller,
           100 * r->caller / r->total);
}

/* Parts of the defense as it is by default: losses in every iteration, 48 counting passes in
 * 100. */
static void print_defense(const struct result *plain, const struct result *smooth,
                          const struct result *counting)
{
    const double spectrum = 1e3 * smooth->stage[ANISOTROPY],
                 variation = 1e3 * smooth->stage[TOTAL_VARIATION];
    const double pass = 1e3 * counting->stage[COUNT] / VIEWS,
                 each = spectrum + variation + 0.48 * pass;
    printf("\nThe defense: anisotropy %.2f ms, total variation %.2f ms, a counting pass %.2f ms "
           "and so %.2f ms an iteration; together %.1f ms, %.0f %% of %.1f ms.\n",
           spectrum, variation, pass, 0.48 * pass, each, 0.1 * each / plain->total,
           1e3 * plain->total);
}

static void csv_row(FILE *csv, const char *sweep, const struct result *r)
{
    if (!csv)
        return;
    fprintf(csv, "%s,%zu,%d,%d,%.3f", sweep, r->gaussians, r->side, r->threads, 1e3 * r->total);
    for (int k = 0; k < STAGES; k++)
        fprintf(csv, ",%.3f", 1e3 * r->stage[k]);
    fprintf(csv, ",%.2f,%.3f\n", (double) r->stats.pairs / r->side / r->side,
            (double) r->stats.instances / (double) r->gaussians);
}

static void print_row(const struct result *r)
{
    printf("| %zu | %d | %.1f |", r->gaussians, r->side, 1e3 * r->total);
    for (int k = 0; k < STAGES; k++)
        printf(" %.2f |", 1e3 * r->stage[k]);
    printf(" %.1f | %.2f |\n", (double) r->stats.pairs / r->side / r->side,
           (double) r->stats.instances / (double) r->gaussians);
}

static void table_head(void)
{
    printf("| Gaussians | side | ms |");
    for (int k = 0; k < STAGES; k++)
        printf(" %s |", stage_names[k]);
    printf(" pairs/pixel | instances/Gaussian |\n|---|---|---|");
    for (int k = 0; k < STAGES + 2; k++)
        printf("---|");
    printf("\n");
}

static int usage(void)
{
    fprintf(stderr,
            "usage: bench [--quick] [--threads T] [--cpu VARIANT] [--model MODEL.ply] [--csv "
            "FILE]\n"
            "       bench --engine ENGINE [--quick | --rounds N] [--threads T] [--cpu VARIANT] "
            "[--gaussians N]\n"
            "           [--side N] [--model MODEL.ply] [--defense] [--without PART,...] [--parts] "
            "[--kernels] [--csv FILE]\n");
    return 1;
}

struct bench_options {
    struct stages_options stages; /* .engine NULL: the first form */
    bool quick;
    int threads, gaussians, side; /* the last two: 0 = by default */
    const char *model;
};

static bool read_number(const char *text, int least, int *out)
{
    char *end;
    const long value = strtol(text, &end, 10);
    *out = (int) value;
    return end != text && !*end && value >= least && value <= INT_MAX;
}

/* False: they are not as the usage says. */
static bool parse(int argc, char **argv, struct bench_options *o)
{
    struct stages_options *s = &o->stages;
    bool good = true;
    for (int i = 1; i < argc && good; i++) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (!strcmp(argv[i], "--quick"))
            o->quick = true;
        else if (!strcmp(argv[i], "--defense"))
            s->defense = true;
        else if (!strcmp(argv[i], "--parts"))
            s->parts = true;
        else if (!strcmp(argv[i], "--kernels"))
            s->kernels = true;
        else if (!value)
            return false;
        else if (!strcmp(argv[i], "--threads"))
            good = read_number(argv[++i], 0, &o->threads);
        else if (!strcmp(argv[i], "--rounds"))
            good = read_number(argv[++i], 1, &s->rounds);
        else if (!strcmp(argv[i], "--cpu"))
            s->cpu = argv[++i];
        else if (!strcmp(argv[i], "--model"))
            o->model = argv[++i];
        else if (!strcmp(argv[i], "--csv"))
            s->csv = argv[++i];
        else if (!strcmp(argv[i], "--engine"))
            s->engine = argv[++i];
        else if (!strcmp(argv[i], "--without"))
            s->without = argv[++i];
        else if (!strcmp(argv[i], "--gaussians"))
            good = read_number(argv[++i], 1, &o->gaussians);
        else if (!strcmp(argv[i], "--side"))
            good = read_number(argv[++i], 1, &o->side);
        else
            return false;
    }
    const bool second_form =
        s->rounds || s->defense || s->parts || s->kernels || s->without || o->gaussians || o->side;
    return good && (s->engine || !second_form);
}

static struct sg_model *load_model(sg_ctx *ctx, const char *path, size_t gaussians)
{
    struct sg_model *m;
    if (!path)
        return surface_model(ctx, gaussians);
    if (sg_model_read_ply(ctx, path, UINT32_MAX, &m))
        bench_fail(ctx, "model");
    return m;
}

/* The second form: one size on any engine. */
static void run_engine(sg_ctx *ctx, struct bench_options *o)
{
    const struct sg_defense_params off = {SG_DEFENSE_DEFAULTS};
    struct stages_options *s = &o->stages;
    const int side = o->side ? o->side : 800;
    stages_check(ctx, s);
    s->rounds = s->rounds ? s->rounds : o->quick ? 9 : 31;
    struct sg_model *m = load_model(ctx, o->model, o->gaussians ? (size_t) o->gaussians : 300000);
    struct sg_view view = make_view(side);
    const struct result whole = measure(m, side, o->threads, s->engine, s->cpu, s->rounds, &off);
    print_engine(&whole, s->engine);
    stages_print(ctx, m, &view, s);
    free(view.rgb);
    sg_model_destroy(&m);
}

/* One size of the CPU engine: stages next to the machine, the defense, threads. The speed of memory
 * that is shared with others drifts: one thread and all take turns, and of each the middle one of
 * three counts. */
static void run_headline(const struct bench_options *o, const struct sg_model *m,
                         const struct roofline *machine, int rounds, FILE *csv)
{
    const char *const cpu = o->stages.cpu;
    const struct sg_defense_params off = {SG_DEFENSE_DEFAULTS};
    struct sg_defense_params smooth_only = off, count_only = off;
    smooth_only.on = count_only.on = true;
    smooth_only.rho = count_only.lambda = 0;
    count_only.rho = 1e-9;
    count_only.interval = 1, count_only.from = 0, count_only.until = 1000000;
    struct result all[3], single[3], smooth[3], counting[3];
    for (int i = 0; i < 3; i++) {
        all[i] = measure(m, 800, o->threads, NULL, cpu, rounds, &off);
        smooth[i] = measure(m, 800, o->threads, NULL, cpu, rounds, &smooth_only);
        counting[i] = measure(m, 800, o->threads, NULL, cpu, rounds / 2, &count_only);
        if (o->threads > 1)
            single[i] = measure(m, 800, 1, NULL, cpu, rounds / 2, &off);
    }
    const struct result r = middle(all), with_losses = middle(smooth),
                        with_counts = middle(counting);
    print_stages(&r, machine);
    csv_row(csv, "headline", &r);
    print_defense(&r, &with_losses, &with_counts);
    if (o->threads == 1)
        return;
    const struct result one = middle(single);
    printf("\nScaling, threads 1 to %d: %.1f to %.1f ms, %.2fx (", o->threads, 1e3 * one.total,
           1e3 * r.total, one.total / r.total);
    for (int k = 0; k < STAGES; k++)
        printf("%s%s %.2fx", k ? ", " : "", stage_names[k], one.stage[k] / r.stage[k]);
    printf(").\n");
    csv_row(csv, "threads", &one);
}

static void run_size(sg_ctx *ctx, const struct bench_options *o, size_t gaussians, int side,
                     int rounds, const char *sweep, FILE *csv)
{
    const struct sg_defense_params off = {SG_DEFENSE_DEFAULTS};
    struct sg_model *m = surface_model(ctx, gaussians);
    const struct result r = measure(m, side, o->threads, NULL, o->stages.cpu, rounds, &off);
    sg_model_destroy(&m);
    print_row(&r);
    csv_row(csv, sweep, &r);
}

static void run_sweeps(sg_ctx *ctx, const struct bench_options *o, int rounds, FILE *csv)
{
    static const size_t counts[] = {10000, 30000, 100000, 300000, 1000000};
    static const int sides[] = {200, 400, 800, 1600};
    printf("\nBy Gaussians:\n\n");
    table_head();
    for (int i = 0; i < (o->quick ? 3 : 5); i++)
        run_size(ctx, o, counts[i], 800, rounds, "gaussians", csv);
    printf("\nBy pixels:\n\n");
    table_head();
    for (int i = 0; i < (o->quick ? 2 : 4); i++)
        run_size(ctx, o, 100000, sides[i], rounds, "pixels", csv);
}

/* The first form. */
static void run_cpu(sg_ctx *ctx, const struct bench_options *o)
{
    const struct cpu_kernels *kernels;
    const int rounds = o->quick ? 9 : 31;
    struct sg_model *m = load_model(ctx, o->model, 300000);
    if (sg_cpu_select(ctx, o->stages.cpu, &kernels))
        bench_fail(ctx, "kernels");
    FILE *csv = csv_open(o->stages.csv);
    if (csv)
        fprintf(csv, "sweep,gaussians,side,threads,ms,project,bin,raster,loss,raster_backward,"
                     "update,pairs_per_pixel,instances_per_gaussian\n");
    const struct roofline machine = roofline_measure(ctx, kernels);
    printf("splatguard %s, kernels %s. Machine: stream %.1f GB/s with %d threads, FMA %.0f GFLOP/s "
           "a core; pairs on full lanes %.2f G/s forward, %.2f G/s backward a core.\n",
           sg_version(), kernels->name, 1e-9 * machine.bandwidth, o->threads, 1e-9 * machine.flops,
           1e-9 * machine.forward, 1e-9 * machine.backward);
    run_headline(o, m, &machine, rounds, csv);
    sg_model_destroy(&m);
    if (!o->model)
        run_sweeps(ctx, o, rounds / 2, csv);
    csv_close(csv, o->stages.csv);
}

int main(int argc, char **argv)
{
    struct bench_options o = {.threads = 2};
    sg_ctx *ctx;
    if (!parse(argc, argv, &o))
        return usage();
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = o.threads}))
        bench_fail(NULL, "context");
    o.threads = sg_ctx_threads(ctx);
    if (o.stages.engine)
        run_engine(ctx, &o);
    else
        run_cpu(ctx, &o);
    sg_ctx_destroy(&ctx);
    return 0;
}
