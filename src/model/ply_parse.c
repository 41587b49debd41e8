/* SPDX-License-Identifier: Apache-2.0 */
#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ply.h"

#define MAX_LINES 4096
#define MAX_LINE 512

static const struct {
    const char *name;
    enum ply_type type;
} type_names[] = {
    {"char", PLY_I8},   {"int8", PLY_I8},     {"uchar", PLY_U8},   {"uint8", PLY_U8},
    {"short", PLY_I16}, {"int16", PLY_I16},   {"ushort", PLY_U16}, {"uint16", PLY_U16},
    {"int", PLY_I32},   {"int32", PLY_I32},   {"uint", PLY_U32},   {"uint32", PLY_U32},
    {"float", PLY_F32}, {"float32", PLY_F32}, {"double", PLY_F64}, {"float64", PLY_F64},
};

static const size_t type_size[] = {1, 1, 2, 2, 4, 4, 4, 8};

static bool parse_type(const char *name, enum ply_type *out)
{
    for (size_t i = 0; i < sizeof(type_names) / sizeof(type_names[0]); i++)
        if (!strcmp(name, type_names[i].name)) {
            *out = type_names[i].type;
            return true;
        }
    return false;
}

/* Next header line without its end; false at the end of the file or if it is too long. */
static bool next_line(struct ply *p, char *line)
{
    const char *start = p->data + p->at, *end = memchr(start, '\n', p->size - p->at);
    if (!end || end - start >= MAX_LINE)
        return false;
    size_t n = (size_t) (end - start);
    p->at += n + 1;
    if (n && start[n - 1] == '\r')
        n--;
    memcpy(line, start, n);
    line[n] = 0;
    return true;
}

static size_t row_minimum(const struct ply *p)
{
    size_t bytes = 0;
    for (int i = 0; i < p->properties; i++) {
        if (p->format == PLY_ASCII)
            bytes += 2; /* a digit and a separator */
        else
            bytes += type_size[p->property[i].list ? p->property[i].length_type : p->property[i].type];
    }
    return bytes ? bytes : 1;
}

static double decode(const unsigned char *b, enum ply_type type, bool big)
{
    uint64_t bits = 0;
    const size_t n = type_size[type];
    for (size_t i = 0; i < n; i++)
        bits |= (uint64_t) b[big ? n - 1 - i : i] << (8 * i);
    float f;
    double d;
    const uint32_t low = (uint32_t) bits;
    switch (type) {
    case PLY_I8:
        return (int8_t) bits;
    case PLY_I16:
        return (int16_t) bits;
    case PLY_I32:
        return (int32_t) bits;
    case PLY_F32:
        memcpy(&f, &low, 4);
        return (double) f;
    case PLY_F64:
        memcpy(&d, &bits, 8);
        return d;
    default:
        return (double) bits;
    }
}

static int short_file(sg_ctx *ctx, const struct ply *p, uint64_t row)
{
    return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu: found the end of the file in row %llu, expected %llu rows",
                   p->path, p->size, (unsigned long long) row, (unsigned long long) p->rows);
}

/* One number at p->at. */
static int number(sg_ctx *ctx, struct ply *p, uint64_t row, enum ply_type type, double *out)
{
    if (p->format != PLY_ASCII) {
        if (p->size - p->at < type_size[type])
            return short_file(ctx, p, row);
        *out = decode((const unsigned char *) p->data + p->at, type, p->format == PLY_BIG);
        p->at += type_size[type];
        return SG_OK;
    }
    while (p->at < p->size && strchr(" \t\r\n", p->data[p->at]))
        p->at++;
    if (p->at >= p->size)
        return short_file(ctx, p, row);
    char *end; /* the file is followed by a zero byte */
    static locale_t c_locale;
    if (!c_locale)
        c_locale = newlocale(LC_ALL_MASK, "C", (locale_t) 0);
    *out = type == PLY_F64 ? strtod_l(p->data + p->at, &end, c_locale)
                           : (double) strtof_l(p->data + p->at, &end, c_locale);
    if (type != PLY_F64 && type != PLY_F32)
        *out = strtod_l(p->data + p->at, &end, c_locale);
    if (end == p->data + p->at)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu, row %llu: found '%c', expected a number", p->path, p->at,
                       (unsigned long long) row, p->data[p->at]);
    p->at = (size_t) (end - p->data);
    return SG_OK;
}

int sg_ply_row(sg_ctx *ctx, struct ply *p, uint64_t row, double *values)
{
    for (int i = 0; i < p->properties; i++) {
        const struct ply_property *q = &p->property[i];
        int code;
        if (!q->list) {
            if ((code = number(ctx, p, row, q->type, &values[i])))
                return code;
            continue;
        }
        double length, skipped;
        values[i] = 0;
        if ((code = number(ctx, p, row, q->length_type, &length)))
            return code;
        if (!(length >= 0 && length <= (double) p->size))
            return sg_fail(ctx, SG_ERR_INPUT, "%s: row %llu: found a list of %g items, expected at most %zu", p->path,
                           (unsigned long long) row, length, p->size);
        for (uint64_t k = 0; k < (uint64_t) length; k++)
            if ((code = number(ctx, p, row, q->type, &skipped)))
                return code;
    }
    return SG_OK;
}

int sg_ply_find(const struct ply *p, const char *name)
{
    for (int i = 0; i < p->properties; i++)
        if (!p->property[i].list && !strcmp(p->property[i].name, name))
            return i;
    return -1;
}

/* Steps over the rows of an element that comes before the wanted one. */
static int skip_rows(sg_ctx *ctx, struct ply *p)
{
    double values[PLY_MAX_PROPERTIES];
    int code = SG_OK;
    for (uint64_t row = 0; row < p->rows && !code && p->properties; row++)
        code = sg_ply_row(ctx, p, row, values);
    return code;
}

/* "property ..." of the current element. */
static int parse_property(sg_ctx *ctx, struct ply *p, const char *line, int number_of_line)
{
    char type[32], length[32], name[64];
    struct ply_property q = {0};
    bool good;
    if (sscanf(line, "property list %31s %31s %63s", length, type, name) == 3) {
        q.list = true;
        good = parse_type(type, &q.type) && parse_type(length, &q.length_type) && q.length_type < PLY_F32;
    } else
        good = sscanf(line, "property %31s %63s", type, name) == 2 && parse_type(type, &q.type);
    if (!good)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found \"%.60s\", expected a property with known types", p->path,
                       number_of_line, line);
    if (p->properties == PLY_MAX_PROPERTIES)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found more than %d properties", p->path, number_of_line,
                       PLY_MAX_PROPERTIES);
    snprintf(q.name, sizeof(q.name), "%.31s", name);
    p->property[p->properties++] = q;
    return SG_OK;
}

int sg_ply_open(sg_ctx *ctx, struct ply *p, const char *path, const char *data, size_t size, uint64_t max_rows)
{
    /* Elements in file order; those before `vertex` are skipped by a second walk of the header. */
    char line[MAX_LINE], format[32], name[64];
    int vertex = -1, elements = 0;
    size_t body = 0;
    *p = (struct ply){.path = path, .data = data, .size = size};
    for (int wanted = 0;; wanted++) {
        size_t here = p->at; /* in the body */
        p->at = 0;
        int n = 1, element = -1, code;
        p->properties = 0;
        p->rows = 0;
        if (!next_line(p, line) || strcmp(line, "ply"))
            return sg_fail(ctx, SG_ERR_INPUT, "%s: line 1: found another kind of file, expected \"ply\"", path);
        for (;;) {
            n++;
            if (n > MAX_LINES || !next_line(p, line))
                return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found no end_header", path, n);
            unsigned long long rows;
            if (!strcmp(line, "end_header"))
                break;
            if (!strncmp(line, "comment", 7) || !strncmp(line, "obj_info", 8) || !line[0])
                continue;
            if (sscanf(line, "format %31s", format) == 1) {
                if (!strcmp(format, "ascii"))
                    p->format = PLY_ASCII;
                else if (!strcmp(format, "binary_little_endian"))
                    p->format = PLY_LITTLE;
                else if (!strcmp(format, "binary_big_endian"))
                    p->format = PLY_BIG;
                else
                    return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found format \"%s\", expected ascii or binary",
                                   path, n, format);
            } else if (!strncmp(line, "element ", 8)) {
                if (strchr(line, '-') || sscanf(line, "element %63s %llu", name, &rows) != 2)
                    return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found \"%.60s\", expected a name and a count", path,
                                   n, line);
                element++;
                if (!strcmp(name, "vertex") && vertex < 0)
                    vertex = element;
                if (element == wanted)
                    p->rows = rows;
            } else if (!strncmp(line, "property ", 9) && element >= 0) {
                if (element == wanted && (code = parse_property(ctx, p, line, n)))
                    return code;
            } else
                return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found \"%.60s\", expected a PLY header line", path, n,
                               line);
        }
        elements = element + 1;
        if (vertex < 0 || vertex >= elements)
            return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found no element vertex in the header", path, n);
        body = p->at;
        p->at = wanted ? here : body;
        const uint64_t room = (p->size - p->at) / row_minimum(p) + (p->format == PLY_ASCII);
        if (p->rows > room && p->properties)
            return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %zu: found %zu bytes, expected %llu rows of at least %zu bytes",
                           path, p->at, p->size - p->at, (unsigned long long) p->rows, row_minimum(p));
        if (wanted == vertex)
            break;
        if ((code = skip_rows(ctx, p)))
            return code;
    }
    if (!p->properties)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no property of element vertex", path);
    if (p->rows > max_rows)
        return sg_fail(ctx, SG_ERR_BUDGET, "%s: found %llu rows, the limit is %llu", path, (unsigned long long) p->rows,
                       (unsigned long long) max_rows);
    return SG_OK;
}
