/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "attack_run.h"
#include "interrupt.h"
#include "core/json_text.h"
#include "run/config.h"
#include "run_log.h"

/* Lines up to the checkpoint stay. */
static bool take(void *arg, const json_t *line)
{
    struct attack_run *r = arg;
    const json_t *iteration = json_object_get(line, "iteration");
    if (!json_is_integer(iteration) ||
        json_integer_value(iteration) > sg_attack_iteration(r->attack))
        return false;
    r->logged = (int) json_integer_value(iteration);
    r->totals.seconds = json_number_value(json_object_get(line, "seconds"));
    r->totals.inner_seconds = json_number_value(json_object_get(line, "inner_seconds"));
    r->totals.inner_bytes = json_number_value(json_object_get(line, "inner_bytes"));
    r->totals.max_gaussians = (uint64_t) json_integer_value(json_object_get(line, "max_gaussians"));
    return true;
}

int attack_log_open(struct attack_run *r)
{
    r->log_path = run_path(r->config->run.folder, "attack/log.jsonl");
    return r->log_path ? run_log_open(r->log_path, r->config->resume ? take : NULL, r, &r->log)
                       : no_memory();
}

int attack_log_step(struct attack_run *r)
{
    const struct sg_attack_step *s = &r->step;
    if (r->logged == s->iteration || !s->iteration)
        return 0;
    r->logged = s->iteration;
    json_t *line = json_pack(
        "{s:i,s:I,s:o,s:o,s:o,s:o,s:o,s:I,s:o,s:o,s:o}", "iteration", s->iteration, "gaussians",
        (json_int_t) s->gaussians, "loss", number_json(s->loss), "l1", number_json(s->l1), "ssim",
        number_json(s->ssim), "psnr", number_json(s->psnr), "tv", number_json(s->tv),
        "max_gaussians", (json_int_t) r->totals.max_gaussians, "seconds",
        number_json(r->totals.seconds), "inner_seconds", number_json(r->totals.inner_seconds),
        "inner_bytes", number_json(r->totals.inner_bytes));
    return run_log_line(r->log, r->log_path, line);
}

/* [iteration, Gaussians] of a line of the log. */
static bool add_growth(void *curve, const json_t *line)
{
    json_array_append_new(curve, json_pack("[O,O]", json_object_get(line, "iteration"),
                                           json_object_get(line, "gaussians")));
    return true;
}

/* Which views are poisoned: round(ratio n) of them, those with the least draws. */
static bool *choose(const struct attack_run *r)
{
    const size_t n = r->scene->n_train,
                 wanted = (size_t) lround((double) r->config->run.ratio * (double) n);
    bool *chosen = calloc(n ? n : 1, sizeof(*chosen));
    for (size_t k = 0; chosen && k < wanted; k++) {
        size_t best = n;
        for (size_t i = 0; i < n; i++)
            if (!chosen[i] && (best == n || sg_attack_draw(r->params.seed, i) <
                                                sg_attack_draw(r->params.seed, best)))
                best = i;
        chosen[best] = true;
    }
    return chosen;
}

static int poison(struct attack_run *r, size_t view, uint8_t *rgb)
{
    static const enum sg_naive_attack naive[] = {[SG_METHOD_NOISE] = SG_NAIVE_NOISE,
                                                 [SG_METHOD_TV_PER_VIEW] = SG_NAIVE_TV,
                                                 [SG_METHOD_DRIFT] = SG_NAIVE_DRIFT};
    const struct attack_config *c = r->config;
    int error;
    if (c->run.method == SG_METHOD_POISON_SPLAT)
        error = sg_attack_poison(r->attack, view, rgb);
    else
        error = sg_attack_naive(r->ctx, &r->scene->train[view], view, &r->params,
                                naive[c->run.method], rgb);
    const struct sg_view *v = &r->scene->train[view];
    const size_t width = (size_t) v->camera.width,
                 spared = (size_t) lroundf(c->run.spare * (float) width);
    for (size_t y = 0; y < (size_t) v->camera.height && !error; y++)
        memcpy(rgb + 3 * width * y, v->rgb + 3 * width * y, 3 * spared);
    return error;
}

/* Means and the worst case over the images, for people. */
struct tally {
    size_t poisoned;
    double linf, psnr, before, after;
};

static int write_views(struct attack_run *r, const bool *chosen, json_t *images, struct tally *t)
{
    const struct attack_config *c = r->config;
    const struct sg_scene *scene = r->scene;
    int error = sg_poisoned_scene_begin(r->ctx, scene, &c->run.files, c->run.folder);
    /* The training views last: should a scene name a photo in both splits, its poison stands. */
    for (size_t k = 0; k < scene->n_train + scene->n_test && !error; k++) {
        const bool train = k >= scene->n_test;
        const size_t i = train ? k - scene->n_test : k;
        if (interrupted())
            return SG_ERR_INTERRUPTED;
        const struct sg_view *view = train ? &scene->train[i] : &scene->test[i];
        struct sg_poison_report p = {0};
        uint8_t *rgb = malloc(3 * (size_t) view->camera.width * (size_t) view->camera.height);
        if (!rgb)
            return SG_ERR_BUDGET;
        if (train && chosen[i])
            error = poison(r, i, rgb);
        if (!error)
            error = sg_poisoned_scene_image(r->ctx, scene, view, &c->run.files, c->run.folder,
                                            train && chosen[i] ? rgb : view->rgb, &p);
        free(rgb);
        if (!error)
            json_array_append_new(
                images,
                json_pack("{s:o,s:o,s:b,s:o,s:o,s:o,s:o}", "name", sg_text_to_json(view->name),
                          "file", sg_text_to_json(p.file), "poisoned", train && chosen[i], "linf",
                          number_json(p.linf), "psnr", number_json(p.psnr), "tv_before",
                          number_json(p.tv_before), "tv_after", number_json(p.tv_after)));
        if (!error && train && chosen[i]) {
            t->poisoned++;
            t->linf = p.linf > t->linf ? p.linf : t->linf;
            t->psnr += p.psnr, t->before += p.tv_before, t->after += p.tv_after;
        }
        sg_poison_report_clear(&p);
    }
    return error;
}

int attack_write(struct attack_run *r)
{
    const struct attack_config *c = r->config;
    struct tally t = {0};
    json_t *images = json_array();
    bool *chosen = choose(r);
    char *path = run_path(c->run.folder, "poison.json");
    int code = chosen && path ? 0 : no_memory();
    const int error = code ? 0 : write_views(r, chosen, images, &t);
    if (error)
        code = error == SG_ERR_INTERRUPTED ? exit_code(error) : report(r->ctx, error);
    if (!code) {
        struct rusage usage;
        getrusage(RUSAGE_SELF, &usage);
        const double n = t.poisoned ? (double) t.poisoned : 1;
        json_t *growth = json_array();
        if (r->attack)
            run_log_read(r->log_path, add_growth, growth);
        json_t *root = json_pack("{s:s,s:o,s:o,s:o}", "version", sg_version(), "options",
                                 sg_config_to_json(sg_attack_run_config, &c->run), "images", images,
                                 "growth", growth);
        images = NULL;
#define PUT(key, value) json_object_set_new(root, key, value)
        PUT("epsilon_levels",
            number_json(round(255 * (double) r->params.epsilon))); /* null: no bound */
        PUT("poisoned_images", json_integer((json_int_t) t.poisoned));
        PUT("clean_images",
            json_integer((json_int_t) (r->scene->n_train + r->scene->n_test - t.poisoned)));
        PUT("linf_max", number_json(t.linf));
        PUT("psnr_mean", number_json(t.psnr / n));
        PUT("tv_before_mean", number_json(t.before / n));
        PUT("tv_after_mean", number_json(t.after / n));
        if (c->run.method == SG_METHOD_TV_PER_VIEW)
            PUT("schedule", json_pack("{s:i}", "inner", r->params.inner));
        if (r->attack) {
            PUT("schedule",
                json_pack("{s:i,s:i,s:i}", "iterations", r->params.iterations, "inner",
                          r->params.inner, "update-interval", r->params.update_interval));
            PUT("proxy", sg_text_to_json(r->proxy));
            PUT("proxy_gaussians", json_integer((json_int_t) r->proxy_gaussians));
            PUT("decoy_max_gaussians", json_integer((json_int_t) r->totals.max_gaussians));
            PUT("attack_seconds", number_json(r->totals.seconds));
            PUT("inner_seconds", number_json(r->totals.inner_seconds));
            PUT("inner_gigabytes_per_second",
                number_json(r->totals.inner_seconds > 0
                                ? 1e-9 * r->totals.inner_bytes / r->totals.inner_seconds
                                : 0));
        }
        PUT("peak_rss_bytes", json_integer((json_int_t) usage.ru_maxrss * 1024));
        PUT("threads", json_integer(sg_ctx_threads(r->ctx)));
#undef PUT
        code = run_write_json(path, root);
        json_decref(root);
        if (!code && !c->quiet)
            say(stderr,
                "%zu poisoned images in %s: largest change %.0f grey levels, PSNR %.2f dB, total "
                "variation %.2f to %.2f\n",
                t.poisoned, c->run.folder, t.linf, t.psnr / n, t.before / n, t.after / n);
    }
    json_decref(images);
    free(chosen);
    free(path);
    return code;
}
