/* SPDX-License-Identifier: Apache-2.0 */
/* Statistics that distinguish a poison from texture: how strong neighbouring steps are and how they
 * follow each other, over tiles of 2 x 2 blocks. A poison within a bound is about equally strong in
 * all tiles, its steps alternate, and their sizes differ less than those of a scene, whose steps
 * are mostly small and sometimes large. */
#include <math.h>
#include <stdlib.h>

#include "audit_blocks.h"
#include "core/compare.h"

/* grey levels squared: rounding. Added to sums of squares so that smooth tiles do not divide by
 * 0. */
#define ENERGY 0.25
#define LEAST 0.15     /* mean square step of the tiles that count */
#define PIXELS 512     /* pixels and directions that a tile needs, of at most 2048 */
#define BIN_SHARE 3e-3 /* added to shares before their logarithm */

/* The sums of a tile's blocks, in grey levels. */
struct tile {
    double pixels[2], squares[2]; /* down, across */
    double total, extremes, oscillation, curvature, next, second, used, level;
    double bins[SG_AUDIT_BINS];
};

static void add(struct tile *t, const struct audit_sums *s, int direction)
{
    const double unit = SG_AUDIT_UNIT;
    t->pixels[direction] += s->pixels;
    t->squares[direction] += (double) s->squares / (unit * unit);
    t->total += s->total / unit;
    t->extremes += s->extremes / unit;
    t->oscillation += s->oscillation / unit;
    t->curvature += (double) s->curvature / unit;
    t->next += (double) s->next / (unit * unit);
    t->second += (double) s->second / (unit * unit);
}

static struct tile tile_of(const struct audit_texture *t, const struct audit_plane *p, size_t i)
{
    struct tile tile = {.used = 0};
    const size_t across = sg_audit_blocks_across(p), n = sg_audit_block_count(p);
    for (size_t k = 0; k < 4; k++) {
        const size_t x = i % t->across * 2 + k % 2, y = i / t->across * 2 + k / 2;
        if (x >= across || y * across + x >= n)
            continue;
        const struct audit_block *b = &p->blocks[y * across + x];
        add(&tile, &b->down, 0);
        add(&tile, &b->across, 1);
        tile.used += b->used;
        for (int bin = 0; bin < SG_AUDIT_BINS; bin++)
            tile.bins[bin] += b->bins[bin];
        tile.level += (double) b->level / SG_AUDIT_UNIT;
    }
    return tile;
}

/* Of each tile. */
enum value {
    ENERGY_LN,
    NEXT,
    SECOND,
    EVENNESS,
    CURVATURE_EVENNESS,
    DIRECTION,
    EXTREMES,
    OSCILLATION,
    BRIGHTNESS
};

static double value_of(const struct tile *t, enum value value)
{
    const double n = fmax(t->pixels[0] + t->pixels[1], 1), total = t->total / n,
                 curvature = t->curvature / n;
    const double squares = (t->squares[0] + t->squares[1]) / n;
    switch (value) {
    case ENERGY_LN:
        return log(squares + ENERGY) / 2;
    case NEXT: /* correlation of a step with the next: -1 for alternating steps, 1 for a slope */
        return t->next / n / (squares + ENERGY);
    case SECOND:
        return t->second / n / (squares + ENERGY);
    case EVENNESS: /* 1 where all steps are of one size */
        return total * total / (squares + ENERGY);
    case CURVATURE_EVENNESS:
        return curvature * curvature / (2 * squares - 2 * t->next / n + ENERGY);
    case DIRECTION:
        return log((t->squares[1] + t->pixels[1] * ENERGY + 1e-9) /
                   (t->squares[0] + t->pixels[0] * ENERGY + 1e-9));
    case EXTREMES:
        return t->extremes / n / 2 / (total + 0.5);
    case OSCILLATION:
        return log(t->oscillation / n + 0.1);
    default:
        return log(t->level / fmax(t->used, 1) + 8);
    }
}

/* The tiles of one area, and where its statistics go. */
struct area {
    struct audit_texture *texture;
    const struct audit_plane *plane;
    size_t left, right, top, bottom;
    double *next;
};

/* All, the halves, the quarters: left, right, top and bottom end in halves of the photo. */
static const uint8_t places[SG_AUDIT_AREAS][4] = {{0, 2, 0, 2}, {0, 1, 0, 2}, {1, 2, 0, 2},
                                                  {0, 2, 0, 1}, {0, 2, 1, 2}, {0, 1, 0, 1},
                                                  {1, 2, 0, 1}, {0, 1, 1, 2}, {1, 2, 1, 2}};

bool sg_audit_has_quarter(size_t area, bool right, bool lower)
{
    const uint8_t *p = places[area];
    return p[0] <= right && right < p[1] && p[2] <= lower && lower < p[3];
}

static struct area area_of(struct audit_texture *t, size_t i)
{
    const uint8_t *p = places[i];
    return (struct area){.texture = t,
                         .left = p[0] * t->across / 2,
                         .right = p[1] * t->across / 2,
                         .top = p[2] * t->down / 2,
                         .bottom = p[3] * t->down / 2};
}

/* The next kept tile of the area, row by row, from *i on; *i becomes the one after it. */
static bool next_tile(const struct area *a, size_t *i, size_t *tile)
{
    const size_t across = a->right - a->left;
    for (; *i < across * (a->bottom - a->top); (*i)++) {
        *tile = (a->top + *i / across) * a->texture->across + a->left + *i % across;
        if (a->texture->kept[*tile]) {
            (*i)++;
            return true;
        }
    }
    return false;
}

size_t sg_audit_tiles(const struct audit_texture *t, size_t area)
{
    const struct area a = area_of((struct audit_texture *) t, area);
    size_t n = 0;
    for (size_t i = 0, tile; next_tile(&a, &i, &tile);)
        n++;
    return n;
}

/* Writes the value of each kept tile to the column. Returns how many there are. */
static size_t fill(const struct area *a, enum value value)
{
    size_t n = 0;
    for (size_t i = 0, k; next_tile(a, &i, &k);) {
        const struct tile tile = tile_of(a->texture, a->plane, k);
        a->texture->column[n++] = (float) value_of(&tile, value);
    }
    return n;
}

static void put(struct area *a, double feature)
{
    *a->next++ = feature;
}

static double quantile(const struct area *a, size_t n, double part)
{
    return n ? (double) a->texture->column[(size_t) (part * (double) (n - 1) + 0.5)] : 0;
}

static double deviation(const struct area *a, size_t n)
{
    const float *column = a->texture->column;
    double sum = 0, squares = 0;
    for (size_t i = 0; i < n; i++)
        sum += (double) column[i];
    for (size_t i = 0; i < n; i++)
        squares +=
            ((double) column[i] - sum / (double) n) * ((double) column[i] - sum / (double) n);
    return n ? sqrt(squares / (double) n) : 0;
}

static void put_quantiles(struct area *a, enum value value, const double *parts, int count)
{
    const size_t n = fill(a, value);
    qsort(a->texture->column, n, sizeof(*a->texture->column), sg_float_ascending);
    for (int k = 0; k < count; k++)
        put(a, quantile(a, n, parts[k]));
}

/* A photo may lie on its side: which direction is the stronger one does not matter. */
static void put_direction(struct area *a)
{
    const size_t n = fill(a, DIRECTION);
    const float *column = a->texture->column;
    qsort(a->texture->column, n, sizeof(*column), sg_float_ascending);
    put(a, n ? fabs((double) column[(n - 1) / 2] + (double) column[n / 2]) / 2 : 0);
    put(a, deviation(a, n));
}

/* How the energy of the tiles follows their brightness: that of a sensor's noise does. */
static void put_brightness(struct area *a)
{
    double sum[2] = {0}, squares[2] = {0}, product = 0, n = 0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0, k; next_tile(a, &i, &k);) {
            const struct tile tile = tile_of(a->texture, a->plane, k);
            const double x[2] = {value_of(&tile, ENERGY_LN), value_of(&tile, BRIGHTNESS)};
            if (pass == 0) {
                sum[0] += x[0], sum[1] += x[1], n++;
                continue;
            }
            for (int d = 0; d < 2; d++)
                squares[d] += (x[d] - sum[d] / n) * (x[d] - sum[d] / n);
            product += (x[0] - sum[0] / n) * (x[1] - sum[1] / n);
        }
    put(a, product / sqrt((squares[0] + 1e-4 * n) * (squares[1] + 1e-4 * n) + 1e-9));
}

static void put_bins(struct area *a)
{
    double bins[SG_AUDIT_BINS] = {0}, sum = 0;
    for (size_t i = 0, k; next_tile(a, &i, &k);) {
        const struct tile tile = tile_of(a->texture, a->plane, k);
        for (int b = 0; b < SG_AUDIT_BINS; b++)
            bins[b] += tile.bins[b], sum += tile.bins[b];
    }
    for (int b = 0; b < SG_AUDIT_BINS; b++)
        put(a, log(bins[b] / fmax(sum, 1) + BIN_SHARE));
}

static void choose_tiles(struct audit_texture *t, const struct audit_plane *p)
{
    for (size_t i = 0; i < t->across * t->down; i++) {
        const struct tile tile = tile_of(t, p, i);
        const double n = tile.pixels[0] + tile.pixels[1];
        t->kept[i] = n >= PIXELS && tile.squares[0] + tile.squares[1] > LEAST * n;
    }
}

void sg_audit_texture(struct audit_texture *t, const struct audit_plane *p, bool luma)
{
    static const double spread[] = {0.1, 0.5, 0.9}, middle[] = {0.5, 0.25, 0.75};
    const int parts = luma ? 3 : 1;
    size_t done = t->done;
    if (!done)
        choose_tiles(t, p);
    for (size_t i = 0; i < SG_AUDIT_AREAS; i++) {
        struct area a = area_of(t, i);
        a.plane = p;
        a.next = t->values[i] + done;
        put_quantiles(&a, ENERGY_LN, spread, 3);
        put(&a, deviation(&a, fill(&a, ENERGY_LN)));
        put_quantiles(&a, NEXT, middle, parts);
        put_quantiles(&a, SECOND, middle, 1);
        put_quantiles(&a, EVENNESS, middle, parts);
        put_quantiles(&a, CURVATURE_EVENNESS, middle, parts);
        put_direction(&a);
        put_quantiles(&a, EXTREMES, middle, 1);
        put_quantiles(&a, OSCILLATION, spread, 3);
        if (luma) {
            put_bins(&a);
            put_brightness(&a);
        }
        t->done = (size_t) (a.next - t->values[i]);
    }
}
