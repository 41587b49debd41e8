/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "interrupt.h"
#include "progress.h"
#include "run_folder.h"

#define T(field) offsetof(struct train_config, field)
#define INTEGER(name, field, low, high, help)                                                                          \
    {                                                                                                                  \
        name, 0, OPT_INT, T(field), low, high, NULL, "N", help, false                                                  \
    }
#define RATE(name, field, help)                                                                                        \
    {                                                                                                                  \
        name, 0, OPT_FLOAT, T(train.field), 0, 1000, NULL, "X", help, false                                            \
    }

static const struct option train_options[] = {
    {"Run", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"output", 'o', OPT_STRING, T(output), 0, 0, NULL, "RUN", "Folder to write the run to.", true},
    {"model-path", 'm', OPT_STRING, T(output), 0, 0, NULL, "RUN", "The reference's name for --output.", true},
    {"source-path", 's', OPT_STRING, T(source), 0, 0, NULL, "SCENE", "The reference's way to name the scene.", false},
    INTEGER("iterations", train.iterations, 1, 10000000, "Training iterations."),
    {"seed", 0, OPT_U64, T(train.seed), 0, 9e15, NULL, "S", "Seed of every random draw.", false},
    {"threads", 'j', OPT_INT, T(threads), 0, 256, NULL, "T", "Worker threads; 0 = one per CPU. Results are the same.",
     true},
    {"eval", 0, OPT_FLAG, T(eval), 0, 0, NULL, NULL, "Hold the test views out and measure PSNR and SSIM on them.",
     false},
    {"resume", 0, OPT_FLAG, T(resume), 0, 0, NULL, NULL,
     "Continue RUN from its checkpoint with its own options: same bytes as an uninterrupted run.", true},
    {"force", 0, OPT_FLAG, T(force), 0, 0, NULL, NULL, "Replace an earlier run in the folder.", true},
    {"quiet", 'q', OPT_FLAG, T(quiet), 0, 0, NULL, NULL, "No progress.", true},
    INTEGER("save-every", save_every, 0, 10000000,
            "Save model and checkpoint every N iterations; 0 = at the end only."),
    INTEGER("eval-every", eval_every, 0, 10000000, "Measure the test views every N iterations; 0 = at the end only."),
    INTEGER("log-every", log_every, 1, 10000000, "Write a line to log.jsonl every N iterations."),
    {"backend", 0, OPT_CHOICE, T(backend), 0, 0, BACKENDS, "NAME", "cpu, or ref: the slow scalar oracle.", false},
    {"cpu", 0, OPT_STRING, T(train.cpu), 0, 0, NULL, "VARIANT",
     "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU).", false},
    SCENE_OPTIONS(struct train_config, scene, false),
    {"Initialisation", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"init", 0, OPT_STRING, T(init), 0, 0, NULL, "MODEL.ply", "Start from this model.", false},
    {"init-points", 0, OPT_U64, T(train.init_points), 4, 1e8, NULL, "N", "Random points where the scene has none.",
     false},
    {"Model and loss", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    INTEGER("sh-degree", train.sh_degree, 0, 3, "Degree of the spherical harmonics."),
    INTEGER("sh-interval", train.sh_interval, 1, 10000000, "Iterations between raises of the degree in use."),
    {"random-background", 0, OPT_FLAG, T(train.random_background), 0, 0, NULL, NULL,
     "A random background colour each iteration.", false},
    {"lambda-dssim", 0, OPT_FLOAT, T(train.lambda_dssim), 0, 1, NULL, "X", "Weight of 1 - SSIM against L1.", false},
    {"Learning rates", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    RATE("position-lr-init", position_lr_init, "Position, at the start, in scene extents."),
    RATE("position-lr-final", position_lr_final, "Position, at the end, in scene extents."),
    INTEGER("position-lr-max-steps", train.position_lr_max_steps, 1, 1000000000, "Iterations between the two."),
    RATE("feature-lr", feature_lr, "Colour; higher SH degrees learn at a twentieth."),
    RATE("opacity-lr", opacity_lr, "Opacity."),
    RATE("scaling-lr", scaling_lr, "Scale."),
    RATE("rotation-lr", rotation_lr, "Rotation."),
    {"Densification", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    RATE("percent-dense", percent_dense, "Split Gaussians larger than this share of the extent, clone smaller ones."),
    INTEGER("densification-interval", train.densification_interval, 1, 10000000, "Iterations between densifications."),
    INTEGER("densify-from-iter", train.densify_from_iter, 0, 1000000000, "Densify after this iteration."),
    INTEGER("densify-until-iter", train.densify_until_iter, 0, 1000000000, "Densify before this iteration."),
    RATE("densify-grad-threshold", densify_grad_threshold, "Mean view-space gradient that makes a Gaussian grow."),
    INTEGER("opacity-reset-interval", train.opacity_reset_interval, 1, 1000000000,
            "Iterations between opacity resets."),
    {"max-gaussians", 0, OPT_U64, T(train.max_gaussians), 0, 4e9, NULL, "N", "Growth stops there; 0 = no limit.",
     false},
    {"Rasteriser", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false},
    {"max-instances", 0, OPT_U64, T(train.max_instances), 1, 4e9, NULL, "N",
     "(Gaussian, tile) pairs held at once; views with more are processed in bands, with the same result.", false},
    {"reference-tiles", 0, OPT_FLAG, T(train.reference_tiles), 0, 0, NULL, NULL,
     "Keep every tile of the 3-sigma square, for parity checks.", false},
    {0},
};

static const struct train_config defaults = {
    .scene = {SCENE_OPTION_DEFAULTS},
    .train = {SG_TRAIN_DEFAULTS},
    .log_every = 100,
};

struct run {
    struct train_config *c;
    sg_ctx *ctx;
    struct sg_scene *scene;
    sg_trainer *trainer;
    FILE *log;
    struct progress progress;
    size_t max_gaussians;
    uint64_t max_instances;
    double seconds, cpu_seconds; /* of training alone, this session */
    struct sg_eval last;         /* newest measurement */
    int last_at;                 /* its iteration, 0 = none */
};

static double cpu_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* Measures the test views; fps only on request. */
static int measure(struct run *r, int time_fps)
{
    struct sg_model *m = NULL;
    sg_renderer *renderer = NULL;
    struct sg_render_params params = {SG_RENDER_DEFAULTS};
    for (int ch = 0; ch < 3; ch++)
        params.background[ch] = r->c->train.white_background ? 1 : 0;
    params.max_instances = r->c->train.max_instances;
    int error = sg_trainer_model(r->trainer, &m);
    if (!error)
        error = sg_renderer_create(r->ctx, r->c->train.backend, r->c->train.cpu, m, &params, &renderer);
    if (!error) {
        sg_eval_clear(r->ctx, &r->last);
        error = sg_evaluate(r->ctx, renderer, r->scene->test, r->scene->n_test, time_fps, &r->last);
        r->last_at = sg_trainer_iteration(r->trainer);
    }
    sg_renderer_destroy(&renderer);
    sg_model_destroy(r->ctx, &m);
    if (error)
        return report(r->ctx, error);
    if (!r->c->quiet) {
        progress_break(&r->progress);
        fprintf(stderr, "iteration %d: PSNR %.3f, SSIM %.4f on %zu test views\n", r->last_at, r->last.psnr,
                r->last.ssim, r->last.views);
    }
    return 0;
}

static int log_json(struct run *r, json_t *line)
{
    char *text = json_dumps(line, JSON_COMPACT | JSON_REAL_PRECISION(8));
    const bool bad = !text || fprintf(r->log, "%s\n", text) < 0 || fflush(r->log);
    free(text);
    json_decref(line);
    if (bad)
        fprintf(stderr, "splatguard: %s/log.jsonl: cannot write: %s\n", r->c->output, strerror(errno));
    return bad ? 2 : 0;
}

static json_t *times_json(const sg_trainer *t)
{
    struct sg_train_times s;
    sg_trainer_times(t, &s);
    return json_pack("{s:f,s:f,s:f,s:f,s:f,s:f,s:f}", "project", s.project, "bin", s.bin, "raster", s.raster, "loss",
                     s.loss, "raster_backward", s.raster_backward, "update", s.update, "densify", s.densify);
}

/* Everything that is due after an iteration. */
static int after_step(struct run *r, const struct sg_train_step *s)
{
    const struct train_config *c = r->c;
    const bool last = s->iteration == c->train.iterations;
    int code = 0;
    progress_step(&r->progress, s);
    if (s->gaussians > r->max_gaussians)
        r->max_gaussians = s->gaussians;
    if (s->render.instances > r->max_instances)
        r->max_instances = s->render.instances;
    if (s->iteration % c->log_every == 0 || last || s->iteration == 1)
        code = log_json(r, json_pack("{s:i,s:f,s:f,s:f,s:f,s:s,s:I,s:I,s:I,s:I,s:I,s:I,s:I,s:f}", "iteration",
                                     s->iteration, "loss", s->loss, "l1", s->l1, "ssim", s->ssim, "psnr", s->psnr,
                                     "view", r->scene->train[s->view].name, "gaussians", (json_int_t) s->gaussians,
                                     "cloned", (json_int_t) s->cloned, "split", (json_int_t) s->split, "pruned",
                                     (json_int_t) s->pruned, "visible", (json_int_t) s->render.visible, "instances",
                                     (json_int_t) s->render.instances, "pairs", (json_int_t) s->render.pairs, "seconds",
                                     r->seconds));
    if (!code && c->eval && c->eval_every && s->iteration % c->eval_every == 0 && !last && !(code = measure(r, 0)))
        code = log_json(r, json_pack("{s:i,s:f,s:f}", "iteration", s->iteration, "test_psnr", r->last.psnr, "test_ssim",
                                     r->last.ssim));
    if (!code && c->save_every && s->iteration % c->save_every == 0 && !last &&
        !(code = run_save_model(r->ctx, c->output, r->trainer)))
        code = run_save_checkpoint(r->ctx, c->output, r->trainer);
    return code;
}

static int loop(struct run *r)
{
    int code = 0;
    while (!code && sg_trainer_iteration(r->trainer) < r->c->train.iterations && !interrupted()) {
        struct sg_train_step step;
        const double start = monotonic_seconds(), cpu = cpu_now();
        const int error = sg_trainer_step(r->trainer, &step);
        r->seconds += monotonic_seconds() - start;
        r->cpu_seconds += cpu_now() - cpu;
        if (error) {
            progress_break(&r->progress);
            return report(r->ctx, error);
        }
        code = after_step(r, &step);
    }
    return code;
}

static json_t *cpu_name(void)
{
    char line[256];
    FILE *f = fopen("/proc/cpuinfo", "r");
    json_t *name = NULL;
    while (f && !name && fgets(line, sizeof(line), f)) {
        char *value = strchr(line, ':');
        if (!strncmp(line, "model name", 10) && value) {
            value[strcspn(value, "\n")] = 0;
            name = json_string(value + 2);
        }
    }
    if (f)
        fclose(f);
    return name ? name : json_string("unknown");
}

static int write_summary(struct run *r)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    json_t *ledger = json_object();
    for (int tag = 0; tag < SG_MEM_TAGS; tag++)
        json_object_set_new(ledger, sg_mem_tag_name((enum sg_mem_tag) tag),
                            json_integer((json_int_t) sg_mem_peak(r->ctx, (enum sg_mem_tag) tag)));
    const int done = sg_trainer_iteration(r->trainer);
    json_t *s = json_pack(
        "{s:s,s:i,s:b,s:I,s:I,s:I,s:f,s:f,s:f,s:I,s:I,s:o,s:o,s:s,s:o,s:i,s:i,s:i}", "version", sg_version(),
        "iterations", done, "interrupted",
        done<r->c->train.iterations, "max_gaussians", (json_int_t) r->max_gaussians, "final_gaussians",
             (json_int_t) sg_trainer_gaussians(r->trainer), "max_instances", (json_int_t) r->max_instances,
             "train_seconds", r->seconds, "cpu_seconds", r->cpu_seconds, "iterations_per_second", r->seconds> 0
            ? (done - r->progress.first) / r->seconds
            : 0.0,
        "peak_rss_bytes", (json_int_t) usage.ru_maxrss * 1024, "peak_ledger_bytes",
        (json_int_t) sg_mem_peak(r->ctx, SG_MEM_TAGS), "peak_ledger_bytes_by_tag", ledger, "stage_seconds",
        times_json(r->trainer), "variant", sg_trainer_variant(r->trainer), "machine", cpu_name(), "threads",
        sg_ctx_threads(r->ctx), "train_views", (int) r->scene->n_train, "test_views", (int) r->scene->n_test);
    if (s && r->last_at == done && r->last.views) {
        json_object_set_new(s, "psnr", json_real(r->last.psnr));
        json_object_set_new(s, "ssim", json_real(r->last.ssim));
        json_object_set_new(s, "fps", json_real(r->last.fps));
    }
    char *path = run_path(r->c->output, "summary.json");
    const int code = s && path ? run_write_json(path, s) : 4;
    free(path);
    json_decref(s);
    return code;
}

/* Ends the run: what there is, is saved, interrupted or not. */
static int finish(struct run *r)
{
    const bool cut = sg_trainer_iteration(r->trainer) < r->c->train.iterations;
    if (cut)
        progress_break(&r->progress);
    int code = run_save_model(r->ctx, r->c->output, r->trainer);
    if (!code)
        code = run_save_checkpoint(r->ctx, r->c->output, r->trainer);
    if (!code && r->c->eval && !cut)
        code = measure(r, 1);
    if (!code)
        code = write_summary(r);
    if (!code && cut) {
        fprintf(stderr, "interrupted at iteration %d; saved. Continue with: splatguard train --resume %s\n",
                sg_trainer_iteration(r->trainer), r->c->output);
        code = 130;
    }
    return code;
}

/* Trainer on the loaded scene, from points, a model or the checkpoint. */
static int start(struct run *r)
{
    struct train_config *c = r->c;
    struct sg_model *initial = NULL;
    int error = 0, code = 0;
    if (c->init)
        error = sg_model_read_ply(r->ctx, c->init, UINT32_MAX, &initial);
    if (!error)
        error = sg_trainer_create(r->ctx, r->scene, initial, &c->train, &r->trainer);
    sg_model_destroy(r->ctx, &initial);
    if (!error && c->resume) {
        char *path = run_path(c->output, "checkpoint.bin");
        error = path ? sg_trainer_load(r->trainer, path) : SG_ERR_INTERNAL;
        free(path);
    }
    if (!error && !c->resume && !(error = sg_trainer_model(r->trainer, &initial)))
        code = run_create(r->ctx, c, r->scene, initial, sg_trainer_variant(r->trainer));
    sg_model_destroy(r->ctx, &initial);
    if (error)
        return report(r->ctx, error);
    if (code)
        return code;
    r->max_gaussians = sg_trainer_gaussians(r->trainer);
    char *path = run_path(c->output, "log.jsonl");
    r->log = path ? fopen(path, c->resume ? "ab" : "wb") : NULL;
    if (!r->log) {
        fprintf(stderr, "splatguard: %s: cannot write: %s\n", path, strerror(errno));
        code = 2;
    }
    free(path);
    return code;
}

/* RUN's own options; of the command line only what does not change the result, and more iterations, count. */
static int adopt_run(struct train_config *c, const char *scene_argument, json_t **keep)
{
    struct train_config now = *c;
    if (!c->output)
        now.output = scene_argument;
    if (!now.output) {
        fprintf(stderr, "splatguard train: --resume needs the run's folder\n");
        return 1;
    }
    *c = defaults;
    int code = run_read_config(now.output, c, keep);
    c->output = now.output;
    c->resume = true;
    c->quiet = now.quiet;
    c->threads = now.threads;
    if (now.train.iterations != defaults.train.iterations && now.train.iterations > c->train.iterations)
        c->train.iterations = now.train.iterations;
    return code;
}

static int run_train(const void *config, const char *const *positional, int count)
{
    struct train_config c = *(const struct train_config *) config;
    struct run r = {.c = &c};
    json_t *keep = NULL;
    int code = 0;
    if (c.resume)
        code = adopt_run(&c, count ? positional[0] : NULL, &keep);
    else if (count)
        c.source = positional[0];
    if (!code && (!c.source || !c.output)) {
        fprintf(stderr, "splatguard train: missing %s; usage: splatguard train %s\n", c.source ? "-o RUN" : "SCENE",
                command_train.arguments);
        code = 1;
    }
    if (code)
        goto done;
    static const char *const backends[] = {"cpu", "ref"};
    c.train.backend = backends[c.backend];
    c.train.cpu = cpu_variant(c.train.cpu);
    c.train.white_background = c.scene.params.white_background;
    c.scene.params.format = (enum sg_scene_format) c.scene.format;
    c.scene.params.eval = c.eval;
    if ((code = open_context(&r.ctx, c.threads, c.quiet)))
        goto done;
    const int error = sg_scene_load(r.ctx, c.source, &c.scene.params, &r.scene);
    if (error) {
        code = report(r.ctx, error);
        goto done;
    }
    if (c.eval && !r.scene->n_test) {
        fprintf(stderr, "splatguard: %s: found no test views, needed for --eval\n", c.source);
        code = 2;
        goto done;
    }
    if ((code = start(&r)))
        goto done;
    interrupt_catch();
    progress_begin(&r.progress, c.quiet, sg_trainer_iteration(r.trainer), c.train.iterations);
    if (!(code = loop(&r)))
        code = finish(&r);
done:
    if (r.log)
        fclose(r.log);
    if (r.ctx) {
        sg_eval_clear(r.ctx, &r.last);
        sg_trainer_destroy(&r.trainer);
        sg_scene_destroy(r.ctx, &r.scene);
    }
    sg_ctx_destroy(&r.ctx);
    json_decref(keep);
    return code;
}

const struct command command_train = {
    .name = "train",
    .arguments = "SCENE -o RUN [options]",
    .summary = "Trains a model from photos with known cameras.",
    .description =
        "Trains a 3D Gaussian Splatting model of SCENE (Blender, COLMAP or nerfstudio layout) into the folder "
        "RUN. Ctrl-C saves and exits; `train --resume RUN` continues.",
    .options = train_options,
    .config_size = sizeof(struct train_config),
    .defaults = &defaults,
    .max_positional = 1,
    .run = run_train,
};
