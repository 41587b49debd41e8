/* SPDX-License-Identifier: Apache-2.0 */
/* An attack from its proxy to its last file. */
#include "attack_run.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "interrupt.h"

/* Scenes of Blender bring test photos of their own, which stay clean; where there are none, nothing
 * is missing. */
int attack_load(struct attack_run *r)
{
    struct attack_config *c = r->config;
    const bool blender = run_has(c->run.source, "transforms_test.json") &&
                         run_has(c->run.source, "transforms_train.json");
    c->run.scene.eval = blender || c->run.views == SG_ATTACK_TRAIN_VIEWS;
    int error = sg_scene_load(r->ctx, c->run.source, &c->run.scene, &r->scene);
    if (error == SG_ERR_INPUT && blender) { /* or their photos are not here */
        c->run.scene.eval = false;
        error = sg_scene_load(r->ctx, c->run.source, &c->run.scene, &r->scene);
    }
    if (!error && c->run.scene.eval && c->run.views == SG_ATTACK_ALL_VIEWS &&
        r->scene->format != SG_FORMAT_BLENDER) {
        c->run.scene.eval =
            false; /* another layout lies in the same folder, and is the one that is read */
        sg_scene_destroy(&r->scene);
        error = sg_scene_load(r->ctx, c->run.source, &c->run.scene, &r->scene);
    }
    return error ? report(r->ctx, error) : 0;
}

/* 3 unless a run's summary says that it took all its iterations. */
static int whole(const char *summary, int iterations)
{
    json_t *s = run_read_json(summary, "summary.json of a run");
    const bool all = json_integer_value(json_object_get(s, "iterations")) == iterations;
    json_decref(s);
    return all ? 0 : 3;
}

/* Trains the proxy as `splatguard train` does, into POISONED/attack/proxy, or goes on with it. */
static int train_proxy(const struct attack_config *c, char **model)
{
    const struct command *train = &command_train;
    struct train_config t;
    struct option_place list[OPTIONS_MAX];
    bool given[OPTIONS_MAX] = {false};
    train->defaults(&t);
    char *folder = run_path(c->run.folder, "attack/proxy"),
         *done = folder ? run_path(folder, "summary.json") : NULL;
    char *begun = folder ? run_path(folder, "checkpoint.bin") : NULL;
    int code = folder && done && begun ? 0 : no_memory();
    if (code || (c->resume && !access(done, F_OK) && access(begun, F_OK)))
        goto done;
    t.run.source = c->run.source;
    t.run.folder = folder;
    t.proxy_of = c->run.folder;
    t.run.train.iterations = c->run.proxy_iterations;
    t.run.train.seed = c->run.attack.seed;
    t.run.train.max_instances = c->run.attack.max_instances;
    t.run.train.cpu = c->run.attack.cpu;
    t.run.train.engine = c->run.attack.engine;
    t.run.scene = c->run.scene;
    t.run.scene.eval = c->run.views == SG_ATTACK_TRAIN_VIEWS;
    t.run.eval_every = 0;
    t.threads = c->threads;
    t.run.max_memory = c->run.max_memory;
    /* a resumed proxy has another limit of its own */
    for (size_t i = options_list(train, list); i-- > 0;)
        given[i] = !strcmp(list[i].row->name, "max-memory");
    t.quiet = c->quiet;
    t.resume = c->resume && !access(begun, F_OK);
    t.force = !t.resume;
    if (!c->quiet)
        say(stderr, "training the proxy\n");
    code = train->run(&t, given, NULL, 0);
    if (!code && (code = whole(done, c->run.proxy_iterations)))
        say(stderr, "splatguard: %s: memory did not suffice for the proxy\n", folder);
    if (!code)
        unlink(begun); /* marks it as whole; its model is what counts */
done:
    *model = code ? NULL : find_model(folder, 0);
    free(folder);
    free(done);
    free(begun);
    return code ? code : *model ? 0 : 2;
}

static int checkpoint(struct attack_run *r)
{
    char *path = run_path(r->config->run.folder, "attack/checkpoint.bin");
    const int code = path ? attack_log_step(r) : no_memory(),
              error = path && !code ? sg_attack_save(r->attack, path) : 0;
    free(path);
    return error ? report(r->ctx, error) : code;
}

static int loop(struct attack_run *r)
{
    const struct attack_config *c = r->config;
    int code = 0, done = sg_attack_iteration(r->attack);
    /* An interrupted attack goes on to where its state is whole. */
    while (!code && done < r->params.iterations &&
           (!interrupted() || done % r->params.update_interval)) {
        const double start = sg_seconds();
        const int error = sg_attack_step(r->attack, &r->step);
        r->totals.seconds += sg_seconds() - start;
        if (error) {
            progress_break(&r->progress);
            return report(r->ctx, error);
        }
        done = r->step.iteration;
        r->totals.inner_seconds += r->step.inner_seconds;
        r->totals.inner_bytes += (double) r->step.inner_bytes;
        if (r->step.gaussians > r->totals.max_gaussians)
            r->totals.max_gaussians = r->step.gaussians;
        progress_step(&r->progress, &(struct sg_train_step){.iteration = done,
                                                            .loss = r->step.loss,
                                                            .psnr = r->step.psnr,
                                                            .gaussians = r->step.gaussians});
        if (done % 100 == 0 || done == 1 || done == r->params.iterations)
            code = attack_log_step(r);
        if (!code && c->run.save_every && done % c->run.save_every == 0 &&
            done % r->params.update_interval == 0 && done < r->params.iterations)
            code = checkpoint(r);
    }
    if (!code && done < r->params.iterations) {
        progress_break(&r->progress);
        code = checkpoint(r);
        if (!code) {
            say(stderr, "interrupted at iteration %d; saved\n", done);
            say_resume("attack", c->run.folder);
        }
        return code ? code : 130;
    }
    return code;
}

static int start_decoy(struct attack_run *r, const char *proxy)
{
    struct sg_model *model = NULL;
    char *saved = run_path(r->config->run.folder, "attack/checkpoint.bin");
    int error = sg_model_read_ply(r->ctx, proxy, UINT32_MAX, &model),
        code = saved ? 0 : no_memory();
    if (!error)
        error = sg_model_check(r->ctx, model, proxy);
    if (!error)
        r->proxy_gaussians = model->count;
    if (!error && !code && r->config->resume && !access(saved, F_OK)) {
        char *state = run_path(r->config->run.folder, "attack");
        if (state)
            run_clean(state);
        free(state);
        sg_model_destroy(&model);
        error = sg_attack_resume(r->ctx, r->scene, saved, &r->params, &r->attack);
    } else if (!error && !code)
        error = sg_attack_create(r->ctx, r->scene, model, &r->params, &r->attack);
    sg_model_destroy(&model);
    free(saved);
    if (error)
        return report(r->ctx, error);
    return code ? code : attack_log_open(r);
}

static int save_decoy(struct attack_run *r)
{
    struct sg_model *decoy = NULL;
    char *path = run_path(r->config->run.folder, "attack/decoy.ply");
    int error = path ? sg_attack_decoy(r->attack, &decoy) : SG_ERR_BUDGET;
    if (!error)
        error = sg_model_write_ply(r->ctx, decoy, path);
    sg_model_destroy(&decoy);
    free(path);
    return error ? report(r->ctx, error) : 0;
}

int attack_whole(struct attack_run *r, const char *proxy)
{
    struct attack_config *c = r->config;
    int code = 0;
    const bool splat = c->run.method == SG_METHOD_POISON_SPLAT;
    char *model = proxy ? strdup(proxy) : NULL;
    if (splat && !model) { /* which loads the scene for itself */
        sg_scene_destroy(&r->scene);
        code = train_proxy(c, &model);
        if (!code)
            code = attack_load(r);
    }
    interrupt_catch();
    r->proxy = model;
    if (!code && splat)
        code = start_decoy(r, model);
    r->lasting = !code;
    if (!code && splat) {
        progress_begin(&r->progress, c->quiet, sg_attack_iteration(r->attack),
                       r->params.iterations);
        code = loop(r);
    }
    const bool ended = !code;
    if (!code && c->run.keep_decoy && splat)
        code = save_decoy(r);
    if (!code && (code = attack_write(r)) == exit_code(SG_ERR_INTERRUPTED))
        say(stderr, "interrupted while writing\n");
    /* What cannot be written must not cost the attack. */
    if (code && ended && (!splat || !checkpoint(r)))
        say_resume("attack", c->run.folder);
    if (!code) {
        char *saved = run_path(c->run.folder, "attack/checkpoint.bin");
        if (saved)
            unlink(saved);
        free(saved);
    }
    free(model);
    return code;
}
