/* SPDX-License-Identifier: Apache-2.0 */
/* Headers of PLY files (Turk 1994). Counts are not trusted here: they are checked before rows are
 * read. */
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
    const size_t ready = sg_source_fill(p->in, MAX_LINE),
                 most = ready < MAX_LINE ? ready : MAX_LINE;
    const char *start = p->in->window, *end = most ? memchr(start, '\n', most) : NULL;
    if (!end)
        return false;
    size_t n = (size_t) (end - start);
    memcpy(line, start, n);
    sg_source_skip(p->in, n + 1);
    if (n && line[n - 1] == '\r')
        n--;
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
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: line %d: found \"%.60s\", expected one format, ascii or binary, 1.0",
                   p->in->path, at, line);
}

/* Whether a line ends after the characters that sscanf has read. */
static bool is_whole(const char *line, int read)
{
    return read > 0 && !line[read + (int) strspn(line + read, " \t")];
}

static int parse_element(sg_ctx *ctx, struct ply *p, const char *line, int at)
{
    char count[32];
    int read = 0;
    struct ply_element e = {.first = p->total};
    if (sscanf(line, "element %63s %31s%n", e.name, count, &read) != 2 || !is_whole(line, read) ||
        !parse_count(count, &e.rows))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: line %d: found \"%.60s\", expected an element's name and count",
                       p->in->path, at, line);
    if (p->elements == PLY_MAX_ELEMENTS)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found another element, expected at most %d",
                       p->in->path, at, PLY_MAX_ELEMENTS);
    for (int i = 0; i < p->elements; i++)
        if (!strcmp(p->element[i].name, e.name))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: line %d: found element %s twice, expected it once", p->in->path, at,
                           e.name);
    p->element[p->elements++] = e;
    return SG_OK;
}

static int parse_property(sg_ctx *ctx, struct ply *p, const char *line, int at)
{
    char type[32], length[32];
    struct ply_property q = {0};
    bool good;
    int read = 0;
    if (sscanf(line, "property list %31s %31s %63s%n", length, type, q.name, &read) == 3) {
        q.list = true;
        good = parse_type(type, &q.type) && parse_type(length, &q.length_type) &&
               q.length_type < PLY_F32;
    } else
        good = sscanf(line, "property %31s %63s%n", type, q.name, &read) == 2 &&
               parse_type(type, &q.type);
    if (!good || !is_whole(line, read) || !p->elements)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: line %d: found \"%.60s\", expected an element's property of known type",
                       p->in->path, at, line);
    if (p->total == PLY_MAX_PROPERTIES)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: line %d: found another property, expected at most %d", p->in->path, at,
                       PLY_MAX_PROPERTIES);
    for (int i = p->element[p->elements - 1].first; i < p->total; i++)
        if (!strcmp(p->all[i].name, q.name))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: line %d: found property %s twice, expected it once", p->in->path,
                           at, q.name);
    p->all[p->total++] = q;
    p->element[p->elements - 1].properties++;
    return SG_OK;
}

static bool starts(const char *line, const char *word)
{
    const size_t n = strlen(word);
    return !strncmp(line, word, n) && (line[n] == ' ' || line[n] == '\t' || !line[n]);
}

bool sg_ply_is_marked(struct sg_source *in)
{
    const char *start = sg_source_peek(in, 4);
    return start && (!memcmp(start, "ply\n", 4) || !memcmp(start, "ply\r", 4));
}

int sg_ply_parse_header(sg_ctx *ctx, struct ply *p)
{
    char line[MAX_LINE];
    const int marked = sg_source_skip_mark(ctx, p->in);
    if (marked)
        return marked;
    char first[17];
    const size_t most = sizeof(first) - 1, ready = sg_source_fill(p->in, most),
                 n = ready < most ? ready : most;
    const char *end = n ? memchr(p->in->window, '\n', n) : NULL;
    sg_show_bytes(p->in->window, end ? (size_t) (end - p->in->window) : n, first);
    if (!next_line(p, line) || strcmp(line, "ply"))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: line 1: found \"%s\", expected \"ply\"", p->in->path,
                       first);
    for (int at = 2;; at++) {
        int code = SG_OK;
        if (at > MAX_LINES || !next_line(p, line))
            return sg_fail(ctx, SG_ERR_INPUT, "%s: line %d: found no end_header, expected one",
                           p->in->path, at);
        if (starts(line, "end_header")) {
            if (p->format)
                return SG_OK;
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: line %d: found no format line before, expected one", p->in->path,
                           at);
        }
        if (starts(line, "format"))
            code = parse_format(ctx, p, line, at);
        else if (starts(line, "element"))
            code = parse_element(ctx, p, line, at);
        else if (starts(line, "property"))
            code = parse_property(ctx, p, line, at);
        else if (starts(line, "comment"))
            sscanf(line, PLY_NETWORKS "%16[0-9a-f]", p->networks);
        else if (!starts(line, "obj_info") && line[0])
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: line %d: found \"%.60s\", expected a PLY header line", p->in->path,
                           at, line);
        if (code)
            return code;
    }
}
