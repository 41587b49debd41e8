/* SPDX-License-Identifier: Apache-2.0 */
/* Reading a run's folder: parameters, scene, model, summary. */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "config.h"
#include "core/file.h"
#include "engine/engine.h"
#include "files.h"
#include "math/exposure.h"
#include "splatguard/engine.h"
#include "splatguard/run.h"

#define CFG_ARGS_BYTES 65536      /* other trainers write a few hundred bytes */
#define EXPOSURE_BYTES (64 << 20) /* a photo takes 400 */

void sg_run_params_clear(struct sg_run_params *p)
{
    json_decref(p->texts);
    p->texts = NULL;
}

/* Whether these are kernels that this machine has. A run on a device has the device's name there,
 * and one of the reference engine "ref". */
static bool is_cpu_variant(const char *name)
{
    struct sg_engine_info e;
    for (size_t i = 0; sg_engine_list(i, &e); i++)
        if (!strcmp(e.engine, "cpu") && e.variant && !strcmp(e.variant, name))
            return true;
    return false;
}

static int read_params(sg_ctx *ctx, const char *folder, bool strict, struct sg_run_params *out)
{
    json_t *root;
    sg_clear_error(ctx);
    *out = sg_run_params_default();
    out->folder = folder;
    int code = sg_run_read_json(ctx, folder, "config.json", "config.json of a run", &root);
    if (code)
        return code;
    out->texts = root;
    char *path = sg_strf(ctx, "%s/config.json", folder);
    code = path ? sg_config_from_json(ctx, sg_run_config, out, json_object_get(root, "options"),
                                      strict, path)
                : SG_ERR_BUDGET;
    const char *variant = json_string_value(json_object_get(root, "cpu_variant"));
    if (variant && is_cpu_variant(variant)) /* else it is of another machine or engine */
        out->train.cpu = variant;
    sg_free(path);
    return code;
}

int sg_run_read_params(sg_ctx *ctx, const char *folder, struct sg_run_params *out)
{
    return read_params(ctx, folder, true, out);
}

/* Reads cfg_args of another trainer's folder. It is Python text, of which only simple cases are
 * understood. */
static void read_cfg_args(sg_ctx *ctx, const char *run, struct sg_scene_params *scene)
{
    char *path, *text;
    size_t size;
    int n;
    if (!sg_run_read_file(ctx, run, "cfg_args", CFG_ARGS_BYTES, &path, &text, &size)) {
        const char *resolution = strstr(text, "resolution=");
        scene->white_background = strstr(text, "white_background=True");
        scene->eval = !strstr(text, "eval=False");
        scene->test_halves = scene->eval && strstr(text, "train_test_exp=True");
        if (resolution && sscanf(resolution, "resolution=%d", &n) == 1 && n >= -1 && n &&
            n <= SG_SIDE_MAX)
            scene->resolution = n;
    }
    sg_clear_error(ctx); /* without it, or with other text, the defaults apply */
    sg_free(text);
    sg_free(path);
}

int sg_run_read_scene(sg_ctx *ctx, const char *folder, struct sg_run_params *out)
{
    sg_clear_error(ctx);
    if (sg_run_has(ctx, folder, "config.json"))
        return read_params(ctx, folder, false, out);
    *out = sg_run_params_default();
    out->folder = folder;
    out->scene.eval = true;
    read_cfg_args(ctx, folder, &out->scene);
    return SG_OK;
}

/* Three rows of four numbers. */
static bool read_exposure(const json_t *map, float out[SG_EXPOSURE])
{
    bool sound = json_array_size(map) == 3;
    for (size_t k = 0; k < SG_EXPOSURE; k++) {
        const json_t *row = json_array_get(map, k / 4), *number = json_array_get(row, k % 4);
        out[k] = (float) json_number_value(number);
        sound = sound && json_array_size(row) == 4 && json_is_number(number) && isfinite(out[k]);
    }
    return sound;
}

int sg_run_read_exposures(sg_ctx *ctx, const char *folder, const struct sg_view *views, size_t n,
                          float *out)
{
    json_t *root;
    void *room;
    sg_clear_error(ctx);
    int code = sg_run_read_large_json(ctx, folder, "exposure.json", "exposure.json of a run",
                                      EXPOSURE_BYTES, &room, &root);
    for (size_t i = 0; i < n && !code; i++) {
        char *key = sg_run_exposure_key(ctx, views[i].name);
        const json_t *map = key ? json_object_get(root, key) : NULL;
        if (!key)
            code = SG_ERR_BUDGET;
        else if (!map)
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s/exposure.json: found nothing of photo \"%s\", expected its map",
                           folder, views[i].name);
        else if (!read_exposure(map, out + i * SG_EXPOSURE))
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s/exposure.json: \"%s\": found another value, expected 3 rows of 4 "
                           "finite numbers",
                           folder, views[i].name);
        sg_free(key);
    }
    json_decref(root);
    sg_free(room);
    return code;
}

/* The newest iteration with a model, or 0. */
static int newest(sg_ctx *ctx, const char *run)
{
    char *folder = sg_strf(ctx, "%s/point_cloud", run);
    DIR *d = folder ? opendir(folder) : NULL;
    int best = 0;
    for (struct dirent *e; d && (e = readdir(d));) {
        int n;
        char rest;
        if (sscanf(e->d_name, "iteration_%d%c", &n, &rest) != 1 || n <= best)
            continue;
        char *file = sg_strf(ctx, "%s/%s/point_cloud.ply", folder, e->d_name);
        if (file && !access(file, F_OK))
            best = n;
        sg_free(file);
    }
    if (d)
        closedir(d);
    sg_free(folder);
    return best;
}

/* The model of an iteration, and the networks that may lie beside it. */
static int check_model(sg_ctx *ctx, const char *run, int iteration)
{
    static const char *const names[] = {"point_cloud.ply", "networks.safetensors"};
    int code = SG_OK;
    for (int i = 0; i < 2 && !code; i++) {
        char name[80];
        snprintf(name, sizeof(name), "point_cloud/iteration_%d/%s", iteration, names[i]);
        code = sg_run_check_inside(ctx, run, name);
        if (!code && !i && !sg_run_has(ctx, run, name))
            code = sg_fail(ctx, SG_ERR_INPUT, "%s: found no %s, expected that iteration's model",
                           run, name);
    }
    return code;
}

int sg_run_find_model(sg_ctx *ctx, const char *path, int iteration, char *out, size_t size)
{
    sg_clear_error(ctx);
    int n;
    if (access(path, F_OK))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: cannot open the model: %s", path, strerror(errno));
    if (!sg_dir_exists(path)) {
        n = snprintf(out, size, "%s", path);
    } else {
        iteration = iteration ? iteration : newest(ctx, path);
        if (!iteration && sg_run_has_option(ctx, path, "config.json", "iterations"))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found a run that has saved no model yet, expected one", path);
        if (!iteration)
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found no point_cloud/iteration_N/point_cloud.ply, expected a run "
                           "folder",
                           path);
        const int code = check_model(ctx, path, iteration);
        if (code)
            return code;
        n = snprintf(out, size, "%s/point_cloud/iteration_%d/point_cloud.ply", path, iteration);
    }
    return n >= 0 && (size_t) n < size
               ? SG_OK
               : sg_fail(ctx, SG_ERR_BUDGET, "%s: found a path of %d bytes, expected less than %zu",
                         path, n, size);
}

struct sg_run_summary {
    json_t *root;
};

/* A run gets its summary when it ends. That nothing is there is left to the reading. */
static int check_ended(sg_ctx *ctx, const char *folder)
{
    if (!sg_dir_exists(folder))
        return access(folder, F_OK)
                   ? SG_OK
                   : sg_fail(ctx, SG_ERR_INPUT, "%s: found a file, expected the folder of a run",
                             folder);
    if (sg_run_has(ctx, folder, "summary.json"))
        return SG_OK;
    if (sg_run_has(ctx, folder, "config.json"))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no summary.json: the run is not finished%s",
                       folder,
                       sg_run_has(ctx, folder, "checkpoint.bin")
                           ? "; train --resume continues it, unless it is running"
                           : "");
    return sg_fail(ctx, SG_ERR_INPUT, "%s: found no summary.json, expected the folder of a run",
                   folder);
}

int sg_run_summary_read(sg_ctx *ctx, const char *folder, sg_run_summary **out)
{
    sg_clear_error(ctx);
    *out = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(**out));
    int code = *out ? check_ended(ctx, folder) : SG_ERR_BUDGET;
    if (!code)
        code =
            sg_run_read_json(ctx, folder, "summary.json", "summary.json of a run", &(*out)->root);
    if (!code && isnan(sg_run_summary_number(*out, "iterations")))
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "%s/summary.json: found no number iterations, expected the summary of a run",
                       folder);
    if (code)
        sg_run_summary_destroy(out);
    return code;
}

double sg_run_summary_number(const sg_run_summary *summary, const char *key)
{
    const json_t *v = summary->root;
    while (*key) {
        const size_t n = strcspn(key, ".");
        char part[64];
        snprintf(part, sizeof(part), "%.*s", (int) n, key);
        v = json_object_get(v, part);
        key += n + (key[n] == '.');
    }
    return json_is_boolean(v) ? json_is_true(v) : json_is_number(v) ? json_number_value(v) : NAN;
}

void sg_run_summary_destroy(sg_run_summary **summary)
{
    if (!summary || !*summary)
        return;
    json_decref((*summary)->root);
    sg_free(*summary);
    *summary = NULL;
}
