/* SPDX-License-Identifier: Apache-2.0 */
/* What an image looks like to the audit. Pixels that a mask leaves out are skipped: the neighbours
 * of a pixel are the nearest used ones of its row and column. Masks that are noise themselves, in
 * which neighbours could be anywhere, are told by how many used pixels lie at their border. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "audit_photo.h"
#include "core/internal.h"
#include "spectral/frequency.h"

#define BLOCK 16 /* pixels of the photo */
#define UNIT 4   /* values are quarters of grey levels, so that means of four pixels are kept */
#define FAINT 2  /* grey levels: smaller steps are rounding, sensor noise and compression */

/* A block is noisy that oscillates by more than so many grey levels a pixel and has more than this
 * share of its variation in that. */
#define NOISY_OSCILLATION 2.5
#define NOISY_SHARE 0.45

/* Sums over one direction: pixels that have two neighbours, differences to the next, at local
 * extremes those to both neighbours, and the lesser of these. */
struct variation {
    double pixels, total, extremes, oscillation;
};

/* The same of a block, over both directions. */
struct block {
    uint32_t pixels, total, extremes, oscillation;
};

/* The newest used pixel of a line and the one before it. */
struct line {
    int16_t before, here;
    uint32_t seen, block;
};

/* The pixel `here` between two neighbours: what it oscillates. */
static int oscillation(int before, int here, int after)
{
    const int a = here - before, b = here - after;
    if ((a < 0) != (b < 0) || abs(a) < FAINT * UNIT || abs(b) < FAINT * UNIT)
        return 0;
    return abs(a) < abs(b) ? abs(a) : abs(b);
}

/* The line's next used pixel: the one before it now has two neighbours. */
static inline void meet(struct line *l, int after, size_t block, struct variation *v,
                        struct block *blocks)
{
    if (l->seen >= 2) {
        struct block *b = &blocks[l->block];
        const int o = oscillation(l->before, l->here, after), step = abs(after - l->here);
        const int both = o ? abs(l->here - l->before) + step : 0;
        v->pixels++, b->pixels++;
        v->total += step, b->total += (uint32_t) step;
        v->oscillation += o, b->oscillation += (uint32_t) o;
        v->extremes += both, b->extremes += (uint32_t) both;
    }
    l->seen++;
    l->before = l->here;
    l->here = (int16_t) after;
    l->block = (uint32_t) block;
}

/* The image whose variation is measured, and room for it. */
struct plane {
    const uint8_t *mask; /* NULL = all used */
    size_t w, h, block;
    int16_t *values;
    struct line *columns;
    struct block *blocks;
};

static size_t blocks_across(const struct plane *p)
{
    return (p->w + p->block - 1) / p->block;
}

static size_t block_count(const struct plane *p)
{
    return blocks_across(p) * ((p->h + p->block - 1) / p->block);
}

static void vary(const struct plane *p, struct variation *down, struct variation *across)
{
    *down = *across = (struct variation){0};
    memset(p->columns, 0, p->w * sizeof(*p->columns));
    memset(p->blocks, 0, block_count(p) * sizeof(*p->blocks));
    for (size_t y = 0; y < p->h; y++) {
        struct line row = {0};
        for (size_t x = 0; x < p->w; x++) {
            const size_t i = y * p->w + x, block = y / p->block * blocks_across(p) + x / p->block;
            if (p->mask && !p->mask[i])
                continue;
            meet(&row, p->values[i], block, across, p->blocks);
            meet(&p->columns[x], p->values[i], block, down, p->blocks);
        }
    }
}

/* Mean over the pixels that have two neighbours, in grey levels. */
static double mean(double sum, const struct variation *v)
{
    return v->pixels > 0 ? sum / v->pixels / UNIT : 0;
}

/* Oscillation of the difference of two channels, mean of both directions. */
static double chroma(const struct plane *p, const uint8_t *rgb, int a, int b)
{
    struct variation down, across;
    for (size_t i = 0; i < p->w * p->h; i++)
        p->values[i] = (int16_t) (UNIT * (rgb[3 * i + (size_t) a] - rgb[3 * i + (size_t) b]));
    vary(p, &down, &across);
    return (mean(down.oscillation, &down) + mean(across.oscillation, &across)) / 2;
}

/* Whether the used pixels of a block have more than one value. */
static bool varies(const struct plane *p, size_t block)
{
    const size_t x0 = block % blocks_across(p) * p->block, y0 = block / blocks_across(p) * p->block;
    int first = -1;
    for (size_t y = y0; y < y0 + p->block && y < p->h; y++)
        for (size_t x = x0; x < x0 + p->block && x < p->w; x++) {
            const size_t i = y * p->w + x;
            if (p->mask && !p->mask[i])
                continue;
            if (first >= 0 && p->values[i] != first)
                return true;
            first = p->values[i];
        }
    return false;
}

/* The share of the used pixels that have one that is left out above, below, left or right. */
static double ragged(const struct plane *p)
{
    size_t used = 0, border = 0;
    for (size_t i = 0; p->mask && i < p->w * p->h; i++) {
        const size_t x = i % p->w;
        if (!p->mask[i])
            continue;
        used++;
        border += (x > 0 && !p->mask[i - 1]) || (x + 1 < p->w && !p->mask[i + 1]) ||
                  (i >= p->w && !p->mask[i - p->w]) ||
                  (i + p->w < p->w * p->h && !p->mask[i + p->w]);
    }
    return used ? (double) border / (double) used : 0;
}

static double content(const struct plane *p, bool all)
{
    size_t pixels = 0;
    for (size_t b = 0; b < block_count(p); b++) {
        const size_t x0 = b % blocks_across(p) * p->block, y0 = b / blocks_across(p) * p->block;
        if (!all && !varies(p, b))
            continue;
        for (size_t y = y0; y < y0 + p->block && y < p->h; y++)
            for (size_t x = x0; x < x0 + p->block && x < p->w; x++)
                pixels += !p->mask || p->mask[y * p->w + x];
    }
    return (double) pixels;
}

/* A block's oscillation, which counts as much as it has pixels. */
struct share {
    float oscillation;
    uint32_t weight;
};

static int ascending(const void *a, const void *b)
{
    const float x = ((const struct share *) a)->oscillation,
                y = ((const struct share *) b)->oscillation;
    return (x > y) - (x < y);
}

/* The oscillation up to which this part of the weight is. */
static double quantile(const struct share *s, size_t n, double weight)
{
    double sum = 0;
    size_t i = 0;
    while (i + 1 < n && (sum += (double) s[i].weight) <= weight)
        i++;
    return n ? (double) s[i].oscillation : 0;
}

/* What local extremes carry of all variation. Two levels a pixel more, so that faint noise on
 * smooth photos, which costs nothing, is not most of what there is. */
static double share_of_extremes(double extremes, double total, double pixels)
{
    return pixels > 0 ? extremes / 2 / (total + UNIT * pixels) : 0;
}

static double oscillation_of(const struct block *b)
{
    return b->pixels ? (double) b->oscillation / b->pixels / UNIT : 0;
}

/* How the oscillation lies over the blocks. */
struct distribution {
    double tenth, quarter, half; /* of the area has no more, grey levels */
    double noisy;                /* share of the area */
};

/* Blocks of one colour, a background, say nothing about the rest. */
static struct distribution distribute(const struct plane *p, struct share *own)
{
    size_t n = 0;
    double weight = 0, noisy = 0;
    for (size_t i = 0; i < block_count(p); i++) {
        const struct block *b = &p->blocks[i];
        if (!b->pixels || !varies(p, i))
            continue;
        own[n++] = (struct share){(float) oscillation_of(b), b->pixels};
        weight += b->pixels;
        if (oscillation_of(b) > NOISY_OSCILLATION &&
            share_of_extremes(b->extremes, b->total, b->pixels) > NOISY_SHARE)
            noisy += b->pixels;
    }
    qsort(own, n, sizeof(*own), ascending);
    return (struct distribution){.tenth = quantile(own, n, weight / 10),
                                 .quarter = quantile(own, n, weight / 4),
                                 .half = quantile(own, n, weight / 2),
                                 .noisy = weight > 0 ? noisy / weight : 0};
}

static double share_of(const struct variation *down, const struct variation *across)
{
    return share_of_extremes(down->extremes + across->extremes, down->total + across->total,
                             down->pixels + across->pixels);
}

/* To half the size: means of four pixels, used where all four are. The blocks stay the same parts
 * of the photo. */
static void halve(struct plane *p, uint8_t *mask)
{
    const size_t w = p->w / 2, h = p->h / 2;
    for (size_t y = 0; y < h; y++)
        for (size_t x = 0; x < w; x++) {
            const size_t a = 2 * y * p->w + 2 * x, b = a + p->w;
            const int sum = p->values[a] + p->values[a + 1] + p->values[b] + p->values[b + 1];
            const bool used =
                p->mask && p->mask[a] && p->mask[a + 1] && p->mask[b] && p->mask[b + 1];
            p->values[y * w + x] = (int16_t) ((sum + 2) / 4);
            if (p->mask)
                mask[y * w + x] = used ? 255 : 0;
        }
    p->mask = p->mask ? mask : NULL;
    p->w = w, p->h = h, p->block /= 2;
}

static double slope(const struct sg_spectrum *s)
{
    double high = 0, middle = 0;
    int n_high = 0, n_middle = 0;
    for (int i = 0; i < SG_SPECTRUM_RINGS; i++) {
        const double r = (i + 0.5) / SG_SPECTRUM_RINGS;
        if (r > 0.7 && r < 0.95)
            high += s->radial[i], n_high++;
        if (r > 0.35 && r < 0.55)
            middle += s->radial[i], n_middle++;
    }
    return log((high / n_high + 1e-9) / (middle / n_middle + 1e-9));
}

int sg_audit_measure(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width, int height,
                     struct sg_audit_features *out, float *map)
{
    struct plane p = {.mask = mask, .w = (size_t) width, .h = (size_t) height, .block = BLOCK};
    *out = (struct sg_audit_features){0};
    int code = SG_OK;
    p.values = sg_alloc_raw(ctx, SG_MEM_FRAME, p.w * p.h, sizeof(*p.values));
    p.columns = sg_alloc_raw(ctx, SG_MEM_FRAME, p.w, sizeof(*p.columns));
    p.blocks = sg_alloc_raw(ctx, SG_MEM_FRAME, block_count(&p), sizeof(*p.blocks));
    struct share *own = sg_alloc_raw(ctx, SG_MEM_FRAME, block_count(&p), sizeof(*own));
    uint8_t *less = mask ? sg_alloc_raw(ctx, SG_MEM_FRAME, p.w * p.h / 4 + 1, 1) : NULL;
    if (!p.values || !p.columns || !p.blocks || !own || (mask && !less)) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    out->osc_chroma = (chroma(&p, rgb, 0, 1) + chroma(&p, rgb, 2, 1)) / 2;

    struct variation down, across;
    for (size_t i = 0; i < p.w * p.h; i++)
        p.values[i] =
            (int16_t) (UNIT *
                       ((77 * rgb[3 * i] + 150 * rgb[3 * i + 1] + 29 * rgb[3 * i + 2] + 128) >> 8));
    vary(&p, &down, &across);
    out->tv_down = mean(down.total, &down), out->tv_across = mean(across.total, &across);
    out->osc_down = mean(down.oscillation, &down),
    out->osc_across = mean(across.oscillation, &across);
    out->osc_share = share_of(&down, &across);
    struct distribution d = distribute(&p, own);
    out->osc_quiet = d.quarter, out->noisy = d.noisy;
    out->ragged = ragged(&p);
    out->content = content(&p, out->ragged > SG_AUDIT_RAGGED);
    for (size_t i = 0; map && i < block_count(&p); i++)
        map[i] = (float) oscillation_of(&p.blocks[i]);

    halve(&p, less);
    vary(&p, &down, &across);
    d = distribute(&p, own);
    out->half_quiet = d.tenth, out->half_osc = d.half, out->half_share = share_of(&down, &across);
    halve(&p, less);
    vary(&p, &down, &across);
    d = distribute(&p, own);
    out->quarter_osc = d.half, out->quarter_share = share_of(&down, &across);
done:
    sg_free(p.values);
    sg_free(p.columns);
    sg_free(p.blocks);
    sg_free(own);
    sg_free(less);
    if (code)
        return code;
    struct sg_spectrum spectrum;
    code = sg_spectrum_of(ctx, rgb, width, height, NULL, &spectrum, NULL);
    if (!code)
        out->slope = slope(&spectrum), out->anisotropy = spectrum.anisotropy;
    return code;
}
