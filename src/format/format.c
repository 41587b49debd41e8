/* SPDX-License-Identifier: Apache-2.0 */
/* Recognises model files and hands them to their readers and writers. */
#include <strings.h>

#include "codec.h"
#include "core/file.h"
#include "model/anchors.h"

/* Far more than the 4 billion Gaussians of a model take in any format. */
#define MAX_BYTES ((uint64_t) 1 << 40)

static const struct {
    const char *name, *ending;
} formats[SG_MODEL_FORMATS] = {
    [SG_MODEL_AUTO] = {"auto", NULL},
    [SG_MODEL_PLY] = {"ply", ".ply"},
    [SG_MODEL_SPLAT] = {"splat", ".splat"},
    [SG_MODEL_SPZ] = {"spz", ".spz"},
    [SG_MODEL_KSPLAT] = {"ksplat", ".ksplat"},
    [SG_MODEL_SOG] = {"sog", ".sog"},
    [SG_MODEL_GLB] = {"glb", ".glb"},
    [SG_MODEL_COMPRESSED_PLY] = {"compressed-ply", ".compressed.ply"},
};

const char *sg_model_format_name(enum sg_model_format format)
{
    return format >= 0 && format < SG_MODEL_FORMATS ? formats[format].name : "unknown";
}

static bool ends_with(const char *text, const char *end)
{
    const size_t n = strlen(text), m = strlen(end);
    return n > m && !strcasecmp(text + n - m, end);
}

enum sg_model_format sg_model_format_of(const char *path)
{
    int found = SG_MODEL_AUTO;
    for (int f = 1; f < SG_MODEL_FORMATS; f++) /* .compressed.ply is longer than .ply */
        if (ends_with(path, formats[f].ending) &&
            (!found || strlen(formats[f].ending) > strlen(formats[found].ending)))
            found = f;
    return (enum sg_model_format) found;
}

struct sg_model_file sg_model_file_default(void)
{
    return (struct sg_model_file){SG_MODEL_FILE_DEFAULTS};
}

static bool starts_with(struct sg_source *in, const char *bytes, size_t n)
{
    const char *start = sg_source_peek(in, n);
    return start && !memcmp(start, bytes, n);
}

/* A .splat file begins with any float, so all that is fixed in a header of gzip has to be there: as
 * floats these are of no scene. */
static bool is_gzip(struct sg_source *in)
{
    const char *start = sg_source_peek(in, 4);
    return start && !memcmp(start, "\x1f\x8b\x08", 3) && !(start[3] & 0xe0);
}

/* A text that only headers of compressed PLY files have. */
static bool is_compressed_ply(struct sg_source *in)
{
    static const char *const marks[] = {"property uint packed_position",
                                        "property uint32 packed_position"};
    const size_t filled = sg_source_fill(in, 4096), n = filled < 4096 ? filled : 4096;
    return memmem(in->window, n, marks[0], strlen(marks[0])) ||
           memmem(in->window, n, marks[1], strlen(marks[1]));
}

static int read_from(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                     struct sg_model **out)
{
    const enum sg_model_format named = sg_model_format_of(in->path);
    if (is_gzip(in) || starts_with(in, "NGSP", 4))
        return sg_spz_read(ctx, in, max_gaussians, out);
    if (starts_with(in, "PK\3\4", 4))
        return sg_sog_read(ctx, in, max_gaussians, out);
    if (starts_with(in, "glTF\2\0\0", 8))
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: found glTF, expected .ply, .compressed.ply, .splat, .spz, .ksplat or .sog",
            in->path);
    if (!sg_ply_is_marked(in)) { /* these have no mark */
        if (named == SG_MODEL_KSPLAT)
            return sg_ksplat_read(ctx, in, max_gaussians, out);
        if (named == SG_MODEL_SPLAT)
            return sg_splat_read(ctx, in, max_gaussians, out);
    }
    return is_compressed_ply(in) ? sg_compressed_ply_read(ctx, in, max_gaussians, out)
                                 : sg_ply_read_model(ctx, in, max_gaussians, out);
}

int sg_model_read(sg_ctx *ctx, const char *path, uint64_t max_gaussians, struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    struct sg_source in;
    int code = sg_source_open(ctx, &in, path, MAX_BYTES);
    if (!code)
        code = read_from(ctx, &in, max_gaussians, out);
    sg_source_close(&in);
    return code;
}

int sg_model_read_drawable(sg_ctx *ctx, const char *path, uint64_t max_gaussians,
                           struct sg_model **out)
{
    sg_clear_error(ctx);
    bool anchors;
    *out = NULL;
    const int code = sg_anchors_recognise(ctx, path, &anchors);
    return code      ? code
           : anchors ? sg_anchors_read(ctx, path, max_gaussians, out)
                     : sg_model_read(ctx, path, max_gaussians, out);
}

static int check_file(sg_ctx *ctx, const char *path, const struct sg_model_file *file)
{
    if (file->format == SG_MODEL_KSPLAT)
        return sg_fail(ctx, SG_ERR_USAGE, "%s: found format %s, which is only read", path,
                       formats[file->format].name);
    if (file->format <= SG_MODEL_AUTO || file->format >= SG_MODEL_FORMATS)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "%s: found no format, expected a name that ends with .ply, "
                       ".compressed.ply, .splat, .spz, .sog or .glb",
                       path);
    if (file->spz_version < 2 || file->spz_version > 4)
        return sg_fail(ctx, SG_ERR_USAGE, "spz_version: found %d, expected 2 to 4",
                       file->spz_version);
    return SG_OK;
}

/* The readers must take what was written. */
static int check_packed(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path)
{
    const off_t size = ftello(f);
    return size < 0 || ferror(f) || m->count / SG_GAUSSIANS_A_BYTE <= (uint64_t) size
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INPUT,
                         "%s: found %zu Gaussians so much alike that %lld bytes hold them, "
                         "expected at most %d for a byte in this format",
                         path, m->count, (long long) size, SG_GAUSSIANS_A_BYTE);
}

int sg_model_write(sg_ctx *ctx, const struct sg_model *m, const char *path,
                   const struct sg_model_file *file)
{
    sg_clear_error(ctx);
    struct sg_model_file choice = file ? *file : sg_model_file_default();
    struct sg_file_writer w = {0};
    if (choice.format == SG_MODEL_AUTO)
        choice.format = sg_model_format_of(path);
    int code = check_file(ctx, path, &choice);
    if (!code && choice.format == SG_MODEL_PLY)
        return sg_model_write_ply(ctx, m, path);
    if (!code)
        code = sg_model_refuse_anchors(ctx, m);
    if (!code)
        code = sg_model_check(ctx, m, "model");
    if (!code)
        code = sg_file_create(ctx, &w, path);
    if (code)
        return code;
    if (choice.format == SG_MODEL_COMPRESSED_PLY)
        code = sg_compressed_ply_write(ctx, m, w.stream);
    else if (choice.format == SG_MODEL_SPLAT)
        code = sg_splat_write(m, w.stream);
    else if (choice.format == SG_MODEL_SPZ)
        code = sg_spz_write(ctx, m, w.stream, path, choice.spz_version);
    else if (choice.format == SG_MODEL_SOG)
        code = sg_sog_write(ctx, m, w.stream, path);
    else
        code = sg_glb_write(ctx, m, w.stream, path);
    if (!code && (choice.format == SG_MODEL_SOG ||
                  (choice.format == SG_MODEL_SPZ && choice.spz_version == 4)))
        code = check_packed(ctx, m, w.stream, path);
    if (!code)
        code = sg_file_commit(ctx, &w);
    sg_file_abandon(&w);
    return code;
}
