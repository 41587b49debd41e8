/* SPDX-License-Identifier: Apache-2.0 */

#include "commands.h"
#include "interrupt.h"

struct smooth_config {
    struct sg_scene_params scene;
    struct sg_poison_files files;
    const char *output;
    uint64_t max_memory;
    int views, threads;
    bool quiet;
};

#define M(field) offsetof(struct smooth_config, field)

static const struct sg_option smooth_options[] = {
    TEXT_ROW("output", M(output), "SMOOTHED", "Folder to write the smoothed scene to.",
             .group = "Files", .letter = 'o'),
    CHOICE_ROW("views", M(views), "all|train", "WHICH",
               "Smooth all views of COLMAP and nerfstudio scenes, or leave the test views as they "
               "are. Blender's test file always stays.",
               .group = "Files"),
    CHOICE_ROW("save", M(files.save), "auto|png|jpg", "FORMAT",
               "auto: JPEG for COLMAP scenes, else PNG.", .group = "Files"),
    NUMBER_ROW("jpeg-quality", SG_OPTION_INT, M(files.jpeg_quality), 1, 100, "N", "JPEG quality.",
               .group = "Files"),
    NUMBER_ROW("threads", SG_OPTION_INT, M(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU.", .group = "Files", .letter = 'j'),
    MEMORY_ROW(struct smooth_config, max_memory, .group = "Files"),
    FLAG_ROW("quiet", M(quiet), "Warnings only.", .group = "Files", .letter = 'q'),
    {0},
};

static const struct option_part smooth_parts[] = {{sg_scene_options, M(scene), "test-halves"}, {0}};

static void defaults(void *config)
{
    struct smooth_config *c = config;
    *c = (struct smooth_config){.scene = sg_scene_params_default(),
                                .files = sg_poison_files_default()};
    c->files.jpeg_quality = 95;
    c->scene.smooth = SG_SMOOTH_GAUSSIAN;
}

static int write_scene(sg_ctx *ctx, const struct sg_scene *scene, const struct smooth_config *c)
{
    int error = sg_poisoned_scene_begin(ctx, scene, &c->files, c->output);
    for (size_t k = 0; k < scene->n_train + scene->n_test && !error; k++) {
        const struct sg_view *view =
            k < scene->n_test ? &scene->test[k] : &scene->train[k - scene->n_test];
        if (interrupted())
            return SG_ERR_INTERRUPTED;
        const uint8_t *rgb;
        if ((error = sg_view_pixels(ctx, view, &rgb)))
            break;
        error = sg_poisoned_scene_image(ctx, scene, view, &c->files, c->output, rgb, NULL);
        sg_view_release(view);
    }
    return error ? error : sg_poisoned_scene_finish(ctx, scene, &c->files, c->output);
}

static int run_smooth(const void *config, const bool *given, const char *const *positional,
                      int count)
{
    (void) count;
    struct smooth_config copy = *(const struct smooth_config *) config, *c = &copy;
    struct sg_scene *scene = NULL;
    sg_output *output = NULL;
    sg_ctx *ctx = NULL;
    if (!c->output)
        return missing(&command_smooth, "-o SMOOTHED");
    if (c->scene.smooth == SG_SMOOTH_OFF) {
        say(stderr, "splatguard smooth: --smooth: found off, expected a filter\n");
        return STATUS_USAGE;
    }
    if (c->files.save == SG_POISON_PNG &&
        options_given(&command_smooth, given, M(files.jpeg_quality)))
        warn_unused("jpeg-quality", "with --save png");
    c->scene.eval = c->views == 1;
    if (!c->scene.eval && options_given(&command_smooth, given, M(scene.test_every)))
        warn_unused("test-every", "without --views train");
    const int code = open_context(&ctx, c->threads, c->max_memory, c->quiet);
    if (code)
        return code;
    const char *const inputs[] = {positional[0], NULL};
    interrupt_catch();
    /* What an interrupted one has left is not a scene yet, and is completed. A scene is refused. */
    int error = sg_output_claim(ctx, c->output, "smooth", true, inputs, &output);
    if (!error)
        error = sg_poisoned_scene_load(ctx, positional[0], &c->scene, &scene);
    if (!error && c->files.save == SG_POISON_AUTO && scene->format != SG_FORMAT_COLMAP &&
        options_given(&command_smooth, given, M(files.jpeg_quality)))
        warn_unused("jpeg-quality", "with --save auto, which is PNG for this scene");
    if (!error)
        error = write_scene(ctx, scene, c);
    const int status = report_option(ctx, &command_smooth, error);
    if (!status && !c->quiet)
        say(stderr, "%zu photos written to %s\n", scene->n_train + scene->n_test, c->output);
    sg_scene_destroy(&scene);
    sg_output_release(&output);
    sg_ctx_destroy(&ctx);
    return status;
}

const struct command command_smooth = {
    .name = "smooth",
    .arguments = "SCENE -o SMOOTHED [options]",
    .summary = "Writes a copy of a scene with smoothed photos.",
    .description =
        "Makes a copy of SCENE, in its own layout, whose photos a filter has smoothed: "
        "the same photos as `train --smooth` makes while it loads them, with --save png and "
        "--views train.",
    .groups = "Defense|Files|Scene",
    .options = smooth_options,
    .parts = smooth_parts,
    .config_size = sizeof(struct smooth_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = 1,
    .run = run_smooth,
};
