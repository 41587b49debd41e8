/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "train_run.h"

static int cannot(const struct train_run *r, const char *what)
{
    say(stderr, "splatguard: %s/log.jsonl: cannot %s: %s\n", r->config->output, what, strerror(errno ? errno : EIO));
    return 2;
}

static void take_totals(struct train_totals *t, const json_t *line)
{
    if (!json_object_get(line, "train_seconds"))
        return;
    t->seconds = json_number_value(json_object_get(line, "train_seconds"));
    t->cpu_seconds = json_number_value(json_object_get(line, "cpu_seconds"));
    t->max_gaussians = (uint64_t) json_integer_value(json_object_get(line, "max_gaussians"));
    t->max_instances = (uint64_t) json_integer_value(json_object_get(line, "max_instances"));
    t->filter_events = (uint64_t) json_integer_value(json_object_get(line, "filter_events"));
    t->filter_removed = (uint64_t) json_integer_value(json_object_get(line, "filter_removed"));
}

/* A killed run may have logged beyond its checkpoint: those iterations will be done and logged again. */
static int trim(struct train_run *r, const char *path)
{
    FILE *in = run_open(path, LOG_BYTES);
    if (!in)
        return errno == ENOENT ? 0 : cannot(r, "read");
    char *kept = NULL, *line = NULL;
    size_t size = 0, room = 0;
    const int done = sg_trainer_iteration(r->trainer);
    FILE *out = open_memstream(&kept, &size);
    for (ssize_t n; out && (n = getline(&line, &room, in)) > 0;) {
        json_t *value = n > LOG_LINE_BYTES ? NULL : json_loads(line, 0, NULL);
        const json_t *iteration = json_object_get(value, "iteration");
        if (!iteration)
            iteration = json_object_get(value, "filter");
        if (json_is_integer(iteration) && json_integer_value(iteration) <= done) {
            fputs(line, out);
            take_totals(&r->totals, value);
            if (json_object_get(value, "train_seconds"))
                r->logged = (int) json_integer_value(iteration);
        }
        json_decref(value);
    }
    fclose(in);
    free(line);
    if (!out || fclose(out))
        return 4;
    const int code = run_write_file(path, kept, size);
    free(kept);
    return code;
}

int train_log_open(struct train_run *r)
{
    char *path = run_path(r->config->output, "log.jsonl");
    int code = !path ? 4 : r->config->resume ? trim(r, path) : 0;
    if (!code && !(r->log = run_open_log(path, r->config->resume)))
        code = cannot(r, "write");
    free(path);
    return code;
}

static int write_line(struct train_run *r, json_t *line)
{
    char *text = json_dumps(line, JSON_COMPACT | JSON_REAL_PRECISION(8));
    errno = 0;
    const bool bad = !text || fprintf(r->log, "%s\n", text) < 0 || fflush(r->log);
    free(text);
    json_decref(line);
    return bad ? cannot(r, "write") : 0;
}

int train_log_step(struct train_run *r)
{
    const struct sg_train_step *s = &r->step;
    const struct train_totals *t = &r->totals;
    if (r->logged == s->iteration || !s->iteration)
        return 0;
    r->logged = s->iteration;
    json_t *line =
        json_pack("{s:i,s:o,s:o,s:o,s:o,s:o,s:I,s:I,s:I,s:I,s:I,s:I,s:I,s:I,s:I,s:o,s:o}", "iteration", s->iteration,
                  "loss", number_json(s->loss), "l1", number_json(s->l1), "ssim", number_json(s->ssim), "psnr",
                  number_json(s->psnr), "view", text_json(r->scene->train[s->view].name), "gaussians",
                  (json_int_t) s->gaussians, "cloned", (json_int_t) r->cloned, "split", (json_int_t) r->split, "pruned",
                  (json_int_t) r->pruned, "visible", (json_int_t) s->render.visible, "instances",
                  (json_int_t) s->render.instances, "max_tile", (json_int_t) s->render.max_tile, "max_gaussians",
                  (json_int_t) t->max_gaussians, "max_instances", (json_int_t) t->max_instances, "train_seconds",
                  number_json(t->seconds), "cpu_seconds", number_json(t->cpu_seconds));
    r->cloned = r->split = r->pruned = 0;
    if (r->config->train.defense.on) {
        json_object_set_new(line, "anisotropy", number_json(s->defense.anisotropy));
        json_object_set_new(line, "total_variation", number_json(s->defense.total_variation));
        json_object_set_new(line, "filter_events", json_integer((json_int_t) t->filter_events));
        json_object_set_new(line, "filter_removed", json_integer((json_int_t) t->filter_removed));
    }
    return write_line(r, line);
}

int train_log_filter(struct train_run *r)
{
    const struct sg_defense_step *d = &r->step.defense;
    return write_line(r, json_pack("{s:i,s:o,s:I,s:I,s:o,s:[o,o,o],s:I}", "filter", r->step.iteration, "rho",
                                   number_json(d->rho), "scored", (json_int_t) d->scored, "removed",
                                   (json_int_t) d->removed, "unseen_share",
                                   number_json(d->scored ? (double) d->unseen / (double) d->scored : 0),
                                   "log_score_percentiles", number_json(d->score[0]), number_json(d->score[1]),
                                   number_json(d->score[2]), "gaussians", (json_int_t) r->step.gaussians));
}

int train_log_eval(struct train_run *r)
{
    return write_line(r, json_pack("{s:i,s:o,s:o}", "iteration", r->evaluated, "test_psnr", number_json(r->eval.psnr),
                                   "test_ssim", number_json(r->eval.ssim)));
}
