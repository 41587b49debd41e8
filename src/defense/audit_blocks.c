/* SPDX-License-Identifier: Apache-2.0 */
/* Pixels that a mask leaves out are skipped: the neighbours of a pixel are the nearest used ones of
 * its row and column. Masks that are noise themselves, in which neighbours could be anywhere, are
 * recognised by how many used pixels lie at their border (audit_features.c). */
#include "audit_blocks.h"

#include <stdlib.h>
#include <string.h>

#define FAINT 2 /* grey levels: smaller steps are rounding, sensor noise and compression */

/* Upper ends of the bins of curvature, grey levels. */
static const int bin_ends[SG_AUDIT_BINS - 1] = {2, 4, 8, 12, 16, 24, 32, 48};

static inline int bin_of(int curvature)
{
    int k = 0;
    while (k < SG_AUDIT_BINS - 1 && curvature >= bin_ends[k] * SG_AUDIT_UNIT)
        k++;
    return k;
}

/* The next used pixel of a line. The pixel before it now has two neighbours. */
static inline void push_pixel(struct audit_line *l, int after, size_t block,
                              struct audit_block *blocks, bool down)
{
    const int step = after - l->here;
    if (l->seen >= 2) {
        struct audit_block *b = &blocks[l->block];
        struct audit_sums *s = down ? &b->down : &b->across;
        const int before = l->step, a = abs(before), c = abs(step), curvature = abs(step - before);
        s->pixels++;
        s->total += (uint32_t) c;
        s->squares += (uint64_t) (c * c);
        s->curvature += (uint64_t) curvature;
        s->next += step * before;
        if (l->seen >= 3)
            s->second += step * l->step_before;
        if ((before < 0) != (step < 0) && a >= FAINT * SG_AUDIT_UNIT &&
            c >= FAINT * SG_AUDIT_UNIT) {
            s->extremes += (uint32_t) (a + c);
            s->oscillation += (uint32_t) (a < c ? a : c);
        }
        b->bins[bin_of(curvature)]++;
    }
    l->seen++;
    l->step_before = l->step;
    l->step = (int16_t) step;
    l->here = (int16_t) after;
    l->block = (uint32_t) block;
}

size_t sg_audit_blocks_across(const struct audit_plane *p)
{
    return (p->w + p->block - 1) / p->block;
}

size_t sg_audit_block_count(const struct audit_plane *p)
{
    return sg_audit_blocks_across(p) * ((p->h + p->block - 1) / p->block);
}

void sg_audit_sum(const struct audit_plane *p)
{
    memset(p->columns, 0, p->w * sizeof(*p->columns));
    memset(p->blocks, 0, sg_audit_block_count(p) * sizeof(*p->blocks));
    for (size_t y = 0; y < p->h; y++) {
        struct audit_line row = {0};
        const size_t first = y / p->block * sg_audit_blocks_across(p);
        for (size_t x = 0; x < p->w; x++) {
            const size_t i = y * p->w + x, block = first + x / p->block;
            if (p->mask && !p->mask[i])
                continue;
            p->blocks[block].used++;
            p->blocks[block].level += p->values[i];
            push_pixel(&row, p->values[i], block, p->blocks, false);
            push_pixel(&p->columns[x], p->values[i], block, p->blocks, true);
        }
    }
}

void sg_audit_halve(struct audit_plane *p, uint8_t *mask)
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
