/* SPDX-License-Identifier: Apache-2.0 */
/* An attack from its parameters to its last file. */
#include "attack.h"

#include <limits.h>
#include <string.h>
#include <unistd.h>

#include "attack/poisoned_scene.h"
#include "config.h"
#include "core/clock.h"
#include "core/file.h"
#include "folder.h"
#include "model/anchors.h"
#include "option/option.h"
#include "splatguard/format.h"
#include "train.h"
#include "train/schedule.h"

void sg_attack_run_params_clear(struct sg_attack_run_params *p)
{
    json_decref(p->texts);
    p->texts = NULL;
}

int sg_attack_run_read_params(sg_ctx *ctx, const char *folder, struct sg_attack_run_params *out)
{
    json_t *root;
    sg_clear_error(ctx);
    *out = sg_attack_run_params_default();
    out->folder = folder;
    int code =
        sg_run_read_json(ctx, folder, "attack/config.json", "config.json of an attack", &root);
    if (code)
        return code;
    out->texts = root;
    char *path = sg_strf(ctx, "%s/attack/config.json", folder);
    code = path ? sg_config_from_json(ctx, sg_attack_run_config, out,
                                      json_object_get(root, "options"), true, path)
                : SG_ERR_BUDGET;
    sg_free(path);
    return code;
}

bool sg_attack_ask(struct attack_run *r, const struct sg_attack_step *step)
{
    if (r->params->step && r->params->step(r->params->step_priv, step))
        r->stopped = true;
    return r->stopped;
}

static int load_scene(struct attack_run *r)
{
    struct sg_scene_params s = r->params->scene;
    s.eval = r->params->views == SG_ATTACK_TRAIN_VIEWS;
    return sg_poisoned_scene_load(r->ctx, r->params->source, &s, &r->scene);
}

/* The published schedule where the parameters leave it to the preset. */
static void apply_preset(struct attack_run *r)
{
    static const char *const names[] = {"auto", "ns", "mip", "tt"};
    struct sg_attack_params *p = &r->attack_params;
    *p = r->params->attack;
    if (r->params->method == SG_METHOD_TV_PER_VIEW && p->inner == SG_ATTACK_BY_PRESET)
        p->inner = 100;
    sg_attack_complete(names[r->params->preset], r->scene->format, p);
    r->status->iterations = p->iterations;
}

static void remove_file(sg_ctx *ctx, const char *folder, const char *name)
{
    char *path = sg_strf(ctx, "%s/%s", folder, name);
    if (path)
        unlink(path);
    sg_free(path);
}

/* The config.json of a finished attack that is replaced. While it is there, all but FOLDER/attack
 * belongs to that attack. */
#define EARLIER "attack/earlier.json"

/* A proxy is trained first, which can fail: the earlier attack stays until that is done. */
static int keep_earlier(struct attack_run *r)
{
    json_t *config = NULL;
    const char *folder = r->params->folder;
    sg_run_read_json(r->ctx, folder, "attack/config.json", "config.json of an attack", &config);
    sg_clear_error(r->ctx); /* one that cannot be read is of no use later */
    return sg_run_write_json(r->ctx, folder, EARLIER, config ? config : json_object());
}

/* Until this attack ends, the images of an earlier one must not be taken for its own. */
static int remove_earlier(struct attack_run *r)
{
    static const char *const files[] = {"poison.json", "attack/log.jsonl", "attack/decoy.ply",
                                        "attack/networks.safetensors", EARLIER};
    const struct sg_attack_run_params *p = r->params;
    const int code = sg_poisoned_scene_begin(r->ctx, r->scene, &p->files, p->folder);
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]) && !code; i++)
        remove_file(r->ctx, p->folder, files[i]);
    return code;
}

/* Whether all iterations of the proxy are done, by the summary of its run. */
static bool has_proxy(sg_ctx *ctx, const char *folder)
{
    json_t *s = NULL;
    const char name[] = "attack/proxy/summary.json";
    if (sg_run_has(ctx, folder, name))
        sg_run_read_json(ctx, folder, name, "summary.json of a run", &s);
    sg_clear_error(ctx); /* without a summary that can be read it is not done */
    const bool done = json_is_false(json_object_get(s, "interrupted"));
    json_decref(s);
    return done;
}

static bool trains_proxy(const struct sg_attack_run_params *p)
{
    return p->method == SG_METHOD_POISON_SPLAT && !p->proxy;
}

/* Parameters of the proxy's training, or those that it was begun with. */
static struct sg_run_params proxy_params(const struct sg_attack_run_params *p, const char *folder)
{
    struct sg_run_params t = sg_run_params_default();
    t.source = p->source;
    t.folder = folder;
    t.train.iterations = p->proxy_iterations;
    t.train.seed = p->attack.seed;
    t.train.max_instances = p->attack.max_instances;
    t.train.max_gaussians = p->attack.victim_gaussians;
    t.train.engine = p->attack.engine;
    t.train.cpu = p->attack.cpu;
    t.train.scaffold = p->attack.scaffold;
    t.train.model = p->attack.model == SG_ATTACK_SCAFFOLD ? SG_MODEL_SCAFFOLD : SG_MODEL_3DGS;
    t.scene = p->scene;
    t.scene.eval = p->views == SG_ATTACK_TRAIN_VIEWS;
    t.scene.test_halves = false;
    t.eval_every = 0;
    t.max_memory = p->max_memory, t.max_vram = p->max_vram;
    t.step = p->proxy_step;
    t.step_priv = p->step_priv;
    return t;
}

/* Trains the proxy like any run, in FOLDER/attack/proxy, or continues it. */
static int train_proxy(struct attack_run *r, char model[PATH_MAX])
{
    const struct sg_attack_run_params *p = r->params;
    char *folder = sg_strf(r->ctx, "%s/attack/proxy", p->folder);
    sg_run *run = NULL;
    if (!folder)
        return SG_ERR_BUDGET;
    sg_scene_destroy(&r->scene); /* the proxy's run loads it itself */
    const bool begun = sg_run_has(r->ctx, folder, "checkpoint.bin"),
               done = r->resume && !begun && has_proxy(r->ctx, p->folder),
               resume = r->resume && begun;
    struct sg_run_params t = proxy_params(p, folder), own = {0};
    int code = SG_OK;
    if (!done && resume) {
        code = sg_run_read_params(r->ctx, folder, &own);
        own.source = t.source, own.max_memory = t.max_memory, own.max_vram = t.max_vram;
        own.scene.follow_links = t.scene.follow_links, own.scene.strict = t.scene.strict;
        own.train.cpu = t.train.cpu ? t.train.cpu : own.train.cpu;
        own.step = t.step, own.step_priv = t.step_priv;
    }
    if (!done && !code) {
        sg_log(r->ctx, SG_LOG_INFO, "training the proxy");
        code = sg_run_open_in(r->ctx, resume ? &own : &t, resume ? SG_RUN_RESUME : SG_RUN_REPLACE,
                              true, &run);
        if (!code)
            code = sg_run_train(run);
        sg_run_close(&run);
        if (!code && !has_proxy(r->ctx, p->folder))
            code =
                sg_fail(r->ctx, SG_ERR_BUDGET, "%s: memory did not suffice for the proxy", folder);
    }
    if (!done && !code)
        remove_file(r->ctx, folder, "checkpoint.bin"); /* it is complete: its model is enough */
    r->has_proxy = !code;
    if (!code)
        code = load_scene(r);
    if (!code)
        code = sg_run_find_model(r->ctx, folder, 0, model, PATH_MAX);
    sg_run_params_clear(&own);
    sg_free(folder);
    return code;
}

static int save_checkpoint(struct attack_run *r)
{
    char *path = sg_strf(r->ctx, "%s/attack/checkpoint.bin", r->params->folder);
    int code = path ? sg_attack_log_step(r) : SG_ERR_BUDGET;
    if (!code)
        code = sg_run_log_settle(&r->log, true);
    if (!code)
        code = sg_attack_save(r->attack, path);
    if (!code)
        r->checkpoint = sg_attack_iteration(r->attack);
    sg_free(path);
    return code;
}

/* A log or a checkpoint that cannot be written does not end the attack: the disk may have room
 * again. The end reports what the log lacks, see sg_run_log_close. */
static void note_error(const struct attack_run *r, int code)
{
    if (code)
        sg_log(r->ctx, SG_LOG_WARN, "%s", sg_last_error(r->ctx));
    sg_clear_error(r->ctx);
}

static int loop(struct attack_run *r)
{
    const struct sg_attack_params *p = &r->attack_params;
    int code = SG_OK, done = sg_attack_iteration(r->attack), saved = done;
    /* A stopped attack continues to the next iteration at which it can be saved. */
    while (!code && done < p->iterations && (!r->stopped || done % p->update_interval)) {
        const double start = sg_seconds();
        const int before = done;
        code = sg_attack_advance(r->attack, &r->step);
        r->totals.seconds += sg_seconds() - start;
        done = sg_attack_iteration(r->attack);
        if (code == SG_ERR_INTERRUPTED) { /* by the context's progress function */
            r->stopped = true;
            if (done == before)
                break;
            sg_clear_error(r->ctx); /* this iteration was done first */
            code = SG_OK;
        }
        if (code)
            return code;
        r->totals.inner_seconds += r->step.inner_seconds;
        r->totals.inner_bytes += (double) r->step.inner_bytes;
        if (r->step.gaussians > r->totals.max_gaussians)
            r->totals.max_gaussians = r->step.gaussians;
        sg_attack_ask(r, &r->step);
        if (done % 100 == 0 || done == 1 || done == p->iterations)
            note_error(r, sg_attack_log_step(r));
        note_error(r, sg_run_log_settle(&r->log, done == p->iterations));
        if (r->params->save_every && sg_due(saved, done, r->params->save_every) &&
            done % p->update_interval == 0 && done < p->iterations) {
            note_error(r, save_checkpoint(r));
            saved = done;
        }
    }
    if (done == p->iterations || done % p->update_interval)
        return code;
    sg_clear_error(r->ctx);
    code = save_checkpoint(r);
    return code ? code
                : sg_fail(r->ctx, SG_ERR_INTERRUPTED, "interrupted at iteration %d; saved", done);
}

/* attack/config.json, from which the attack can be continued. */
static int write_config(const struct attack_run *r)
{
    const struct sg_attack_run_params *p = r->params;
    json_t *options = sg_config_to_json(sg_attack_run_config, p);
    json_object_set_new(options, "source-path", sg_place_json(p->source));
    if (p->proxy)
        json_object_set_new(options, "proxy", sg_place_json(p->proxy));
    return sg_run_write_json(r->ctx, p->folder, "attack/config.json",
                             json_pack("{s:s,s:o}", "version", sg_version(), "options", options));
}

static int read_proxy(struct attack_run *r, struct sg_model **model)
{
    const struct sg_scaffold_params *scaffold = &r->attack_params.scaffold;
    const bool anchors = r->attack_params.model == SG_ATTACK_SCAFFOLD;
    int code =
        (anchors ? sg_model_read_drawable : sg_model_read)(r->ctx, r->proxy, UINT32_MAX, model);
    if (!code && anchors)
        code = sg_model_expect_anchors(r->ctx, *model, r->proxy, sg_network_parts(scaffold),
                                       scaffold->appearance ? r->scene->n_train : 0);
    if (!code)
        code = sg_model_check(r->ctx, *model, r->proxy);
    if (!code)
        r->proxy_gaussians = sg_model_gaussians(*model);
    return code;
}

static int resume_decoy(struct attack_run *r, const char *saved)
{
    int code = sg_run_check_inside(r->ctx, r->params->folder, "attack/checkpoint.bin");
    if (!code)
        code = sg_attack_resume(r->ctx, r->scene, saved, &r->attack_params, &r->attack);
    r->checkpoint = code ? 0 : sg_attack_iteration(r->attack);
    return code ? code : write_config(r); /* the scene may have moved */
}

static int make_decoy(struct attack_run *r)
{
    struct sg_model *model = NULL;
    char *saved = sg_strf(r->ctx, "%s/attack/checkpoint.bin", r->params->folder);
    int code = saved ? read_proxy(r, &model) : SG_ERR_BUDGET;
    const bool resume = !code && r->resume && !access(saved, F_OK);
    if (resume)
        sg_model_destroy(&model);
    if (!code)
        code = resume ? resume_decoy(r, saved)
                      : sg_attack_create(r->ctx, r->scene, model, &r->attack_params, &r->attack);
    sg_model_destroy(&model);
    sg_free(saved);
    return code;
}

static int save_decoy(struct attack_run *r)
{
    struct sg_model *decoy = NULL;
    char *path = sg_strf(r->ctx, "%s/attack/decoy.ply", r->params->folder);
    int code = path ? sg_attack_decoy(r->attack, &decoy) : SG_ERR_BUDGET;
    if (!code)
        code = sg_model_write_ply(r->ctx, decoy, path);
    sg_model_destroy(&decoy);
    sg_free(path);
    return code;
}

static bool is_attack(sg_ctx *ctx, const char *folder)
{
    return sg_run_has_option(ctx, folder, "attack/config.json", "epsilon") ||
           sg_run_has_option(ctx, folder, "poison.json", "epsilon");
}

/* A checkpoint of the attack or of its proxy. */
static bool has_checkpoint(sg_ctx *ctx, const char *folder)
{
    return sg_run_has(ctx, folder, "attack/checkpoint.bin") ||
           sg_run_has(ctx, folder, "attack/proxy/checkpoint.bin");
}

/* The folder holds a whole attack, which no other one has begun to replace. */
static bool is_finished(sg_ctx *ctx, const char *folder)
{
    return sg_run_has(ctx, folder, "poison.json") &&
           !sg_run_has(ctx, folder, "attack/checkpoint.bin") && !sg_run_has(ctx, folder, EARLIER);
}

/* The folder holds nothing to continue from and nothing to use. */
static bool is_lost(sg_ctx *ctx, const char *folder)
{
    return !sg_run_has(ctx, folder, "poison.json") && !has_checkpoint(ctx, folder) &&
           !has_proxy(ctx, folder);
}

static void discard_proxy(sg_ctx *ctx, const char *folder)
{
    char *proxy = sg_strf(ctx, "%s/attack/proxy", folder);
    if (proxy) {
        sg_run_discard(proxy);
        remove_file(ctx, proxy, SG_OUTPUT_MARK);
        rmdir(proxy); /* where it is empty */
    }
    sg_free(proxy);
}

/* Makes FOLDER/attack with its config.json. Removes what an earlier attack left to continue from,
 * and all of it unless it is whole and a proxy is trained first. */
static int begin_files(struct attack_run *r)
{
    static const char *const files[] = {"attack/checkpoint.bin", "attack/proxy/summary.json",
                                        "attack/proxy/checkpoint.bin"};
    const struct sg_attack_run_params *p = r->params;
    const bool keep = trains_proxy(p) && sg_run_has(r->ctx, p->folder, "poison.json") &&
                      sg_run_has(r->ctx, p->folder, "attack/config.json");
    char *state = sg_strf(r->ctx, "%s/attack", p->folder);
    int code = state ? SG_OK : SG_ERR_BUDGET;
    if (!code && !keep)
        code = remove_earlier(r);
    if (!code)
        code = sg_dir_create(r->ctx, state);
    if (!code && keep && !sg_run_has(r->ctx, p->folder, EARLIER))
        code = keep_earlier(r);
    r->keeps_earlier = keep && !code;
    sg_free(state);
    if (code)
        return code;
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++)
        remove_file(r->ctx, p->folder, files[i]);
    if (!trains_proxy(p))
        discard_proxy(r->ctx, p->folder);
    return write_config(r);
}

/* The attack failed before its first save. Removes what was begun, so that the same call works once
 * the cause is gone. */
static void remove_begun(sg_ctx *ctx, const char *folder)
{
    remove_file(ctx, folder, "attack/config.json");
    remove_file(ctx, folder, "attack/log.jsonl");
    discard_proxy(ctx, folder);
    char *state = sg_strf(ctx, "%s/attack", folder);
    if (state)
        rmdir(state); /* where it is empty */
    sg_free(state);
}

/* The same where an earlier attack is still there: the folder is that attack's again. */
static void return_earlier(sg_ctx *ctx, const char *folder)
{
    char *config = sg_strf(ctx, "%s/attack/config.json", folder),
         *earlier = config ? sg_strf(ctx, "%s/" EARLIER, folder) : NULL;
    discard_proxy(ctx, folder);
    if (earlier)
        rename(earlier, config);
    sg_free(earlier);
    sg_free(config);
}

static int name_checkpoint(const struct attack_run *r, int code)
{
    return sg_run_name_checkpoint(r->ctx, code, r->params->folder, "attack/checkpoint.bin",
                                  r->checkpoint);
}

/* Proxy, decoy, poisons. */
static int run_attack(struct attack_run *r, char model[PATH_MAX])
{
    const struct sg_attack_run_params *p = r->params;
    const bool splat = p->method == SG_METHOD_POISON_SPLAT;
    int code = SG_OK;
    if (trains_proxy(p)) {
        code = train_proxy(r, model);
        r->proxy = model;
    }
    if (!code && sg_run_has(r->ctx, p->folder, EARLIER)) {
        code = remove_earlier(r);
        r->keeps_earlier = false;
    }
    if (code)
        return code;
    sg_attack_ask(r, NULL);
    if (splat) {
        code = r->attack ? SG_OK : make_decoy(r);
        if (!code)
            code = sg_attack_open_log(r);
        if (!code)
            r->status->first = sg_attack_iteration(r->attack);
        if (!code)
            code = loop(r);
        if (code && code != SG_ERR_INTERRUPTED && r->checkpoint)
            code = name_checkpoint(r, code);
        if (code)
            return code;
    }
    if (p->keep_decoy && splat)
        code = save_decoy(r);
    if (!code)
        code = sg_attack_write(r);
    if (!code) {
        remove_file(r->ctx, p->folder, "attack/checkpoint.bin");
        return code;
    }
    /* What has been learned is kept, so that the images can be written later. */
    char *why = sg_strdup(r->ctx, sg_last_error(r->ctx));
    sg_clear_error(r->ctx);
    const int lost = splat ? save_checkpoint(r) : SG_OK;
    if (lost)
        sg_log(r->ctx, SG_LOG_WARN, "%s", sg_last_error(r->ctx));
    sg_clear_error(r->ctx);
    sg_fail(r->ctx, code, "%s", why ? why : "out of memory");
    sg_free(why);
    return lost && r->checkpoint ? name_checkpoint(r, code) : code;
}

/* What a killed attack left unfinished, beside the scene's own files. */
static int remove_temporary(sg_ctx *ctx, const char *folder)
{
    char *state = sg_strf(ctx, "%s/attack", folder);
    if (!state)
        return SG_ERR_BUDGET;
    sg_run_remove_temporary(folder);
    sg_run_remove_temporary(state);
    sg_free(state);
    return SG_OK;
}

/* Whether images have a quality is known only with the scene. */
static void warn_of_quality(const struct attack_run *r)
{
    const struct sg_poison_files *files = &r->params->files, own = sg_poison_files_default();
    if (files->save == SG_POISON_AUTO && r->scene->format != SG_FORMAT_COLMAP && !r->resume &&
        (files->jpeg_quality != own.jpeg_quality || files->full_chroma != own.full_chroma))
        sg_log(r->ctx, SG_LOG_WARN,
               "the quality and chroma of JPEG have no effect with --save auto, which is PNG for "
               "this scene");
}

/* In a folder that is claimed. *fresh: it was new or empty. */
static int begin_attack(struct attack_run *r, char model[PATH_MAX], bool *fresh)
{
    const struct sg_attack_run_params *p = r->params;
    int code = SG_OK;
    if (p->method == SG_METHOD_POISON_SPLAT && p->proxy)
        code = sg_run_find_model(r->ctx, p->proxy, 0, model, PATH_MAX);
    if (!code)
        code = load_scene(r);
    if (code)
        return code;
    apply_preset(r);
    code = sg_attack_check(r->ctx, &r->attack_params);
    if (!code)
        code = sg_poisoned_scene_check(r->ctx, r->scene, &p->files);
    if (!code)
        code = remove_temporary(r->ctx, p->folder);
    /* Nothing of an earlier attack is removed before this one can begin. */
    r->proxy = model[0] ? model : NULL;
    if (!code && !r->resume && r->proxy)
        code = make_decoy(r);
    if (!code)
        warn_of_quality(r);
    if (!code && !r->resume) {
        *fresh = !sg_run_has_files(p->folder);
        code = begin_files(r);
    } else if (!code && !sg_run_has(r->ctx, p->folder, "attack/checkpoint.bin"))
        code = write_config(r);
    return code;
}

int sg_attack_run(sg_ctx *ctx, const struct sg_attack_run_params *p, enum sg_run_start start,
                  struct sg_attack_run_status *status)
{
    sg_clear_error(ctx);
    struct sg_attack_run_status own;
    struct sg_attack_run_params rounded = *p;
    sg_config_round(sg_attack_run_config, &rounded);
    struct attack_run r = {.ctx = ctx,
                           .params = &rounded,
                           .resume = start == SG_RUN_RESUME,
                           .status = status ? status : &own};
    *r.status = (struct sg_attack_run_status){0};
    sg_output *output = NULL;
    char model[PATH_MAX] = "";
    bool fresh = false;
    const struct sg_output_rules rules = {.maker = "attack",
                                          .earlier = "attack",
                                          .is_own = is_attack,
                                          .is_lost = is_lost,
                                          .within = "attack/proxy/config.json",
                                          .makes_scenes = true,
                                          .replace = start == SG_RUN_REPLACE,
                                          .resume = r.resume,
                                          .inputs = {p->source, p->proxy}};
    int code = p->source && p->folder
                   ? sg_check_options(ctx, sg_attack_run_options(), p)
                   : sg_fail(ctx, SG_ERR_USAGE, "attack: found no source or folder");
    if (!code)
        code = sg_config_check(ctx, sg_attack_run_config, p);
    if (code)
        return code;
    r.status->finished = r.resume && is_finished(ctx, p->folder);
    if (!r.status->finished) {
        code = sg_output_claim_by(ctx, p->folder, &rules, &output);
        if (!code)
            code = begin_attack(&r, model, &fresh);
        if (!code) {
            code = run_attack(&r, model);
            /* An attack without a decoy begins again. */
            r.status->resumable = code && (p->method != SG_METHOD_POISON_SPLAT || r.has_proxy ||
                                           has_checkpoint(ctx, p->folder));
        }
        if (fresh && code && !r.status->resumable)
            remove_begun(ctx, p->folder);
        else if (code && !r.status->resumable && r.keeps_earlier)
            return_earlier(ctx, p->folder);
        const int closed = sg_run_log_close(&r.log);
        code = code ? code : closed;
        sg_attack_destroy(&r.attack);
        sg_scene_destroy(&r.scene);
        sg_output_release(&output);
    }
    return code;
}
