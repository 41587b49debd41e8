/* SPDX-License-Identifier: Apache-2.0 */
/* Photos, differences, spectra and their distributions in one picture. */
#include "splatguard/spectrum.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/compare.h"
#include "image/image.h"
#include "image/stroke_font.h"
#include "splatguard/output.h"

#define CELL 320 /* pixels, the longer side of an image */
#define GAP 16
#define TITLE 30
#define PLOT 260 /* height of a plot */
#define AXIS 44  /* left of a plot and below it, for its labels */

struct canvas {
    uint8_t *rgb;
    int width, height;
};

static const uint8_t colours[SG_SPECTRUM_IMAGES_MAX][3] = {{0x22, 0x66, 0xaa}, {0xcc, 0x33, 0x44},
                                                           {0x22, 0x88, 0x44}, {0xbb, 0x88, 0x00},
                                                           {0x88, 0x33, 0xaa}, {0x44, 0x44, 0x44}};
static const uint8_t ink[3] = {0x33, 0x33, 0x33}, faint[3] = {0xdd, 0xdd, 0xdd};

static void blend(struct canvas *c, int x, int y, const uint8_t colour[3], double alpha)
{
    if (x < 0 || y < 0 || x >= c->width || y >= c->height)
        return;
    uint8_t *p = c->rgb + 3 * ((size_t) y * (size_t) c->width + (size_t) x);
    for (int k = 0; k < 3; k++)
        p[k] = (uint8_t) (p[k] + (colour[k] - p[k]) * alpha + 0.5);
}

static void line(struct canvas *c, double x0, double y0, double x1, double y1, double radius,
                 const uint8_t colour[3])
{
    const double dx = x1 - x0, dy = y1 - y0, length2 = dx * dx + dy * dy;
    for (int y = (int) (fmin(y0, y1) - radius - 1); y <= (int) (fmax(y0, y1) + radius + 2); y++)
        for (int x = (int) (fmin(x0, x1) - radius - 1); x <= (int) (fmax(x0, x1) + radius + 2);
             x++) {
            double along = length2 > 0 ? ((x - x0) * dx + (y - y0) * dy) / length2 : 0;
            along = fmin(fmax(along, 0), 1);
            const double cover = radius + 0.5 - hypot(x - x0 - along * dx, y - y0 - along * dy);
            if (cover > 0)
                blend(c, x, y, colour, fmin(cover, 1));
        }
}

/* The stroke font has capitals only. Centred on x, with y as the baseline. */
static void text(struct canvas *c, double x, double y, double size, const uint8_t colour[3],
                 const char *words)
{
    char capitals[64];
    size_t n = 0;
    for (; words[n] && n < sizeof(capitals) - 1; n++)
        capitals[n] = isalnum((unsigned char) words[n]) || strchr(".-/+ ", words[n])
                          ? (char) toupper((unsigned char) words[n])
                          : '-';
    capitals[n] = 0;
    const int reach = (int) (size * (double) n * 0.6) + 4;
    for (int py = (int) (y - size) - 2; py <= (int) y + 2; py++)
        for (int px = (int) x - reach; px <= (int) x + reach; px++) {
            int hits = 0;
            for (int s = 0; s < 16; s++)
                hits += sg_stroke_ink(capitals, px + (s % 4 + 0.5) / 4 - x,
                                      y - (py + (s / 4 + 0.5) / 4), size, 0.07);
            if (hits)
                blend(c, px, py, colour, hits / 16.0);
        }
}

/* Scales pixels to w x h at (x, y). */
static int place(sg_ctx *ctx, struct canvas *c, const uint8_t *rgb, int width, int height, int x,
                 int y, int w, int h)
{
    uint8_t *small = sg_alloc_raw(ctx, SG_MEM_IMAGES, (size_t) w * (size_t) h, 3);
    int code = small ? sg_resample(ctx, rgb, width, height, 3, small, w, h) : SG_ERR_BUDGET;
    for (int row = 0; row < h && !code; row++)
        memcpy(c->rgb + 3 * ((size_t) (y + row) * (size_t) c->width + (size_t) x),
               small + 3 * (size_t) row * (size_t) w, 3 * (size_t) w);
    sg_free(small);
    return code;
}

static int draw_difference(sg_ctx *ctx, struct canvas *c, const struct sg_spectrum_image *a,
                           const struct sg_spectrum_image *b, double gain, int x, int y, int w,
                           int h)
{
    const size_t n = 3 * (size_t) a->picture.width * (size_t) a->picture.height;
    uint8_t *d = sg_alloc_raw(ctx, SG_MEM_IMAGES, n, 1);
    if (!d)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++)
        d[i] =
            (uint8_t) (fmin(fmax(127.5 + gain * (b->picture.rgb[i] - a->picture.rgb[i]), 0), 255) +
                       0.5);
    const int code = place(ctx, c, d, a->picture.width, a->picture.height, x, y, w, h);
    sg_free(d);
    return code;
}

/* Magnified without smoothing, so that pixels stay visible. */
static void draw_crop(struct canvas *c, const struct sg_spectrum_image *p,
                      const struct sg_spectrum_crop *crop, int x, int y, int w, int h)
{
    for (int row = 0; row < h; row++)
        for (int column = 0; column < w; column++) {
            const size_t from =
                (size_t) (crop->y + row * crop->height / h) * (size_t) p->picture.width +
                (size_t) (crop->x + column * crop->width / w);
            memcpy(c->rgb + 3 * ((size_t) (y + row) * (size_t) c->width + (size_t) (x + column)),
                   p->picture.rgb + 3 * from, 3);
        }
}

/* One scale for all columns, so that brightness can be compared: between two percentiles of the
 * first. */
static int draw_amplitude(sg_ctx *ctx, struct canvas *c, const struct sg_spectrum_image *p,
                          float low, float high, int x, int y)
{
    const size_t n = (size_t) p->picture.width * (size_t) p->picture.height;
    uint8_t *grey = sg_alloc_raw(ctx, SG_MEM_IMAGES, n, 3);
    if (!grey)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++)
        memset(grey + 3 * i,
               (int) (255 * fminf(fmaxf((p->amplitude[i] - low) / (high - low), 0), 1) + 0.5f), 3);
    const int code = place(ctx, c, grey, p->picture.width, p->picture.height, x, y, CELL, CELL);
    sg_free(grey);
    return code;
}

struct plot {
    int x, y, w, h; /* of the area inside the axes */
    double low, high;
};

static void axes(struct canvas *c, const struct plot *p, const char *title,
                 const char *const ticks[], int n_ticks)
{
    for (int i = 0; i < n_ticks; i++) {
        const double x = p->x + (double) i / (n_ticks - 1) * p->w;
        line(c, x, p->y, x, p->y + p->h, 0, faint);
        text(c, x, p->y + p->h + 20, 10, ink, ticks[i]);
    }
    line(c, p->x, p->y, p->x, p->y + p->h, 0.3, ink);
    line(c, p->x, p->y + p->h, p->x + p->w, p->y + p->h, 0.3, ink);
    text(c, p->x + p->w / 2.0, p->y + p->h + 38, 10, ink, title);
}

/* Of image k: its colour, and its dashes for those who cannot tell colours. done: pixels of the
 * line so far. */
static void stroke(struct canvas *c, double x0, double y0, double x1, double y1, int k,
                   double *done)
{
    static const int dashes[SG_SPECTRUM_IMAGES_MAX][2] = {{1, 0},  {12, 6}, {3, 5},
                                                          {20, 4}, {8, 8},  {2, 10}}; /* on, off */
    const double length = hypot(x1 - x0, y1 - y0), on = dashes[k][0], period = on + dashes[k][1];
    for (double a = 0, b; a < length; a = b) {
        const double phase = fmod(*done + a, period);
        b = k ? fmin(a + (phase < on ? on : period) - phase + 1e-6, length) : length;
        if (phase < on)
            line(c, x0 + (x1 - x0) * a / length, y0 + (y1 - y0) * a / length,
                 x0 + (x1 - x0) * b / length, y0 + (y1 - y0) * b / length, 1, colours[k]);
    }
    *done += length;
}

static void curve(struct canvas *c, const struct plot *p, const double *values, int n, int image)
{
    double done = 0;
    for (int i = 0; i + 1 < n; i++) {
        double y[2];
        for (int k = 0; k < 2; k++)
            y[k] =
                p->y + p->h * (1 - fmin(fmax((values[i + k] - p->low) / (p->high - p->low), 0), 1));
        stroke(c, p->x + (i + 0.5) / n * p->w, y[0], p->x + (i + 1.5) / n * p->w, y[1], image,
               &done);
    }
}

static void draw_plots(struct canvas *c, const struct sg_spectrum_image *images, int n, int top)
{
    static const char *const directions[] = {"-90", "-45", "0", "45", "90"};
    static const char *const frequencies[] = {"0", "0.125", "0.25", "0.375", "0.5"};
    const int half = (c->width - 3 * GAP) / 2;
    struct plot a = {GAP + AXIS, top, half - AXIS - GAP, PLOT - AXIS, 0, 0}, r = a;
    r.x += half + GAP;
    double angular[SG_SPECTRUM_IMAGES_MAX][SG_SPECTRUM_BINS_MAX / 2],
        radial[SG_SPECTRUM_IMAGES_MAX][SG_SPECTRUM_RINGS];
    r.low = INFINITY, r.high = -INFINITY;
    for (int k = 0; k < n; k++) {
        const struct sg_spectrum *s = &images[k].spectrum;
        /* Directions from -90 to 90 degrees; the other half of a real image's spectrum is the
         * same. */
        for (int b = 0; b < s->bins / 2; b++) {
            angular[k][b] = 2 * s->angular[s->bins / 4 + b];
            a.high = fmax(a.high, 1.1 * angular[k][b]);
        }
        for (int i = 0; i < SG_SPECTRUM_RINGS; i++) {
            if (!(s->radial[i] > 0)) /* small images have empty rings */
                radial[k][i] = i ? radial[k][i - 1] : log10(fmax(s->radial[1], 1e-12));
            else
                radial[k][i] = log10(s->radial[i]);
            r.low = fmin(r.low, radial[k][i]), r.high = fmax(r.high, radial[k][i]);
        }
    }
    r.low = floor(r.low), r.high = fmax(ceil(r.high), r.low + 1);
    a.high = a.high > 0 ? a.high : 1;
    axes(c, &a, "ENERGY BY DEGREES", directions, 5);
    axes(c, &r, "LOG10 ENERGY BY CYCLES/PIXEL", frequencies, 5);
    for (int tick = 0; tick <= 4; tick++) {
        char label[32];
        snprintf(label, sizeof(label), "%.2f", a.high * tick / 4);
        text(c, a.x - 26, a.y + a.h * (1 - tick / 4.0) + 5, 10, ink, label);
        snprintf(label, sizeof(label), "%.1f", r.low + (r.high - r.low) * tick / 4);
        text(c, r.x - 26, r.y + r.h * (1 - tick / 4.0) + 5, 10, ink, label);
    }
    for (int k = 0; k < n; k++) {
        const double y = r.y + 14 + 16 * k; /* where the falling curve leaves room */
        double done = 0;
        curve(c, &a, angular[k], images[k].spectrum.bins / 2, k);
        curve(c, &r, radial[k], SG_SPECTRUM_RINGS, k);
        char name[16]; /* as long as there is room for the next one */
        snprintf(name, sizeof(name), "%s", images[k].title);
        stroke(c, r.x + r.w - 190, y - 4, r.x + r.w - 150, y - 4, k, &done);
        text(c, r.x + r.w - 140 + 4.5 * (double) strlen(name), y, 10, colours[k], name);
    }
}

/* The values that are black and white in the spectra. */
static int find_range(sg_ctx *ctx, const struct sg_spectrum_image *p, float *low, float *high)
{
    const size_t n = (size_t) p->picture.width * (size_t) p->picture.height;
    float *sorted = sg_alloc_raw(ctx, SG_MEM_IMAGES, n, sizeof(float));
    if (!sorted)
        return SG_ERR_BUDGET;
    memcpy(sorted, p->amplitude, n * sizeof(float));
    qsort(sorted, n, sizeof(float), sg_float_ascending);
    *low = sorted[n / 50];
    *high = fmaxf(sorted[n - 1 - n / 1000], *low + 1e-3f);
    sg_free(sorted);
    return SG_OK;
}

static int draw(sg_ctx *ctx, const struct sg_spectrum_image *images, int n, double gain,
                const struct sg_spectrum_crop *crop, uint8_t **rgb, int *width, int *height)
{
    int tallest = 1;
    bool differences = false;
    for (int k = 0; k < n; k++) {
        const double scale = (double) CELL / (images[k].picture.width > images[k].picture.height
                                                  ? images[k].picture.width
                                                  : images[k].picture.height);
        const int h = (int) fmax(images[k].picture.height * scale, 1);
        tallest = h > tallest ? h : tallest;
        differences |= k && images[k].picture.width == images[0].picture.width &&
                       images[k].picture.height == images[0].picture.height;
    }
    const int columns = n > 1 ? n : 2; /* room for the plots */
    const double enlarged =
        crop->width ? (double) CELL / (crop->width > crop->height ? crop->width : crop->height) : 0;
    const int crop_w = crop->width ? (int) fmax(crop->width * enlarged, 1) : 0;
    const int crop_h = crop->width ? (int) fmax(crop->height * enlarged, 1) : 0;
    const int photos = TITLE, crops = photos + tallest + GAP,
              changes = crop_h ? crops + crop_h + GAP : crops,
              spectra = differences ? changes + tallest + GAP + 14 : changes;
    const int plots = spectra + CELL + GAP;
    struct canvas c = {.width = columns * (CELL + GAP) + GAP, .height = plots + PLOT + GAP};
    c.rgb = sg_alloc_raw(ctx, SG_MEM_IMAGES, (size_t) c.width * (size_t) c.height, 3);
    float low = 0, high = 1;
    int code = c.rgb ? find_range(ctx, &images[0], &low, &high) : SG_ERR_BUDGET;
    if (c.rgb)
        memset(c.rgb, 255, 3 * (size_t) c.width * (size_t) c.height);
    for (int k = 0; k < n && !code; k++) {
        const struct sg_spectrum_image *p = &images[k];
        const double scale =
            (double) CELL /
            (p->picture.width > p->picture.height ? p->picture.width : p->picture.height);
        const int w = (int) fmax(p->picture.width * scale, 1),
                  h = (int) fmax(p->picture.height * scale, 1), x = GAP + k * (CELL + GAP);
        text(&c, x + CELL / 2.0, photos - 10, 13, colours[k], p->title);
        code = place(ctx, &c, p->picture.rgb, p->picture.width, p->picture.height,
                     x + (CELL - w) / 2, photos, w, h);
        if (!code && crop_h)
            draw_crop(&c, p, crop, x + (CELL - crop_w) / 2, crops, crop_w, crop_h);
        if (!code && k && p->picture.width == images[0].picture.width &&
            p->picture.height == images[0].picture.height) {
            char label[48];
            snprintf(label, sizeof(label), "DIFFERENCE X %.3g", gain);
            code = draw_difference(ctx, &c, &images[0], p, gain, x + (CELL - w) / 2, changes, w, h);
            text(&c, x + CELL / 2.0, changes + h + 16, 10, ink, label);
        }
        if (!code)
            code = draw_amplitude(ctx, &c, p, low, high, x, spectra);
    }
    if (!code)
        draw_plots(&c, images, n, plots);
    if (code)
        sg_free(c.rgb);
    else
        *rgb = c.rgb, *width = c.width, *height = c.height;
    return code;
}

/* Every image has to have all of the crop. */
static int check_crop(sg_ctx *ctx, const struct sg_spectrum_image *images, int n,
                      const struct sg_spectrum_crop *crop)
{
    for (int k = 0; k < n && crop->width; k++) {
        const struct sg_picture *p = &images[k].picture;
        if (crop->x < 0 || crop->y < 0 || crop->width < 1 || crop->height < 1 ||
            crop->width > p->width || crop->x > p->width - crop->width ||
            crop->height > p->height || crop->y > p->height - crop->height)
            return sg_fail(ctx, SG_ERR_USAGE,
                           "spectrum: found a crop of %d x %d at %d, %d, expected one within the "
                           "%d x %d of image %d",
                           crop->width, crop->height, crop->x, crop->y, p->width, p->height, k);
    }
    return SG_OK;
}

int sg_spectrum_write_picture(sg_ctx *ctx, const char *path, const struct sg_spectrum_image *images,
                              int n, double gain, const struct sg_spectrum_crop *crop)
{
    uint8_t *rgb = NULL;
    int width, height;
    sg_clear_error(ctx);
    if (n < 1 || n > SG_SPECTRUM_IMAGES_MAX)
        return sg_fail(ctx, SG_ERR_USAGE, "spectrum: found %d images, expected 1 to %d", n,
                       SG_SPECTRUM_IMAGES_MAX);
    int code = check_crop(ctx, images, n, crop);
    if (!code)
        code = draw(ctx, images, n, gain, crop, &rgb, &width, &height);
    if (!code)
        code = sg_output_check_replaced(ctx, path);
    if (!code)
        code = sg_image_write_picture(ctx, path, rgb, width, height, 3);
    sg_free(rgb);
    return code;
}
