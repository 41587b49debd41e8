/* SPDX-License-Identifier: Apache-2.0 */
/* Few that stand for many: tables of numbers and palettes of vectors, by k-means (Lloyd 1982).
 * Results are the same for any number of threads. */
#ifndef SG_FORMAT_CLUSTER_H
#define SG_FORMAT_CLUSTER_H

#include "core/context.h"
#include "splatguard/model.h"

#define SG_TABLE_SIZE 256 /* numbers of a table */

/* Rising numbers that stand for n finite values with a small square error; the smallest is repeated
 * where the values have fewer. Sorts the values. */
int sg_make_table(sg_ctx *ctx, float *values, size_t n, float table[SG_TABLE_SIZE]);
/* The number that is nearest to a value. */
uint8_t sg_nearest_number(const float table[SG_TABLE_SIZE], float value);

/* Planes `first` to `first` + `width` - 1 of a model's Gaussians as vectors. */
struct sg_vectors {
    const struct sg_model *model;
    int first, width; /* at most SG_SH_REST_MAX */
};
/* At most `most` vectors that stand for all: *palette has *count rows of `width` floats, freed by
 * sg_free; labels[i] is the row for Gaussian i. Every row is used. */
int sg_make_palette(sg_ctx *ctx, const struct sg_vectors *vectors, size_t most, float **palette,
                    size_t *count, uint32_t *labels);

#endif
