/* SPDX-License-Identifier: Apache-2.0 */
/* Headers of PLY files (Turk 1994). Nothing here is believed yet: counts are checked where rows are read. */
#include <stdio.h>
#include <string.h>

#include "ply.h"

#define MAX_LINES 4096
#define MAX_LINE 512

static bool parse_type(const char *name, enum ply_type *out)
{
    static const struct {
        const char *name;
        enum ply_type type;
    } types[] = {
        {"char", PLY_I8},   {"int8", PLY_I8},     {"uchar", PLY_U8},   {"uint8", PLY_U8},
        {"short", PLY_I16}, {"int16", PLY_I16},   {"ushort", PLY_U16}, {"uint16", PLY_U16},
        {"int", PLY_I32},   {"int32", PLY_I32},   {"uint", PLY_U32},   {"uint32", PLY_U32},
        {"float", PLY_F32}, {"float32", PLY_F32}, {"double", PLY_F64}, {"float64", PLY_F64},
    };
    for (size_t i = 0; i < sizeof(types) / sizeof(types[0]); i++)
        if (!strcmp(name, types[i].name)) {
            *out = types[i].type;
            return true;
        }
    return false;
}

/* Next header line without its end; false at the end of the file or if it is too long. */
static bool next_line(struct ply *p, char *line)
{
    const size_t left = p->size - p->at, most = left < MAX_LINE ? left : MAX_LINE;
    const char *start = p->data + p->at, *end = memchr(start, '\n', most);
    if (!end)
        return false;
    size_t n = (size_t) (end - start);
    p->at += n + 1;
    if (n && start[n - 1] == '\r')
        n--;
    memcpy(line, start, n);
    line[n] = 0;
    return true;
}

static bool parse_count(const char *text, uint64_t *out)
{
    uint64_t n = 0;
    for (const char *c = text; *c; c++)
        if (*c < '0' || *c > '9' || n > (UINT64_MAX - 9) / 10)
            return false;
        else
            n = 10 * n + (uint64_t) (*c - '0');
    *out = n;
    return *text;
}

static int parse_format(sg_ctx *ctx, struct ply *p, const char *line, int at)
{
    static const char *const names[] = {"", "ascii", "binary_little_endian", "binary_big_endian"};
    char name[32] = "", version[16] = "";
    sscanf(line, "format %31s %15s", name, version);
    for (enum ply_format f = PLY_ASCII; f <= PLY_BIG; f++)
        if (!strcmp(name, names[f]) && !strcmp(version, "1.0") && !p->format) {
            p->format = f;
            return SG_OK;
        }
    return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found \"%.60s\", expected one format, ascii or binary, 1.0",
                   p->path, at, line);
}

static int parse_element(sg_ctx *ctx, struct ply *p, const char *line, int at)
{
    char name[64], count[32];
    struct ply_element e = {.first = p->total};
    if (sscanf(line, "element %63s %31s", name, count) != 2 || !parse_count(count, &e.rows))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found \"%.60s\", expected an element's name and count", p->path,
                       at, line);
    if (p->elements == PLY_MAX_ELEMENTS)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found another element, expected at most %d", p->path, at,
                       PLY_MAX_ELEMENTS);
    snprintf(e.name, sizeof(e.name), "%.31s", name);
    p->element[p->elements++] = e;
    return SG_OK;
}

static int parse_property(sg_ctx *ctx, struct ply *p, const char *line, int at)
{
    char type[32], length[32], name[64];
    struct ply_property q = {0};
    bool good;
    if (sscanf(line, "property list %31s %31s %63s", length, type, name) == 3) {
        q.list = true;
        good = parse_type(type, &q.type) && parse_type(length, &q.length_type) && q.length_type < PLY_F32;
    } else
        good = sscanf(line, "property %31s %63s", type, name) == 2 && parse_type(type, &q.type);
    if (!good || !p->elements)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found \"%.60s\", expected an element's property of known type",
                       p->path, at, line);
    if (p->total == PLY_MAX_PROPERTIES)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found another property, expected at most %d", p->path, at,
                       PLY_MAX_PROPERTIES);
    snprintf(q.name, sizeof(q.name), "%.31s", name);
    p->all[p->total++] = q;
    p->element[p->elements - 1].properties++;
    return SG_OK;
}

static bool starts(const char *line, const char *word)
{
    const size_t n = strlen(word);
    return !strncmp(line, word, n) && (line[n] == ' ' || line[n] == '\t' || !line[n]);
}

int sg_ply_parse_header(sg_ctx *ctx, struct ply *p)
{
    char line[MAX_LINE];
    if (!next_line(p, line) || strcmp(line, "ply"))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line 1: found another kind of file, expected \"ply\"", p->path);
    for (int at = 2;; at++) {
        int code = SG_OK;
        if (at > MAX_LINES || !next_line(p, line))
            return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found no end_header, expected one", p->path, at);
        if (starts(line, "end_header")) {
            if (p->format)
                return SG_OK;
            return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found no format line before, expected one", p->path, at);
        }
        if (starts(line, "format"))
            code = parse_format(ctx, p, line, at);
        else if (starts(line, "element"))
            code = parse_element(ctx, p, line, at);
        else if (starts(line, "property"))
            code = parse_property(ctx, p, line, at);
        else if (!starts(line, "comment") && !starts(line, "obj_info") && line[0])
            code = sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found \"%.60s\", expected a PLY header line", p->path, at,
                           line);
        if (code)
            return code;
    }
}
