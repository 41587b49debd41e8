/* SPDX-License-Identifier: Apache-2.0 */
/* The commands of a job, by its kind and phase. */
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "bench_work.h"

__attribute__((format(printf, 2, 3))) static void add(struct command_line *c, const char *format,
                                                      ...)
{
    va_list args;
    va_start(args, format);
    if (c->n < COMMAND_WORDS - 1 && vasprintf(&c->words[c->n], format, args) >= 0)
        c->n++;
    va_end(args);
    c->words[c->n] = NULL;
}

/* {clean*0.5} becomes half of the clean run's Gaussians. */
static void add_option(const struct scheduler *s, struct command_line *c, const struct job *j,
                       const char *text)
{
    double factor;
    if (!plan_limit(text, &factor)) {
        add(c, "%s", text);
        return;
    }
    const char *clean = s->b->plan->jobs[j->needs[j->n_needs - 1]].key;
    const double n = store_metric(s->b->store, clean, "final_gaussians");
    if (!(n >= 0)) { /* which the command refuses */
        add(c, "%s", text);
        return;
    }
    add(c, "%.0f", n * factor > 4 ? floor(n * factor) : 4);
}

static void add_options(const struct scheduler *s, struct command_line *c, const struct job *j,
                        const json_t *options)
{
    for (size_t i = 0; i < json_array_size(options); i++)
        add_option(s, c, j, json_string_value(json_array_get(options, i)));
}

static const json_t *options_of(const struct job *j)
{
    return json_object_get(j->config, "options");
}

/* Where the photos of a scene or poison are. */
static void add_source(const struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    const char *path = json_string_value(json_object_get(j->config, "path")),
               *layout = json_string_value(json_object_get(j->from, "layout"));
    if (j->kind == JOB_POISON)
        add(c, "%s/scene", s->work[index].folder);
    else if (path)
        add(c, "%s", path);
    else
        add(c, "%s/scene/%s", s->work[index].folder, layout ? layout : "blender");
}

static bool has_word(const json_t *options, const char *word)
{
    return options_place(options, word) < json_array_size(options);
}

/* Options of a run's scene that its folder does not keep: they are given anew to each command. */
static void add_transient(struct command_line *c, const struct job *run, const json_t *given)
{
    char word[64];
    for (const struct sg_option *row = sg_scene_options(); row->name; row++) {
        snprintf(word, sizeof(word), "--%s", row->name);
        if (row->transient && has_word(options_of(run), word) && !has_word(given, word))
            add(c, "%s", word);
    }
}

/* Options of the scene that a run was given. Its folder brings them to other commands; the file of
 * a pruned model does not. */
static json_t *run_scene_options(const struct job *run)
{
    const json_t *options = options_of(run);
    json_t *of_scene = json_array();
    for (size_t i = 0; i < json_array_size(options); i++) {
        const char *word = json_string_value(json_array_get(options, i));
        const struct sg_option *row = sg_scene_options();
        while (row->name && (strncmp(word, "--", 2) || strcmp(word + 2, row->name)))
            row++;
        if (!row->name || row->transient || strcmp(row->group, "Scene"))
            continue;
        json_array_append(of_scene, json_array_get(options, i));
        if (row->type != SG_OPTION_FLAG)
            json_array_append(of_scene, json_array_get(options, i + 1));
    }
    return of_scene;
}

/* Of a pruned model: its run's. */
static json_t *pruned_scene_options(const struct plan *p, const struct job *j)
{
    return j->kind == JOB_PRUNE ? run_scene_options(&p->jobs[j->needs[1]]) : json_array();
}

/* The same photos for all: the clean scene's test views. model: in the job's folder. */
static void add_eval(const struct scheduler *s, struct command_line *c, int index,
                     const char *model)
{
    const struct plan *p = s->b->plan;
    const struct job *j = &p->jobs[index];
    add(c, "eval"), add(c, "%s/%s", s->work[index].folder, model);
    add(c, "--json"), add(c, "--per-view");
    add(c, "--quiet"), add(c, "--threads"), add(c, "%d", p->threads), add(c, "--scene");
    add_source(s, c, j->needs[0]);
    json_t *engine = p->engine ? json_pack("[s, s]", "--engine", p->engine) : NULL;
    json_t *run = pruned_scene_options(p, j);
    const json_t *const lists[] = {engine, json_object_get(j->from, "size"),
                                   json_object_get(j->from, "options"), run};
    json_t *options = options_merge(lists, 4);
    json_decref(engine);
    json_decref(run);
    add_options(s, c, j, options);
    json_decref(options);
}

/* Begins a command that writes a folder of its job's, or goes on with it: where the scene is now,
 * since the folder of work may have moved. Returns whether the rest of the command is left to add.
 */
static bool add_begin(const struct scheduler *s, struct command_line *c, int index,
                      const char *command, int source, const char *folder)
{
    const bool saved = job_has_checkpoint(s, index);
    add(c, "%s", command);
    if (saved)
        add(c, "--resume"), add(c, "%s/%s", s->work[index].folder, folder), add(c, "-s");
    add_source(s, c, source);
    if (saved)
        add_transient(c, &s->b->plan->jobs[index], NULL);
    else
        add(c, "-o"), add(c, "%s/%s", s->work[index].folder, folder);
    return !saved;
}

static void add_train(const struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    if (!add_begin(s, c, index, "train", j->kind == JOB_PROXY ? j->needs[0] : j->needs[1], "run"))
        return;
    add(c, "--seed"), add(c, "%d", j->seed);
    if (j->kind == JOB_TRAIN)
        add(c, "--eval");
    add_options(s, c, j, options_of(j));
}

static void add_attack(const struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    const bool begins = add_begin(s, c, index, "attack", j->needs[0], "scene");
    if (j->n_needs > 1)
        add(c, "--proxy"), add(c, "%s/run", s->work[j->needs[1]].folder);
    if (begins)
        add_options(s, c, j, options_of(j));
}

static void add_prune(const struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    const struct job *run = &s->b->plan->jobs[j->needs[1]];
    add(c, "prune"), add(c, "%s/run", s->work[j->needs[1]].folder), add(c, "--json");
    add(c, "--scene"), add_source(s, c, run->needs[1]);
    add_transient(c, run, options_of(j));
    add(c, "-o"), add(c, "%s/model.ply", s->work[index].folder);
    add(c, "--seed"), add(c, "%d", j->seed);
    add_options(s, c, j, options_of(j));
}

/* The model from the cameras of its own training photos, and these photos. */
static void add_render(const struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    const struct job *of = &s->b->plan->jobs[j->needs[1]];
    const bool run = of->kind == JOB_TRAIN;
    json_t *brought = pruned_scene_options(s->b->plan, of);
    const json_t *const lists[] = {options_of(j), brought};
    json_t *options = options_merge(lists, 2);
    add(c, "render"), add(c, "%s/%s", s->work[j->needs[1]].folder, run ? "run" : "model.ply");
    add(c, "--scene"), add_source(s, c, j->needs[2]);
    add(c, "-o"), add(c, "%s/views", s->work[index].folder);
    add(c, "--split"), add(c, "train"), add(c, "--photo");
    add_options(s, c, j, options);
    json_decref(brought);
    json_decref(options);
}

/* Photos as training sees them: without the test views. */
static void add_audit(const struct scheduler *s, struct command_line *c, int index)
{
    const struct job *j = &s->b->plan->jobs[index];
    add(c, "audit"), add_source(s, c, j->needs[0]), add(c, "--json"), add(c, "--eval");
    add_options(s, c, j, options_of(j));
}

void command_clear(struct command_line *c)
{
    for (int i = 0; i < c->n; i++)
        free(c->words[i]);
    c->n = 0;
}

bool command_make(const struct scheduler *s, int index, struct command_line *c)
{
    const struct plan *p = s->b->plan;
    const struct job *j = &p->jobs[index];
    const struct work *w = &s->work[index];
    const json_t *synth = json_object_get(j->config, "synth");
    const bool measured = j->kind == JOB_TRAIN || j->kind == JOB_PRUNE;
    c->n = 0;
    add(c, "splatguard");
    if (w->phase == 1 && measured)
        add_eval(s, c, index, j->kind == JOB_TRAIN ? "run" : "model.ply");
    else if (w->phase == 0 && j->kind == JOB_SCENE && synth) {
        add(c, "synth"), add(c, "-o"), add(c, "%s/scene", w->folder);
        add_options(s, c, j, synth);
    } else if (w->phase == 0 && j->kind != JOB_SCENE)
        (j->kind == JOB_POISON     ? add_attack
         : j->kind == JOB_PRUNE    ? add_prune
         : j->kind == JOB_PICTURES ? add_render
         : j->kind == JOB_AUDIT    ? add_audit
                                   : add_train)(s, c, index);
    else {
        command_clear(c);
        return false;
    }
    if (w->phase == 0)
        add(c, "--quiet"), add(c, "--threads"), add(c, "%d", p->threads);
    return true;
}
