/* SPDX-License-Identifier: Apache-2.0 */
/* .ksplat of GaussianSplats3D (Kellogg): a header, headers of sections, then the sections. Level 0
 * of its compression has floats; levels 1 and 2 have positions within buckets and half floats, and
 * level 2 SH as bytes. */
#include "codec.h"

#define HEADER 4096
#define SECTION_HEADER 1024
#define WHOLE_RANGE 32767 /* of positions in a bucket where the file says 0 */

struct file {
    sg_ctx *ctx;
    struct sg_source *in;
    int level, sh_degree; /* the highest of its sections */
    uint32_t sections, count;
    float sh_low, sh_high; /* what the bytes of level 2 span */
};

struct section {
    uint32_t count, room; /* Gaussians, and rows in the file */
    uint32_t bucket_size, buckets, full, partial;
    uint32_t range;
    uint16_t bucket_bytes;
    int sh_degree;
    float block;
};

static void parse_section(const char *b, struct section *s)
{
    *s = (struct section){
        .count = sg_u32(b),
        .room = sg_u32(b + 4),
        .bucket_size = sg_u32(b + 8),
        .buckets = sg_u32(b + 12),
        .block = sg_f32(b + 16),
        .bucket_bytes = sg_u16(b + 20),
        .range = sg_u32(b + 24) ? sg_u32(b + 24) : WHOLE_RANGE,
        .full = sg_u32(b + 32),
        .partial = sg_u32(b + 36),
        .sh_degree = sg_u16(b + 40),
    };
}

static size_t row_bytes(int level, int sh_degree)
{
    const size_t rest = (size_t) sg_sh_rest(sh_degree);
    return level == 0 ? 44 + 4 * rest : level == 1 ? 24 + 2 * rest : 24 + rest;
}

static float half(const char *bytes)
{
    const uint16_t h = sg_u16(bytes);
    const int exponent = h >> 10 & 31, fraction = h & 1023;
    const float value = exponent == 31  ? fraction ? NAN : INFINITY
                        : exponent == 0 ? ldexpf((float) fraction, -24)
                                        : ldexpf((float) (1024 + fraction), exponent - 25);
    return h & 0x8000 ? -value : value;
}

static int check_section(const struct file *f, uint32_t index, const struct section *s)
{
    if (s->sh_degree > 3)
        return sg_fail(f->ctx, SG_ERR_INPUT, "%s: section %u: found SH degree %d, expected 0 to 3",
                       f->in->path, index, s->sh_degree);
    if (s->count > s->room)
        return sg_fail(f->ctx, SG_ERR_INPUT, "%s: section %u: found %u Gaussians in room for %u",
                       f->in->path, index, s->count, s->room);
    if (f->level && s->count &&
        ((uint64_t) s->full + s->partial > s->buckets || s->bucket_bytes != 12))
        return sg_fail(f->ctx, SG_ERR_INPUT,
                       "%s: section %u: found %u full and %u other buckets of %u bytes, expected "
                       "%u in all of 12",
                       f->in->path, index, s->full, s->partial, s->bucket_bytes, s->buckets);
    return SG_OK;
}

/* Both passes over the headers of sections read from one copy of them. */
static int read_headers(struct file *f, char **headers)
{
    struct sg_source *in = f->in;
    const char *b = sg_source_peek(in, HEADER);
    if (!b)
        return sg_fail(f->ctx, SG_ERR_INPUT, "%s: found %llu bytes, expected a header of %d",
                       in->path, (unsigned long long) in->size, HEADER);
    f->sections = sg_u32(b + 4), f->count = sg_u32(b + 16);
    f->level = sg_u16(b + 20);
    f->sh_low = sg_f32(b + 36), f->sh_high = sg_f32(b + 40);
    if (f->sh_low == 0 && f->sh_high == 0) /* as files without SH and older ones have */
        f->sh_low = -1.5f, f->sh_high = 1.5f;
    if (b[0] != 0 || b[1] < 1)
        return sg_fail(f->ctx, SG_ERR_INPUT, "%s: header: found version %d.%d, expected 0.1",
                       in->path, (uint8_t) b[0], (uint8_t) b[1]);
    if (f->level > 2)
        return sg_fail(f->ctx, SG_ERR_INPUT,
                       "%s: header: found compression level %d, expected 0 to 2", in->path,
                       f->level);
    sg_source_skip(in, HEADER);
    if (f->sections > sg_source_left(in) / SECTION_HEADER)
        return sg_fail(f->ctx, SG_ERR_INPUT, "%s: header: found %u sections in %llu bytes",
                       in->path, f->sections, (unsigned long long) sg_source_left(in));
    *headers = sg_alloc_raw(f->ctx, SG_MEM_MISC, f->sections + 1, SECTION_HEADER);
    if (!*headers)
        return SG_ERR_BUDGET;
    uint64_t bytes = 0, count = 0;
    for (uint32_t i = 0; i < f->sections; i++) {
        const char *header = sg_source_peek(in, SECTION_HEADER);
        struct section s;
        if (!header)
            return sg_short_file(f->ctx, in);
        memcpy(*headers + (size_t) i * SECTION_HEADER, header, SECTION_HEADER);
        parse_section(header, &s);
        sg_source_skip(in, SECTION_HEADER);
        const int code = check_section(f, i, &s);
        if (code)
            return code;
        if (s.count && s.sh_degree > f->sh_degree)
            f->sh_degree = s.sh_degree;
        count += s.count;
        bytes += 4 * (uint64_t) s.partial + (uint64_t) s.bucket_bytes * s.buckets +
                 (uint64_t) s.room * row_bytes(f->level, s.sh_degree);
        if (bytes > in->size) /* at once: the sum must not overflow */
            break;
    }
    if (bytes > sg_source_left(in))
        return sg_fail(f->ctx, SG_ERR_INPUT,
                       "%s: found %llu bytes after the headers, expected sections of %llu bytes or "
                       "more",
                       in->path, (unsigned long long) sg_source_left(in),
                       (unsigned long long) bytes);
    if (count != f->count)
        return sg_fail(f->ctx, SG_ERR_INPUT,
                       "%s: found sections of %llu Gaussians, expected %u as in the header",
                       in->path, (unsigned long long) count, f->count);
    return SG_OK;
}

/* Takes n x size bytes of the file into memory. */
static int take(struct file *f, size_t n, size_t size, char **out)
{
    *out = sg_alloc_raw(f->ctx, SG_MEM_MISC, n + 1, size);
    if (!*out)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++) {
        const char *b = sg_source_peek(f->in, size);
        if (!b)
            return sg_short_file(f->ctx, f->in);
        memcpy(*out + i * size, b, size);
        sg_source_skip(f->in, size);
    }
    return SG_OK;
}

static void decode_row(const struct file *f, const struct section *s, const char *b,
                       const char *centre, struct sg_model *m, size_t i)
{
    const float step = s->block / 2 / (float) s->range;
    for (int k = 0; k < 3; k++) {
        *sg_model_at(m, i, SG_P_XYZ + k) =
            f->level
                ? ((float) sg_u16(b + 2 * k) - (float) s->range) * step + sg_f32(centre + 4 * k)
                : sg_f32(b + 4 * k);
        *sg_model_at(m, i, SG_P_SCALE + k) =
            sg_log_scale(f->level ? half(b + 6 + 2 * k) : sg_f32(b + 12 + 4 * k));
    }
    for (int k = 0; k < 4; k++)
        *sg_model_at(m, i, SG_P_ROT + k) = f->level ? half(b + 12 + 2 * k) : sg_f32(b + 24 + 4 * k);
    b += f->level ? 20 : 40;
    for (int k = 0; k < 3; k++)
        *sg_model_at(m, i, SG_P_SH + k) = sg_dc_of_byte((uint8_t) b[k]);
    *sg_model_at(m, i, SG_P_OPACITY) = sg_logit_of_byte((uint8_t) b[3]);
    b += 4;
    /* Degree by degree: the coefficients of red, of green, of blue. */
    for (int degree = 1, first = 0; degree <= s->sh_degree; first += 2 * degree + 1, degree++)
        for (int channel = 0; channel < 3; channel++)
            for (int k = 0; k < 2 * degree + 1; k++) {
                float v;
                if (f->level == 0)
                    v = sg_f32(b), b += 4;
                else if (f->level == 1)
                    v = half(b), b += 2;
                else
                    v = f->sh_low + (float) (uint8_t) *b++ / 255 * (f->sh_high - f->sh_low);
                *sg_model_at(m, i, SG_P_SH + 3 * (1 + first + k) + channel) = v;
            }
}

/* Full buckets come first, then those whose sizes the section lists. */
static int read_section(struct file *f, uint32_t index, const struct section *s, struct sg_model *m,
                        size_t first)
{
    char *sizes = NULL, *centres = NULL;
    int code = SG_OK;
    if (!f->level) /* no positions in buckets */
        sg_source_skip(f->in, 4 * (uint64_t) s->partial +
                                  (uint64_t) s->bucket_bytes * (uint64_t) s->buckets);
    else if (!(code = take(f, s->partial, 4, &sizes)))
        code = take(f, s->bucket_bytes ? s->buckets : 0, s->bucket_bytes, &centres);
    const size_t bytes = row_bytes(f->level, s->sh_degree);
    uint32_t bucket = 0, in_bucket = 0;
    for (uint32_t i = 0; i < s->count && !code; i++) {
        const char *row = sg_source_peek(f->in, bytes);
        if (!row) {
            code = sg_short_file(f->ctx, f->in);
            break;
        }
        while (f->level && bucket < s->full + s->partial &&
               in_bucket >=
                   (bucket < s->full ? s->bucket_size : sg_u32(sizes + 4 * (bucket - s->full))))
            bucket++, in_bucket = 0;
        if (f->level && bucket == s->full + s->partial) {
            code = sg_fail(f->ctx, SG_ERR_INPUT,
                           "%s: section %u: found Gaussian %u in no bucket, expected one of %u",
                           f->in->path, index, i, bucket);
            break;
        }
        in_bucket++;
        decode_row(f, s, row, f->level ? centres + 12 * (size_t) bucket : NULL, m, first + i);
        sg_source_skip(f->in, bytes);
    }
    sg_source_skip(f->in, (uint64_t) (s->room - s->count) * bytes);
    sg_free(sizes);
    sg_free(centres);
    return code;
}

int sg_ksplat_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out)
{
    struct file f = {.ctx = ctx, .in = in};
    char *headers = NULL;
    size_t first = 0;
    *out = NULL;
    int code = read_headers(&f, &headers);
    if (!code)
        code = sg_claimed_model(ctx, in, f.count, f.sh_degree, max_gaussians, out);
    for (uint32_t i = 0; i < f.sections && !code; i++) {
        struct section s;
        parse_section(headers + (size_t) i * SECTION_HEADER, &s);
        code = read_section(&f, i, &s, *out, first);
        first += s.count;
    }
    sg_free(headers);
    if (code)
        sg_model_destroy(out);
    return code;
}
