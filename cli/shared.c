/* SPDX-License-Identifier: Apache-2.0 */
/* What several commands need: contexts, errors, finding a run's model and its scene options. */
#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "commands.h"

int exit_code(int error)
{
    switch (error) {
    case SG_OK:
        return 0;
    case SG_ERR_USAGE:
        return 1;
    case SG_ERR_INPUT:
        return 2;
    case SG_ERR_BUDGET:
        return 3;
    case SG_ERR_INTERRUPTED:
        return 130;
    default:
        return 4;
    }
}

int report(const sg_ctx *ctx, int error)
{
    const char *text = ctx ? sg_last_error(ctx) : "";
    fprintf(stderr, "splatguard: %s\n", text[0] ? text : "internal error");
    return exit_code(error);
}

static void log_line(void *priv, enum sg_log_level level, const char *message)
{
    const bool *quiet = priv;
    if (level <= SG_LOG_WARN || (level == SG_LOG_INFO && !*quiet))
        fprintf(stderr, "%s%s\n", level <= SG_LOG_WARN ? "warning: " : "", message);
}

int open_context(sg_ctx **ctx, int threads, bool quiet)
{
    static bool quiet_log;
    quiet_log = quiet;
    const int code =
        sg_ctx_create(ctx, &(struct sg_ctx_params){.threads = threads, .log = log_line, .log_priv = &quiet_log});
    if (code)
        fprintf(stderr, "splatguard: cannot start %d threads\n", threads);
    return exit_code(code);
}

const char *cpu_variant(const char *option)
{
    const char *environment = getenv("SG_CPU");
    return option ? option : environment && environment[0] ? environment : NULL;
}

static bool is_dir(const char *path)
{
    struct stat st;
    return !stat(path, &st) && S_ISDIR(st.st_mode);
}

char *find_model(const char *path)
{
    char *found = NULL;
    if (!is_dir(path))
        return strdup(path);
    char folder[4096];
    snprintf(folder, sizeof(folder), "%s/point_cloud", path);
    DIR *d = opendir(folder);
    long newest = -1;
    for (struct dirent *e; d && (e = readdir(d));) {
        long n;
        char rest;
        if (sscanf(e->d_name, "iteration_%ld%c", &n, &rest) == 1 && n > newest)
            newest = n;
    }
    if (d)
        closedir(d);
    if (newest < 0)
        fprintf(stderr, "splatguard: %s: found no point_cloud/iteration_N/point_cloud.ply, expected a run folder\n",
                path);
    else if (asprintf(&found, "%s/iteration_%ld/point_cloud.ply", folder, newest) < 0)
        found = NULL;
    return found;
}

int run_scene_options(const char *model, struct scene_options *scene, json_t **keep)
{
    *keep = NULL;
    if (!is_dir(model))
        return 0;
    char path[4096];
    snprintf(path, sizeof(path), "%s/config.json", model);
    json_error_t error;
    json_t *config = json_load_file(path, JSON_REJECT_DUPLICATES, &error);
    if (!config)
        return 0; /* another trainer's folder */
    json_t *o = json_object_get(config, "options"), *v;
    if ((v = json_object_get(o, "images")) && json_is_string(v))
        scene->params.images = json_string_value(v);
    if ((v = json_object_get(o, "masks")) && json_is_string(v))
        scene->params.masks = json_string_value(v);
    if ((v = json_object_get(o, "resolution")) && json_is_integer(v))
        scene->params.resolution = (int) json_integer_value(v);
    if ((v = json_object_get(o, "downscale")) && json_is_number(v))
        scene->params.downscale = json_number_value(v);
    if ((v = json_object_get(o, "test-every")) && json_is_integer(v))
        scene->params.test_every = (int) json_integer_value(v);
    scene->params.white_background |= json_is_true(json_object_get(o, "white-background"));
    scene->params.centred_principal |= json_is_true(json_object_get(o, "centred-principal"));
    *keep = config;
    return 0;
}
