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

#define WORD_BYTES 512 /* of a number in text */

/* Fewest bytes a row can take: with it, a row count that the file cannot hold is refused before it
 * is used. *lists: rows can take more. */
static size_t row_minimum(const struct ply *p, const struct ply_element *e, bool *lists)
{
    size_t bytes = 0;
    *lists = false;
    for (int i = 0; i < e->properties; i++) {
        const struct ply_property *q = &p->all[e->first + i];
        *lists |= q->list;
        if (p->format == PLY_ASCII)
            bytes += 2; /* a digit and a separator */
        else
            bytes += type_size[q->list ? q->length_type : q->type];
    }
    return bytes;
}

static int short_file(sg_ctx *ctx, const struct ply *p, uint64_t row)
{
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: byte %llu: found the end of the file in row %llu, expected %llu rows",
                   p->in->path, (unsigned long long) p->in->size, (unsigned long long) row,
                   (unsigned long long) p->rows);
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

static void skip_space(struct sg_source *in)
{
    for (const char *c; (c = sg_source_peek(in, 1)) && is_space(*c);)
        sg_source_skip(in, 1);
}

/* One word of an ASCII body. */
static int text_value(sg_ctx *ctx, struct ply *p, uint64_t row, enum ply_type type, double *out)
{
    struct sg_source *in = p->in;
    char word[WORD_BYTES + 1], *end;
    size_t n = 0;
    skip_space(in);
    const uint64_t at = in->at;
    const size_t ready = sg_source_fill(in, WORD_BYTES + 1);
    if (!ready)
        return short_file(ctx, p, row);
    for (; n < ready && n < WORD_BYTES && !is_space(in->window[n]); n++)
        word[n] = in->window[n];
    word[n] = 0;
    if (n < ready && !is_space(in->window[n])) /* the rest would be read as another number */
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %llu, row %llu: found \"%.20s...\", expected a number of at most "
                       "%d bytes",
                       in->path, (unsigned long long) at, (unsigned long long) row, word,
                       WORD_BYTES);
    /* strtof where the file says float: rounding once, a printed float returns to its bits. */
    *out = type == PLY_F32 ? (double) sg_strtof(word, &end) : sg_strtod(word, &end);
    if (end != word + n)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %llu, row %llu: found \"%.20s\", expected a number", in->path,
                       (unsigned long long) at, (unsigned long long) row, word);
    sg_source_skip(in, n);
    return SG_OK;
}

static float binary_float(const char *bytes, enum ply_type type, bool big)
{
    const uint64_t bits = binary_bits(bytes, type_size[type], big);
    float value;
    if (type != PLY_F32)
        return (float) binary_value(bits, type);
    memcpy(&value, &(uint32_t){(uint32_t) bits}, 4); /* a conversion to double would quieten NaNs */
    return value;
}

static int next_value(sg_ctx *ctx, struct ply *p, uint64_t row, enum ply_type type, float *out)
{
    if (p->format == PLY_ASCII) {
        double d = 0;
        const int code = text_value(ctx, p, row, type, &d);
        *out = (float) d;
        return code;
    }
    const char *bytes = sg_source_peek(p->in, type_size[type]);
    if (!bytes)
        return short_file(ctx, p, row);
    *out = binary_float(bytes, type, p->format == PLY_BIG);
    sg_source_skip(p->in, type_size[type]);
    return SG_OK;
}

static int skip_list(sg_ctx *ctx, struct ply *p, uint64_t row, const struct ply_property *q)
{
    double length = 0, ignored;
    int code = SG_OK;
    const bool text = p->format == PLY_ASCII;
    const char *bytes = text ? NULL : sg_source_peek(p->in, type_size[q->length_type]);
    if (text)
        code = text_value(ctx, p, row, q->length_type, &length);
    else if (!bytes)
        code = short_file(ctx, p, row);
    else {
        length = binary_value(binary_bits(bytes, type_size[q->length_type], p->format == PLY_BIG),
                              q->length_type);
        sg_source_skip(p->in, type_size[q->length_type]);
    }
    if (code)
        return code;
    const uint64_t least = text ? 1 : type_size[q->type], most = sg_source_left(p->in) / least;
    if (!(length >= 0 && length <= (double) most))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %llu, row %llu: found a list of %g items, expected 0 to %llu",
                       p->in->path, (unsigned long long) p->in->at, (unsigned long long) row,
                       length, (unsigned long long) most);
    if (!text)
        sg_source_skip(p->in, (uint64_t) length * least);
    else
        for (uint64_t k = 0; k < (uint64_t) length && !code; k++)
            code = text_value(ctx, p, row, q->type, &ignored);
    return code;
}

int sg_ply_row(sg_ctx *ctx, struct ply *p, uint64_t row, float *values)
{
    int code = SG_OK;
    if (p->row_bytes) {
        const char *bytes = sg_source_peek(p->in, p->row_bytes);
        if (!bytes)
            return short_file(ctx, p, row);
        for (int i = 0; i < p->properties; bytes += type_size[p->property[i++].type])
            values[i] = binary_float(bytes, p->property[i].type, p->format == PLY_BIG);
        sg_source_skip(p->in, p->row_bytes);
        return SG_OK;
    }
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

/* Whether the file can hold all rows of the header; where rows have a fixed size, whether it holds
 * exactly those. */
static int check_size(sg_ctx *ctx, const struct ply *p)
{
    const struct sg_source *in = p->in;
    uint64_t left =
        sg_source_left(in) + (p->format == PLY_ASCII); /* the last number needs no separator */
    bool lists, any = p->format == PLY_ASCII;
    for (int i = 0; i < p->elements; i++) {
        const struct ply_element *e = &p->element[i];
        const size_t least = row_minimum(p, e, &lists);
        if (least && e->rows > left / least)
            return sg_fail(
                ctx, SG_ERR_INPUT,
                "%s: byte %llu: found %llu bytes, expected %llu rows of at least %zu bytes of %s",
                in->path, (unsigned long long) in->at, (unsigned long long) sg_source_left(in),
                (unsigned long long) e->rows, least, e->name);
        left -= e->rows * least;
        any |= lists && e->rows;
    }
    if (left && !any)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %llu: found %llu bytes after the last row, expected none",
                       in->path, (unsigned long long) (in->size - left), (unsigned long long) left);
    return SG_OK;
}

/* Makes an element the current one. */
static void enter(struct ply *p, int i)
{
    const struct ply_element *e = &p->element[i];
    bool lists;
    const size_t bytes = row_minimum(p, e, &lists);
    p->current = i;
    p->rows = e->rows;
    p->properties = e->properties;
    p->property = p->all + e->first;
    p->row_bytes = p->format == PLY_ASCII || lists ? 0 : bytes;
}

static int skip_rows(sg_ctx *ctx, struct ply *p)
{
    float ignored[PLY_MAX_PROPERTIES];
    int code = SG_OK;
    if (p->row_bytes) { /* the file holds them: see check_size, but for lists before */
        if (p->rows > sg_source_left(p->in) / p->row_bytes)
            return short_file(ctx, p, 0);
        sg_source_skip(p->in, p->rows * p->row_bytes);
        return SG_OK;
    }
    for (uint64_t row = 0; p->properties && row < p->rows && !code; row++)
        code = sg_ply_row(ctx, p, row, ignored);
    return code;
}

int sg_ply_open(sg_ctx *ctx, struct ply *p, struct sg_source *in, uint64_t max_rows)
{
    *p = (struct ply){.in = in};
    int code = sg_ply_parse_header(ctx, p), vertex = 0;
    if (code)
        return code;
    while (vertex < p->elements && strcmp(p->element[vertex].name, "vertex"))
        vertex++;
    if (vertex == p->elements)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found no element vertex, expected one",
                       in->path);
    if (!p->element[vertex].properties)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found no property of element vertex",
                       in->path);
    code = check_size(ctx, p);
    if (!code && p->element[vertex].rows > max_rows)
        code =
            sg_fail(ctx, SG_ERR_INPUT, "%s: header: found %llu rows, the limit is %llu", in->path,
                    (unsigned long long) p->element[vertex].rows, (unsigned long long) max_rows);
    for (int i = 0; i < vertex && !code; i++) {
        enter(p, i);
        code = skip_rows(ctx, p);
    }
    enter(p, vertex);
    return code;
}

int sg_ply_finish(sg_ctx *ctx, struct ply *p)
{
    int code = SG_OK;
    for (int i = p->current + 1; i < p->elements && !code; i++) {
        enter(p, i);
        code = skip_rows(ctx, p);
    }
    if (p->format == PLY_ASCII)
        skip_space(p->in);
    if (!code && sg_source_left(p->in))
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %llu: found %llu bytes after the last row, expected none",
                       p->in->path, (unsigned long long) p->in->at,
                       (unsigned long long) sg_source_left(p->in));
    return code;
}
