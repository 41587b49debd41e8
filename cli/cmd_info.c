/* SPDX-License-Identifier: Apache-2.0 */
#include <stdlib.h>

#include "commands.h"

struct info_config {
    bool json;
};

static const struct option info_options[] = {
    GROUP_ROW("Output"),
    FLAG_ROW("json", offsetof(struct info_config, json), "Print one JSON object.", .transient = true),
    {0},
};

static const struct info_config defaults = {0};

static int print_json(const struct sg_model_info *i)
{
    json_t *root =
        json_pack("{s:I,s:i,s:o,s:o,s:o,s:o,s:I,s:I,s:I}", "gaussians", (json_int_t) i->count, "sh_degree",
                  i->sh_degree, "min", numbers_json(i->min, 3), "max", numbers_json(i->max, 3), "scale_percentiles",
                  numbers_json(i->scale_percentile, 5), "opacity_percentiles", numbers_json(i->opacity_percentile, 5),
                  "nonfinite", (json_int_t) i->nonfinite, "zero_rotation", (json_int_t) i->zero_rotation, "transparent",
                  (json_int_t) i->transparent);
    return json_print(root, 0);
}

static void print_text(const char *path, const struct sg_model_info *i)
{
    const double *s = i->scale_percentile, *o = i->opacity_percentile;
    printf("%s\n  Gaussians  %zu, SH degree %d\n", path, i->count, i->sh_degree);
    printf("  bounds     x %.4g .. %.4g, y %.4g .. %.4g, z %.4g .. %.4g\n", i->min[0], i->max[0], i->min[1], i->max[1],
           i->min[2], i->max[2]);
    printf("  percentile       1 %%        25 %%       50 %%       75 %%       99 %%\n");
    printf("  scale      %-10.4g %-10.4g %-10.4g %-10.4g %-10.4g\n", s[0], s[1], s[2], s[3], s[4]);
    printf("  opacity    %-10.4g %-10.4g %-10.4g %-10.4g %-10.4g\n", o[0], o[1], o[2], o[3], o[4]);
    if (i->nonfinite)
        printf("  broken     %zu Gaussians hold a NaN or an infinity and are never drawn\n", i->nonfinite);
    if (i->zero_rotation)
        printf("  broken     %zu Gaussians have a rotation of length 0\n", i->zero_rotation);
    if (i->transparent)
        printf("  unused     %zu Gaussians have an opacity below 1/255 and are never drawn\n", i->transparent);
}

static int run_info(const void *config, const bool *given, const char *const *positional, int count)
{
    (void) given, (void) count;
    const struct info_config *c = config;
    sg_ctx *ctx;
    struct sg_model *model = NULL;
    struct sg_model_info info;
    char *path = find_model(positional[0], 0);
    int code = path ? open_context(&ctx, 1, 0, true) : 2;
    if (!code) {
        int error = sg_model_read_ply(ctx, path, UINT32_MAX, &model);
        if (!error)
            error = sg_model_inspect(ctx, model, &info);
        if (error)
            code = report(ctx, error);
        else if (c->json)
            code = print_json(&info);
        else
            print_text(path, &info);
        sg_model_destroy(&model);
        sg_ctx_destroy(&ctx);
    }
    free(path);
    return code;
}

const struct command command_info = {
    .name = "info",
    .arguments = "RUN|MODEL.ply [--json]",
    .summary = "Says what is in a model and what is wrong with it.",
    .description =
        "Prints count, SH degree, bounds and percentiles of scale and opacity. A file that cannot be read is "
        "refused with the place and the reason.",
    .options = info_options,
    .config_size = sizeof(struct info_config),
    .defaults = &defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_info,
};
