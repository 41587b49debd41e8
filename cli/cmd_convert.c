/* SPDX-License-Identifier: Apache-2.0 */
#include <limits.h>
#include <stdlib.h>

#include "commands.h"
#include "interrupt.h"

struct convert_config {
    struct sg_model_selection selection;
    struct sg_model_file file;
    const char *crop;
    uint64_t max_memory;
    int iteration;
    bool quiet;
};

#define M(field) offsetof(struct convert_config, field)

static const struct sg_option convert_options[] = {
    CHOICE_ROW("format", M(file.format), "auto|ply|compressed-ply|splat|spz|ksplat|sog|glb",
               "FORMAT", "Format of OUT; auto: by its ending. ksplat can only be read.",
               .group = "Output"),
    NUMBER_ROW("spz-version", SG_OPTION_INT, M(file.spz_version), 2, 4, "N",
               "Version of .spz; 2 has coarse rotations, but older programs read it; 4 is smaller.",
               .group = "Output"),
    NUMBER_ROW("sh-degree", SG_OPTION_INT, M(selection.sh_degree), 0, 3, "N",
               "Keep spherical harmonics up to this degree.", .group = "Selection"),
    TEXT_ROW("crop", M(crop), "BOX",
             "Keep the Gaussians with their centre in the box X0,Y0,Z0,X1,Y1,Z1 (scene units).",
             .group = "Selection"),
    NUMBER_ROW("min-opacity", SG_OPTION_DOUBLE, M(selection.min_opacity), 0, 1, "A",
               "Keep the Gaussians of at least this opacity.", .group = "Selection"),
    NUMBER_ROW("iteration", SG_OPTION_INT, M(iteration), 0, 10000000, "N",
               "The run's model after this iteration; 0 = the newest.", .group = "Output"),
    MEMORY_ROW(struct convert_config, max_memory, .group = "Output"),
    FLAG_ROW("quiet", M(quiet), "Warnings only.", .group = "Output", .letter = 'q'),
    {0},
};

static void defaults(void *config)
{
    *(struct convert_config *) config = (struct convert_config){
        .selection = sg_model_selection_default(), .file = sg_model_file_default()};
}

static bool parse_box(const char *text, struct sg_model_selection *s)
{
    double value[6];
    for (int k = 0; k < 6; k++) {
        char *end;
        value[k] = strtod(text, &end);
        if (end == text || *end != (k < 5 ? ',' : 0))
            return false;
        text = end + 1;
    }
    s->crop = true;
    for (int k = 0; k < 3; k++) {
        s->low[k] = value[k], s->high[k] = value[3 + k];
        if (!(s->low[k] <= s->high[k]))
            return false;
    }
    return true;
}

static int run_convert(const void *config, const bool *given, const char *const *positional,
                       int count)
{
    (void) count;
    struct convert_config copy = *(const struct convert_config *) config, *c = &copy;
    const char *out = positional[1];
    struct sg_model *model = NULL, *kept = NULL;
    sg_ctx *ctx = NULL;
    char path[PATH_MAX] = "";
    if (c->crop && !parse_box(c->crop, &c->selection)) {
        say(stderr,
            "splatguard convert: --crop: found \"%s\", expected six numbers X0,Y0,Z0,X1,Y1,Z1 with "
            "X0 <= X1, Y0 <= Y1 and Z0 <= Z1\n",
            c->crop);
        return STATUS_USAGE;
    }
    if (check_iteration(&command_convert, positional[0], c->iteration))
        return STATUS_USAGE;
    if (choose_format(&command_convert, out, &c->file.format))
        return STATUS_USAGE;
    if (options_given(&command_convert, given, M(file.spz_version)) &&
        c->file.format != SG_MODEL_SPZ) {
        say(stderr,
            "splatguard convert: --spz-version: found without effect on the format %s, expected "
            "spz\n",
            sg_model_format_name(c->file.format));
        return STATUS_USAGE;
    }
    const int code = open_context(&ctx, 0, c->max_memory, c->quiet);
    if (code)
        return code;
    interrupt_catch();
    int error = sg_run_find_model(ctx, positional[0], c->iteration, path, sizeof(path));
    if (!error)
        error = sg_output_check_file(ctx, out);
    if (!error)
        error = sg_model_read(ctx, path, UINT32_MAX, &model);
    if (!error)
        error = sg_model_select(ctx, model, &c->selection, &kept);
    const size_t before = model ? model->count : 0;
    sg_model_destroy(&model);
    if (!error && kept->count == before && c->file.format != SG_MODEL_PLY) /* which keeps NaN */
        error = sg_model_check(ctx, kept, path);
    if (!error && interrupted())
        error = SG_ERR_INTERRUPTED;
    if (!error)
        error = sg_model_write(ctx, kept, out, &c->file);
    if (!error && !c->quiet)
        say(stdout, "%s: %zu of %zu Gaussians, SH degree %d, %s\n", out, kept->count, before,
            c->file.format == SG_MODEL_SPLAT ? 0 : kept->sh_degree, /* it has colours only */
            sg_model_format_name(c->file.format));
    const int status = report_model(ctx, path, error);
    sg_model_destroy(&kept);
    sg_ctx_destroy(&ctx);
    return status;
}

static const struct option_hint convert_hints[] = {
    {"o", "OUT is named without an option: convert RUN|MODEL OUT"},
    {"output", "OUT is named without an option: convert RUN|MODEL OUT"},
    {0},
};

const struct command command_convert = {
    .name = "convert",
    .arguments = "RUN|MODEL OUT [options]",
    .summary = "Converts a model between file formats, or keeps a part of it.",
    .description =
        "Reads .ply, compressed .ply of SuperSplat, .splat, .spz, .ksplat or .sog, recognised by "
        "content where the format has a mark, and writes .ply, .compressed.ply, .splat, .spz, "
        ".sog or .glb (glTF with KHR_gaussian_splatting). Formats but .ply and .glb round; "
        "docs/formats.md has how much. OUT must be new.",
    .groups = "Selection|Output",
    .options = convert_options,
    .hints = convert_hints,
    .config_size = sizeof(struct convert_config),
    .defaults = defaults,
    .min_positional = 2,
    .max_positional = 2,
    .run = run_convert,
};
