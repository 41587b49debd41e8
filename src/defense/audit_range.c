/* SPDX-License-Identifier: Apache-2.0 */
/* The range of the values of one channel in cells of 8 x 8 pixels. A poison that uses its whole
 * bound makes the range at least twice the bound where the scene is smooth, and at least the bound
 * where the scene is black or white, since values are clipped there. */
#include <math.h>
#include <string.h>

#include "audit_blocks.h"

#define CELL 8     /* pixels on a side */
#define USED 32    /* least pixels of a cell */
#define FEW 16     /* least cells of a kind that have statistics */
#define LEVELS 256 /* of a channel */
#define DARK 2     /* values up to this are black */
#define BRIGHT 253 /* values from this on are white */
#define QUARTERS 4 /* of a photo */
#define TILE (2 * SG_AUDIT_BLOCK)

/* Shares of ends where there are too few cells. */
#define OPEN_ENDS 0.2
#define CLOSED_ENDS 0.1

/* Cells by their range, and pixels within a level of the farthest values. */
struct ranges {
    uint32_t cells[LEVELS], ends[LEVELS];
};

/* Cells whose values reach neither black nor white, and cells whose values do. */
struct area_ranges {
    struct ranges open, closed;
};

/* One channel of it. */
struct cell {
    const uint8_t *first, *mask; /* value and use of the first pixel; mask: NULL = all used */
    size_t width;                /* of the photo */
    size_t w, h;                 /* less than CELL at the photo's border */
};

static inline bool used(const struct cell *c, size_t x, size_t y)
{
    return !c->mask || c->mask[y * c->width + x];
}

static inline int value(const struct cell *c, size_t x, size_t y)
{
    return c->first[3 * (y * c->width + x)];
}

static void count_cell(const struct cell *c, struct area_ranges *r)
{
    int low = LEVELS, high = -1;
    uint32_t pixels = 0, at_low = 0, at_high = 0;
    for (size_t y = 0; y < c->h; y++)
        for (size_t x = 0; x < c->w; x++)
            if (used(c, x, y)) {
                const int v = value(c, x, y);
                pixels++;
                low = v < low ? v : low;
                high = v > high ? v : high;
            }
    if (pixels < USED || low == high)
        return;
    for (size_t y = 0; y < c->h; y++)
        for (size_t x = 0; x < c->w; x++) {
            at_low += used(c, x, y) && value(c, x, y) <= low + 1;
            at_high += used(c, x, y) && value(c, x, y) >= high - 1;
        }
    const bool closed = low <= DARK || high >= BRIGHT;
    struct ranges *own = closed ? &r->closed : &r->open;
    own->cells[high - low]++;
    own->ends[high - low] += !closed ? at_low + at_high : high >= BRIGHT ? at_low : at_high;
}

static void add(struct ranges *sum, const struct ranges *r)
{
    for (size_t i = 0; i < LEVELS; i++)
        sum->cells[i] += r->cells[i], sum->ends[i] += r->ends[i];
}

/* Histogram of ranges, or of twice the estimates of a bound. */
struct histogram {
    uint64_t cells[2 * LEVELS], total;
};

static void count(struct histogram *h, const struct ranges *r, size_t factor)
{
    for (size_t i = 0; i < LEVELS; i++)
        h->cells[factor * i] += r->cells[i], h->total += r->cells[i];
}

static size_t quantile(const struct histogram *h, double part)
{
    const double rank = part * ((double) h->total - 1) + 0.5;
    uint64_t sum = h->cells[0];
    size_t i = 0;
    while (i + 1 < 2 * LEVELS && (double) sum < rank)
        sum += h->cells[++i];
    return i;
}

static double logarithm(const struct histogram *h, double part, double scale)
{
    return h->total ? log((double) quantile(h, part) * scale + 0.5) : 0;
}

/* The share of pixels near an end of their cell's range, over cells of at most this range. */
static double ends(const struct ranges *r, size_t range, double otherwise)
{
    uint64_t cells = 0, pixels = 0;
    for (size_t i = 0; i <= range; i++)
        cells += r->cells[i], pixels += r->ends[i];
    return cells ? (double) pixels / (double) cells / (CELL * CELL) : otherwise;
}

/* Writes SG_AUDIT_RANGE statistics. Where a kind has too few cells, the statistics of all cells are
 * used. */
static void put(const struct area_ranges *r, double *out)
{
    static const double all_parts[] = {0.02, 0.05, 0.1, 0.25, 0.5, 0.75};
    static const double closed_parts[] = {0.1, 0.25, 0.5, 0.75}, open_parts[] = {0.05, 0.25, 0.5};
    struct histogram all = {.total = 0}, closed = {.total = 0}, open = {.total = 0};
    count(&all, &r->open, 1);
    count(&all, &r->closed, 2);
    count(&open, &r->open, 1);
    count(&closed, &r->closed, 1);
    for (size_t k = 0; k < 6; k++)
        *out++ = logarithm(&all, all_parts[k], 0.5);
    for (size_t k = 0; k < 4; k++)
        *out++ = closed.total < FEW ? logarithm(&all, closed_parts[k], 0.5)
                                    : logarithm(&closed, closed_parts[k], 1);
    for (size_t k = 0; k < 3; k++)
        *out++ = logarithm(open.total < FEW ? &all : &open, open_parts[k], 0.5);
    *out++ = (double) closed.total / fmax((double) all.total, 1);
    *out++ = open.total < FEW ? OPEN_ENDS : ends(&r->open, quantile(&open, 0.25), OPEN_ENDS);
    *out++ = closed.total < FEW ? CLOSED_ENDS : ends(&r->closed, LEVELS - 1, CLOSED_ENDS);
}

void sg_audit_range(struct audit_texture *t, const uint8_t *rgb, const uint8_t *mask, size_t w,
                    size_t h)
{
    struct area_ranges quarters[QUARTERS];
    memset(quarters, 0, sizeof(quarters));
    for (size_t y = 0; y < h; y += CELL)
        for (size_t x = 0; x < w; x += CELL) {
            const bool right = x / TILE >= t->across / 2, lower = y / TILE >= t->down / 2;
            struct cell c = {.mask = mask ? mask + y * w + x : NULL,
                             .width = w,
                             .w = w - x < CELL ? w - x : CELL,
                             .h = h - y < CELL ? h - y : CELL};
            for (size_t channel = 0; channel < 3; channel++) {
                c.first = rgb + 3 * (y * w + x) + channel;
                count_cell(&c, &quarters[2 * lower + right]);
            }
        }
    for (size_t i = 0; i < SG_AUDIT_AREAS; i++) {
        struct area_ranges sum = {.open = {.cells = {0}}};
        for (size_t k = 0; k < QUARTERS; k++)
            if (sg_audit_has_quarter(i, k % 2, k / 2)) {
                add(&sum.open, &quarters[k].open);
                add(&sum.closed, &quarters[k].closed);
            }
        put(&sum, t->values[i] + t->done);
    }
    t->done += SG_AUDIT_RANGE;
}
