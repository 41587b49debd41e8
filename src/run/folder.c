/* SPDX-License-Identifier: Apache-2.0 */
#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "config.h"
#include "core/file.h"
#include "core/json_text.h"
#include "math/exposure.h"

/* A Python string literal. */
static void put_quoted(FILE *out, const char *text)
{
    fputc('\'', out);
    for (; *text; text++) {
        if (*text == '\'' || *text == '\\')
            fputc('\\', out);
        fputc(*text == '\n' ? ' ' : *text, out);
    }
    fputc('\'', out);
}

/* The text that viewers of the reference parse. */
static int write_cfg_args(sg_ctx *ctx, const struct sg_run_params *p)
{
    struct sg_file_writer w;
    char *path = sg_strf(ctx, "%s/cfg_args", p->folder), *absolute = realpath(p->source, NULL);
    int code = path ? sg_file_create(ctx, &w, path) : SG_ERR_BUDGET;
    if (!code) {
        fprintf(w.stream,
                "Namespace(data_device='cpu', eval=%s, images=", p->scene.eval ? "True" : "False");
        put_quoted(w.stream, p->scene.images ? p->scene.images : "images");
        fprintf(w.stream, ", model_path=");
        put_quoted(w.stream, p->folder);
        fprintf(w.stream, ", resolution=%d, sh_degree=%d, source_path=", p->scene.resolution,
                p->train.sh_degree);
        put_quoted(w.stream, absolute ? absolute : p->source);
        fprintf(w.stream, ", train_test_exp=%s, white_background=%s)",
                p->scene.test_halves && p->train.exposure ? "True" : "False",
                p->scene.white_background ? "True" : "False");
        code = sg_file_commit(ctx, &w);
    }
    sg_free(path);
    free(absolute);
    return code;
}

int sg_run_write_config(sg_ctx *ctx, const struct sg_run_params *p, const char *variant)
{
    json_t *options = sg_config_to_json(sg_run_config, p);
    json_object_set_new(options, "source-path", sg_place_json(p->source));
    const int code = sg_run_write_json(ctx, p->folder, "config.json",
                                       json_pack("{s:s,s:s,s:o}", "version", sg_version(),
                                                 "cpu_variant", variant, "options", options));
    return code ? code : write_cfg_args(ctx, p);
}

static int write_input(sg_ctx *ctx, const char *run, const struct sg_model *m)
{
    char *path = sg_strf(ctx, "%s/input.ply", run);
    float *xyz = sg_alloc_raw(ctx, SG_MEM_MISC, m->count, 3 * sizeof(float));
    uint8_t *rgb = sg_alloc_raw(ctx, SG_MEM_MISC, m->count, 3);
    int code = path && xyz && rgb ? SG_OK : SG_ERR_BUDGET;
    for (size_t i = 0; i < 3 * m->count && !code; i++) {
        xyz[i] = *sg_model_at(m, i / 3, SG_P_XYZ + (int) (i % 3));
        const float c =
            (*sg_model_at(m, i / 3, SG_P_SH + (int) (i % 3)) * 0.28209479f + 0.5f) * 255 + 0.5f;
        rgb[i] = (uint8_t) (c > 0 ? c < 255 ? c : 255 : 0);
    }
    if (!code)
        code = sg_points_write_ply(ctx, path, xyz, rgb, m->count);
    sg_free(xyz);
    sg_free(rgb);
    sg_free(path);
    return code;
}

bool sg_run_is_run(sg_ctx *ctx, const char *folder)
{
    return sg_run_has_option(ctx, folder, "config.json", "densify-grad-threshold");
}

/* Below another folder or AT_FDCWD. Follows no link, since a run may not be trusted. */
static DIR *open_folder(int at, const char *name, int links)
{
    const int fd = openat(at, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC | links);
    DIR *d = fd < 0 ? NULL : fdopendir(fd);
    if (fd >= 0 && !d)
        close(fd);
    return d;
}

/* Whether runs and attacks write files of that name. */
static bool is_written(const char *file)
{
    static const char *const names[] = {
        "config.json",          "summary.json", "log.jsonl", "checkpoint.bin",  "cfg_args",
        "cameras.json",         "input.ply",    "decoy.ply", "point_cloud.ply", "exposure.json",
        "networks.safetensors", "poison.json"};
    bool found = false;
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
        found |= !strcmp(file, names[i]);
    return found;
}

/* Leftovers in every point_cloud/iteration_N, and the models of iterations after one. */
static void clean_models(DIR *run, int after)
{
    DIR *models = open_folder(dirfd(run), "point_cloud", O_NOFOLLOW);
    for (struct dirent *e; models && (e = readdir(models));) {
        int n;
        char rest;
        DIR *d = sscanf(e->d_name, "iteration_%d%c", &n, &rest) == 1
                     ? open_folder(dirfd(models), e->d_name, O_NOFOLLOW)
                     : NULL;
        if (!d)
            continue;
        sg_remove_temporary(d, is_written);
        if (n > after) {
            unlinkat(dirfd(d), "point_cloud.ply", 0);
            unlinkat(dirfd(d), "networks.safetensors", 0);
        }
        closedir(d);
        unlinkat(dirfd(models), e->d_name, AT_REMOVEDIR); /* where it is empty */
    }
    if (models)
        closedir(models);
}

/* Leftovers, and the earlier run itself if asked for, which must not be mistaken for the new one.
 * Only files that a run writes are touched. */
static void clean(const char *run, bool all)
{
    static const char *const files[] = {"summary.json", "log.jsonl", "checkpoint.bin",
                                        "exposure.json"};
    DIR *d = open_folder(AT_FDCWD, run, 0);
    if (!d)
        return;
    sg_remove_temporary(d, is_written);
    for (size_t i = 0; all && i < sizeof(files) / sizeof(files[0]); i++)
        unlinkat(dirfd(d), files[i], 0);
    clean_models(d, all ? 0 : INT_MAX);
    closedir(d);
}

static bool has_model(sg_ctx *ctx, const char *run)
{
    char *path = sg_strf(ctx, "%s/point_cloud", run);
    DIR *models = path ? opendir(path) : NULL;
    bool found = !path;
    for (struct dirent *e; models && !found && (e = readdir(models));) {
        char *model = sg_strf(ctx, "%s/%s/point_cloud.ply", path, e->d_name);
        found = !model || !access(model, F_OK);
        sg_free(model);
    }
    if (models)
        closedir(models);
    sg_free(path);
    return found;
}

bool sg_run_is_lost(sg_ctx *ctx, const char *run)
{
    return !sg_run_has(ctx, run, "checkpoint.bin") && !sg_run_has(ctx, run, "summary.json") &&
           !has_model(ctx, run);
}

void sg_run_remove_files(sg_ctx *ctx, const char *run)
{
    if (!has_model(ctx, run) && !sg_run_has(ctx, run, "checkpoint.bin"))
        sg_run_discard(run);
}

void sg_run_discard(const char *run)
{
    static const char *const files[] = {"cameras.json", "input.ply", "cfg_args", "config.json"};
    clean(run, true);
    DIR *d = open_folder(AT_FDCWD, run, 0);
    for (size_t i = 0; d && i < sizeof(files) / sizeof(files[0]); i++)
        unlinkat(dirfd(d), files[i], 0);
    if (d) {
        unlinkat(dirfd(d), "point_cloud", AT_REMOVEDIR); /* where it is empty */
        closedir(d);
    }
}

void sg_run_remove_temporary(const char *run)
{
    clean(run, false);
}

int sg_run_create_files(sg_ctx *ctx, const struct sg_run_params *p, const struct sg_scene *scene,
                        const struct sg_model *initial, const char *variant)
{
    char *cameras = sg_strf(ctx, "%s/cameras.json", p->folder);
    int code = cameras ? sg_dir_create(ctx, p->folder) : SG_ERR_BUDGET;
    if (!code) {
        clean(p->folder, true);
        code = sg_run_write_config(ctx, p, variant); /* first: it marks the folder as a run's */
    }
    if (!code)
        code = sg_cameras_write_json(ctx, scene, cameras);
    if (!code)
        code = write_input(ctx, p->folder, initial);
    sg_free(cameras);
    return code;
}

/* The maps of the training photos by name, as the reference writes them. */
static int save_exposures(sg_ctx *ctx, const char *run, const struct sg_scene *scene,
                          const float *exposures)
{
    json_t *root = json_object();
    for (size_t i = 0; root && i < scene->n_train; i++) {
        const float *e = exposures + i * SG_EXPOSURE;
        json_t *rows = json_array();
        for (int k = 0; k < 3; k++)
            json_array_append_new(rows,
                                  json_pack("[f,f,f,f]", (double) e[4 * k], (double) e[4 * k + 1],
                                            (double) e[4 * k + 2], (double) e[4 * k + 3]));
        char *key = sg_run_exposure_key(ctx, scene->train[i].name);
        if (!key)
            json_decref(rows);
        if (!key || json_object_set_new(root, key, rows)) {
            json_decref(root);
            root = NULL; /* which is reported as a lack of memory */
        }
        sg_free(key);
    }
    return sg_run_write_json(ctx, run, "exposure.json", root);
}

/* A run that ended early can have saved a model after its newest checkpoint. Where it goes on from
 * there, that model must not be taken for the newest. */
static void remove_later(const char *run, int iteration)
{
    DIR *d = open_folder(AT_FDCWD, run, 0);
    if (!d)
        return;
    clean_models(d, iteration);
    closedir(d);
}

/* A model that cannot be written leaves no folder. */
static int write_model(sg_ctx *ctx, sg_trainer *trainer, char *path)
{
    struct sg_model *m = NULL;
    size_t made;
    char *slash = strrchr(path, '/');
    *slash = 0;
    int code = sg_dir_make(ctx, path, &made);
    *slash = '/';
    if (!code)
        code = sg_trainer_model(trainer, &m);
    if (!code)
        code = sg_model_write_ply(ctx, m, path);
    sg_model_destroy(&m);
    if (code) {
        *slash = 0;
        sg_dir_unmake(path, made);
    }
    return code;
}

int sg_run_save_model(sg_ctx *ctx, const char *run, const struct sg_scene *scene,
                      sg_trainer *trainer, int iteration)
{
    char name[64], *path;
    snprintf(name, sizeof(name), "point_cloud/iteration_%d/point_cloud.ply", iteration);
    const float *exposures;
    sg_clear_error(ctx);
    int code = sg_path_below(ctx, run, name, &path);
    if (!code)
        code = write_model(ctx, trainer, path);
    if (!code)
        code = sg_trainer_exposures(trainer, &exposures);
    if (!code && exposures)
        code = save_exposures(ctx, run, scene, exposures);
    if (!code)
        remove_later(run, iteration);
    sg_free(path);
    return code;
}

int sg_run_save_checkpoint(sg_ctx *ctx, const char *run, sg_trainer *trainer)
{
    char *path = sg_strf(ctx, "%s/checkpoint.bin", run);
    const int code = path ? sg_trainer_save(trainer, path) : SG_ERR_BUDGET;
    sg_free(path);
    return code;
}
