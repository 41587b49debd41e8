/* SPDX-License-Identifier: Apache-2.0 */
#include "run_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/file.h"
#include "core/json_text.h"
#include "run/config.h"

#define JSON_BYTES                                                                                 \
    (256                                                                                           \
     << 10) /* a config or summary has a few thousand; parsed it takes a hundred times as many */

char *run_path(const char *run, const char *name)
{
    char *path;
    return asprintf(&path, "%s/%s", run, name) < 0 ? NULL : path;
}

bool run_has(const char *run, const char *name)
{
    char *path = run_path(run, name);
    const bool has = path && !access(path, F_OK);
    free(path);
    return has;
}

int run_cannot(const char *what, const char *path)
{
    say(stderr, "splatguard: %s: cannot %s: %s\n", path, what, strerror(errno ? errno : EIO));
    return 2;
}

int run_write_file(const char *path, const char *text, size_t size)
{
    char *temporary;
    if (!sg_replaceable(path)) {
        say(stderr, "splatguard: %s: cannot write: found a folder or device, expected a file\n",
            path);
        return 2;
    }
    if (asprintf(&temporary, "%s.tmp%ld", path, (long) getpid()) < 0)
        return no_memory();
    int code = 0;
    FILE *f = sg_temporary_open(temporary);
    if (f)
        fwrite(text, 1, size, f); /* errors surface at the end */
    if (!f)
        code = run_cannot("write", path);
    else if (!sg_temporary_finish(f, temporary, path)) {
        code = run_cannot("write", path);
        unlink(temporary);
    }
    free(temporary);
    return code;
}

FILE *run_open(const char *path, uint64_t most)
{
    FILE *f = sg_regular_open(path);
    struct stat st;
    if (f && (fstat(fileno(f), &st) || (uint64_t) st.st_size > most)) {
        fclose(f);
        f = NULL;
        errno = EFBIG;
    }
    return f;
}

json_t *run_read_json(const char *path, const char *what)
{
    json_error_t error = {0};
    FILE *f = run_open(path, JSON_BYTES);
    if (f && (getc(f) != 0xef || getc(f) != 0xbb ||
              getc(f) != 0xbf)) /* the byte-order mark of some editors */
        rewind(f);
    json_t *root = f ? json_loadf(f, JSON_REJECT_DUPLICATES, &error) : NULL;
    if (!f)
        say(stderr, "splatguard: %s: cannot read: %s; expected the %s\n", path, strerror(errno),
            what);
    else if (!root)
        say(stderr, "splatguard: %s: line %d: %s; expected the %s\n", path, error.line, error.text,
            what);
    if (f)
        fclose(f);
    sg_bytes_from_json(json_object_get(root, "options"));
    return root;
}

json_t *run_place_json(const char *folder)
{
    char *absolute = realpath(folder, NULL);
    json_t *value = sg_bytes_to_json(absolute ? absolute : folder);
    free(absolute);
    return value ? value : json_null();
}

int run_write_json(const char *path, const json_t *value)
{
    char *text = json_dumps(value, JSON_INDENT(2) | JSON_REAL_PRECISION(15));
    if (!text)
        return no_memory();
    size_t n = strlen(text);
    text[n] = '\n'; /* in place of the final zero: the length is passed on */
    const int code = run_write_file(path, text, n + 1);
    free(text);
    return code;
}

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
static int write_cfg_args(const struct train_config *c)
{
    char *text = NULL, *path = run_path(c->run.folder, "cfg_args"),
         *absolute = realpath(c->run.source, NULL);
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    if (out) {
        fprintf(out, "Namespace(data_device='cpu', eval=%s, images=",
                c->run.scene.eval ? "True" : "False");
        put_quoted(out, c->run.scene.images ? c->run.scene.images : "images");
        fprintf(out, ", model_path=");
        put_quoted(out, c->run.folder);
        fprintf(out, ", resolution=%d, sh_degree=%d, source_path=", c->run.scene.resolution,
                c->run.train.sh_degree);
        put_quoted(out, absolute ? absolute : c->run.source);
        fprintf(out, ", white_background=%s)", c->run.scene.white_background ? "True" : "False");
    }
    const int code = !out || fclose(out) || !path ? no_memory() : run_write_file(path, text, size);
    free(text);
    free(path);
    free(absolute);
    return code;
}

int run_write_config(const struct train_config *c, const char *variant)
{
    char *path = run_path(c->run.folder, "config.json");
    json_t *options = sg_config_to_json(sg_run_config, &c->run);
    json_object_set_new(options, "source-path", run_place_json(c->run.source));
    json_t *root = json_pack("{s:s,s:s,s:o}", "version", sg_version(), "cpu_variant", variant,
                             "options", options);
    const int code = root && path ? run_write_json(path, root) : no_memory();
    json_decref(root);
    free(path);
    return code;
}

static int write_input(sg_ctx *ctx, const char *run, const struct sg_model *m)
{
    char *path = run_path(run, "input.ply");
    float *xyz = malloc(m->count * 3 * sizeof(float));
    uint8_t *rgb = malloc(m->count * 3);
    int code = path && xyz && rgb ? 0 : no_memory();
    for (size_t i = 0; i < 3 * m->count && !code; i++) {
        xyz[i] = *sg_model_at(m, i / 3, SG_P_XYZ + (int) (i % 3));
        const float c =
            (*sg_model_at(m, i / 3, SG_P_SH + (int) (i % 3)) * 0.28209479f + 0.5f) * 255 + 0.5f;
        rgb[i] = (uint8_t) (c > 0 ? c < 255 ? c : 255 : 0);
    }
    if (!code) {
        const int error = sg_points_write_ply(ctx, path, xyz, rgb, m->count);
        code = error ? report(ctx, error) : 0;
    }
    free(xyz);
    free(rgb);
    free(path);
    return code;
}

/* Hidden files do not count: some systems put them everywhere. */
bool run_has_other_files(const char *folder)
{
    DIR *d = opendir(folder);
    bool found = false;
    for (struct dirent *e; d && !found && (e = readdir(d));)
        found = e->d_name[0] != '.';
    if (d)
        closedir(d);
    return found;
}

bool run_options_in(const char *folder, const char *name, const char *option)
{
    char *path = run_path(folder, name);
    FILE *f = path ? run_open(path, JSON_BYTES) : NULL;
    json_t *root = f ? json_loadf(f, JSON_REJECT_DUPLICATES, NULL) : NULL;
    const bool ours = json_is_string(json_object_get(root, "version")) &&
                      json_object_get(json_object_get(root, "options"), option);
    json_decref(root);
    if (f)
        fclose(f);
    free(path);
    return ours;
}

bool run_is_ours(const char *folder)
{
    return run_options_in(folder, "config.json", "densify-grad-threshold");
}

/* Below another folder or AT_FDCWD, and through no link: a run may come from a stranger. */
static DIR *open_folder(int at, const char *name, int links)
{
    const int fd = openat(at, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC | links);
    DIR *d = fd < 0 ? NULL : fdopendir(fd);
    if (fd >= 0 && !d)
        close(fd);
    return d;
}

/* NAME.tmpPID for a name that runs and attacks write. */
static bool is_temporary(const char *file)
{
    static const char *const names[] = {"config.json",    "summary.json", "log.jsonl",
                                        "checkpoint.bin", "cfg_args",     "cameras.json",
                                        "input.ply",      "decoy.ply",    "point_cloud.ply"};
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        const size_t n = strlen(names[i]);
        long pid;
        char rest;
        if (!strncmp(file, names[i], n) && sscanf(file + n, ".tmp%ld%c", &pid, &rest) == 1)
            return true;
    }
    return false;
}

/* What a killed process was writing into a folder. */
static void remove_temporary(DIR *d)
{
    for (struct dirent *e; (e = readdir(d));)
        if (is_temporary(e->d_name))
            unlinkat(dirfd(d), e->d_name, 0);
}

/* Leftovers in every point_cloud/iteration_N, and the model itself if asked for. */
static void clean_models(DIR *run, bool all)
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
        remove_temporary(d);
        if (all)
            unlinkat(dirfd(d), "point_cloud.ply", 0);
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
    static const char *const files[] = {"summary.json", "log.jsonl", "checkpoint.bin"};
    DIR *d = open_folder(AT_FDCWD, run, 0);
    if (!d)
        return;
    remove_temporary(d);
    for (size_t i = 0; all && i < sizeof(files) / sizeof(files[0]); i++)
        unlinkat(dirfd(d), files[i], 0);
    clean_models(d, all);
    closedir(d);
}

static bool has_model(const char *run)
{
    char *path = run_path(run, "point_cloud");
    DIR *models = path ? opendir(path) : NULL;
    bool found = !path;
    for (struct dirent *e; models && !found && (e = readdir(models));) {
        char *model = NULL;
        found =
            asprintf(&model, "%s/%s/point_cloud.ply", path, e->d_name) < 0 || !access(model, F_OK);
        free(model);
    }
    if (models)
        closedir(models);
    free(path);
    return found;
}

bool run_is_lost(const char *run)
{
    return !run_has(run, "checkpoint.bin") && !run_has(run, "summary.json") && !has_model(run);
}

void run_forget(const char *run)
{
    static const char *const files[] = {"cameras.json", "input.ply", "cfg_args", "config.json"};
    if (has_model(run) || run_has(run, "checkpoint.bin"))
        return;
    clean(run, true);
    DIR *d = open_folder(AT_FDCWD, run, 0);
    for (size_t i = 0; d && i < sizeof(files) / sizeof(files[0]); i++)
        unlinkat(dirfd(d), files[i], 0);
    if (d) {
        unlinkat(dirfd(d), "point_cloud", AT_REMOVEDIR); /* where it is empty */
        closedir(d);
    }
}

void run_clean(const char *run)
{
    clean(run, false);
}

int run_create(sg_ctx *ctx, const struct train_config *c, const struct sg_scene *scene,
               const struct sg_model *initial, const char *variant)
{
    char *cameras = run_path(c->run.folder, "cameras.json");
    int error = cameras ? sg_dir_create(ctx, c->run.folder) : SG_ERR_BUDGET, code = 0;
    if (!error) {
        clean(c->run.folder, true);
        code = run_write_config(c, variant); /* first: it marks the folder as a run's */
        error = code ? SG_OK : sg_cameras_write_json(ctx, scene, cameras);
    }
    code = error ? report(ctx, error) : code;
    if (!code)
        code = write_input(ctx, c->run.folder, initial);
    if (!code)
        code = write_cfg_args(c);
    free(cameras);
    return code;
}

int run_save_model(sg_ctx *ctx, const char *run, sg_trainer *trainer)
{
    char name[64], *path;
    snprintf(name, sizeof(name), "point_cloud/iteration_%d/point_cloud.ply",
             sg_trainer_iteration(trainer));
    struct sg_model *m = NULL;
    sg_clear_error(ctx);
    int error = sg_path_below(ctx, run, name, &path);
    if (!error) {
        char *slash = strrchr(path, '/');
        *slash = 0;
        error = sg_dir_create(ctx, path);
        *slash = '/';
    }
    if (!error)
        error = sg_trainer_model(trainer, &m);
    if (!error)
        error = sg_model_write_ply(ctx, m, path);
    sg_model_destroy(&m);
    sg_free(path);
    return error ? report(ctx, error) : 0;
}

int run_save_checkpoint(sg_ctx *ctx, const char *run, sg_trainer *trainer)
{
    char *path = run_path(run, "checkpoint.bin");
    const int error = path ? sg_trainer_save(trainer, path) : SG_ERR_BUDGET;
    free(path);
    return error ? report(ctx, error) : 0;
}

int run_read_config(sg_ctx *ctx, const char *run, struct sg_run_params *p, json_t **keep)
{
    char *path = run_path(run, "config.json");
    json_t *root = path ? run_read_json(path, "config.json of a run") : NULL;
    *keep = root;
    const int code =
        root ? report(ctx, sg_config_from_json(ctx, sg_run_config, p,
                                               json_object_get(root, "options"), true, path))
             : STATUS_INPUT;
    free(path);
    return code;
}
