/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <string.h>
#include <sys/resource.h>

#include "attack.h"
#include "attack/poisoned_scene.h"
#include "config.h"
#include "core/context.h"
#include "core/json_text.h"
#include "core/rng.h"
#include "scene/photo.h"

/* The most memory that this process and those before it had. */
static uint64_t peak_rss(struct attack_run *r)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    const uint64_t here = 1024 * (uint64_t) usage.ru_maxrss;
    if (here > r->totals.peak_rss)
        r->totals.peak_rss = here;
    return r->totals.peak_rss;
}

/* Keeps the lines up to the checkpoint. */
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
    r->totals.peak_rss = (uint64_t) json_integer_value(json_object_get(line, "peak_rss_bytes"));
    return true;
}

/* Sets the values of a view in a line. */
static int fill(void *arg, json_t *line, uint64_t view, bool wait, bool *known)
{
    const struct attack_run *r = arg;
    struct sg_attack_step s = {.tv = json_number_value(json_object_get(line, "tv"))};
    const int code = sg_attack_arrived(r->attack, view, wait, &s, known);
    if (code || !*known)
        return code;
    return sg_run_log_set(&r->log, line,
                          json_pack("{s:o,s:o,s:o,s:o,s:o}", "loss", sg_number_json(s.loss), "l1",
                                    sg_number_json(s.l1), "ssim", sg_number_json(s.ssim), "psnr",
                                    sg_number_json(s.psnr), "tv", sg_number_json(s.tv)));
}

int sg_attack_open_log(struct attack_run *r)
{
    return sg_run_log_open(r->ctx, r->params->folder, "attack/log.jsonl", r->resume ? take : NULL,
                           fill, r, &r->log);
}

int sg_attack_log_step(struct attack_run *r)
{
    const struct sg_attack_step *s = &r->step;
    if (r->logged == s->iteration || !s->iteration)
        return 0;
    r->logged = s->iteration;
    json_t *line = json_pack(
        "{s:i,s:I,s:n,s:n,s:n,s:n,s:o,s:I,s:o,s:o,s:o,s:I}", "iteration", s->iteration, "gaussians",
        (json_int_t) s->gaussians, "loss", "l1", "ssim", "psnr", "tv", sg_number_json(s->tv),
        "max_gaussians", (json_int_t) r->totals.max_gaussians, "seconds",
        sg_number_json(r->totals.seconds), "inner_seconds", sg_number_json(r->totals.inner_seconds),
        "inner_bytes", sg_number_json(r->totals.inner_bytes), "peak_rss_bytes",
        (json_int_t) peak_rss(r));
    return sg_run_log_later(&r->log, line, sg_attack_view(r->attack));
}

/* [iteration, Gaussians] of a line of the log. Without memory the curve has a gap. */
static bool add_growth(void *curve, const json_t *line)
{
    json_array_append_new(curve, json_pack("[O,O]", json_object_get(line, "iteration"),
                                           json_object_get(line, "gaussians")));
    return true;
}

static float draw(const struct attack_run *r, uint64_t view)
{
    return sg_rng_uniform(r->params->attack.seed, SG_RNG_POISONED, 0, view);
}

/* Which views are poisoned: round(ratio n) of them, those with the least draws. */
static bool *choose(const struct attack_run *r)
{
    const size_t n = r->scene->n_train,
                 wanted = (size_t) lround((double) r->params->ratio * (double) n);
    bool *chosen = sg_alloc(r->ctx, SG_MEM_MISC, n + 1, sizeof(*chosen));
    for (size_t k = 0; chosen && k < wanted; k++) {
        size_t best = n;
        for (size_t i = 0; i < n; i++)
            if (!chosen[i] && (best == n || draw(r, i) < draw(r, best)))
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
    const struct sg_attack_run_params *p = r->params;
    int error;
    if (p->method == SG_METHOD_POISON_SPLAT)
        error = sg_attack_poison(r->attack, view, rgb);
    else
        error = sg_attack_naive(r->ctx, &r->scene->train[view], view, &r->attack_params,
                                naive[p->method], rgb);
    const struct sg_view *v = &r->scene->train[view];
    const size_t width = (size_t) v->camera.width,
                 spared = (size_t) lroundf(p->spare * (float) width);
    const uint8_t *photo;
    if (error || (error = sg_photo_pixels(r->ctx, v, &photo)))
        return error;
    for (size_t y = 0; y < (size_t) v->camera.height; y++)
        memcpy(rgb + 3 * width * y, photo + 3 * width * y, 3 * spared);
    sg_view_release(v);
    return SG_OK;
}

/* Means and the worst case over the images, for people. */
struct tally {
    size_t poisoned;
    double linf, psnr, before, after;
};

#define MOST_AT_ONCE 16 /* images that are written */

static const struct sg_view *view_at(const struct sg_scene *scene, size_t k)
{
    return k < scene->n_test ? &scene->test[k] : &scene->train[k - scene->n_test];
}

/* An image that is written. */
struct written {
    const struct sg_view *view;
    bool poisoned;
    uint8_t *rgb;         /* the poisoned pixels, or NULL */
    const uint8_t *photo; /* what is written */
    struct sg_poison_report report;
    struct sg_failure failure;
    int code;
};

/* Images whose files are written at once, since most of the time goes into their compression. */
struct batch {
    struct attack_run *run;
    struct written *items;
    size_t count;
};

static void write_one(void *arg, size_t i, int thread)
{
    (void) thread;
    const struct batch *b = arg;
    struct written *w = &b->items[i];
    const struct sg_attack_run_params *p = b->run->params;
    sg_failures_apart(&w->failure);
    w->code = sg_poisoned_scene_image(b->run->ctx, b->run->scene, w->view, &p->files, p->folder,
                                      w->photo, &w->report);
    sg_failures_apart(NULL);
}

/* What is written for view k: of the test views, then of the training views, so that a photo that a
 * scene names in both splits ends as poison. */
static int take_view(struct attack_run *r, size_t k, const bool *chosen, struct written *w)
{
    const size_t tests = r->scene->n_test;
    *w =
        (struct written){.view = view_at(r->scene, k), .poisoned = k >= tests && chosen[k - tests]};
    if (!w->poisoned)
        return sg_photo_pixels(r->ctx, w->view, &w->photo);
    const struct sg_camera *c = &w->view->camera;
    w->rgb = sg_alloc_raw(r->ctx, SG_MEM_FRAME, (size_t) c->height, 3 * (size_t) c->width);
    w->photo = w->rgb;
    return w->rgb ? poison(r, k - tests, w->rgb) : SG_ERR_BUDGET;
}

static void drop_view(struct written *w)
{
    if (!w->poisoned && w->photo)
        sg_view_release(w->view);
    sg_free(w->rgb);
    sg_poison_report_clear(&w->report);
}

static int put_image(struct attack_run *r, const struct written *w, json_t *images, struct tally *t)
{
    const struct sg_poison_report *p = &w->report;
    if (json_array_append_new(
            images,
            json_pack("{s:o,s:o,s:b,s:o,s:o,s:o,s:o}", "name", sg_text_to_json(w->view->name),
                      "file", sg_text_to_json(p->file), "poisoned", w->poisoned, "linf",
                      sg_number_json(p->linf), "psnr", sg_number_json(p->psnr), "tv_before",
                      sg_number_json(p->tv_before), "tv_after", sg_number_json(p->tv_after))))
        return sg_no_memory(r->ctx);
    if (w->poisoned) {
        t->poisoned++;
        t->linf = p->linf > t->linf ? p->linf : t->linf;
        t->psnr += p->psnr, t->before += p->tv_before, t->after += p->tv_after;
    }
    return SG_OK;
}

/* Two views of a scene may name one photo, which is one file of the copy. */
static bool is_in(const struct batch *b, const struct sg_view *view)
{
    for (size_t i = 0; i < b->count; i++)
        if (sg_poisoned_scene_shares_file(b->run->scene, b->items[i].view, view))
            return true;
    return false;
}

/* Takes views from number *k on, as many as there is room for, and writes their images. */
static int write_batch(struct batch *b, size_t room, const bool *chosen, size_t *k, json_t *images,
                       struct tally *t)
{
    struct attack_run *r = b->run;
    const struct sg_scene *scene = r->scene;
    const size_t n = scene->n_train + scene->n_test;
    int error = SG_OK;
    for (b->count = 0; b->count < room && *k < n && !error; ++*k) {
        if (is_in(b, view_at(scene, *k)) || (*k == scene->n_test && b->count))
            break;
        if (sg_attack_ask(r, NULL))
            error = sg_fail(r->ctx, SG_ERR_INTERRUPTED, "interrupted while writing");
        else
            error = take_view(r, *k, chosen, &b->items[b->count++]);
    }
    if (!error)
        sg_parallel_for(r->ctx, b->count, write_one, b);
    for (size_t i = 0; i < b->count; i++) {
        struct written *w = &b->items[i];
        if (!error && w->code)
            error = sg_fail(r->ctx, w->code, "%s", w->failure.text);
        if (!error)
            error = put_image(r, w, images, t);
        drop_view(w);
    }
    return error;
}

static int write_views(struct attack_run *r, const bool *chosen, json_t *images, struct tally *t)
{
    const struct sg_attack_run_params *p = r->params;
    const size_t n = r->scene->n_train + r->scene->n_test;
    const size_t threads = (size_t) sg_ctx_threads(r->ctx);
    /* With a limit of the memory one at a time: its plan has room for no more. */
    const size_t room = sg_mem_limit(r->ctx) ? 1 : threads < MOST_AT_ONCE ? threads : MOST_AT_ONCE;
    struct batch b = {.run = r, .items = sg_alloc(r->ctx, SG_MEM_MISC, room, sizeof(*b.items))};
    int error =
        b.items ? sg_poisoned_scene_begin(r->ctx, r->scene, &p->files, p->folder) : SG_ERR_BUDGET;
    for (size_t k = 0; k < n && !error;)
        error = write_batch(&b, room, chosen, &k, images, t);
    if (!error)
        error = sg_poisoned_scene_finish(r->ctx, r->scene, &p->files, p->folder);
    sg_free(b.items);
    return error;
}

int sg_attack_write(struct attack_run *r)
{
    const struct sg_attack_run_params *p = r->params;
    const struct sg_attack_params *a = &r->attack_params;
    struct tally t = {0};
    json_t *images = json_array();
    bool *chosen = choose(r);
    const int code = chosen ? write_views(r, chosen, images, &t) : SG_ERR_BUDGET;
    sg_free(chosen);
    if (code) {
        json_decref(images);
        return code;
    }
    const double n = t.poisoned ? (double) t.poisoned : NAN; /* of none: null */
    json_t *growth = json_array();
    if (r->attack && sg_run_log_read(r->ctx, r->log.path, add_growth, growth))
        sg_clear_error(r->ctx); /* the curve then has a gap */
    json_t *root =
        json_pack("{s:s,s:o,s:o,s:o}", "version", sg_version(), "options",
                  sg_config_to_json(sg_attack_run_config, p), "images", images, "growth", growth);
    bool whole = true;
#define PUT(key, value) (whole &= !json_object_set_new(root, key, value))
    PUT("epsilon_levels", sg_number_json(round(255 * (double) a->epsilon))); /* null: no bound */
    PUT("poisoned_images", json_integer((json_int_t) t.poisoned));
    PUT("clean_images",
        json_integer((json_int_t) (r->scene->n_train + r->scene->n_test - t.poisoned)));
    PUT("linf_max", sg_number_json(t.poisoned ? t.linf : NAN));
    PUT("psnr_mean", sg_number_json(t.psnr / n));
    PUT("tv_before_mean", sg_number_json(t.before / n));
    PUT("tv_after_mean", sg_number_json(t.after / n));
    if (p->method == SG_METHOD_TV_PER_VIEW)
        PUT("schedule", json_pack("{s:i}", "inner", a->inner));
    if (r->attack) {
        PUT("schedule", json_pack("{s:i,s:i,s:i}", "iterations", a->iterations, "inner", a->inner,
                                  "update-interval", a->update_interval));
        PUT("proxy", sg_text_to_json(r->proxy));
        PUT("proxy_gaussians", json_integer((json_int_t) r->proxy_gaussians));
        PUT("decoy_max_gaussians", json_integer((json_int_t) r->totals.max_gaussians));
        PUT("attack_seconds", sg_number_json(r->totals.seconds));
        PUT("inner_seconds", sg_number_json(r->totals.inner_seconds));
        PUT("inner_gigabytes_per_second",
            sg_number_json(r->totals.inner_seconds > 0
                               ? 1e-9 * r->totals.inner_bytes / r->totals.inner_seconds
                               : 0));
    }
    PUT("peak_rss_bytes", json_integer((json_int_t) peak_rss(r)));
    PUT("threads", json_integer(sg_ctx_threads(r->ctx)));
#undef PUT
    if (!whole) {
        json_decref(root);
        return sg_no_memory(r->ctx);
    }
    if (t.poisoned)
        sg_log(r->ctx, SG_LOG_INFO,
               "%zu poisoned images in %s: largest change %.0f grey levels, PSNR %.2f dB, total "
               "variation %.2f to %.2f",
               t.poisoned, p->folder, t.linf, t.psnr / n, t.before / n, t.after / n);
    else
        sg_log(r->ctx, SG_LOG_INFO, "no poisoned image in %s", p->folder);
    return sg_run_write_json(r->ctx, p->folder, "poison.json", root);
}
