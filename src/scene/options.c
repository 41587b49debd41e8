/* SPDX-License-Identifier: Apache-2.0 */
/* How a scene is loaded: names, ranges and help. */
#include "option/option.h"
#include "scene/reader.h"

#define STRUCT struct sg_scene_params
#define SCENE .group = "Scene"
#define EXPERT .expert = true

_Static_assert(SG_SMOOTH_GAUSSIAN == 1 && SG_SMOOTH_BILATERAL == 2 && SG_SMOOTH_WAVELET == 3,
               "the order of filters");

/* Of the formats among the choices. */
enum place {
    PLACE_AUTO,
#define R(value, name, files, turn) PLACE_##value,
    SG_READERS(R)
#undef R
};
#define R(value, name, files, turn)                                                                \
    _Static_assert((int) SG_FORMAT_##value == (int) PLACE_##value, "the order of formats");
SG_READERS(R)
#undef R
#define R(value, name, files, turn) "|" #name /* the choices are one string */
#define FORMATS "auto" SG_READERS(R)

static const struct sg_option scene_options[] = {
    SG_CHOICE("format", format, FORMATS, "FORMAT", "Layout of the scene folder.", SCENE, EXPERT),
    SG_TEXT("images", images, "DIR", "COLMAP: image folder below the scene, e.g. images_4.", SCENE,
            .letter = 'i'),
    SG_TEXT("colmap", colmap, "DIR",
            "COLMAP: folder of the model below the scene, where there are several, e.g. sparse/1.",
            SCENE, EXPERT),
    SG_NUMBER(SG_OPTION_INT, "resolution", resolution, -1, SG_SIDE_MAX, "R",
              "1, 2, 4, 8 divide the size; -1 limits the width to 1600; other numbers are the "
              "target width.",
              SCENE, .letter = 'r', .nonzero = true),
    SG_NUMBER(SG_OPTION_DOUBLE, "downscale", downscale, 1, 64, "F",
              "Divides the image size that --resolution gives.", SCENE),
    SG_FLAG("white-background", white_background,
            "White instead of black behind transparent images (not COLMAP's) and renders.", SCENE,
            .letter = 'w'),
    SG_NUMBER(SG_OPTION_INT, "test-every", test_every, 1, 1000000, "N",
              "COLMAP, nerfstudio: every N-th view by name is a test view.", SCENE, EXPERT),
    SG_FLAG("test-halves", test_halves,
            "Train on the left half of each test photo too, and measure the right half, so that "
            "the photo's exposure or appearance is learned. For train with --eval.",
            SCENE, EXPERT),
    SG_FLAG("centred-principal", centred_principal, "Ignore cx and cy, as the reference does.",
            SCENE, EXPERT),
    SG_TEXT("masks", masks, "DIR",
            "Folder of masks inside the scene's, white = use; masks is found without this option.",
            SCENE),
    SG_FLAG("follow-links", follow_links,
            "Follow symbolic links that lead out of the scene's folder.", SCENE, EXPERT,
            .transient = true),
    SG_FLAG("strict", strict,
            "Refuse a scene with missing or broken photos, or photos at another scale than their "
            "camera.",
            SCENE, .transient = true),
    SG_CHOICE("smooth", smooth, "off|gaussian|bilateral|wavelet", "FILTER",
              "Smooth the training photos after resizing, as a simple defense to compare with: "
              "Gaussian of 5 x 5 pixels, sigma 1.5; bilateral of diameter 9, both sigmas 75; soft "
              "thresholds of wavelets.",
              .group = "Defense", EXPERT),
    {0},
};

const struct sg_option *sg_scene_options(void)
{
    return scene_options;
}
