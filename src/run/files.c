/* SPDX-License-Identifier: Apache-2.0 */
#include "files.h"

#include <dirent.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/file.h"
#include "core/folder.h"
#include "core/json_text.h"

/* A config or summary has a few thousand bytes. Parsing needs a hundred times as many. */
#define JSON_BYTES (256 << 10)

bool sg_run_has(sg_ctx *ctx, const char *run, const char *name)
{
    char *path = sg_strf(ctx, "%s/%s", run, name);
    const bool has = path && !access(path, F_OK);
    sg_free(path);
    return has;
}

int sg_run_check_inside(sg_ctx *ctx, const char *run, const char *name)
{
    struct sg_folder folder;
    if (!sg_dir_exists(run))
        return SG_OK;
    int code = sg_folder_open(ctx, run, false, &folder);
    char *path = code ? NULL : sg_strf(ctx, "%s/%s", run, name);
    if (!code && !path)
        code = SG_ERR_BUDGET;
    if (!code && sg_folder_leads_out(&folder, path))
        code =
            sg_fail(ctx, SG_ERR_INPUT,
                    "%s: found a link that leads out of %s, expected a file inside it", path, run);
    sg_folder_close(&folder);
    sg_free(path);
    return code;
}

int sg_run_read_file(sg_ctx *ctx, const char *run, const char *name, uint64_t most, char **path,
                     char **text, size_t *size)
{
    *path = sg_strf(ctx, "%s/%s", run, name), *text = NULL, *size = 0;
    const int code = *path ? sg_run_check_inside(ctx, run, name) : SG_ERR_BUDGET;
    return code ? code : sg_file_read(ctx, *path, most, text, size);
}

bool sg_run_has_files(const char *folder)
{
    DIR *d = opendir(folder);
    bool found = false;
    for (struct dirent *e; d && !found && (e = readdir(d));)
        found = e->d_name[0] != '.';
    if (d)
        closedir(d);
    return found;
}

int sg_no_memory(sg_ctx *ctx)
{
    return sg_fail(ctx, SG_ERR_BUDGET, "out of memory");
}

json_t *sg_number_json(double v)
{
    return v - v == 0 ? json_real(v) : json_null();
}

static int parse(sg_ctx *ctx, const char *path, const char *what, const char *text, size_t size,
                 json_t **out)
{
    json_error_t error = {0};
    /* the byte-order mark of some editors */
    const size_t skip = size >= 3 && !memcmp(text, "\xef\xbb\xbf", 3) ? 3 : 0;
    *out = json_loadb(text + skip, size - skip, JSON_REJECT_DUPLICATES, &error);
    return *out ? SG_OK
                : sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: %s; expected the %s", path, error.line,
                          error.text, what);
}

int sg_run_read_json(sg_ctx *ctx, const char *run, const char *name, const char *what, json_t **out)
{
    char *path, *text;
    size_t size;
    *out = NULL;
    int code = sg_run_read_file(ctx, run, name, JSON_BYTES, &path, &text, &size);
    if (!code)
        code = parse(ctx, path, what, text, size, out);
    if (!code)
        sg_bytes_from_json(json_object_get(*out, "options"));
    sg_free(text);
    sg_free(path);
    return code;
}

int sg_run_read_large_json(sg_ctx *ctx, const char *run, const char *name, const char *what,
                           size_t bytes, void **room, json_t **out)
{
    char *path, *text;
    size_t size;
    *out = NULL, *room = NULL;
    int code = sg_run_read_file(ctx, run, name, bytes, &path, &text, &size);
    if (!code)
        code = sg_json_reserve(ctx, text, size, room);
    if (!code)
        code = parse(ctx, path, what, text, size, out);
    sg_free(text);
    sg_free(path);
    return code;
}

int sg_run_write_json(sg_ctx *ctx, const char *run, const char *name, json_t *value)
{
    char *path = sg_strf(ctx, "%s/%s", run, name);
    char *text = value ? json_dumps(value, JSON_INDENT(2) | JSON_REAL_PRECISION(15)) : NULL;
    int code = !path ? SG_ERR_BUDGET : text ? SG_OK : sg_no_memory(ctx);
    if (!code) {
        const size_t n = strlen(text);
        text[n] = '\n'; /* in place of the final zero: the length is passed on */
        code = sg_file_write(ctx, path, text, n + 1);
    }
    free(text);
    sg_free(path);
    json_decref(value);
    return code;
}

char *sg_run_exposure_key(sg_ctx *ctx, const char *name)
{
    json_t *value = sg_bytes_to_json(name);
    const char *coded = json_string_value(json_object_get(value, "percent"));
    char *key = !value ? NULL : coded ? sg_strf(ctx, "/%s", coded) : sg_strdup(ctx, name);
    if (!value)
        sg_no_memory(ctx);
    json_decref(value);
    return key;
}

json_t *sg_place_json(const char *folder)
{
    char *absolute = realpath(folder, NULL);
    json_t *value = sg_bytes_to_json(absolute ? absolute : folder);
    free(absolute);
    return value ? value : json_null();
}

bool sg_run_has_option(sg_ctx *ctx, const char *run, const char *name, const char *option)
{
    json_t *root = NULL;
    const bool before = sg_failed(ctx);
    sg_run_read_json(ctx, run, name, "config.json", &root);
    if (!before) /* no error: the answer is "no" */
        sg_clear_error(ctx);
    const bool ours = json_is_string(json_object_get(root, "version")) &&
                      json_object_get(json_object_get(root, "options"), option);
    json_decref(root);
    return ours;
}

int sg_run_name_checkpoint(sg_ctx *ctx, int code, const char *folder, const char *name,
                           int iteration)
{
    char *why = sg_strdup(ctx, sg_last_error(ctx));
    sg_clear_error(ctx);
    code = sg_fail(ctx, code, "%s; %s/%s of iteration %d is kept: a resumed run goes on from it",
                   why ? why : "internal error", folder, name, iteration);
    sg_free(why);
    return code;
}
