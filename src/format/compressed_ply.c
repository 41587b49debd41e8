/* SPDX-License-Identifier: Apache-2.0 */
/* The compressed PLY of PlayCanvas' SuperSplat. Element `chunk` has the ranges of 256 Gaussians
 * each, element `vertex` four words a Gaussian with positions within these ranges, and element `sh`
 * the SH beyond degree 0 as bytes. */
#include "codec.h"

#define CHUNK 256
#define RANGES 18

/* The order in which we write them, which is that of SuperSplat; files may have another. */
static const char *const range_names[RANGES] = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};
enum { RANGE_POSITION = 0, RANGE_SCALE = 6, RANGE_COLOUR = 12 };
enum { WORD_POSITION, WORD_ROTATION, WORD_SCALE, WORD_COLOUR, WORDS };
static const char *const word_names[WORDS] = {"packed_position", "packed_rotation", "packed_scale",
                                              "packed_color"};

/* Bits of x y z in a word, from its top. */
static const struct {
    int shift;
    uint32_t most;
} packed_vector[3] = {{21, 2047}, {11, 1023}, {0, 2047}};

struct layout {
    int chunk[RANGES], word[WORDS], sh[SG_SH_REST_MAX]; /* property in its element, or -1 */
    int sh_degree;
    bool colours; /* in ranges of chunks, else 0..1 */
    uint64_t chunks, count;
    int chunk_floats, words, bytes; /* per row of the three elements */
};

/* Where a property is in an element, or -1. */
static int find(const struct ply *p, const struct ply_element *e, const char *name)
{
    for (int i = 0; i < e->properties; i++)
        if (!strcmp(p->all[e->first + i].name, name))
            return i;
    return -1;
}

static int refuse(sg_ctx *ctx, const struct ply *p, const char *name)
{
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: header: found no %s as in compressed PLY, expected element chunk of float, "
                   "element vertex of uint, and perhaps element sh of uchar, little endian",
                   p->in->path, name);
}

static bool has_only(const struct ply *p, const struct ply_element *e, enum ply_type type)
{
    for (int i = 0; i < e->properties; i++)
        if (p->all[e->first + i].type != type || p->all[e->first + i].list)
            return false;
    return true;
}

static int read_layout(sg_ctx *ctx, const struct ply *p, struct layout *l)
{
    static const struct {
        const char *name;
        enum ply_type type;
    } parts[3] = {{"chunk", PLY_F32}, {"vertex", PLY_U32}, {"sh", PLY_U8}};
    const struct ply_element *e = p->element;
    *l = (struct layout){0};
    if (p->format != PLY_LITTLE)
        return refuse(ctx, p, "little endian data");
    for (int i = 0; i < 3; i++)
        if (i < p->elements ? strcmp(e[i].name, parts[i].name) || !has_only(p, &e[i], parts[i].type)
                            : i < 2)
            return refuse(ctx, p, parts[i].name);
    if (p->elements > 3)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: header: found element %s, expected none after sh",
                       p->in->path, e[3].name);
    for (int i = 0; i < RANGES; i++) {
        l->chunk[i] = find(p, &e[0], range_names[i]);
        if (l->chunk[i] < 0 && i < RANGE_COLOUR)
            return refuse(ctx, p, range_names[i]);
    }
    l->colours = true;
    for (int i = RANGE_COLOUR; i < RANGES; i++)
        l->colours &= l->chunk[i] >= 0;
    for (int i = 0; i < WORDS; i++)
        if ((l->word[i] = find(p, &e[1], word_names[i])) < 0)
            return refuse(ctx, p, word_names[i]);
    l->chunks = e[0].rows, l->count = e[1].rows;
    l->chunk_floats = e[0].properties, l->words = e[1].properties;
    l->bytes = p->elements > 2 ? e[2].properties : 0;
    if (l->chunks != l->count / CHUNK + (l->count % CHUNK != 0))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found %llu chunks for %llu Gaussians, expected one for %d",
                       p->in->path, (unsigned long long) l->chunks, (unsigned long long) l->count,
                       CHUNK);
    while (l->sh_degree < 3 && sg_sh_rest(l->sh_degree) < l->bytes)
        l->sh_degree++;
    if (sg_sh_rest(l->sh_degree) != l->bytes || (l->bytes && e[2].rows != l->count))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: header: found %d f_rest properties in %llu rows, expected 9, 24 or 45 "
                       "in %llu",
                       p->in->path, l->bytes, (unsigned long long) (l->bytes ? e[2].rows : 0),
                       (unsigned long long) l->count);
    for (int i = 0; i < l->bytes; i++) {
        char name[24];
        snprintf(name, sizeof(name), "f_rest_%d", i);
        if ((l->sh[i] = find(p, &e[2], name)) < 0)
            return refuse(ctx, p, name);
    }
    return SG_OK;
}

/* Every row of known size: the file holds exactly these. */
static int check_size(sg_ctx *ctx, const struct ply *p, const struct layout *l)
{
    const uint64_t left = sg_source_left(p->in),
                   row = 4 * (uint64_t) l->words + (uint64_t) l->bytes,
                   chunk = 4 * (uint64_t) l->chunk_floats;
    /* Neither product overflows: counts beyond the file's bytes are refused before. */
    if (l->count > left / row || l->chunks * chunk + l->count * row != left)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %llu: found %llu bytes, expected %llu chunks of %llu bytes and "
                       "%llu Gaussians of %llu",
                       p->in->path, (unsigned long long) p->in->at, (unsigned long long) left,
                       (unsigned long long) l->chunks, (unsigned long long) chunk,
                       (unsigned long long) l->count, (unsigned long long) row);
    return SG_OK;
}

static float mix(const float *range, int axis, float t)
{
    return range[axis] * (1 - t) + range[3 + axis] * t;
}

static void decode_vector(struct sg_model *m, size_t i, int plane, uint32_t word,
                          const float *range)
{
    for (int k = 0; k < 3; k++) {
        const uint32_t v = word >> packed_vector[k].shift & packed_vector[k].most;
        *sg_model_at(m, i, plane + k) = mix(range, k, (float) v / (float) packed_vector[k].most);
    }
}

/* The number of the largest component of w x y z, which is positive, and the others in order. */
static void decode_rotation(struct sg_model *m, size_t i, uint32_t word)
{
    const int largest = (int) (word >> 30);
    float rest = 1;
    int shift = 20;
    for (int k = 0; k < 4; k++) {
        if (k == largest)
            continue;
        const float v = ((float) (word >> shift & 1023) / 1023 - 0.5f) * (float) M_SQRT2;
        *sg_model_at(m, i, SG_P_ROT + k) = v;
        rest -= v * v;
        shift -= 10;
    }
    *sg_model_at(m, i, SG_P_ROT + largest) = sqrtf(fmaxf(rest, 0));
}

static int read_rows(sg_ctx *ctx, struct sg_source *in, const struct layout *l, const float *ranges,
                     struct sg_model *m)
{
    for (size_t i = 0; i < m->count; i++) {
        const char *row = sg_source_peek(in, 4 * (size_t) l->words);
        if (!row)
            return sg_short_file(ctx, in);
        const float *range = ranges + i / CHUNK * RANGES;
        uint32_t word[WORDS];
        for (int k = 0; k < WORDS; k++)
            word[k] = sg_u32(row + 4 * l->word[k]);
        decode_vector(m, i, SG_P_XYZ, word[WORD_POSITION], range + RANGE_POSITION);
        decode_vector(m, i, SG_P_SCALE, word[WORD_SCALE], range + RANGE_SCALE);
        decode_rotation(m, i, word[WORD_ROTATION]);
        for (int k = 0; k < 3; k++) {
            const float t = (float) (uint8_t) (word[WORD_COLOUR] >> (24 - 8 * k)) / 255;
            const float colour = l->colours ? mix(range + RANGE_COLOUR, k, t) : t;
            *sg_model_at(m, i, SG_P_SH + k) = (colour - 0.5f) / SG_SH_C0;
        }
        *sg_model_at(m, i, SG_P_OPACITY) = sg_logit_of_byte((uint8_t) word[WORD_COLOUR]);
        sg_source_skip(in, 4 * (size_t) l->words);
    }
    /* Bytes stand for the middles of 256 steps from -4 to 4, the first and last for its ends.
     * Properties are coefficients of red, then of green, then of blue. */
    for (size_t i = 0; i < m->count && l->bytes; i++) {
        const char *row = sg_source_peek(in, (size_t) l->bytes);
        if (!row)
            return sg_short_file(ctx, in);
        for (int k = 0; k < l->bytes; k++) {
            const uint8_t b = (uint8_t) row[l->sh[k]];
            const int channel = k / (l->bytes / 3), coefficient = k % (l->bytes / 3);
            *sg_model_at(m, i, SG_P_SH + 3 * (1 + coefficient) + channel) =
                b == 0     ? -4
                : b == 255 ? 4
                           : ((float) b + 0.5f) / 32 - 4;
        }
        sg_source_skip(in, (size_t) l->bytes);
    }
    return SG_OK;
}

int sg_compressed_ply_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                           struct sg_model **out)
{
    struct ply p = {.in = in};
    struct layout l;
    float *ranges = NULL;
    *out = NULL;
    int code = sg_ply_parse_header(ctx, &p);
    if (!code)
        code = read_layout(ctx, &p, &l);
    if (!code)
        code = check_size(ctx, &p, &l);
    if (!code)
        code = sg_claimed_model(ctx, in, l.count, l.sh_degree, max_gaussians, out);
    if (!code && !(ranges = sg_alloc(ctx, SG_MEM_MISC, (size_t) l.chunks, RANGES * sizeof(float))))
        code = SG_ERR_BUDGET;
    for (size_t i = 0; i < l.chunks && !code; i++) {
        const char *row = sg_source_peek(in, 4 * (size_t) l.chunk_floats);
        for (int k = 0; k < RANGES && row; k++)
            ranges[i * RANGES + (size_t) k] = l.chunk[k] < 0 ? 0 : sg_f32(row + 4 * l.chunk[k]);
        code = row ? SG_OK : sg_short_file(ctx, in);
        if (row)
            sg_source_skip(in, 4 * (size_t) l.chunk_floats);
    }
    if (!code)
        code = read_rows(ctx, in, &l, ranges, *out);
    sg_free(ranges);
    if (code)
        sg_model_destroy(out);
    return code;
}

/* The value of a Gaussian that a range is of. */
static float ranged(const struct sg_model *m, size_t i, int group, int axis)
{
    if (group == RANGE_POSITION)
        return *sg_model_at(m, i, SG_P_XYZ + axis);
    if (group == RANGE_SCALE) /* beyond, e^20 would do as well */
        return fminf(fmaxf(*sg_model_at(m, i, SG_P_SCALE + axis), -20), 20);
    return *sg_model_at(m, i, SG_P_SH + axis) * SG_SH_C0 + 0.5f;
}

/* Of the CHUNK Gaussians from order[first] on. */
static void find_ranges(const struct sg_model *m, const uint32_t *order, size_t first,
                        float range[RANGES])
{
    for (int group = 0; group < RANGES; group += 6)
        for (int axis = 0; axis < 3; axis++) {
            float low = INFINITY, high = -INFINITY;
            for (size_t i = first; i < first + CHUNK && i < m->count; i++) {
                const float v = ranged(m, order[i], group, axis);
                low = fminf(low, v), high = fmaxf(high, v);
            }
            range[group + axis] = low, range[group + 3 + axis] = high;
        }
}

static uint32_t encode(float v, float low, float high, uint32_t most)
{
    return v <= low || high - low <= 0
               ? 0
               : (uint32_t) (fminf((v - low) / (high - low), 1) * (float) most + 0.5f);
}

static uint32_t encode_vector(const struct sg_model *m, size_t i, int group, const float *range)
{
    uint32_t word = 0;
    for (int k = 0; k < 3; k++)
        word |= encode(ranged(m, i, group, k), range[group + k], range[group + 3 + k],
                       packed_vector[k].most)
                << packed_vector[k].shift;
    return word;
}

static uint32_t encode_rotation(const struct sg_model *m, size_t i)
{
    float q[4];
    int largest = 0;
    sg_unit_quaternion(m, i, q);
    for (int k = 1; k < 4; k++)
        largest = fabsf(q[k]) > fabsf(q[largest]) ? k : largest;
    uint32_t word = (uint32_t) largest;
    for (int k = 0; k < 4; k++)
        if (k != largest)
            word = word << 10 |
                   encode((q[largest] < 0 ? -q[k] : q[k]) * (float) M_SQRT1_2 + 0.5f, 0, 1, 1023);
    return word;
}

static void write_header(const struct sg_model *m, FILE *f)
{
    fprintf(f, "ply\nformat binary_little_endian 1.0\ncomment splatguard %s\nelement chunk %zu\n",
            sg_version(), m->count / CHUNK + (m->count % CHUNK != 0));
    for (int k = 0; k < RANGES; k++)
        fprintf(f, "property float %s\n", range_names[k]);
    fprintf(f, "element vertex %zu\n", m->count);
    for (int k = 0; k < WORDS; k++)
        fprintf(f, "property uint %s\n", word_names[k]);
    if (m->sh_degree)
        fprintf(f, "element sh %zu\n", m->count);
    for (int k = 0; k < sg_sh_rest(m->sh_degree); k++)
        fprintf(f, "property uchar f_rest_%d\n", k);
    fprintf(f, "end_header\n");
}

static void write_rows(const struct sg_model *m, const uint32_t *order, FILE *f)
{
    float range[RANGES];
    for (size_t i = 0; i < m->count; i += CHUNK) {
        find_ranges(m, order, i, range);
        fwrite(range, sizeof(float), RANGES, f); /* little endian hosts only */
    }
    for (size_t i = 0; i < m->count; i++) {
        const size_t from = order[i];
        if (i % CHUNK == 0)
            find_ranges(m, order, i, range);
        uint32_t colour = sg_byte(255 * sg_logistic(*sg_model_at(m, from, SG_P_OPACITY)));
        for (int k = 0; k < 3; k++)
            colour |= encode(ranged(m, from, RANGE_COLOUR, k), range[RANGE_COLOUR + k],
                             range[RANGE_COLOUR + 3 + k], 255)
                      << (24 - 8 * k);
        const uint32_t word[WORDS] = {[WORD_POSITION] =
                                          encode_vector(m, from, RANGE_POSITION, range),
                                      [WORD_ROTATION] = encode_rotation(m, from),
                                      [WORD_SCALE] = encode_vector(m, from, RANGE_SCALE, range),
                                      [WORD_COLOUR] = colour};
        fwrite(word, sizeof(uint32_t), WORDS, f);
    }
    const int rest = sg_sh_rest(m->sh_degree);
    for (size_t i = 0; i < m->count && rest; i++) {
        uint8_t bytes[SG_SH_REST_MAX];
        for (int k = 0; k < rest; k++) {
            const int channel = k / (rest / 3), coefficient = k % (rest / 3);
            const float v = *sg_model_at(m, order[i], SG_P_SH + 3 * (1 + coefficient) + channel);
            bytes[k] = (uint8_t) fminf(fmaxf((v + 4) * 32, 0), 255);
        }
        fwrite(bytes, 1, (size_t) rest, f);
    }
}

/* Values are fractions of the ranges of their chunk, so neighbours share one. */
int sg_compressed_ply_write(sg_ctx *ctx, const struct sg_model *m, FILE *f)
{
    uint32_t *order;
    const int code = sg_model_order(ctx, m, &order);
    if (!code) {
        write_header(m, f);
        write_rows(m, order, f);
    }
    sg_free(order);
    return code;
}
