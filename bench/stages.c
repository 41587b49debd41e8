/* SPDX-License-Identifier: Apache-2.0 */
/* Each stage of an iteration, waited for, on a model that does not move: its time, what it moves
 * and computes, and the least time that the machine needs for that. What a stage moves and computes
 * is counted from the view's numbers, without caches: every array that it reads or writes once. */
#include "stages.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"
#include "device.h"
#include "engine/cpu/dispatch.h"
#include "engine/ops.h"
#include "measure.h"
#include "roofline.h"

enum {
    PROJECT,
    BIN,
    RASTER,
    LOSS,
    RASTER_BACKWARD,
    UPDATE,
    STATISTICS,
    /* of the defense */
    ANISOTROPY,
    TOTAL_VARIATION,
    TOLERANCE,
    HITS,
    STAGES
};
#define ALWAYS ANISOTROPY /* the stages before it */
#define SHORTEST 1e-6     /* seconds: less is noise, or no stage of this engine */

static const char *const names[STAGES] = {
    "project",         "bin",       "raster",     "loss",
    "raster backward", "update",    "statistics", "anisotropy",
    "total variation", "tolerance", "hits"};

/* What a stage has to do, by the view's numbers. */
struct work {
    double items;
    const char *unit;
    double bytes, operations;
    uint64_t dispatches;
};

struct bench {
    sg_ctx *ctx;
    struct sg_engine *engine;
    struct sg_camera camera;
    struct sg_render_params render;
    sg_photo photo;
    int degree, rounds;
    bool defense, device;
    double *hits; /* room for count_hits */
    struct sg_step step;
    struct rates rates;
    struct work work[STAGES];
    double *samples[STAGES], seconds[STAGES];
};

static void check(const struct bench *b, int code, const char *what)
{
    if (code)
        bench_fail(b->ctx, what);
}

/* ---- an iteration ---- */

static const struct sg_loss photometric = {
    SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}};
/* Its last tenth of the iterations. */
static struct sg_loss tolerant(void)
{
    return (struct sg_loss){
        SG_LOSS_PHOTOMETRIC,
        1,
        {.photometric = {.lambda_dssim = 0.2f, .tolerance = sg_loss_tolerance(8), .low_pass = 20}}};
}

static void compare(struct bench *b, struct sg_loss first, bool anisotropy, bool variation)
{
    struct sg_loss list[3] = {first};
    size_t n = 1;
    if (anisotropy)
        list[n++] =
            (struct sg_loss){SG_LOSS_ANISOTROPY, 0.02, {.anisotropy = {SG_ANISOTROPY_DEFAULTS}}};
    if (variation)
        list[n++] =
            (struct sg_loss){SG_LOSS_TOTAL_VARIATION, 4, {.total_variation = SG_TV_PENALTY_HUBER}};
    check(b, sg_engine_losses(b->engine, &(struct sg_target){.photo = b->photo}, list, n),
          "losses");
}

static void wait_for(struct bench *b)
{
    check(b, sg_engine_read_step(b->engine, &b->step), "read_step");
}

/* Steps that are too small to move anything, so that each iteration has the same work. */
static void learn(struct bench *b, bool statistics)
{
    struct sg_update u = {.adam = true, .statistics = statistics};
    for (int g = 0; g < SG_GROUPS; g++)
        u.rate[g] = 1e-30f, u.root[g] = 1;
    check(b, sg_engine_raster_backward(b->engine), "raster_backward");
    check(b, sg_engine_optimise(b->engine, &u), "optimise");
}

static void draw(struct bench *b)
{
    check(b, sg_engine_draw(b->engine, &b->camera, b->degree, &b->render, false), "draw");
}

static double of_losses(const struct sg_engine_times *after, const struct sg_engine_times *before,
                        enum sg_loss_kind kind)
{
    return after->loss[kind] - before->loss[kind];
}

static double of_update(const struct sg_engine_times *after, const struct sg_engine_times *before)
{
    return after->project_backward + after->optimise - before->project_backward - before->optimise;
}

/* An iteration without statistics. */
static void run_plain(struct bench *b, bool defense, double seconds[STAGES])
{
    const struct sg_engine_times start = sg_engine_times(b->engine);
    draw(b);
    compare(b, photometric, defense, defense);
    learn(b, false);
    wait_for(b);
    const struct sg_engine_times end = sg_engine_times(b->engine);
    seconds[PROJECT] = end.project - start.project;
    seconds[BIN] = end.bin - start.bin;
    seconds[RASTER] = end.raster - start.raster;
    seconds[LOSS] = of_losses(&end, &start, SG_LOSS_PHOTOMETRIC);
    seconds[ANISOTROPY] = of_losses(&end, &start, SG_LOSS_ANISOTROPY);
    seconds[TOTAL_VARIATION] = of_losses(&end, &start, SG_LOSS_TOTAL_VARIATION);
    seconds[RASTER_BACKWARD] = end.raster_backward - start.raster_backward;
    seconds[UPDATE] = of_update(&end, &start);
}

/* Another one, which takes longer by the statistics and the tolerance, and hits in one view. */
static void run_more(struct bench *b, double seconds[STAGES])
{
    const struct sg_camera *camera = &b->camera;
    const struct sg_engine_times start = sg_engine_times(b->engine);
    draw(b);
    compare(b, b->defense ? tolerant() : photometric, false, false);
    learn(b, true);
    wait_for(b);
    const struct sg_engine_times end = sg_engine_times(b->engine);
    seconds[STATISTICS] = of_update(&end, &start) - seconds[UPDATE];
    seconds[TOLERANCE] = of_losses(&end, &start, SG_LOSS_PHOTOMETRIC) - seconds[LOSS];
    if (b->defense)
        check(b, sg_engine_count_hits(b->engine, &camera, 1, &b->render, SG_HIT_PIXELS, b->hits),
              "hits");
    seconds[HITS] = sg_engine_times(b->engine).count - end.count;
}

/* Median seconds of the stages. all: else those of an iteration without the defense. */
static void measure(struct bench *b, bool all)
{
    double seconds[STAGES] = {0};
    for (int i = 0; i < b->rounds; i++) {
        run_plain(b, all && b->defense, seconds);
        if (all)
            run_more(b, seconds);
        for (int k = 0; k < STAGES; k++)
            b->samples[k][i] = seconds[k];
    }
    for (int k = 0; k < STAGES; k++)
        b->seconds[k] = median(b->samples[k], b->rounds);
}

/* ---- what the stages have to do ---- */

static uint64_t since(const struct bench *b, uint64_t *dispatches)
{
    const uint64_t before = *dispatches;
    *dispatches = b->device ? device_dispatches(b->engine) : 0;
    return *dispatches - before;
}

/* Kernels of a stage, in a round that warms up. */
static void count_dispatches(struct bench *b)
{
    struct sg_engine *e = b->engine;
    struct work *w = b->work;
    const struct sg_camera *camera = &b->camera;
    uint64_t at = 0;
    since(b, &at);
    check(b, sg_engine_project(e, camera, b->degree, &b->render), "project");
    w[PROJECT].dispatches = since(b, &at);
    check(b, sg_engine_bin(e), "bin");
    w[BIN].dispatches = since(b, &at);
    check(b, sg_engine_raster(e, false), "raster");
    w[RASTER].dispatches = since(b, &at);
    compare(b, photometric, false, false);
    w[LOSS].dispatches = since(b, &at);
    if (b->defense) {
        compare(b, photometric, true, false);
        w[ANISOTROPY].dispatches = since(b, &at) - w[LOSS].dispatches;
        compare(b, photometric, false, true);
        w[TOTAL_VARIATION].dispatches = since(b, &at) - w[LOSS].dispatches;
        compare(b, tolerant(), false, false);
        w[TOLERANCE].dispatches = since(b, &at) - w[LOSS].dispatches;
    }
    check(b, sg_engine_raster_backward(e), "raster_backward");
    w[RASTER_BACKWARD].dispatches = since(b, &at);
    learn(b, true);
    wait_for(b);
    w[UPDATE].dispatches = since(b, &at) - w[RASTER_BACKWARD].dispatches;
    if (b->defense) {
        check(b, sg_engine_count_hits(e, &camera, 1, &b->render, SG_HIT_PIXELS, b->hits), "hits");
        w[HITS].dispatches = since(b, &at);
    }
}

static void set(struct work *w, double items, const char *unit, double bytes, double operations)
{
    w->items = items, w->unit = unit, w->bytes = bytes, w->operations = operations;
}

/* Operations are those of the formulas; a multiply-add is one, and so is an exponential. */
static void count_work(struct bench *b)
{
    struct work *w = b->work;
    const struct sg_render_stats *s = &b->step.stats;
    const double n = (double) sg_engine_count(b->engine), seen = (double) s->visible,
                 instances = (double) s->instances, pairs = (double) s->pairs,
                 pixels = (double) b->camera.width * b->camera.height;
    const double colours = 3 * (b->degree + 1) * (b->degree + 1), planes = 11 + colours;
    /* Digits of the tiles' numbers, and of the depths. */
    const double digits = ceil(log2(pixels / 256 + 2) / 8), keys = 4;
    const double project_ops = 250 * n, shade_ops = 1.7 * colours * seen;
    if (b->device) {
        set(&w[PROJECT], n, "Gaussians", n * (11 * 4 + 16) + seen * (colours * 4 + 64),
            project_ops + shade_ops);
        /* Tiles counted; three scans; keys of depths sorted, of 8 bytes with their values, read
         * twice and written; instances emitted, sorted by tile, and moved to their lists. */
        set(&w[BIN], instances, "instances",
            n * (12 + 3 * 12) + seen * (64 + 20 + keys * 20 + 24 + 88) +
                instances * (16 + digits * 20 + 24),
            n * 40 + seen * (100 + keys * 20) + instances * (20 + digits * 20));
        /* Each instance with its splat, what it leaves for the backward pass, and every 128th with
         * the states of 256 pixels. */
        set(&w[RASTER], pairs, "pairs", instances * (8 + 64 + 1 + 32) + pixels * 12, pairs * 26);
        set(&w[RASTER_BACKWARD], pairs, "pairs", instances * (8 + 64 + 1 + 32 + 36) + pixels * 24,
            pairs * 45);
        set(&w[LOSS], pixels, "pixels", pixels * (28 + 60 + 84), pixels * 930);
        set(&w[TOTAL_VARIATION], pixels, "pixels", pixels * 36, pixels * 100);
        set(&w[TOLERANCE], pixels, "pixels", pixels * (28 + 52), pixels * 250);
        set(&w[HITS], pairs, "pairs",
            n * (11 * 4 + 16 + 8) + seen * (12 + 64) + w[BIN].bytes + instances * (8 + 64 + 8),
            project_ops + w[BIN].operations + pairs * 20);
    } else { /* in bands that stay in caches */
        set(&w[PROJECT], n, "Gaussians", n * (planes * 4 + 64 + 12), project_ops + shade_ops);
        set(&w[BIN], instances, "instances", instances * 8 + n * 40,
            n * 40 + seen * keys * 20 + instances * 20);
        set(&w[RASTER], pairs, "pairs", instances * (8 + 64) + pixels * 12, pairs * 26);
        set(&w[RASTER_BACKWARD], pairs, "pairs", instances * (8 + 64 + 36) + pixels * 24,
            pairs * 45);
        set(&w[LOSS], pixels, "pixels", pixels * 27, pixels * 930);
        set(&w[TOTAL_VARIATION], pixels, "pixels", pixels * 36, pixels * 100);
        set(&w[TOLERANCE], pixels, "pixels", pixels * 39, pixels * 250);
        set(&w[HITS], pairs, "pairs", w[PROJECT].bytes + w[BIN].bytes + instances * (8 + 64 + 8),
            project_ops + w[BIN].operations + pairs * 20);
    }
    set(&w[UPDATE], n, "Gaussians", n * (planes * 6 * 4 + 16 + 64) + instances * 36,
        n * (planes * 12 + 600));
    set(&w[STATISTICS], n, "Gaussians", n * 16, n * 10);
    /* Rows and columns of three planes, there and back; half of the spectrum is kept. */
    set(&w[ANISOTROPY], pixels, "pixels", pixels * 8 * 12,
        pixels * 3 * (2 * 2.5 * log2(pixels) + 15));
}

static double floor_of(const struct bench *b, const struct work *w, const char **bound)
{
    const double limits[] = {w->bytes / b->rates.bytes, w->operations / b->rates.operations,
                             (double) w->dispatches * b->rates.dispatch};
    static const char *const by[] = {"bytes", "operations", "dispatches"};
    int most = 0;
    for (int k = 1; k < 3; k++)
        most = limits[k] > limits[most] ? k : most;
    *bound = by[most];
    return limits[most];
}

/* ---- tables ---- */

static void print_rates(const struct bench *b, int threads)
{
    const struct rates *r = &b->rates;
    printf("\n%s: copies of %.1f GB/s, %.0f G multiply-adds/s", sg_engine_variant(b->engine),
           1e-9 * r->bytes, 1e-9 * r->operations);
    if (b->device)
        printf(" (%.0f where each waits for the one before), %.1f us a dispatch that does "
               "nothing.\n",
               1e-9 * r->dependent, 1e6 * r->dispatch);
    else
        printf(" with %d threads.\n", threads);
}

static void print_view(const struct bench *b)
{
    const struct sg_render_stats *s = &b->step.stats;
    const double pixels = (double) b->camera.width * b->camera.height;
    printf("%llu Gaussians are visible; %llu instances, %llu in the longest list; %.1f evaluated "
           "pairs a pixel",
           (unsigned long long) s->visible, (unsigned long long) s->instances,
           (unsigned long long) s->max_tile, (double) s->pairs / pixels);
    if (b->device) /* of a Gaussian and a block of pixels */
        printf(", in %llu rows of 32", (unsigned long long) s->pairs / 32);
    printf(".\n");
}

static void print_table(const struct bench *b, FILE *csv)
{
    char device[256];
    snprintf(device, sizeof(device), "%s", sg_engine_variant(b->engine));
    for (char *c = device; *c; c++)
        *c = *c == ',' ? ';' : *c;
    printf("\n| stage | ms | of | MB | M operations | dispatches | floor, ms | by | reached, %% "
           "|\n|---|---:|---|---:|---:|---:|---:|---|---:|\n");
    if (csv)
        fprintf(csv, "engine,device,gaussians,width,height,stage,ms,items,unit,bytes,operations,"
                     "dispatches,floor_ms,bound,share\n");
    for (int k = 0; k < (b->defense ? STAGES : ALWAYS); k++) {
        const struct work *w = &b->work[k];
        const char *bound;
        const double least = floor_of(b, w, &bound), seconds = b->seconds[k],
                     share = seconds > SHORTEST ? least / seconds : 0;
        printf("| %s | %.3f | %.0f %s | %.2f | %.1f | %llu | %.4f | %s |", names[k], 1e3 * seconds,
               w->items, w->unit, 1e-6 * w->bytes, 1e-6 * w->operations,
               (unsigned long long) w->dispatches, 1e3 * least, bound);
        printf(seconds > SHORTEST ? " %.1f |\n" : " - |\n", 100 * share);
        if (csv)
            fprintf(csv, "%s,%s,%zu,%d,%d,%s,%.4f,%.0f,%s,%.0f,%.0f,%llu,%.5f,%s,%.4f\n",
                    b->engine->ops->name, device, sg_engine_count(b->engine), b->camera.width,
                    b->camera.height, names[k], 1e3 * seconds, w->items, w->unit, w->bytes,
                    w->operations, (unsigned long long) w->dispatches, 1e3 * least, bound, share);
    }
}

static int stage_of(const char *name)
{
    int k = 0;
    while (strcmp(names[k], name))
        k++;
    return k;
}

/* The bits of parts by their names. */
static unsigned find_parts(const char *list)
{
    const struct device_part *parts;
    const int n = device_parts(&parts);
    unsigned bits = 0;
    for (const char *at = list; at && *at;) {
        const size_t length = strcspn(at, ",");
        int k = 0;
        while (k < n && (strlen(parts[k].name) != length || strncmp(parts[k].name, at, length)))
            k++;
        if (k == n) {
            fprintf(stderr, "bench: found no part \"%.*s\", expected some of:", (int) length, at);
            for (k = 0; k < n; k++)
                fprintf(stderr, " %s", parts[k].name);
            fprintf(stderr, "\n");
            exit(1);
        }
        bits |= 1u << k;
        at += length + (at[length] == ',');
    }
    return bits;
}

/* Times of a machine drift: each part has its own comparison. */
static void print_parts(struct bench *b)
{
    const struct device_part *parts;
    const int n = device_parts(&parts);
    printf("\n| without | stage | ms | with it | less by, %% |\n|---|---|---:|---:|---:|\n");
    for (int k = 0; k < n; k++) {
        const int stage = stage_of(parts[k].stage);
        check(b, device_leave_out(b->engine, 0), "parts");
        measure(b, false);
        const double with = b->seconds[stage];
        check(b, device_leave_out(b->engine, 1u << k), "parts");
        measure(b, false);
        printf("| %s | %s | %.3f | %.3f | %.1f |\n", parts[k].name, parts[k].stage,
               1e3 * b->seconds[stage], 1e3 * with, 100 * (1 - b->seconds[stage] / with));
    }
    check(b, device_leave_out(b->engine, 0), "parts");
}

static void print_kernels(struct bench *b)
{
    check(b, device_profile_begin(b->engine), "kernels");
    for (int i = 0; i < b->rounds; i++) {
        draw(b);
        compare(b, photometric, b->defense, b->defense);
        learn(b, false);
        wait_for(b);
    }
    device_profile_print(b->engine, b->rounds);
}

static void find_rates(struct bench *b, const char *cpu)
{
    const struct cpu_kernels *kernels;
    if (b->device) {
        check(b, device_rates(b->engine, &b->rates), "rates");
        return;
    }
    check(b, sg_cpu_select(b->ctx, cpu, &kernels), "kernels");
    const struct roofline r = roofline_measure(b->ctx, kernels);
    b->rates =
        (struct rates){.bytes = r.bandwidth, .operations = 0.5 * r.flops * sg_ctx_threads(b->ctx)};
}

void stages_check(sg_ctx *ctx, const struct stages_options *o)
{
    const struct sg_engine_kind *kind = sg_engine_find(ctx, o->engine, o->cpu);
    if (!kind)
        bench_fail(ctx, "engine");
    if ((o->without || o->parts || o->kernels) && !kind->devices) {
        fprintf(stderr, "bench: engine %s has no kernels that parts can be left out of\n",
                kind->name);
        exit(1);
    }
    find_parts(o->without);
}

void stages_print(sg_ctx *ctx, const struct sg_model *model, const struct sg_view *view,
                  const struct stages_options *o)
{
    struct bench b = {.ctx = ctx,
                      .camera = view->camera,
                      .render = {SG_RENDER_DEFAULTS},
                      .degree = model->sh_degree,
                      .rounds = o->rounds,
                      .defense = o->defense};
    check(&b, sg_engine_create(ctx, o->engine, o->cpu, &b.engine), "engine");
    b.device = device_has(b.engine);
    const unsigned without = find_parts(o->without);
    FILE *csv = csv_open(o->csv);
    find_rates(&b, o->cpu);
    check(&b, sg_engine_upload(b.engine, model, NULL), "model");
    check(&b,
          sg_engine_photo_add(b.engine, b.camera.width, b.camera.height, view->rgb, NULL, &b.photo),
          "photo");
    b.hits = calloc(model->count, sizeof(*b.hits));
    for (int k = 0; k < STAGES; k++)
        b.samples[k] = malloc((size_t) b.rounds * sizeof(double));
    count_dispatches(&b);
    count_work(&b);
    if (without)
        check(&b, device_leave_out(b.engine, without), "parts");
    measure(&b, true);
    print_rates(&b, sg_ctx_threads(ctx));
    print_view(&b);
    if (without)
        printf("Left out, with results that are wrong: %s.\n", o->without);
    print_table(&b, csv);
    if (o->parts)
        print_parts(&b);
    if (o->kernels)
        print_kernels(&b);
    csv_close(csv, o->csv);
    for (int k = 0; k < STAGES; k++)
        free(b.samples[k]);
    free(b.hits);
    sg_engine_destroy(&b.engine);
}
