/* SPDX-License-Identifier: Apache-2.0 */
/* The ray-traced scene: names, ranges and help. */
#include "option/option.h"
#include "splatguard/synth.h"

#define STRUCT struct sg_synth_params
#define INTEGER(name, field, low, high, help)                                                      \
    SG_NUMBER(SG_OPTION_INT, name, field, low, high, "N", help, .group = "Output")

static const struct sg_option synth_options[] = {
    INTEGER("width", width, 16, 4096, "Image width in pixels."),
    INTEGER("height", height, 16, 4096, "Image height in pixels."),
    INTEGER("train-views", train_views, 4, 4096, "Views to train on."),
    INTEGER("test-views", test_views, 1, 4096,
            "Views to hold out in the Blender layout; in COLMAP's every 8th is one."),
    INTEGER("points", points, 4, 10000000, "Surface points of the COLMAP layout."),
    INTEGER("samples", samples, 1, 8, "Anti-aliasing samples per pixel and axis."),
    SG_NUMBER(SG_OPTION_U64, "seed", seed, 0, 9e15, "S", "Same options and seed, same bytes.",
              .group = "Output", .any = true),
    {0},
};

const struct sg_option *sg_synth_options(void)
{
    return synth_options;
}
