/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard spectrum: where the energy of images is, as numbers and as a picture. */
#include <stdlib.h>
#include <string.h>

#include "image/image.h"
#include "spectrum_picture.h"

#include "commands.h"

struct spectrum_config {
    const char *output, *crop;
    struct sg_spectrum_params p;
    double gain;
    uint64_t max_memory;
    bool json;
};

#define TITLE_MAX 28 /* letters: what fits above an image */

#define S(field) offsetof(struct spectrum_config, field)
static const struct sg_option spectrum_options[] = {
    TEXT_ROW("output", S(output), "OUT.png",
             "Draw the picture, of at most 6 images, into this file.", .letter = 'o'),
    FLAG_ROW("json", S(json), "Print a JSON array, one object an image."),
    MEMORY_ROW(struct spectrum_config, max_memory, .group = NULL),
    NUMBER_ROW("gain", SG_OPTION_DOUBLE, S(gain), 0.01, 255, "X",
               "How much differences from the first image are magnified."),
    TEXT_ROW("crop", S(crop), "X,Y,W,H", "Also draw this part of every image, magnified."),
    NUMBER_ROW("low", SG_OPTION_DOUBLE, S(p.low), 0, 1, "X",
               "Lower edge of the band, as a part of the Nyquist frequency."),
    NUMBER_ROW("high", SG_OPTION_DOUBLE, S(p.high), 0, 1, "X", "Upper edge of the band."),
    NUMBER_ROW("bins", SG_OPTION_INT, S(p.bins), 4, SG_SPECTRUM_BINS_MAX, "N",
               "Directions over the full circle; divisible by 4."),
    {0},
};

static void defaults(void *config)
{
    *(struct spectrum_config *) config =
        (struct spectrum_config){.p = sg_spectrum_params_default(), .gain = 8};
}

static int load(sg_ctx *ctx, const char *path, const struct spectrum_config *c,
                struct picture_image *out)
{
    struct sg_image image = {0};
    int error = sg_image_read(ctx, path, UINT64_C(1) << 28, &image);
    if (error)
        return error;
    const size_t n = (size_t) image.width * (size_t) image.height;
    uint8_t *rgb = sg_alloc_raw(ctx, SG_MEM_IMAGES, n, 3);
    float *amplitude = sg_alloc_raw(ctx, SG_MEM_IMAGES, n, sizeof(float));
    out->title = strlen(path) > TITLE_MAX ? path + strlen(path) - TITLE_MAX : path;
    out->width = image.width, out->height = image.height;
    out->rgb = rgb, out->amplitude = amplitude; /* freed by the caller */
    error = rgb && amplitude ? SG_OK : SG_ERR_BUDGET;
    if (!error) {
        sg_image_flatten(&image, SG_ALPHA_ON_BLACK, rgb);
        error = sg_spectrum_measure(ctx, rgb, image.width, image.height, &c->p, &out->spectrum,
                                    amplitude);
    }
    sg_image_clear(&image);
    return error;
}

static int print_json(const struct picture_image *images, int n, const char *const *paths)
{
    json_t *list = json_array();
    for (int k = 0; k < n; k++) {
        const struct sg_spectrum *s = &images[k].spectrum;
        json_array_append_new(
            list,
            json_pack("{s:o,s:i,s:i,s:f,s:f,s:f,s:o,s:o,s:o}", "image", sg_text_to_json(paths[k]),
                      "width", images[k].width, "height", images[k].height, "entropy", s->entropy,
                      "anisotropy", s->anisotropy, "band_share", s->band_share, "total_variation",
                      json_pack("{s:f,s:f}", "aniso",
                                sg_total_variation(images[k].rgb, images[k].width, images[k].height,
                                                   SG_TV_ANISO),
                                "vertical2",
                                sg_total_variation(images[k].rgb, images[k].width, images[k].height,
                                                   SG_TV_VERTICAL2)),
                      "angular", numbers_json(s->angular, s->bins), "radial",
                      numbers_json(s->radial, SG_SPECTRUM_RINGS)));
    }
    return json_print(list, 2);
}

static int print_lines(const struct picture_image *images, int n, const char *const *paths)
{
    for (int k = 0; k < n; k++) {
        const struct sg_spectrum *s = &images[k].spectrum;
        const double both =
            sg_total_variation(images[k].rgb, images[k].width, images[k].height, SG_TV_ANISO);
        const double vertical =
            sg_total_variation(images[k].rgb, images[k].width, images[k].height, SG_TV_VERTICAL2) /
            2;
        say(stdout,
            "%s: %d x %d, anisotropy %.4f, %.3f %% of the energy in the band, total variation %.2f "
            "down + %.2f across\n",
            paths[k], images[k].width, images[k].height, s->anisotropy, 100 * s->band_share,
            vertical, both - vertical);
    }
    return 0;
}

static int parse_crop(const char *text, const struct picture_image *images, int n,
                      struct picture_crop *crop)
{
    char rest;
    if (!text)
        return 0;
    const bool four =
        sscanf(text, "%d,%d,%d,%d%c", &crop->x, &crop->y, &crop->width, &crop->height, &rest) == 4;
    for (int k = 0; k < n; k++)
        if (!four || crop->x < 0 || crop->y < 0 || crop->width < 1 || crop->height < 1 ||
            crop->width > images[k].width || crop->x > images[k].width - crop->width ||
            crop->height > images[k].height || crop->y > images[k].height - crop->height) {
            say(stderr,
                "splatguard spectrum: --crop: found \"%s\", expected X,Y,W,H within %d x %d "
                "pixels\n",
                text, images[k].width, images[k].height);
            return 1;
        }
    return 0;
}

static int draw(sg_ctx *ctx, const struct spectrum_config *c, const struct picture_image *images,
                int n, const struct picture_crop *crop)
{
    uint8_t *rgb = NULL;
    int width, height;
    int error = picture_draw(ctx, images, n, c->gain, crop, &rgb, &width, &height);
    int code = report(ctx, error);
    if (!code) /* still */
        code = report(ctx, sg_output_check_replaced(ctx, c->output));
    if (!code) {
        error = sg_image_write_picture(ctx, c->output, rgb, width, height, 3);
        code = error ? report(ctx, error) : 0;
    }
    sg_free(rgb);
    return code;
}

static int run_spectrum(const void *config, const bool *given, const char *const *positional,
                        int count)
{
    const struct spectrum_config *c = config;
    struct picture_image images[OPTIONS_MAX_POSITIONAL] = {0};
    sg_ctx *ctx;
    const size_t drawn[] = {S(crop), S(gain)};
    for (size_t i = 0; i < 2; i++)
        if (!c->output && options_given(&command_spectrum, given, drawn[i])) {
            say(stderr,
                "splatguard spectrum: --%s: found without a picture, expected -o OUT.png with it\n",
                i ? "gain" : "crop");
            return STATUS_USAGE;
        }
    if (c->p.low >= c->p.high) {
        say(stderr, "splatguard spectrum: --low: found %g, expected less than --high, %g\n",
            c->p.low, c->p.high);
        return STATUS_USAGE;
    }
    if (c->p.bins % 4) {
        say(stderr, "splatguard spectrum: --bins: found %d, expected a number divisible by 4\n",
            c->p.bins);
        return 1;
    }
    if (c->output && count > PICTURE_IMAGES_MAX) {
        say(stderr, "splatguard spectrum: found %d images, expected at most %d in a picture\n",
            count, PICTURE_IMAGES_MAX);
        return 1;
    }
    for (int k = 0; c->output && k < count; k++)
        if (is_same(c->output, positional[k])) {
            say(stderr,
                "splatguard spectrum: -o %s: found one of the images, expected another file\n",
                c->output);
            return 1;
        }
    int code = open_context(&ctx, 0, c->max_memory, false);
    if (code)
        return code;
    if (c->output)
        code = report(ctx, sg_output_check_file(ctx, c->output));
    for (int k = 0; k < count && !code; k++) {
        const int error = load(ctx, positional[k], c, &images[k]);
        code = error ? report(ctx, error) : 0;
    }
    struct picture_crop crop = {0};
    if (!code)
        code = parse_crop(c->crop, images, count, &crop);
    if (!code && c->output)
        code = draw(ctx, c, images, count, &crop);
    if (!code)
        code = (c->json ? print_json : print_lines)(images, count, positional);
    for (int k = 0; k < count; k++) {
        sg_free((void *) (uintptr_t) images[k].rgb);
        sg_free((void *) (uintptr_t) images[k].amplitude);
    }
    sg_ctx_destroy(&ctx);
    return code;
}

const struct command command_spectrum = {
    .name = "spectrum",
    .arguments = "IMAGE... [-o OUT.png] [options]",
    .summary = "Shows where the energy of images is: spectrum, directions, frequencies.",
    .description =
        "Measures the Fourier spectrum of images: how much of their energy lies in a band of high "
        "frequencies, how it is spread over directions (anisotropy 0 = evenly), and total "
        "variation. With -o, draws photos, differences from the first, spectra and distributions.",
    .options = spectrum_options,
    .config_size = sizeof(struct spectrum_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = OPTIONS_MAX_POSITIONAL,
    .run = run_spectrum,
};
