/* SPDX-License-Identifier: Apache-2.0 */
/* Measurements of an image for the audit. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "audit_blocks.h"
#include "audit_photo.h"
#include "audit_weights.h"
#include "core/context.h"
#include "spectral/frequency.h"

/* A block is noisy if it oscillates by more than this many grey levels per pixel, and if
 * oscillation is more than this share of its variation. */
#define NOISY_OSCILLATION 2.5
#define NOISY_SHARE 0.45

#define TILES 2 /* fewer tiles have no statistics */

/* The fit had no bounds outside of this range, so estimates are limited to it. */
#define TAU_LEAST 4
#define TAU_MOST 32

/* Sums over the blocks. */
struct variation {
    double pixels, total, extremes, oscillation;
};

static void add(struct variation *v, const struct audit_sums *s)
{
    v->pixels += s->pixels;
    v->total += s->total;
    v->extremes += s->extremes;
    v->oscillation += s->oscillation;
}

static struct variation variation_of(const struct audit_block *b)
{
    struct variation v = {0};
    add(&v, &b->down);
    add(&v, &b->across);
    return v;
}

static void vary(const struct audit_plane *p, struct variation *down, struct variation *across)
{
    sg_audit_sum(p);
    *down = *across = (struct variation){0};
    for (size_t i = 0; i < sg_audit_block_count(p); i++) {
        add(down, &p->blocks[i].down);
        add(across, &p->blocks[i].across);
    }
}

/* Mean over the pixels that have two neighbours, in grey levels. */
static double mean(double sum, const struct variation *v)
{
    return v->pixels > 0 ? sum / v->pixels / SG_AUDIT_UNIT : 0;
}

/* Whether the used pixels of a block have more than one value. */
static bool varies(const struct audit_plane *p, size_t block)
{
    const size_t x0 = block % sg_audit_blocks_across(p) * p->block,
                 y0 = block / sg_audit_blocks_across(p) * p->block;
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

/* The share of the used pixels that have an unused neighbour. */
static double ragged(const struct audit_plane *p)
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

static double content(const struct audit_plane *p, bool all)
{
    size_t pixels = 0;
    for (size_t b = 0; b < sg_audit_block_count(p); b++) {
        const size_t x0 = b % sg_audit_blocks_across(p) * p->block,
                     y0 = b / sg_audit_blocks_across(p) * p->block;
        if (!all && !varies(p, b))
            continue;
        for (size_t y = y0; y < y0 + p->block && y < p->h; y++)
            for (size_t x = x0; x < x0 + p->block && x < p->w; x++)
                pixels += !p->mask || p->mask[y * p->w + x];
    }
    return (double) pixels;
}

/* The oscillation of a block, weighted by its pixels. */
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

/* The quantile of the oscillation by weight. */
static double quantile(const struct share *s, size_t n, double weight)
{
    double sum = 0;
    size_t i = 0;
    while (i + 1 < n && (sum += (double) s[i].weight) <= weight)
        i++;
    return n ? (double) s[i].oscillation : 0;
}

/* The share of local extremes in all variation. Two grey levels per pixel are added to the
 * variation, so that faint noise on smooth photos, which costs nothing, has no large share. */
static double share_of_extremes(double extremes, double total, double pixels)
{
    return pixels > 0 ? extremes / 2 / (total + SG_AUDIT_UNIT * pixels) : 0;
}

static double oscillation_of(const struct audit_block *b)
{
    const struct variation v = variation_of(b);
    return mean(v.oscillation, &v);
}

/* The distribution of oscillation over the blocks. */
struct distribution {
    double tenth, quarter, half; /* grey levels that this share of the area does not exceed */
    double noisy;                /* share of the area */
};

/* Blocks of one colour, such as a background, are left out. */
static struct distribution distribute(const struct audit_plane *p, struct share *own)
{
    size_t n = 0;
    double weight = 0, noisy = 0;
    for (size_t i = 0; i < sg_audit_block_count(p); i++) {
        const struct variation v = variation_of(&p->blocks[i]);
        if (v.pixels == 0 || !varies(p, i))
            continue;
        const double oscillation = mean(v.oscillation, &v);
        own[n++] = (struct share){(float) oscillation, (uint32_t) v.pixels};
        weight += v.pixels;
        if (oscillation > NOISY_OSCILLATION &&
            share_of_extremes(v.extremes, v.total, v.pixels) > NOISY_SHARE)
            noisy += v.pixels;
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

/* Room for one image. */
struct room {
    struct audit_plane plane;
    struct audit_texture texture;
    struct share *shares;
    uint8_t *less; /* the mask of a smaller image */
};

static bool take_room(sg_ctx *ctx, struct room *r, const uint8_t *mask, size_t w, size_t h)
{
    struct audit_plane *p = &r->plane;
    *r = (struct room){.plane = {.mask = mask, .w = w, .h = h, .block = SG_AUDIT_BLOCK}};
    const size_t blocks = sg_audit_block_count(p);
    r->texture.across = (sg_audit_blocks_across(p) + 1) / 2;
    r->texture.down = (blocks / sg_audit_blocks_across(p) + 1) / 2;
    const size_t tiles = r->texture.across * r->texture.down;
    p->values = sg_alloc_raw(ctx, SG_MEM_FRAME, w * h, sizeof(*p->values));
    p->columns = sg_alloc_raw(ctx, SG_MEM_FRAME, w, sizeof(*p->columns));
    p->blocks = sg_alloc_raw(ctx, SG_MEM_FRAME, blocks, sizeof(*p->blocks));
    r->shares = sg_alloc_raw(ctx, SG_MEM_FRAME, blocks, sizeof(*r->shares));
    r->texture.kept = sg_alloc_raw(ctx, SG_MEM_FRAME, tiles, sizeof(*r->texture.kept));
    r->texture.column = sg_alloc_raw(ctx, SG_MEM_FRAME, tiles, sizeof(*r->texture.column));
    r->less = mask ? sg_alloc_raw(ctx, SG_MEM_FRAME, w * h / 4 + 1, 1) : NULL;
    return p->values && p->columns && p->blocks && r->shares && r->texture.kept &&
           r->texture.column && (!mask || r->less);
}

static void give_room(struct room *r)
{
    sg_free(r->plane.values);
    sg_free(r->plane.columns);
    sg_free(r->plane.blocks);
    sg_free(r->shares);
    sg_free(r->texture.kept);
    sg_free(r->texture.column);
    sg_free(r->less);
}

/* Luma at three sizes. */
static void measure_luma(struct room *r, const uint8_t *rgb, struct sg_audit_features *out,
                         float *map)
{
    struct audit_plane p = r->plane;
    struct variation down, across;
    for (size_t i = 0; i < p.w * p.h; i++)
        p.values[i] =
            (int16_t) (SG_AUDIT_UNIT *
                       ((77 * rgb[3 * i] + 150 * rgb[3 * i + 1] + 29 * rgb[3 * i + 2] + 128) >> 8));
    vary(&p, &down, &across);
    sg_audit_texture(&r->texture, &p, true);
    out->tv_down = mean(down.total, &down), out->tv_across = mean(across.total, &across);
    out->osc_down = mean(down.oscillation, &down),
    out->osc_across = mean(across.oscillation, &across);
    out->osc_share = share_of(&down, &across);
    struct distribution d = distribute(&p, r->shares);
    out->osc_quiet = d.quarter, out->noisy = d.noisy;
    out->ragged = ragged(&p);
    out->content = content(&p, out->ragged > SG_AUDIT_RAGGED);
    for (size_t i = 0; map && i < sg_audit_block_count(&p); i++)
        map[i] = (float) oscillation_of(&p.blocks[i]);

    sg_audit_halve(&p, r->less);
    vary(&p, &down, &across);
    sg_audit_texture(&r->texture, &p, true);
    d = distribute(&p, r->shares);
    out->half_quiet = d.tenth, out->half_osc = d.half, out->half_share = share_of(&down, &across);
    sg_audit_halve(&p, r->less);
    vary(&p, &down, &across);
    sg_audit_texture(&r->texture, &p, true);
    d = distribute(&p, r->shares);
    out->quarter_osc = d.half, out->quarter_share = share_of(&down, &across);
}

/* The difference of two channels at two sizes. Returns its oscillation, mean of both directions. */
static double measure_chroma(struct room *r, const uint8_t *rgb, size_t a, size_t b)
{
    struct audit_plane p = r->plane;
    struct variation down, across;
    for (size_t i = 0; i < p.w * p.h; i++)
        p.values[i] = (int16_t) (SG_AUDIT_UNIT * (rgb[3 * i + a] - rgb[3 * i + b]));
    vary(&p, &down, &across);
    sg_audit_texture(&r->texture, &p, false);
    const double oscillation =
        (mean(down.oscillation, &down) + mean(across.oscillation, &across)) / 2;
    sg_audit_halve(&p, r->less);
    sg_audit_sum(&p);
    sg_audit_texture(&r->texture, &p, false);
    return oscillation;
}

enum network { SCORE, TAU };

/* A network with one hidden layer. Its inputs are the statistics, in standard deviations from their
 * mean. */
static double evaluate(enum network network, const double *texture)
{
    double hidden[SG_AUDIT_HIDDEN], sum = (double) sg_audit_networks[network].constant;
    _Static_assert(sizeof(sg_audit_weights) / sizeof(*sg_audit_weights) == SG_AUDIT_TEXTURE,
                   "weights for each");
    for (size_t k = 0; k < SG_AUDIT_HIDDEN; k++)
        hidden[k] = (double) sg_audit_networks[network].hidden[k];
    for (size_t i = 0; i < SG_AUDIT_TEXTURE; i++) {
        const double mean = (double) sg_audit_weights[i].mean,
                     deviation = (double) sg_audit_weights[i].deviation;
        const double x =
            fmin(fmax((texture[i] - mean) / deviation, -SG_AUDIT_LIMIT), SG_AUDIT_LIMIT);
        sum += x * (double) sg_audit_weights[i].network[network].direct;
        for (size_t k = 0; k < SG_AUDIT_HIDDEN; k++)
            hidden[k] += x * (double) sg_audit_weights[i].network[network].hidden[k];
    }
    for (size_t k = 0; k < SG_AUDIT_HIDDEN; k++)
        sum += tanh(hidden[k]) * (double) sg_audit_networks[network].out[k];
    return sum;
}

/* The logit of gross oscillation in any pattern. It grows with the oscillation and with the
 * oscillating part of the photo. */
static double evidence_strong(const struct sg_audit_features *f)
{
    const double ratio = fabs(log((f->osc_down + 0.5) / (f->osc_across + 0.5)));
    return 13.5 * f->osc_share + 4.7 * ratio + 9.7 * f->noisy + SG_AUDIT_STRONG_CONSTANT;
}

/* The highest score of the photo, its halves and its quarters. The offset corrects for the maximum
 * of several scores being higher by chance. */
static void judge(const struct audit_texture *t, struct sg_audit_features *out)
{
    double highest = -INFINITY, amplitude = (out->osc_down + out->osc_across) / 2;
    for (size_t i = 0; i < SG_AUDIT_AREAS; i++) {
        const double evidence = evaluate(SCORE, t->values[i]) - (i ? SG_AUDIT_PART_OFFSET : 0);
        if (sg_audit_tiles(t, i) < TILES || evidence <= highest)
            continue;
        highest = evidence;
        amplitude = exp(evaluate(TAU, t->values[i]));
    }
    out->tiles = (double) sg_audit_tiles(t, 0);
    memcpy(out->texture, t->values[0], sizeof(out->texture));
    out->evidence = fmax(highest, evidence_strong(out));
    out->amplitude = fmin(fmax(amplitude, TAU_LEAST), TAU_MOST);
    out->amplitude_error = SG_AUDIT_TAU_ERROR * out->amplitude;
}

int sg_audit_features_of(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width,
                         int height, struct sg_audit_features *out, float *map)
{
    struct room room;
    struct sg_spectrum spectrum;
    *out = (struct sg_audit_features){0};
    int code = sg_spectrum_of(ctx, rgb, width, height, NULL, &spectrum, NULL);
    if (code)
        return code;
    if (take_room(ctx, &room, mask, (size_t) width, (size_t) height)) {
        out->slope = slope(&spectrum);
        out->anisotropy = spectrum.anisotropy;
        measure_luma(&room, rgb, out, map);
        out->osc_chroma = (measure_chroma(&room, rgb, 0, 1) + measure_chroma(&room, rgb, 2, 1)) / 2;
        sg_audit_range(&room.texture, rgb, mask, (size_t) width, (size_t) height);
        judge(&room.texture, out);
    } else {
        code = SG_ERR_BUDGET;
    }
    give_room(&room);
    return code;
}

int sg_audit_measure(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width, int height,
                     struct sg_audit_features *out, float *map)
{
    sg_clear_error(ctx);
    return sg_audit_features_of(ctx, rgb, mask, width, height, out, map);
}
