/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <limits.h>

#include "info_scene.h"

struct info_config {
    struct sg_scene_params scene;
    bool json, devices;
    int threads;
    uint64_t max_memory;
};

static const struct sg_option info_options[] = {
    FLAG_ROW("json", offsetof(struct info_config, json), "Print one JSON object.",
             .group = "Output"),
    FLAG_ROW("devices", offsetof(struct info_config, devices),
             "List the engines, CPU variants and Vulkan devices.", .group = "Output"),
    NUMBER_ROW("threads", SG_OPTION_INT, offsetof(struct info_config, threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU.", .group = "Output", .letter = 'j'),
    MEMORY_ROW(struct info_config, max_memory, .group = "Output"),
    {0},
};

static const struct option_part info_parts[] = {
    {sg_scene_options, offsetof(struct info_config, scene), "test-halves|white-background|smooth"},
    {0}};

static void defaults(void *config)
{
    *(struct info_config *) config = (struct info_config){.scene = sg_scene_params_default()};
}

static int print_json(const struct sg_model_info *i, uint64_t gaussians)
{
    json_t *first = i->nonfinite
                        ? json_pack("{s:I,s:s}", "gaussian", (json_int_t) i->first_nonfinite,
                                    "property", i->first_property)
                        : json_null();
    json_t *root = json_pack(
        "{s:I,s:i,s:o,s:o,s:o,s:o,s:I,s:o,s:I,s:I}", "gaussians", (json_int_t) gaussians,
        "sh_degree", i->sh_degree, "min", numbers_json(i->min, 3), "max", numbers_json(i->max, 3),
        "scale_percentiles", numbers_json(i->scale_percentile, 5), "opacity_percentiles",
        numbers_json(i->opacity_percentile, 5), "nonfinite", (json_int_t) i->nonfinite,
        "first_nonfinite", first, "zero_rotation", (json_int_t) i->zero_rotation, "transparent",
        (json_int_t) i->transparent);
    if (gaussians > i->count) { /* opacities are made in a view */
        json_object_set_new(root, "anchors", json_integer((json_int_t) i->count));
        json_object_set_new(root, "opacity_percentiles", json_null());
        json_object_set_new(root, "transparent", json_null());
    }
    return json_print(root, 0);
}

static void print_percentiles(const char *title, const double *values)
{
    printf("  %-10s", title);
    for (int k = 0; k < 5; k++)
        if (values[k] - values[k] == 0)
            printf(" %-10.4g", values[k]);
        else
            printf(" %-10s", "-");
    printf("\n");
}

static void print_text(const char *path, const struct sg_model_info *i, uint64_t gaussians)
{
    say(stdout, "%s\n", path);
    if (gaussians > i->count)
        printf("  anchors    %zu, of which networks make up to %" PRIu64 " Gaussians in a view\n",
               i->count, gaussians);
    else
        printf("  Gaussians  %zu, SH degree %d\n", i->count, i->sh_degree);
    if (i->min[0] <= i->max[0])
        printf("  bounds     x %.4g .. %.4g, y %.4g .. %.4g, z %.4g .. %.4g\n", i->min[0],
               i->max[0], i->min[1], i->max[1], i->min[2], i->max[2]);
    else
        printf("  bounds     none: no position is finite\n");
    printf("  percentile       1 %%        25 %%       50 %%       75 %%       99 %%\n");
    print_percentiles(gaussians > i->count ? "offsets" : "scale", i->scale_percentile);
    if (gaussians == i->count) /* those of anchors are made in a view */
        print_percentiles("opacity", i->opacity_percentile);
    if (i->nonfinite)
        printf("  broken     %zu Gaussians hold a NaN or an infinity, the first is Gaussian %zu "
               "(%s)\n",
               i->nonfinite, i->first_nonfinite, i->first_property);
    if (i->zero_rotation)
        printf("  broken     %zu Gaussians have a rotation of length 0\n", i->zero_rotation);
    if (i->transparent)
        printf("  unused     %zu Gaussians have an opacity below 1/255 and are never drawn\n",
               i->transparent);
}

#define MOST_DEVICES 16

static void print_device(size_t number, const struct sg_device_info *d)
{
    printf("vulkan:%zu %s, driver %s, %.1f GB, %.1f free%s%s%s\n", number, d->name, d->driver,
           (double) d->memory / 1e9, (double) d->memory_free / 1e9, d->missing ? "; lacks " : "",
           d->missing ? d->missing : "", d->cpu ? "; on the CPU: used by name only" : "");
}

static json_t *device_json(size_t number, const struct sg_device_info *d)
{
    return json_pack("{s:s,s:I,s:s,s:s,s:I,s:I,s:b,s:b,s:s?}", "engine", "vulkan", "number",
                     (json_int_t) number, "name", d->name, "driver", d->driver, "memory",
                     (json_int_t) d->memory, "memory_free", (json_int_t) d->memory_free, "cpu",
                     (int) d->cpu, "available", (int) !d->missing, "missing", d->missing);
}

static int print_devices(bool json)
{
    struct sg_engine_info e;
    struct sg_device_info devices[MOST_DEVICES];
    const char *missing;
    const size_t n = sg_device_list(devices, MOST_DEVICES, &missing);
    json_t *list = json_array();
    for (size_t i = 0; sg_engine_list(i, &e); i++) {
        json_array_append_new(list, json_pack("{s:s,s:s?,s:s,s:b,s:b,s:s?}", "engine", e.engine,
                                              "variant", e.variant, "description", e.description,
                                              "available", (int) e.available, "chosen",
                                              (int) e.chosen, "missing", e.missing));
        if (!json)
            printf("%-6s %-9s %s%s%s%s\n", e.engine, e.variant ? e.variant : "-", e.description,
                   e.missing ? "; this machine lacks " : "", e.missing ? e.missing : "",
                   e.chosen && e.variant ? "; chosen" : "");
    }
    for (size_t i = 0; i < n; i++) {
        json_array_append_new(list, device_json(i, &devices[i]));
        if (!json)
            print_device(i, &devices[i]);
    }
    if (json)
        return json_print(list, 0);
    json_decref(list);
    return 0;
}

static int info_model(sg_ctx *ctx, const char *place, bool json)
{
    struct sg_model *model = NULL;
    struct sg_model_info info;
    char path[PATH_MAX];
    int error = sg_run_find_model(ctx, place, 0, path, sizeof(path));
    if (!error)
        error = sg_model_read_drawable(ctx, path, UINT32_MAX, &model);
    if (!error)
        error = sg_model_inspect(ctx, model, &info);
    int status = report(ctx, error);
    if (!status && json)
        status = print_json(&info, sg_model_gaussians(model));
    else if (!status)
        print_text(path, &info, sg_model_gaussians(model));
    if (!status) /* printed in full, but of no use */
        status = report(ctx, sg_model_check(ctx, model, path));
    sg_model_destroy(&model);
    return status;
}

static int run_info(const void *config, const bool *given, const char *const *positional, int count)
{
    const struct info_config *c = config;
    const char *of_scene = options_given_of(&command_info, given, &info_parts[0], NULL);
    if (c->devices && count)
        say(stderr, "splatguard info: found %s and --devices, expected one of them\n",
            positional[0]);
    else if (!c->devices && !count)
        say(stderr, "splatguard info: missing argument: a run, a model, a scene, or --devices\n");
    if (c->devices == (count > 0))
        return STATUS_USAGE;
    const char *place = c->devices ? "--devices" : positional[0];
    if (of_scene && (c->devices || !is_scene(place))) {
        say(stderr, "splatguard info: --%s: found without effect on %s, expected a scene\n",
            of_scene, place);
        return STATUS_USAGE;
    }
    const bool limited =
        options_given(&command_info, given, offsetof(struct info_config, max_memory));
    if (c->devices &&
        (limited || options_given(&command_info, given, offsetof(struct info_config, threads)))) {
        say(stderr, "splatguard info: --%s: found without effect on --devices\n",
            limited ? "max-memory" : "threads");
        return STATUS_USAGE;
    }
    if (c->devices)
        return print_devices(c->json);
    sg_ctx *ctx;
    int status = open_context(&ctx, c->threads, c->max_memory, true);
    if (status)
        return status;
    if (is_scene(place))
        status = info_scene(ctx, place, c->scene, c->json);
    else
        status = info_model(ctx, place, c->json);
    sg_ctx_destroy(&ctx);
    return status;
}

const struct command command_info = {
    .name = "info",
    .arguments = "RUN|MODEL|SCENE [options]  or  --devices",
    .summary = "Says what is in a model or a scene and what is wrong with it.",
    .description =
        "Of a model: count, SH degree, bounds and percentiles of scale and opacity. A file that "
        "cannot be read is refused with the place and the reason. A model with values that are not "
        "finite is described too, with exit status 2; it can only be converted to .ply. Of a "
        "scene: its layout, views, sizes, masks, points and cameras, as train would load them, and "
        "a warning for photos that would be skipped. With --devices: the engines and CPU variants "
        "of this build, and whether this machine runs them; and the devices that the engine vulkan "
        "finds, by number, name, driver and memory.",
    .groups = "Output|Scene",
    .options = info_options,
    .parts = info_parts,
    .config_size = sizeof(struct info_config),
    .defaults = defaults,
    .min_positional = 0,
    .max_positional = 1,
    .run = run_info,
};
