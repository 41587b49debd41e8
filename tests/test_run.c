/* SPDX-License-Identifier: Apache-2.0 */
/* Runs as a program that embeds the library uses them. */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "core/file.h"
#include "params.h"
#include "run/files.h"
#include "splatguard/splatguard.h"
#include "synth_scene.h"

static char root[] = "/tmp/sg-run-XXXXXX";
static char scene[64], with_points[64]; /* the latter begins with its own, not with 100 000 */

static char *at(const char *name)
{
    static char paths[8][128];
    static int next;
    char *path = paths[next++ % 8];
    snprintf(path, sizeof(paths[0]), "%s/%s", root, name);
    return path;
}

static sg_ctx *new_context(void)
{
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 2}), SG_OK);
    return ctx;
}

static int set_up(void **state)
{
    (void) state;
    const int code =
        make_synth_scene(root, sg_synth_params(.width = 40, .height = 32, .train_views = 6,
                                               .test_views = 2, .points = 100, .samples = 1));
    snprintf(scene, sizeof(scene), "%s/scene/blender", root);
    snprintf(with_points, sizeof(with_points), "%s/scene/colmap", root);
    return code;
}

static int tear_down(void **state)
{
    (void) state;
    return remove_synth_scene(root);
}

static struct sg_run_params short_run(const char *folder)
{
    struct sg_run_params p = sg_run_params_default();
    p.source = scene, p.folder = folder;
    p.scene.eval = true;
    p.train.iterations = 24, p.train.init_points = 200, p.train.sh_degree = 1;
    p.log_every = 5;
    return p;
}

/* A whole run of an embedding program: from a folder of photos to a folder with a model. */
static int train(sg_ctx *ctx, const struct sg_run_params *params, enum sg_run_start start,
                 struct sg_run_status *status)
{
    sg_run *run;
    int code = sg_run_open(ctx, params, start, &run);
    if (code)
        return code;
    code = sg_run_train(run);
    sg_run_status(run, status);
    sg_run_close(&run);
    return code;
}

static int stop_at(void *priv, const struct sg_train_step *step)
{
    return step && step->iteration == *(int *) priv;
}

/* The file of the model of an iteration, 0 = the newest. */
static char *read_model(sg_ctx *ctx, const char *run, int iteration, size_t *size)
{
    char path[200], *data;
    assert_int_equal(sg_run_find_model(ctx, run, iteration, path, sizeof(path)), SG_OK);
    assert_int_equal(sg_file_read(ctx, path, 1 << 20, &data, size), SG_OK);
    return data;
}

static void assert_same_models(sg_ctx *ctx, const char *a, int of_a, const char *b, int of_b)
{
    size_t size[2];
    char *data[] = {read_model(ctx, a, of_a, &size[0]), read_model(ctx, b, of_b, &size[1])};
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(data[0], data[1], size[0]);
    sg_free(data[0]);
    sg_free(data[1]);
}

static void assert_same_model(sg_ctx *ctx, const char *a, const char *b)
{
    assert_same_models(ctx, a, 0, b, 0);
}

/* Stopped and continued, a run gives the bytes of an uninterrupted one. */
static void test_resume(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    char *whole = at("whole"), *cut = at("cut");
    struct sg_run_status s;
    struct sg_run_params p = short_run(whole), q = short_run(cut), back;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_OK);
    assert_true(s.iteration == 24 && s.iterations == 24 && s.saved == 24 && s.resumable);
    assert_true(!s.finished && s.ended_by == SG_OK);

    int stop = 11;
    q.step = stop_at, q.step_priv = &stop;
    assert_int_equal(train(ctx, &q, SG_RUN_NEW, &s), SG_ERR_INTERRUPTED);
    assert_string_equal(sg_last_error(ctx), "interrupted at iteration 11; saved");
    assert_true(s.iteration == 11 && s.saved == 11 && s.resumable);

    assert_int_equal(sg_run_read_params(ctx, cut, &back), SG_OK);
    assert_int_equal(back.train.iterations, 24);
    assert_int_equal(back.log_every, 5);
    assert_true(back.scene.eval && back.train.tolerance == 0 && back.train.defense.rho == 0.03);
    back.train.lambda_dssim = 0.5f; /* another run */
    assert_int_equal(train(ctx, &back, SG_RUN_RESUME, &s), SG_ERR_INPUT);
    back.train.lambda_dssim = 0.2f;
    assert_int_equal(train(ctx, &back, SG_RUN_RESUME, &s), SG_OK);
    assert_int_equal(s.saved, 24);
    assert_same_model(ctx, whole, cut);
    assert_int_equal(train(ctx, &back, SG_RUN_RESUME, &s), SG_OK);
    assert_true(s.finished);
    char path[128];
    assert_int_equal(sg_run_find_model(ctx, cut, 11, path, sizeof(path)), SG_OK);
    assert_int_equal(sg_run_find_model(ctx, cut, 12, path, sizeof(path)), SG_ERR_INPUT);
    assert_non_null(
        strstr(sg_last_error(ctx), "found no point_cloud/iteration_12/point_cloud.ply"));
    assert_int_equal(sg_run_find_model(ctx, cut, -1, path, sizeof(path)), SG_ERR_INPUT);
    sg_run_params_clear(&back);

    sg_run_summary *summary;
    assert_int_equal(sg_run_summary_read(ctx, cut, &summary), SG_OK);
    assert_true(sg_run_summary_number(summary, "iterations") == 24);
    assert_true(sg_run_summary_number(summary, "interrupted") == 0);
    assert_true(sg_run_summary_number(summary, "psnr") > 5);
    assert_true(sg_run_summary_number(summary, "stage_seconds.project") >= 0);
    assert_true(isnan(sg_run_summary_number(summary, "stage_seconds.tea")));
    assert_true(isnan(sg_run_summary_number(summary, "variant")));
    sg_run_summary_destroy(&summary);
    assert_null(summary);
    sg_ctx_destroy(&ctx);
}

/* A model that was saved after the newest checkpoint, as where memory ran out, is not the newest
 * one of the run that goes on from there. */
static void test_later_model(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    char folder[128], path[200], later[200];
    int stop = 11;
    struct sg_run_status s;
    snprintf(folder, sizeof(folder), "%s", at("later"));
    struct sg_run_params p = short_run(folder);
    p.step = stop_at, p.step_priv = &stop;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INTERRUPTED);
    snprintf(path, sizeof(path), "%s/point_cloud/iteration_11", folder);
    snprintf(later, sizeof(later), "%s/point_cloud/iteration_19", folder);
    assert_int_equal(rename(path, later), 0);
    stop = 15;
    assert_int_equal(train(ctx, &p, SG_RUN_RESUME, &s), SG_ERR_INTERRUPTED);
    assert_int_equal(sg_run_find_model(ctx, folder, 0, path, sizeof(path)), SG_OK);
    assert_non_null(strstr(path, "iteration_15/"));
    assert_int_equal(access(later, F_OK), -1);
    sg_ctx_destroy(&ctx);
}

/* config.json keeps 15 digits of a double: a run that began with more can be continued all the
 * same. */
static void test_resume_with_all_digits(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    char *folder = at("digits");
    int stop = 11;
    struct sg_run_status s;
    struct sg_run_params p = short_run(folder), back;
    p.scene.downscale = 1 + 1.0 / 3;
    p.train.defense.on = true;
    p.train.defense.rho = 1.0 / 30, p.train.defense.lambda = 1.0 / 3;
    p.train.defense.frequency = 10.0 / 3;
    p.step = stop_at, p.step_priv = &stop;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INTERRUPTED);
    assert_int_equal(sg_run_read_params(ctx, folder, &back), SG_OK);
    assert_int_equal(train(ctx, &back, SG_RUN_RESUME, &s), SG_OK);
    assert_int_equal(s.saved, 24);
    sg_run_params_clear(&back);
    sg_ctx_destroy(&ctx);
}

/* Cancels once, where a stage has done so much. */
struct cancel {
    enum sg_stage stage;
    uint64_t done;
    bool over;
};

static int cancel_once(void *priv, enum sg_stage stage, uint64_t done, uint64_t total)
{
    (void) total;
    struct cancel *c = priv;
    const bool now = stage == c->stage && done == c->done && !c->over;
    c->over |= now;
    return now;
}

static sg_ctx *cancelled_context(struct cancel *c)
{
    sg_ctx *ctx;
    const struct sg_ctx_params params = {.threads = 1, .progress = cancel_once, .progress_priv = c};
    assert_int_equal(sg_ctx_create(&ctx, &params), SG_OK);
    return ctx;
}

/* Counts the lines of a log with `text`. */
static int lines_with(sg_ctx *ctx, const char *folder, const char *text)
{
    char path[160], *log;
    size_t size;
    int n = 0;
    snprintf(path, sizeof(path), "%s/log.jsonl", folder);
    assert_int_equal(sg_file_read(ctx, path, 1 << 20, &log, &size), SG_OK);
    for (char *line = strtok(log, "\n"); line; line = strtok(NULL, "\n"))
        n += strstr(line, text) != NULL;
    sg_free(log);
    return n;
}

/* Of an iteration that adds Gaussians, or resets opacities, the model before is saved and measured.
 * Of one that only adds them, which takes no other step, that is the model of the one before. */
static void test_before_changes(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    char whole[128], cut[128];
    size_t before, after;
    struct sg_run_status s;
    snprintf(whole, sizeof(whole), "%s", at("every"));
    snprintf(cut, sizeof(cut), "%s", at("until"));
    struct sg_run_params p = short_run(whole);
    p.train.densify_from_iter = 2, p.train.densification_interval = 6;
    p.train.densify_until_iter = 20, p.train.opacity_reset_interval = 16;
    p.train.densify_grad_threshold = 1e-6f;
    p.save_every = p.eval_every = 6;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_OK);
    assert_int_equal(lines_with(ctx, whole, "\"test_psnr\""), 4);
    assert_int_equal(lines_with(ctx, whole, "\"iteration\":12,\"test_psnr\""), 1);
    int stop = 11;
    p.folder = cut, p.step = stop_at, p.step_priv = &stop;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INTERRUPTED);
    assert_same_models(ctx, whole, 12, cut, 11);
    sg_free(read_model(ctx, whole, 12, &before));
    sg_free(read_model(ctx, whole, 18, &after));
    assert_true(after > before); /* there are changes */

    /* The checkpoint of that iteration has the changes: what follows is the same, also resumed. */
    stop = 12;
    assert_int_equal(train(ctx, &p, SG_RUN_RESUME, &s), SG_ERR_INTERRUPTED);
    p.step = NULL;
    assert_int_equal(train(ctx, &p, SG_RUN_RESUME, &s), SG_OK);
    assert_same_model(ctx, whole, cut);
    assert_int_equal(lines_with(ctx, cut, "\"test_psnr\""), 4);

    /* Opacities as they were before the reset. */
    struct sg_model *m;
    char path[200];
    float most = -100;
    p.folder = at("reset"), p.save_every = 16;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_OK);
    assert_int_equal(sg_run_find_model(ctx, p.folder, 16, path, sizeof(path)), SG_OK);
    assert_int_equal(sg_model_read(ctx, path, UINT32_MAX, &m), SG_OK);
    for (size_t i = 0; i < m->count; i++)
        most = fmaxf(most, *sg_model_at(m, i, SG_P_OPACITY));
    assert_true(most > -3); /* a reset leaves ln(0.01 / 0.99), -4.6 */
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* What the context's progress function cancels in a periodic measurement is the run. The resumed
 * run measures first what the stopped one did not. */
static void test_cancelled_evaluation(void **state)
{
    (void) state;
    struct cancel cancel = {SG_STAGE_EVALUATE, 0, false};
    sg_ctx *ctx = cancelled_context(&cancel);
    struct sg_run_status s;
    struct sg_run_params p = short_run(at("cancelled"));
    p.eval_every = 2;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INTERRUPTED);
    assert_string_equal(sg_last_error(ctx), "interrupted at iteration 2; saved");
    assert_true(cancel.over && s.iteration == 2 && s.saved == 2 && s.resumable);
    assert_int_equal(lines_with(ctx, p.folder, "\"test_psnr\""), 0);
    assert_int_equal(train(ctx, &p, SG_RUN_RESUME, &s), SG_OK);
    assert_int_equal(s.saved, 24);
    assert_int_equal(lines_with(ctx, p.folder, "\"iteration\":2,\"test_psnr\""), 1);
    assert_int_equal(lines_with(ctx, p.folder, "\"test_psnr\""), 12);
    sg_ctx_destroy(&ctx);
}

/* What is cancelled within an iteration ends after it: a resumed run has the bytes of one that went
 * on. */
static void test_cancelled_count(void **state)
{
    (void) state;
    struct cancel cancel = {SG_STAGE_COUNT, 2, true}; /* not in the first run */
    sg_ctx *ctx = cancelled_context(&cancel);
    struct sg_run_status s;
    char whole[128];
    snprintf(whole, sizeof(whole), "%s", at("uncounted"));
    struct sg_run_params p = short_run(whole);
    p.train.defense.on = true, p.preset = SG_RUN_PRESET_NS;
    p.train.defense.interval = 7, p.train.defense.views = 4, p.train.defense.from = 0,
    p.train.defense.until = 24, p.train.densify_until_iter = 24;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_OK);
    const uint64_t removed = s.filter_removed;
    cancel.over = false;
    p.folder = at("counted");
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INTERRUPTED);
    assert_string_equal(sg_last_error(ctx), "interrupted at iteration 7; saved");
    assert_true(cancel.over && s.iteration == 7 && s.saved == 7 && s.resumable);
    assert_in_range(s.filter_removed, 1, removed - 1);
    assert_int_equal(train(ctx, &p, SG_RUN_RESUME, &s), SG_OK);
    assert_int_equal(s.filter_removed, removed); /* those of the first process too */
    assert_same_model(ctx, whole, p.folder);
    sg_ctx_destroy(&ctx);
}

/* One owner at a time; nothing is replaced unasked. */
static void test_folders(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    struct sg_run_status s;
    const char *folder = at("owned");
    struct sg_run_params p = short_run(folder);
    sg_run *run, *other;
    assert_int_equal(sg_run_open(ctx, &p, SG_RUN_NEW, &run), SG_OK);
    assert_int_equal(sg_run_open(ctx, &p, SG_RUN_REPLACE, &other), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "in use by splatguard train, process"));
    assert_null(other);
    assert_int_equal(sg_run_train(run), SG_OK);
    sg_run_close(&run);
    assert_null(run);
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "found an earlier run"));
    assert_int_equal(train(ctx, &p, SG_RUN_REPLACE, &s), SG_OK);
    p.folder = scene;
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "found a scene"));
    p.folder = at("void");
    assert_int_equal(train(ctx, &p, SG_RUN_RESUME, &s), SG_ERR_INPUT);
    p.source = at("nowhere");
    assert_int_equal(train(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INPUT);
    assert_int_equal(access(at("void"), F_OK), -1);

    sg_output *output;
    assert_int_equal(sg_output_claim(ctx, folder, "pictures", true, NULL, &output), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "found other files"));
    assert_int_equal(sg_output_claim(ctx, at("pictures"), "pictures", true, NULL, &output), SG_OK);
    sg_output_release(&output);
    assert_int_equal(access(at("pictures"), F_OK), -1);
    assert_int_equal(sg_output_check_file(ctx, ""), SG_ERR_INPUT);
    sg_ctx_destroy(&ctx);
}

/* Errors name the field of a wrong value, before anything is read. */
static void test_checks(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    sg_run *run;
    struct sg_run_params p = short_run(at("checked"));
    p.source = at("nowhere");
    p.train.defense.rho = -0.95;
    assert_int_equal(sg_run_open(ctx, &p, SG_RUN_NEW, &run), SG_ERR_USAGE);
    assert_string_equal(sg_last_error(ctx), "defense.rho: found -0.95, expected -0.9 to 0.5");
    p = short_run(at("checked"));
    p.train.defense.rho = 0.03, p.train.defense.rho_least = 0.01;
    assert_int_equal(sg_run_check(ctx, &p), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "defense.rho_least: found 0.01 with a fixed rho"));
    p.train.defense.rho_least = 0, p.log_every = 0;
    assert_int_equal(sg_run_check(ctx, &p), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "log_every: found 0, expected 1 to"));
    p.log_every = 1, p.train.tolerance = -3;
    assert_int_equal(sg_run_check(ctx, &p), SG_ERR_USAGE);
    p.train.tolerance = SG_TOLERANCE_AUTO;
    assert_int_equal(sg_run_check(ctx, &p), SG_OK);
    p.train.seed = (uint64_t) 9e15 + 1;
    assert_int_equal(sg_run_check(ctx, &p), SG_ERR_USAGE);
    assert_string_equal(sg_last_error(ctx), "seed: found 9000000000000001, expected at most "
                                            "9000000000000000, which a run's files can carry");
    p.train.seed--;
    assert_int_equal(sg_run_check(ctx, &p), SG_OK);
    p.source = NULL;
    assert_int_equal(sg_run_open(ctx, &p, SG_RUN_NEW, &run), SG_ERR_USAGE);
    sg_ctx_destroy(&ctx);
}

static int stop_attack(void *priv, const struct sg_attack_step *step)
{
    return step && step->iteration >= *(int *) priv;
}

/* The proxy is trained on the way; stopped and continued, an attack ends as a whole one. */
static void test_attack(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    struct sg_attack_run_status s;
    struct sg_attack_run_params p = sg_attack_run_params_default(), back;
    int stop = 3;
    p.source = with_points, p.folder = at("poisoned");
    p.attack.iterations = 6, p.attack.inner = 2;
    p.proxy_iterations = 8;
    p.step = stop_attack, p.step_priv = &stop;
    assert_int_equal(sg_attack_run(ctx, &p, SG_RUN_NEW, &s), SG_ERR_INTERRUPTED);
    assert_true(s.resumable && s.first == 0 && s.iterations == 6 && !s.finished);
    assert_int_equal(access(at("poisoned/poison.json"), F_OK), -1);
    assert_int_equal(sg_attack_run_read_params(ctx, p.folder, &back), SG_OK);
    assert_true(back.attack.iterations == 6 && back.attack.epsilon == p.attack.epsilon);
    assert_int_equal(back.attack.update_interval, SG_ATTACK_BY_PRESET);
    assert_int_equal(sg_attack_run(ctx, &back, SG_RUN_RESUME, &s), SG_OK);
    assert_int_equal(s.first, 3);
    assert_int_equal(access(at("poisoned/poison.json"), F_OK), 0);
    assert_int_equal(sg_attack_run(ctx, &back, SG_RUN_RESUME, &s), SG_OK);
    assert_true(s.finished);
    sg_attack_run_params_clear(&back);
    p.ratio = 2;
    assert_int_equal(sg_attack_run(ctx, &p, SG_RUN_REPLACE, NULL), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "ratio: found 2, expected 0 to 1"));
    sg_ctx_destroy(&ctx);
}

static int stop_proxy(void *priv, const struct sg_train_step *step)
{
    (void) priv;
    return step && step->iteration == 5;
}

static struct sg_attack_run_params short_attack(const char *folder)
{
    struct sg_attack_run_params p = sg_attack_run_params_default();
    p.source = with_points, p.folder = folder;
    p.attack.iterations = 6, p.attack.inner = 2, p.attack.update_interval = 2;
    p.proxy_iterations = 8;
    return p;
}

/* A proxy that ended early without a checkpoint, as where memory runs out before it is saved, is no
 * proxy: a resumed attack trains it again, and a new one may begin. */
static void test_unfinished_proxy(void **state)
{
    (void) state;
    sg_ctx *ctx = new_context();
    struct sg_attack_run_status s;
    char folder[128], path[200];
    snprintf(folder, sizeof(folder), "%s", at("halfway"));
    struct sg_attack_run_params p = short_attack(folder);
    for (int resumed = 0; resumed < 2; resumed++) {
        p.proxy_step = stop_proxy;
        assert_int_equal(sg_attack_run(ctx, &p, SG_RUN_REPLACE, &s), SG_ERR_INTERRUPTED);
        assert_true(s.resumable);
        snprintf(path, sizeof(path), "%s/attack/proxy/checkpoint.bin", folder);
        assert_int_equal(unlink(path), 0);
        snprintf(path, sizeof(path), "%s/attack/proxy", folder);
        assert_int_equal(sg_run_find_model(ctx, path, 5, path, sizeof(path)), SG_OK);
        p.proxy_step = NULL;
        assert_int_equal(sg_attack_run(ctx, &p, resumed ? SG_RUN_RESUME : SG_RUN_NEW, &s), SG_OK);
        snprintf(path, sizeof(path), "%s/poison.json", folder);
        char *text;
        size_t size;
        assert_int_equal(sg_file_read(ctx, path, 1 << 20, &text, &size), SG_OK);
        assert_non_null(strstr(text, "attack/proxy/point_cloud/iteration_8/point_cloud.ply"));
        sg_free(text);
    }
    sg_ctx_destroy(&ctx);
}

/* Cancels from an iteration of the attack on, each time it is asked. */
static int cancel_attack(void *priv, enum sg_stage stage, uint64_t done, uint64_t total)
{
    (void) total;
    return stage == SG_STAGE_ATTACK && done >= (uint64_t) * (int *) priv;
}

/* An attack that the context's progress function cancels is saved where it can be. */
static void test_cancelled_attack(void **state)
{
    (void) state;
    static const struct {
        int cancel, save_every, checkpoint;
    } cases[] = {{4, 0, 4}, {3, 0, 0}, {5, 3, 4}, {1, 1, 0}};
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        int from = cases[i].cancel;
        sg_ctx *ctx;
        const struct sg_ctx_params params = {
            .threads = 1, .progress = cancel_attack, .progress_priv = &from};
        assert_int_equal(sg_ctx_create(&ctx, &params), SG_OK);
        struct sg_attack_run_status s;
        struct sg_attack_run_params p = short_attack(at("stopped"));
        p.save_every = cases[i].save_every;
        assert_int_equal(sg_attack_run(ctx, &p, SG_RUN_REPLACE, &s), SG_ERR_INTERRUPTED);
        assert_true(s.resumable); /* if only from the proxy */
        assert_int_equal(access(at("stopped/attack/checkpoint.bin"), F_OK),
                         cases[i].checkpoint ? 0 : -1);
        from = 100;
        assert_int_equal(sg_attack_run(ctx, &p, SG_RUN_RESUME, &s), SG_OK);
        assert_int_equal(s.first, cases[i].checkpoint);
        sg_ctx_destroy(&ctx);
    }
}

struct full_disk {
    const char *log; /* of the run */
    struct rlimit before;
    int fails; /* warnings */
};

/* No file grows in iterations 2 to 4. */
static int fill_disk(void *priv, const struct sg_attack_step *step)
{
    struct full_disk *d = priv;
    struct rlimit now = d->before;
    if (step && step->iteration >= 2 && step->iteration < 5)
        now.rlim_cur = 0;
    setrlimit(RLIMIT_FSIZE, &now);
    return 0;
}

/* Each name of a photo has a key of its own, which is UTF-8. */
static void test_exposure_keys(void **state)
{
    (void) state;
    static const struct {
        const char *name, *key;
    } photos[] = {{"view 1", "view 1"},
                  {"caf\xc3\xa9", "caf\xc3\xa9"},
                  {"caf%E9", "caf%E9"},
                  {"caf\xe9", "/caf%E9"},
                  {"100%\xff", "/100%25%FF"}};
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, NULL), SG_OK);
    for (size_t i = 0; i < sizeof(photos) / sizeof(photos[0]); i++) {
        char *key = sg_run_exposure_key(ctx, photos[i].name);
        assert_string_equal(key, photos[i].key);
        sg_free(key);
    }
    sg_ctx_destroy(&ctx);
}

static void count_warnings(void *priv, enum sg_log_level level, const char *text)
{
    ((struct full_disk *) priv)->fails += level == SG_LOG_WARN && strstr(text, "File too large");
}

/* A disk that is full for a while costs an attack the log and the checkpoints of that time. */
static void test_full_disk(void **state)
{
    (void) state;
    struct full_disk disk = {0};
    struct sg_attack_run_params p = short_attack(at("full"));
    sg_ctx *ctx;
    assert_int_equal(
        sg_ctx_create(
            &ctx, &(struct sg_ctx_params){.threads = 2, .log = count_warnings, .log_priv = &disk}),
        SG_OK);
    p.save_every = 2;
    p.step = fill_disk, p.step_priv = &disk;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &disk.before), 0);
    signal(SIGXFSZ, SIG_IGN);
    const int code = sg_attack_run(ctx, &p, SG_RUN_NEW, NULL);
    setrlimit(RLIMIT_FSIZE, &disk.before);
    signal(SIGXFSZ, SIG_DFL);
    assert_int_equal(code, SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "log.jsonl: cannot write: lines are missing"));
    assert_int_equal(disk.fails, 2);
    assert_int_equal(access(at("full/poison.json"), F_OK), 0);
    sg_ctx_destroy(&ctx);
}

/* Full as soon as test views are measured: log.jsonl cannot grow, smaller files can be written. */
static int fill_at_measuring(void *priv, enum sg_stage stage, uint64_t done, uint64_t total)
{
    (void) done, (void) total;
    struct full_disk *d = priv;
    struct rlimit now = d->before;
    struct stat log;
    if (stage == SG_STAGE_EVALUATE && !stat(d->log, &log)) {
        now.rlim_cur = (rlim_t) log.st_size;
        setrlimit(RLIMIT_FSIZE, &now);
    }
    return 0;
}

/* A run whose last line is lost is summed up all the same. */
static void test_lost_line(void **state)
{
    (void) state;
    struct full_disk disk = {.log = at("unlogged/log.jsonl")};
    struct sg_run_params p = short_run(at("unlogged"));
    struct sg_run_status s;
    sg_ctx *ctx;
    const struct sg_ctx_params params = {
        .threads = 2, .progress = fill_at_measuring, .progress_priv = &disk};
    assert_int_equal(sg_ctx_create(&ctx, &params), SG_OK);
    p.log_every = 1; /* the log is larger than the summary */
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &disk.before), 0);
    signal(SIGXFSZ, SIG_IGN);
    const int code = train(ctx, &p, SG_RUN_NEW, &s);
    setrlimit(RLIMIT_FSIZE, &disk.before);
    signal(SIGXFSZ, SIG_DFL);
    assert_int_equal(code, SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "log.jsonl: cannot write"));
    sg_run_summary *summary;
    assert_int_equal(sg_run_summary_read(ctx, p.folder, &summary), SG_OK);
    assert_true(sg_run_summary_number(summary, "iterations") == 24);
    assert_true(sg_run_summary_number(summary, "psnr") > 5);
    sg_run_summary_destroy(&summary);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_resume),           cmocka_unit_test(test_resume_with_all_digits),
        cmocka_unit_test(test_folders),          cmocka_unit_test(test_cancelled_evaluation),
        cmocka_unit_test(test_cancelled_count),  cmocka_unit_test(test_checks),
        cmocka_unit_test(test_attack),           cmocka_unit_test(test_exposure_keys),
        cmocka_unit_test(test_later_model),      cmocka_unit_test(test_before_changes),
        cmocka_unit_test(test_unfinished_proxy), cmocka_unit_test(test_cancelled_attack),
        cmocka_unit_test(test_full_disk),        cmocka_unit_test(test_lost_line),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
