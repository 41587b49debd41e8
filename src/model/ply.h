/* SPDX-License-Identifier: Apache-2.0 */
/* PLY containers: a header that says what the bytes mean, and the rows of its element `vertex` as
 * floats. */
#ifndef SG_PLY_H
#define SG_PLY_H

#include "core/source.h"
#include "splatguard/model.h"

#define PLY_MAX_BYTES ((uint64_t) 1 << 36)
#define PLY_MAX_PROPERTIES 256 /* of all elements together */
#define PLY_MAX_ELEMENTS 32
#define PLY_NETWORKS "comment networks XXH3-64 "
#define PLY_HASH 17 /* with the zero that ends it */

enum ply_format { PLY_NO_FORMAT, PLY_ASCII, PLY_LITTLE, PLY_BIG };
enum ply_type { PLY_I8, PLY_U8, PLY_I16, PLY_U16, PLY_I32, PLY_U32, PLY_F32, PLY_F64 };

struct ply_property {
    char name[64];
    enum ply_type type;
    bool list;
    enum ply_type length_type; /* of a list */
};

struct ply_element {
    char name[64];
    uint64_t rows;
    int first, properties; /* range of all[] */
};

/* A file positioned at the rows of one element. */
struct ply {
    struct sg_source *in;
    enum ply_format format;
    uint64_t rows; /* of the element being read */
    int properties;
    size_t row_bytes; /* of a binary element without lists, else 0 */
    const struct ply_property *property;
    int elements, total;
    int current;             /* index of the element being read */
    char networks[PLY_HASH]; /* of the file of networks, by a comment; "": there is none */
    struct ply_element element[PLY_MAX_ELEMENTS];
    struct ply_property all[PLY_MAX_PROPERTIES];
};

/* Parses the header and skips elements before `vertex`. All row counts are checked against the
 * file's size, and that of `vertex` against max_rows, before one is believed. in must outlive p. */
int sg_ply_open(sg_ctx *ctx, struct ply *p, struct sg_source *in, uint64_t max_rows);

/* Fills format, element[] and all[]; leaves the stream at the first byte of the body. Errors name
 * the line. */
int sg_ply_parse_header(sg_ctx *ctx, struct ply *p);
/* Whether the first line is that of a PLY file, and not the first float of a .splat. */
bool sg_ply_is_marked(struct sg_source *in);

/* Index of a property that is not a list, or -1. */
int sg_ply_find(const struct ply *p, const char *name);

/* Next row: one float per property (0 for lists, whose contents are skipped). The bits of float32
 * values, signalling NaNs included, arrive unchanged. */
int sg_ply_row(sg_ctx *ctx, struct ply *p, uint64_t row, float *values);

/* After the last row of `vertex`: the elements behind it, and the end of the file where the header
 * says it is. */
int sg_ply_finish(sg_ctx *ctx, struct ply *p);

/* A model from a source at the first byte of a PLY file; see sg_model_read_ply. */
int sg_ply_read_model(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                      struct sg_model **out);

/* The name that a plane of a model has as a property. */
void sg_plane_name(int plane, int sh_degree, char name[24]);

#endif
