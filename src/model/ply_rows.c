/* SPDX-License-Identifier: Apache-2.0 */
/* Rows of PLY files, in any of the three encodings. */
#include <string.h>

#include "core/numbers.h"
#include "ply.h"

static const size_t type_size[] = {1, 1, 2, 2, 4, 4, 4, 8};

static bool is_space(char c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

/* Fewest bytes a row can take: with it, a row count that the file cannot hold is refused before it is used. */
static size_t row_minimum(const struct ply *p)
{
    size_t bytes = 0;
    for (int i = 0; i < p->properties; i++) {
        const struct ply_property *q = &p->property[i];
        if (p->format == PLY_ASCII)
            bytes += 2; /* a digit and a separator */
        else
            bytes += type_size[q->list ? q->length_type : q->type];
    }
    return bytes;
}

static int short_file(sg_ctx *ctx, const struct ply *p, uint64_t row)
{
    return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu: found the end of the file in row %llu, expected %llu rows",
                   p->path, p->size, (unsigned long long) row, (unsigned long long) p->rows);
}

/* Bytes of a number in the order of a little-endian machine. */
static uint64_t binary_bits(const char *bytes, size_t n, bool big)
{
    uint64_t bits = 0;
    for (size_t i = 0; i < n; i++)
        bits |= (uint64_t) (unsigned char) bytes[big ? n - 1 - i : i] << (8 * i);
    return bits;
}

static double binary_value(uint64_t bits, enum ply_type type)
{
    double d;
    switch (type) {
    case PLY_I8:
        return (int8_t) bits;
    case PLY_I16:
        return (int16_t) bits;
    case PLY_I32:
        return (int32_t) bits;
    case PLY_F64:
        memcpy(&d, &bits, 8);
        return d;
    default: /* unsigned; F32 is never converted */
        return (double) bits;
    }
}

/* One word of an ASCII body. */
static int text_value(sg_ctx *ctx, struct ply *p, uint64_t row, enum ply_type type, double *out)
{
    while (p->at < p->size && is_space(p->data[p->at]))
        p->at++;
    if (p->at == p->size)
        return short_file(ctx, p, row);
    const char *word = p->data + p->at;
    char *end;
    /* strtof where the file says float: rounding once, a printed float returns to its bits. */
    *out = type == PLY_F32 ? (double) sg_strtof(word, &end) : sg_strtod(word, &end);
    if (end == word || (*end && !is_space(*end)) || (!*end && end < p->data + p->size))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu, row %llu: found \"%.20s\", expected a number", p->path, p->at,
                       (unsigned long long) row, word);
    p->at = (size_t) (end - p->data);
    return SG_OK;
}

static int next_value(sg_ctx *ctx, struct ply *p, uint64_t row, enum ply_type type, float *out)
{
    if (p->format == PLY_ASCII) {
        double d = 0;
        const int code = text_value(ctx, p, row, type, &d);
        *out = (float) d;
        return code;
    }
    const size_t n = type_size[type];
    if (p->size - p->at < n)
        return short_file(ctx, p, row);
    const uint64_t bits = binary_bits(p->data + p->at, n, p->format == PLY_BIG);
    if (type == PLY_F32)
        memcpy(out, &(uint32_t){(uint32_t) bits}, 4); /* a conversion to double would quieten NaNs */
    else
        *out = (float) binary_value(bits, type);
    p->at += n;
    return SG_OK;
}

static int skip_list(sg_ctx *ctx, struct ply *p, uint64_t row, const struct ply_property *q)
{
    double length = 0, ignored;
    int code = SG_OK;
    if (p->format == PLY_ASCII)
        code = text_value(ctx, p, row, q->length_type, &length);
    else if (p->size - p->at < type_size[q->length_type])
        code = short_file(ctx, p, row);
    else {
        length =
            binary_value(binary_bits(p->data + p->at, type_size[q->length_type], p->format == PLY_BIG), q->length_type);
        p->at += type_size[q->length_type];
    }
    if (code)
        return code;
    const size_t least = p->format == PLY_ASCII ? 1 : type_size[q->type], most = (p->size - p->at) / least;
    if (!(length >= 0 && length <= (double) most))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu, row %llu: found a list of %g items, expected 0 to %zu",
                       p->path, p->at, (unsigned long long) row, length, most);
    if (p->format != PLY_ASCII)
        p->at += (size_t) length * least;
    else
        for (size_t k = 0; k < (size_t) length && !code; k++)
            code = text_value(ctx, p, row, q->type, &ignored);
    return code;
}

int sg_ply_row(sg_ctx *ctx, struct ply *p, uint64_t row, float *values)
{
    int code = SG_OK;
    for (int i = 0; i < p->properties && !code; i++) {
        const struct ply_property *q = &p->property[i];
        if (q->list) {
            values[i] = 0;
            code = skip_list(ctx, p, row, q);
        } else
            code = next_value(ctx, p, row, q->type, &values[i]);
    }
    return code;
}

int sg_ply_find(const struct ply *p, const char *name)
{
    for (int i = 0; i < p->properties; i++)
        if (!p->property[i].list && !strcmp(p->property[i].name, name))
            return i;
    return -1;
}

/* Makes an element the current one. */
static int enter(sg_ctx *ctx, struct ply *p, const struct ply_element *e)
{
    p->rows = e->rows;
    p->properties = e->properties;
    p->property = p->all + e->first;
    const size_t least = row_minimum(p), left = p->size - p->at;
    /* The last number of an ASCII file needs no separator. */
    if (least && p->rows > (left + (p->format == PLY_ASCII)) / least)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %zu: found %zu bytes, expected %llu rows of at least %zu bytes of %s", p->path, p->at,
                       left, (unsigned long long) p->rows, least, e->name);
    return SG_OK;
}

int sg_ply_open(sg_ctx *ctx, struct ply *p, const char *path, const char *data, size_t size, uint64_t max_rows)
{
    *p = (struct ply){.path = path, .data = data, .size = size};
    int code = sg_ply_parse_header(ctx, p);
    float ignored[PLY_MAX_PROPERTIES];
    for (int e = 0; e < p->elements && !code; e++) {
        code = enter(ctx, p, &p->element[e]);
        if (!code && !strcmp(p->element[e].name, "vertex")) {
            if (!p->properties)
                return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found no property of element vertex", path);
            if (p->rows > max_rows)
                return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found %llu rows, the limit is %llu", path,
                               (unsigned long long) p->rows, (unsigned long long) max_rows);
            return SG_OK;
        }
        for (uint64_t row = 0; p->properties && row < p->rows && !code; row++)
            code = sg_ply_row(ctx, p, row, ignored);
    }
    return code ? code : sg_fail(ctx, SG_ERR_INPUT, "%s: header: found no element vertex, expected one", path);
}
