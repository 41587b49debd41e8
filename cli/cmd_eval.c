/* SPDX-License-Identifier: Apache-2.0 */
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "interrupt.h"
#include "model_views.h"

struct eval_config {
    struct model_options m;
    bool json, per_view, match_colours, exposure;
};

static const struct sg_option eval_options[] = {
    MODEL_ROWS(struct eval_config),
    FLAG_ROW("json", offsetof(struct eval_config, json), "Print one JSON object.",
             .group = "Output"),
    FLAG_ROW("per-view", offsetof(struct eval_config, per_view), "Print each view's values too.",
             .group = "Output"),
    FLAG_ROW("match-colours", offsetof(struct eval_config, match_colours),
             "Measure also after matching the colours of each render to its photo's, as usual "
             "where exposures differ: each channel by a factor and an offset.",
             .group = "Output"),
    FLAG_ROW(
        "exposure", offsetof(struct eval_config, exposure),
        "Measure also with the exposure that the run has learned of each photo, for its newest "
        "model: of training photos, and with --test-halves of test photos.",
        .group = "Output"),
    {0},
};

static const struct option_part eval_parts[] = MODEL_PARTS(struct eval_config);

static void defaults(void *config)
{
    *(struct eval_config *) config = (struct eval_config){.m = model_options_default()};
}

static int print_json(const struct eval_config *c, const struct model_views *v,
                      const struct sg_eval *e)
{
    json_t *root =
        json_pack("{s:f,s:f,s:f,s:i,s:I}", "psnr", e->psnr, "ssim", e->ssim, "fps", e->fps, "views",
                  (int) e->views, "gaussians", (json_int_t) sg_model_gaussians(v->model));
    const char *corrected_by = sg_eval_corrected_by(&v->eval);
    if (corrected_by) {
        json_object_set_new(root, "corrected_by", json_string(corrected_by));
        json_object_set_new(root, "corrected_psnr", number_json(e->corrected_psnr));
        json_object_set_new(root, "corrected_ssim", number_json(e->corrected_ssim));
    }
    json_t *list = c->per_view ? json_array() : NULL;
    for (size_t i = 0; list && i < e->views; i++) {
        const struct sg_view_score *score = &e->per_view[i];
        json_t *view = json_pack("{s:o,s:o,s:o}", "name", text_json(v->views[i].name), "psnr",
                                 number_json(score->psnr), "ssim", number_json(score->ssim));
        if (corrected_by) {
            json_object_set_new(view, "corrected_psnr", number_json(score->corrected_psnr));
            json_object_set_new(view, "corrected_ssim", number_json(score->corrected_ssim));
        }
        json_array_append_new(list, view);
    }
    if (list)
        json_object_set_new(root, "per_view", list);
    return json_print(root, 0);
}

static int refuse(const char *found, const char *expected)
{
    say(stderr, "splatguard eval: --exposure: found %s, expected %s\n", found, expected);
    return STATUS_USAGE;
}

/* The exposures of the training photos, from the run's exposure.json, which is of its newest model.
 */
static int read_exposures(struct model_views *v, const char *run, int iteration)
{
    char file[PATH_MAX], asked[PATH_MAX], newest[PATH_MAX];
    const size_t n = v->scene->n_train;
    if (!is_folder(run))
        return refuse("the file of a model", "a run's folder");
    snprintf(file, sizeof(file), "%s/exposure.json", run);
    if (access(file, F_OK))
        return refuse("a run that has learned none", "one of train --exposure");
    int error = sg_run_find_model(v->ctx, run, iteration, asked, sizeof(asked));
    if (!error)
        error = sg_run_find_model(v->ctx, run, 0, newest, sizeof(newest));
    if (!error && strcmp(asked, newest) != 0)
        return refuse("--iteration", "the newest model, whose exposures are in exposure.json");
    for (size_t i = 0; i < v->n; i++)
        if (v->photos[i] == SIZE_MAX)
            return refuse("test photos whose exposures are not learned",
                          "--split train, or a run with --test-halves");
    v->exposures = malloc((n + 1) * 12 * sizeof(*v->exposures));
    if (!v->exposures)
        return no_memory();
    v->eval.exposures = v->exposures;
    return report(v->ctx,
                  error ? error
                        : sg_run_read_exposures(v->ctx, run, v->scene->train, n, v->exposures));
}

static int run_eval(const void *config, const bool *given, const char *const *positional, int count)
{
    (void) count;
    struct eval_config copy = *(const struct eval_config *) config, *c = &copy;
    struct model_views v;
    struct sg_eval e = {0};
    if (c->match_colours && c->exposure) {
        say(stderr,
            "splatguard eval: found --match-colours and --exposure, expected one of them\n");
        return STATUS_USAGE;
    }
    model_views_warn(&c->m);
    interrupt_catch();
    int code = model_views_open(&v, positional[0], &command_eval, given, c, &c->m);
    if (!code && c->exposure)
        code = read_exposures(&v, positional[0], c->m.iteration);
    if (!code) {
        v.eval.fps = true, v.eval.match_colours = c->match_colours;
        const int error = sg_evaluate(v.ctx, v.renderer, v.views, v.n, &v.eval, &e);
        if (error)
            code = report(v.ctx, error);
        else if (c->json)
            code = print_json(c, &v, &e);
        else {
            for (size_t i = 0; c->per_view && i < e.views; i++) {
                make_printable(v.views[i].name); /* a line end in it too */
                if (isnan(e.per_view[i].psnr))
                    printf("%-32s not measured: its mask hides all of it\n", v.views[i].name);
                else
                    printf("%-32s PSNR %7.3f  SSIM %.4f\n", v.views[i].name, e.per_view[i].psnr,
                           e.per_view[i].ssim);
            }
            printf("PSNR %.3f  SSIM %.4f  FPS %.1f (mean %.1f)  %zu view%s  %zu Gaussians\n",
                   e.psnr, e.ssim, e.fps, e.fps_mean, e.views, e.views == 1 ? "" : "s",
                   (size_t) sg_model_gaussians(v.model));
            if (sg_eval_corrected_by(&v.eval))
                printf("with %s: PSNR %.3f  SSIM %.4f\n",
                       v.eval.exposures ? "exposures" : "matched colours", e.corrected_psnr,
                       e.corrected_ssim);
        }
        sg_eval_clear(&e);
    }
    model_views_close(&v);
    return code;
}

const struct command command_eval = {
    .name = "eval",
    .arguments = "RUN|MODEL --scene SCENE [options]",
    .summary = "Measures PSNR, SSIM and rendering speed.",
    .description = "Renders the views of SCENE and compares them with the photos, clamped and "
                   "rounded to 8 bits. A run's folder brings its own scene options.",
    .groups = "Output|" MODEL_GROUPS,
    .options = eval_options,
    .parts = eval_parts,
    .config_size = sizeof(struct eval_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_eval,
};
