/* SPDX-License-Identifier: Apache-2.0 */
#include "commands.h"
#include "interrupt.h"

struct synth_config {
    struct sg_synth_params p;
    const char *output;
    int threads;
    bool quiet;
};

#define S(field) offsetof(struct synth_config, field)
static const struct sg_option synth_options[] = {
    TEXT_ROW("output", S(output), "DIR", "Folder to make: new or empty.", .letter = 'o',
             .group = "Output"),
    NUMBER_ROW("threads", SG_OPTION_INT, S(threads), 0, 256, "T",
               "Worker threads; 0 = one per CPU.", .letter = 'j', .group = "Output"),
    FLAG_ROW("quiet", S(quiet), "Warnings only.", .letter = 'q', .group = "Output"),
    {0},
};

static const struct option_part synth_parts[] = {{sg_synth_options, S(p), NULL}, {0}};

static void defaults(void *config)
{
    *(struct synth_config *) config = (struct synth_config){.p = sg_synth_params_default()};
}

static int run_synth(const void *config, const bool *given, const char *const *positional,
                     int count)
{
    (void) given, (void) positional, (void) count;
    const struct synth_config *c = config;
    sg_ctx *ctx;
    sg_output *output = NULL;
    if (!c->output)
        return missing(&command_synth, "-o DIR");
    int code = open_context(&ctx, c->threads, 0, c->quiet);
    if (code)
        return code;
    interrupt_catch();
    code = report(ctx, sg_output_claim(ctx, c->output, "synth", false, NULL, &output));
    if (!code) {
        const int error = sg_synth_write(ctx, c->output, &c->p);
        code = error ? report(ctx, error) : 0;
    }
    if (!code && !c->quiet)
        say(stderr,
            "%d views of %d x %d to train on written to %s/blender, with %d to test, and to "
            "%s/colmap, with %d\n",
            c->p.train_views, c->p.width, c->p.height, c->output, c->p.test_views, c->output,
            (c->p.train_views + 6) / 7);
    sg_output_release(&output);
    sg_ctx_destroy(&ctx);
    return code;
}

const struct command command_synth = {
    .name = "synth",
    .arguments = "-o DIR [options]",
    .summary = "Makes a ray-traced scene with exact cameras, to train and test on.",
    .description =
        "Ray-traces the project's own scene and writes it in Blender and in COLMAP layout.",
    .groups = "Output",
    .options = synth_options,
    .parts = synth_parts,
    .config_size = sizeof(struct synth_config),
    .defaults = defaults,
    .run = run_synth,
};
