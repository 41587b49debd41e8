/* SPDX-License-Identifier: Apache-2.0 */
#include "core/json_text.h"
#include "train.h"
#include "train/trainer.h"

#define PARTS 4

static const struct {
    const char *name;
    size_t offset;
} parts[PARTS] = {{"anisotropy", offsetof(struct sg_train_times, anisotropy)},
                  {"total_variation", offsetof(struct sg_train_times, total_variation)},
                  {"count", offsetof(struct sg_train_times, count)},
                  {"prune", offsetof(struct sg_train_times, prune)}};

static double *part(struct sg_train_times *t, int k)
{
    return (double *) ((char *) t + parts[k].offset);
}

json_t *sg_run_defense_seconds(const sg_run *r)
{
    struct sg_train_times before = r->totals.parts, here;
    json_t *object = json_object();
    sg_trainer_times(r->trainer, &here);
    for (int k = 0; k < PARTS; k++)
        json_object_set_new(object, parts[k].name,
                            sg_number_json(*part(&before, k) + *part(&here, k)));
    return object;
}

/* defense: the object with what the defense has done. */
static void take_totals(struct run_totals *t, const json_t *line, const json_t *defense,
                        const char *parts_key)
{
    if (!json_object_get(line, "train_seconds"))
        return;
    t->seconds = json_number_value(json_object_get(line, "train_seconds"));
    t->cpu_seconds = json_number_value(json_object_get(line, "cpu_seconds"));
    t->max_gaussians = (uint64_t) json_integer_value(json_object_get(line, "max_gaussians"));
    t->max_instances = (uint64_t) json_integer_value(json_object_get(line, "max_instances"));
    t->filter_events = (uint64_t) json_integer_value(json_object_get(defense, "filter_events"));
    t->filter_removed = (uint64_t) json_integer_value(json_object_get(defense, "filter_removed"));
    for (int k = 0; k < PARTS; k++)
        *part(&t->parts, k) =
            json_number_value(json_object_get(json_object_get(defense, parts_key), parts[k].name));
}

/* Lines up to the checkpoint, of iterations, of the filter and of noise, stay. */
static bool take(void *arg, const json_t *line)
{
    sg_run *r = arg;
    const json_t *iteration = json_object_get(line, "iteration");
    if (!iteration)
        iteration = json_object_get(line, "filter");
    if (!iteration)
        iteration = json_object_get(line, "noise");
    if (!json_is_integer(iteration) ||
        json_integer_value(iteration) > sg_trainer_iteration(r->trainer))
        return false;
    take_totals(&r->totals, line, line, "defense_seconds");
    r->log_instances = r->totals.max_instances;
    if (!r->first_gaussians)
        r->first_gaussians = (size_t) json_integer_value(json_object_get(line, "gaussians"));
    if (json_object_get(line, "train_seconds"))
        r->logged = (int) json_integer_value(iteration);
    if (json_object_get(line, "test_psnr"))
        r->evaluated = (int) json_integer_value(iteration);
    return true;
}

/* Sets the values of a view in a line. */
static int fill(void *arg, json_t *line, uint64_t view, bool wait, bool *known)
{
    sg_run *r = arg;
    struct sg_train_step s;
    uint64_t most;
    const int code = sg_trainer_arrived(r->trainer, view, wait, &s, &most, known);
    if (code || !*known)
        return code;
    if (most > r->log_instances)
        r->log_instances = most;
    if (most > r->totals.max_instances)
        r->totals.max_instances = most;
    json_t *values = json_pack(
        "{s:o,s:o,s:o,s:o,s:I,s:I,s:I,s:I}", "loss", sg_number_json(s.loss), "l1",
        sg_number_json(s.l1), "ssim", sg_number_json(s.ssim), "psnr", sg_number_json(s.psnr),
        "visible", (json_int_t) s.render.visible, "instances", (json_int_t) s.render.instances,
        "max_tile", (json_int_t) s.render.max_tile, "max_instances", (json_int_t) r->log_instances);
    if (r->train.defense.on &&
        (json_object_set_new(values, "anisotropy", sg_number_json(s.defense.anisotropy)) ||
         json_object_set_new(values, "total_variation",
                             sg_number_json(s.defense.total_variation)))) {
        json_decref(values);
        values = NULL;
    }
    return sg_run_log_set(&r->log, line, values);
}

int sg_run_open_log(sg_run *r)
{
    const int code = sg_run_log_open(r->ctx, r->params.folder, "log.jsonl", r->resume ? take : NULL,
                                     fill, r, &r->log);
    /* The line of an iteration that is done again has gone. */
    if (!code && r->resume && sg_trainer_iteration(r->trainer) < r->checkpoint &&
        json_integer_value(json_object_get(r->earlier, "iterations")) == r->checkpoint) {
        take_totals(&r->totals, r->earlier, json_object_get(r->earlier, "defense"), "seconds");
        r->log_instances = r->totals.max_instances;
    }
    return code;
}

/* After a failure nothing more is logged; the training continues. view: of which the line has
 * values, or 0. */
static int write_line(sg_run *r, json_t *line, uint64_t view)
{
    if (r->log_lost) {
        json_decref(line);
        return 0;
    }
    const int code = view ? sg_run_log_later(&r->log, line, view) : sg_run_log_line(&r->log, line);
    r->log_lost = code != 0;
    return code;
}

int sg_run_take_values(sg_run *r)
{
    uint64_t most;
    if (r->measured == r->step.iteration)
        return SG_OK;
    int code = sg_trainer_values(r->trainer, &r->step);
    if (!code)
        code = sg_trainer_most_instances(r->trainer, &most);
    if (code)
        return code;
    if (most > r->totals.max_instances)
        r->totals.max_instances = most;
    r->measured = r->step.iteration;
    return SG_OK;
}

int sg_run_log_step(sg_run *r)
{
    const struct sg_train_step *s = &r->step;
    const struct run_totals *t = &r->totals;
    if (r->logged == s->iteration || !s->iteration)
        return 0;
    r->logged = s->iteration;
    json_t *line =
        json_pack("{s:i,s:n,s:n,s:n,s:n,s:o,s:I,s:I,s:I,s:I,s:n,s:n,s:n,s:I,s:n,s:I,s:o,s:o}",
                  "iteration", s->iteration, "loss", "l1", "ssim", "psnr", "view",
                  sg_text_to_json(r->scene->train[s->view].name), "gaussians",
                  (json_int_t) s->gaussians, "cloned", (json_int_t) r->cloned, "split",
                  (json_int_t) r->split, "pruned", (json_int_t) r->pruned, "visible", "instances",
                  "max_tile", "max_gaussians", (json_int_t) t->max_gaussians, "max_instances",
                  "ledger_bytes", (json_int_t) sg_mem_current(r->ctx, SG_MEM_TAGS), "train_seconds",
                  sg_number_json(t->seconds), "cpu_seconds", sg_number_json(t->cpu_seconds));
    r->cloned = r->split = r->pruned = 0;
    if (r->train.defense.on) {
        json_object_set_new(line, "anisotropy", json_null());
        json_object_set_new(line, "total_variation", json_null());
        json_object_set_new(line, "filter_events", json_integer((json_int_t) t->filter_events));
        json_object_set_new(line, "filter_removed", json_integer((json_int_t) t->filter_removed));
        json_object_set_new(line, "defense_seconds", sg_run_defense_seconds(r));
    }
    return write_line(r, line, sg_trainer_view(r->trainer));
}

int sg_run_settle_log(sg_run *r, bool wait)
{
    const int code = r->log_lost ? SG_OK : sg_run_log_settle(&r->log, wait);
    r->log_lost |= code != 0;
    return code;
}

int sg_run_log_filter(sg_run *r)
{
    const struct sg_defense_step *d = &r->step.defense;
    return write_line(
        r,
        json_pack("{s:i,s:o,s:I,s:I,s:o,s:[o,o,o],s:I}", "filter", r->step.iteration, "rho",
                  sg_number_json(d->rho), "scored", (json_int_t) d->scored, "removed",
                  (json_int_t) d->removed, "unseen_share",
                  sg_number_json(d->scored ? (double) d->unseen / (double) d->scored : 0),
                  "log_score_percentiles", sg_number_json(d->score[0]), sg_number_json(d->score[1]),
                  sg_number_json(d->score[2]), "gaussians", (json_int_t) r->step.gaussians),
        0);
}

int sg_run_log_noise(sg_run *r)
{
    const struct sg_noise *n = &r->step.noise;
    return write_line(r,
                      json_pack("{s:i,s:I,s:I,s:I,s:I,s:o,s:o,s:o,s:o,s:b}", "noise",
                                r->step.iteration, "compared", (json_int_t) n->compared, "photos",
                                (json_int_t) n->photos, "bounded", (json_int_t) n->bounded, "added",
                                (json_int_t) n->added, "level", sg_number_json(n->level), "before",
                                sg_number_json(n->before), "kurtosis", sg_number_json(n->kurtosis),
                                "beyond", sg_number_json(n->beyond), "smooths", n->smooths),
                      0);
}

int sg_run_log_eval(sg_run *r)
{
    json_t *line =
        json_pack("{s:i,s:o,s:o}", "iteration", r->evaluated, "test_psnr",
                  sg_number_json(r->eval.psnr), "test_ssim", sg_number_json(r->eval.ssim));
    if (line && r->corrected_by) {
        json_object_set_new(line, "corrected_psnr", sg_number_json(r->eval.corrected_psnr));
        json_object_set_new(line, "corrected_ssim", sg_number_json(r->eval.corrected_ssim));
    }
    return write_line(r, line, 0);
}
