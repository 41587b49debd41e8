/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard spectrum: where the energy of images is, as numbers and as a picture. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "commands.h"
#include "interrupt.h"

struct spectrum_config {
    const char *output, *crop;
    struct sg_spectrum_params p;
    double gain;
    uint64_t max_memory;
    bool json, quiet;
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
    FLAG_ROW("quiet", S(quiet), "Warnings and the values only.", .letter = 'q'),
    {0},
};

static void defaults(void *config)
{
    *(struct spectrum_config *) config =
        (struct spectrum_config){.p = sg_spectrum_params_default(), .gain = 8};
}

static int load(sg_ctx *ctx, const char *path, const struct spectrum_config *c,
                struct sg_spectrum_image *out)
{
    out->title = strlen(path) > TITLE_MAX ? path + strlen(path) - TITLE_MAX : path;
    const int error = sg_picture_read(ctx, path, UINT64_C(1) << 28, &out->picture);
    if (error)
        return report(ctx, error);
    if (out->picture.width > SG_SIDE_MAX || out->picture.height > SG_SIDE_MAX) {
        say(stderr, "splatguard spectrum: %s: found %d x %d pixels, expected sides of at most %d\n",
            path, out->picture.width, out->picture.height, SG_SIDE_MAX);
        return STATUS_INPUT;
    }
    out->amplitude =
        sg_mem_alloc(ctx, SG_MEM_IMAGES, (size_t) out->picture.width * (size_t) out->picture.height,
                     sizeof(float)); /* freed by the caller */
    return report(ctx, !out->amplitude
                           ? SG_ERR_BUDGET
                           : sg_spectrum_measure(ctx, out->picture.rgb, out->picture.width,
                                                 out->picture.height, &c->p, &out->spectrum,
                                                 out->amplitude));
}

static int print_json(const struct sg_spectrum_image *images, int n, const char *const *paths)
{
    json_t *list = json_array();
    for (int k = 0; k < n; k++) {
        const struct sg_spectrum *s = &images[k].spectrum;
        json_array_append_new(
            list,
            json_pack(
                "{s:o,s:i,s:i,s:f,s:f,s:f,s:o,s:o,s:o}", "image", text_json(paths[k]), "width",
                images[k].picture.width, "height", images[k].picture.height, "entropy", s->entropy,
                "anisotropy", s->anisotropy, "band_share", s->band_share, "total_variation",
                json_pack("{s:f,s:f}", "aniso",
                          sg_total_variation(images[k].picture.rgb, images[k].picture.width,
                                             images[k].picture.height, SG_ATTACK_TV_ANISO),
                          "vertical2",
                          sg_total_variation(images[k].picture.rgb, images[k].picture.width,
                                             images[k].picture.height, SG_ATTACK_TV_VERTICAL2)),
                "angular", numbers_json(s->angular, s->bins), "radial",
                numbers_json(s->radial, SG_SPECTRUM_RINGS)));
    }
    return json_print(list, 2);
}

static int print_lines(const struct sg_spectrum_image *images, int n, const char *const *paths)
{
    for (int k = 0; k < n; k++) {
        const struct sg_spectrum *s = &images[k].spectrum;
        const double both = sg_total_variation(images[k].picture.rgb, images[k].picture.width,
                                               images[k].picture.height, SG_ATTACK_TV_ANISO);
        const double vertical =
            sg_total_variation(images[k].picture.rgb, images[k].picture.width,
                               images[k].picture.height, SG_ATTACK_TV_VERTICAL2) /
            2;
        say(stdout,
            "%s: %d x %d, anisotropy %.4f, %.3f %% of the energy in the band, total variation %.2f "
            "down + %.2f across\n",
            paths[k], images[k].picture.width, images[k].picture.height, s->anisotropy,
            100 * s->band_share, vertical, both - vertical);
    }
    return 0;
}

static int parse_crop(const char *text, const struct sg_spectrum_image *images, int n,
                      struct sg_spectrum_crop *crop)
{
    char rest;
    if (!text)
        return 0;
    const bool four =
        sscanf(text, "%9d,%9d,%9d,%9d%c", &crop->x, &crop->y, &crop->width, &crop->height, &rest) ==
        4; /* so few digits that an int has room for them */
    for (int k = 0; k < n; k++)
        if (!four || crop->x < 0 || crop->y < 0 || crop->width < 1 || crop->height < 1 ||
            crop->width > images[k].picture.width ||
            crop->x > images[k].picture.width - crop->width ||
            crop->height > images[k].picture.height ||
            crop->y > images[k].picture.height - crop->height) {
            say(stderr,
                "splatguard spectrum: --crop: found \"%s\", expected X,Y,W,H within %d x %d "
                "pixels\n",
                text, images[k].picture.width, images[k].picture.height);
            return STATUS_USAGE;
        }
    return 0;
}

static int check_options(const struct spectrum_config *c, const bool *given,
                         const char *const *positional, int count)
{
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
        return STATUS_USAGE;
    }
    if (c->output && count > SG_SPECTRUM_IMAGES_MAX) {
        say(stderr, "splatguard spectrum: found %d images, expected at most %d in a picture\n",
            count, SG_SPECTRUM_IMAGES_MAX);
        return STATUS_USAGE;
    }
    for (int k = 0; c->output && k < count; k++)
        if (is_same(c->output, positional[k])) {
            say(stderr,
                "splatguard spectrum: -o %s: found one of the images, expected another file\n",
                c->output);
            return STATUS_USAGE;
        }
    return 0;
}

static int run_spectrum(const void *config, const bool *given, const char *const *positional,
                        int count)
{
    const struct spectrum_config *c = config;
    struct sg_spectrum_image images[OPTIONS_MAX_POSITIONAL] = {0};
    sg_ctx *ctx;
    int code = check_options(c, given, positional, count);
    interrupt_catch();
    if (!code)
        code = open_context(&ctx, 0, c->max_memory, c->quiet);
    if (code)
        return code;
    if (c->output)
        code = report(ctx, sg_output_check_file(ctx, c->output));
    const size_t length = c->output ? strlen(c->output) : 0;
    if (!code && c->output && (length < 4 || strcasecmp(c->output + length - 4, ".png") != 0)) {
        say(stderr, "splatguard spectrum: -o %s: expected a name that ends in .png\n", c->output);
        code = STATUS_USAGE;
    }
    for (int k = 0; k < count && !code; k++)
        code = interrupted() ? report(ctx, SG_ERR_INTERRUPTED)
                             : load(ctx, positional[k], c, &images[k]);
    struct sg_spectrum_crop crop = {0};
    if (!code)
        code = parse_crop(c->crop, images, count, &crop);
    if (!code && c->output)
        code =
            report(ctx, sg_spectrum_write_picture(ctx, c->output, images, count, c->gain, &crop));
    if (!code)
        code = (c->json ? print_json : print_lines)(images, count, positional);
    if (!code && c->output && !c->quiet)
        say(stderr, "picture of %d image%s written to %s\n", count, count == 1 ? "" : "s",
            c->output);
    for (int k = 0; k < count; k++) {
        sg_picture_clear(&images[k].picture);
        sg_mem_free(images[k].amplitude);
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
