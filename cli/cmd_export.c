/* SPDX-License-Identifier: Apache-2.0 */
#include "interrupt.h"
#include "model_views.h"

struct export_config {
    struct model_options m;
    bool view_independent;
};

static const struct sg_option export_options[] = {
    FLAG_ROW("view-independent", offsetof(struct export_config, view_independent),
             "Gaussians that look the same from everywhere, as the mean over the views.",
             .group = "Output"),
    MODEL_UNDRAWN_ROWS(struct export_config),
    {0},
};

/* The Gaussians of the views are collected on the CPU, and none is drawn. */
static const struct option_part export_parts[] = {
    {sg_scene_options, offsetof(struct export_config, m.scene), "smooth|white-background"},
    {sg_render_options, offsetof(struct export_config, m.render),
     "max-instances|mip-kernel|reference-tiles"},
    {0},
};

static void defaults(void *config)
{
    *(struct export_config *) config = (struct export_config){.m = model_options_default()};
    ((struct export_config *) config)->m.split = 1;
    ((struct export_config *) config)->m.engine = NULL;
}

static int run_export(const void *config, const bool *given, const char *const *positional,
                      int count)
{
    (void) count;
    struct export_config copy = *(const struct export_config *) config, *c = &copy;
    struct model_views v;
    struct sg_model *baked = NULL;
    const char *out = positional[1];
    struct sg_model_file file = sg_model_file_default();
    if (!c->view_independent)
        return missing(&command_export, "--view-independent, the only way of export so far");
    if (choose_format(&command_export, out, &file.format))
        return STATUS_USAGE;
    interrupt_catch();
    int code = model_views_find(&v, positional[0], &command_export, given, c, &c->m);
    if (!code)
        code = report(v.ctx, sg_output_check_file(v.ctx, out));
    if (!code)
        code = model_views_load(&v, &command_export, given, c, &c->m);
    if (!code && sg_model_gaussians(v.model) == v.model->count) {
        say(stderr,
            "splatguard export: %s: found Gaussians, expected anchors (train --model scaffold); "
            "convert writes such a model\n",
            positional[0]);
        code = STATUS_INPUT;
    }
    if (!code) {
        int error =
            sg_model_bake(v.ctx, v.model, v.views, v.n, v.eval.appearances ? v.photos : NULL,
                          c->m.render.appearance, &baked);
        if (!error && interrupted())
            error = SG_ERR_INTERRUPTED;
        if (!error)
            error = sg_model_write(v.ctx, baked, out, &file);
        code = report_model(v.ctx, positional[0], error);
    }
    if (!code && !c->m.quiet)
        say(stdout,
            "%s: %zu Gaussians, the mean of those that %zu views made of %zu anchors\n"
            "lost: how opacities, sizes and colours change with the direction of view\n",
            out, baked->count, v.n, v.model->count);
    if (v.ctx)
        sg_model_destroy(&baked);
    model_views_close(&v);
    return code;
}

static const struct option_hint export_hints[] = {
    {"o", "OUT is named without an option: export RUN|MODEL OUT"},
    {"output", "OUT is named without an option: export RUN|MODEL OUT"},
    {0},
};

const struct command command_export = {
    .name = "export",
    .arguments = "RUN|MODEL OUT --view-independent [options]",
    .summary = "Makes a model for other viewers from a run with --model scaffold.",
    .description =
        "Scaffold-GS makes its Gaussians for each view anew. This writes one Gaussian for each of "
        "those that the training views drew, with the means of opacity, size, rotation and colour, "
        "as a model of SH degree 0. OUT is new and ends as those of convert do. What depends on "
        "the direction of view is lost, and with it quality: eval measures how much.",
    .groups = "Output|" MODEL_GROUPS,
    .options = export_options,
    .parts = export_parts,
    .hints = export_hints,
    .config_size = sizeof(struct export_config),
    .defaults = defaults,
    .min_positional = 2,
    .max_positional = 2,
    .run = run_export,
};
