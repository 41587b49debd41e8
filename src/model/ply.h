/* SPDX-License-Identifier: Apache-2.0 */
/* PLY containers: a header that says what the bytes mean, and the rows of its element `vertex` as floats. */
#ifndef SG_PLY_H
#define SG_PLY_H

#include "core/internal.h"

#define PLY_MAX_PROPERTIES 256 /* of all elements together */
#define PLY_MAX_ELEMENTS 32

enum ply_format { PLY_NO_FORMAT, PLY_ASCII, PLY_LITTLE, PLY_BIG };
enum ply_type { PLY_I8, PLY_U8, PLY_I16, PLY_U16, PLY_I32, PLY_U32, PLY_F32, PLY_F64 };

struct ply_property {
    char name[32]; /* cut off there: no name that matters is longer */
    enum ply_type type;
    bool list;
    enum ply_type length_type; /* of a list */
};

struct ply_element {
    char name[32];
    uint64_t rows;
    int first, properties; /* range of all[] */
};

/* An open file in memory, positioned at the rows of its element `vertex`. */
struct ply {
    const char *path; /* for messages */
    const char *data; /* whole file, a zero byte after it */
    size_t size, at;  /* next byte to parse */
    enum ply_format format;
    uint64_t rows; /* of the element being read */
    int properties;
    const struct ply_property *property;
    int elements, total;
    struct ply_element element[PLY_MAX_ELEMENTS];
    struct ply_property all[PLY_MAX_PROPERTIES];
};

/* Parses the header and skips elements before `vertex`. The row count is checked against the file's size and
 * max_rows before it is believed. data must outlive p. */
int sg_ply_open(sg_ctx *ctx, struct ply *p, const char *path, const char *data, size_t size, uint64_t max_rows);

/* Fills format, element[] and all[]; leaves p->at at the first byte of the body. Errors name the line. */
int sg_ply_parse_header(sg_ctx *ctx, struct ply *p);

/* Index of a property that is not a list, or -1. */
int sg_ply_find(const struct ply *p, const char *name);

/* Next row: one float per property (0 for lists, whose contents are skipped). The bits of float32 values, signalling
 * NaNs included, arrive unchanged. */
int sg_ply_row(sg_ctx *ctx, struct ply *p, uint64_t row, float *values);

#endif
