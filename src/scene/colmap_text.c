/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP's text files: one record a line (images: two), fields separated by blanks, # starts a
 * comment line. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/numbers.h"
#include "scene/colmap.h"

#define SHOWN 80 /* bytes of a line that messages quote */
/* of a line that are kept: the tracks of points and the observations of images are longer */
#define LINE_BYTES 4096
#define CANCEL_BYTES (16u << 20) /* are read in a fraction of a second */

struct lines {
    struct sg_source *in;
    uint64_t at;     /* where the line last returned begins */
    uint64_t seen;   /* bytes since the caller could last cancel */
    uint64_t number; /* of the line last returned, from 1 */
    size_t words;    /* in all of that line */
    char last[24];   /* the beginning of its last word */
    bool cut;        /* the line was longer than what is kept */
    size_t room;     /* bytes by which it can be longer */
    int code;        /* why reading ended early: no text, or the caller cancelled */
    char text[LINE_BYTES];
};

static int begin(sg_ctx *ctx, struct lines *l, struct sg_source *in)
{
    l->in = in, l->seen = 0, l->number = 0, l->code = SG_OK;
    return sg_source_skip_mark(ctx, in);
}

/* The rest of a text that cannot be read must not be taken for its end. */
static int check_end(sg_ctx *ctx, const struct sg_source *in)
{
    if (!sg_source_left(in))
        return SG_OK;
    return sg_fail(ctx, SG_ERR_INPUT, "%s: found %llu bytes, expected %llu: cannot read on",
                   in->path, (unsigned long long) in->at, (unsigned long long) in->size);
}

/* NULL at the end, and with a code where a line holds a zero byte, the rest cannot be read or the
 * caller cancels. */
static char *next_line(sg_ctx *ctx, struct lines *l)
{
    struct sg_source *in = l->in;
    size_t kept = 0, letters = 0;
    bool blank = true, whole = false;
    if (l->code)
        return NULL;
    if (!sg_source_fill(in, 1)) {
        l->code = check_end(ctx, in);
        return NULL;
    }
    l->at = in->at, l->number++, l->words = 0, l->cut = false;
    for (size_t ready; !whole && (ready = sg_source_fill(in, 1));) {
        const char *end = memchr(in->window, '\n', ready);
        const size_t n = end ? (size_t) (end - in->window) : ready;
        l->seen += n + 1;
        if (l->seen > CANCEL_BYTES) {
            l->seen = 0;
            if ((l->code = sg_progress(ctx, SG_STAGE_LOAD, 0, 1)))
                return NULL;
        }
        if (memchr(in->window, 0, n)) {
            l->code = sg_fail(ctx, SG_ERR_INPUT, "%s: line %llu: found a zero byte, expected text",
                              in->path, (unsigned long long) l->number);
            return NULL;
        }
        for (size_t i = 0; i < n; i++) {
            const char c = in->window[i];
            const bool space = c == ' ' || c == '\t' || c == '\r';
            l->words += blank && !space;
            if (!space) {
                letters = blank ? 0 : letters;
                if (letters < sizeof(l->last) - 1)
                    l->last[letters++] = c;
            }
            blank = space;
        }
        const size_t room = LINE_BYTES - 1 - kept, more = n < room ? n : room;
        memcpy(l->text + kept, in->window, more);
        kept += more;
        l->cut |= more < n;
        whole = end;
        sg_source_skip(in, n + whole);
    }
    if (!whole && (l->code = check_end(ctx, in)))
        return NULL;
    l->text[kept] = 0, l->last[letters] = 0, l->room = LINE_BYTES - 1 - kept;
    if (kept && !l->cut && l->text[kept - 1] == '\r')
        l->text[kept - 1] = 0;
    return l->text;
}

static bool is_comment(const char *line)
{
    return *line == '#';
}

static bool is_blank(const char *line)
{
    return !line[strspn(line, " \t")];
}

/* Next line with a record, NULL at the end. */
static char *next_record(sg_ctx *ctx, struct lines *l)
{
    char *line;
    do
        line = next_line(ctx, l);
    while (line && (is_comment(line) || is_blank(line)));
    return line;
}

static bool field_ends(const char *p)
{
    return !*p || *p == ' ' || *p == '\t';
}

static bool get_number(char **p, double *out)
{
    char *end;
    *out = sg_strtod(*p, &end);
    bool ok = end != *p && field_ends(end);
    *p = end;
    return ok;
}

static bool get_whole(char **p, uint64_t max, uint64_t *out)
{
    char *s = *p + strspn(*p, " \t"), *end;
    *p = s;
    if (*s < '0' || *s > '9') /* strtoull accepts a minus sign */
        return false;
    errno = 0;
    *out = strtoull(s, &end, 10);
    bool ok = !errno && *out <= max && field_ends(end);
    *p = end;
    return ok;
}

static int bad_line(sg_ctx *ctx, const struct lines *l, const char *expected)
{
    const bool whole = strlen(l->text) <= SHOWN && !l->cut;
    return sg_fail(ctx, SG_ERR_INPUT, "%s: line %llu: found \"%.*s%s\", expected %s", l->in->path,
                   (unsigned long long) l->number, SHOWN, l->text, whole ? "" : "...", expected);
}

int sg_colmap_cameras_txt(sg_ctx *ctx, struct sg_source *in, struct sg_colmap_cameras *out)
{
    struct lines l;
    int code = begin(ctx, &l, in);
    for (char *p; !code && (p = next_record(ctx, &l));) {
        char where[512], name[32];
        uint64_t id, width = 0, height = 0;
        bool ok = get_whole(&p, UINT32_MAX, &id);
        p += strspn(p, " \t");
        size_t length = strcspn(p, " \t");
        if (!ok || length >= sizeof(name))
            return bad_line(ctx, &l, "ID MODEL WIDTH HEIGHT PARAMS");
        memcpy(name, p, length);
        name[length] = 0;
        p += length;
        snprintf(where, sizeof(where), "%s: line %llu", in->path, (unsigned long long) l.number);
        int model = sg_colmap_model_find(name);
        if (model < 0)
            return sg_colmap_refuse_model(ctx, where, name);
        double params[SG_COLMAP_PARAMS_MAX];
        ok = get_whole(&p, UINT32_MAX, &width) && get_whole(&p, UINT32_MAX, &height);
        for (int k = 0; k < sg_colmap_model_params(model) && ok; k++)
            ok = get_number(&p, &params[k]);
        if (!ok || !is_blank(p)) {
            char expected[96];
            snprintf(expected, sizeof(expected), "ID %s WIDTH HEIGHT and %d numbers", name,
                     sg_colmap_model_params(model));
            return bad_line(ctx, &l, expected);
        }
        code = sg_colmap_add_camera(ctx, out, where, (uint32_t) id, model, width, height, params);
    }
    if (!code)
        code = l.code;
    return code ? code : sg_colmap_sort_cameras(ctx, out, in->path);
}

/* X, Y and a number for each point. The name of another image, which the number of words need not
 * tell, is none. */
static bool has_points(const struct lines *l)
{
    char *end;
    const char *last = l->last + (l->last[0] == '+');
    sg_strtod(last, &end);
    return l->words % 3 == 0 && (!l->words || (end != last && !*end));
}

int sg_colmap_images_txt(sg_ctx *ctx, struct sg_source *in, uint64_t max_images,
                         const struct sg_colmap_cameras *cameras, struct sg_shots *out)
{
    struct lines l;
    int code = begin(ctx, &l, in);
    for (char *p; !code && (p = next_record(ctx, &l));) {
        char where[512];
        uint64_t id, camera = 0;
        double q[4], t[3];
        bool ok = get_whole(&p, UINT32_MAX, &id);
        for (int k = 0; k < 4 && ok; k++)
            ok = get_number(&p, &q[k]);
        for (int k = 0; k < 3 && ok; k++)
            ok = get_number(&p, &t[k]);
        if (!ok || !get_whole(&p, UINT32_MAX, &camera) || is_blank(p) || l.cut)
            return bad_line(ctx, &l, "ID QW QX QY QZ TX TY TZ CAMERA_ID NAME");
        p += strspn(p, " \t"); /* a name may hold blanks: it is the rest of the line */
        for (size_t n = strlen(p); n && strchr(" \t\r", p[n - 1]); n--)
            p[n - 1] = 0;
        const struct sg_colmap_name name = {p, l.at + (uint64_t) (p - l.text), l.room};
        snprintf(where, sizeof(where), "%s: line %llu", in->path, (unsigned long long) l.number);
        code = sg_colmap_add_image(ctx, out, max_images, cameras, where, (uint32_t) camera, q, t,
                                   &name);
        /* Its 2D points, three numbers each, possibly an empty line. A file without them would lose
         * every other image. */
        if (!code && next_line(ctx, &l) && !has_points(&l))
            code = bad_line(ctx, &l, "2D points, three numbers each, or an empty line");
    }
    return code ? code : l.code;
}

int sg_colmap_points_txt(sg_ctx *ctx, struct sg_source *in, uint64_t max_points,
                         struct sg_points *out)
{
    struct lines l;
    const int code = begin(ctx, &l, in);
    if (code)
        return code;
    size_t room_xyz = 0, room_rgb = 0;
    for (char *p; (p = next_record(ctx, &l));) {
        uint64_t id, rgb[3];
        double xyz[3];
        bool ok = get_whole(&p, UINT64_MAX, &id);
        for (int k = 0; k < 3 && ok; k++)
            ok = get_number(&p, &xyz[k]) && fabs(xyz[k]) < 1e30;
        for (int k = 0; k < 3 && ok; k++)
            ok = get_whole(&p, 255, &rgb[k]);
        if (!ok)
            return bad_line(ctx, &l, "ID X Y Z R G B ERROR TRACK");
        if (out->count >= max_points)
            return sg_fail(
                ctx, SG_ERR_INPUT, "%s: line %llu: found more than %llu points, which is the limit",
                in->path, (unsigned long long) l.number, (unsigned long long) max_points);
        size_t n = out->count;
        if (sg_grow(ctx, SG_MEM_MISC, &out->xyz, &room_xyz, n + 1, n, 3 * sizeof(float)) ||
            sg_grow(ctx, SG_MEM_MISC, &out->rgb, &room_rgb, n + 1, n, 3))
            return SG_ERR_BUDGET;
        for (size_t k = 0; k < 3; k++) {
            out->xyz[3 * n + k] = (float) xyz[k];
            out->rgb[3 * n + k] = (uint8_t) rgb[k];
        }
        out->count++;
    }
    return l.code;
}
