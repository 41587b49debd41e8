/* SPDX-License-Identifier: Apache-2.0 */
/* The anchors that a training begins with, and networks of random weights. */
#include "anchors.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/compare.h"
#include "core/rng.h"
#include "nearest.h"

#define MIN_SQUARED_SCALE 1e-7f
#define LOGIT -2.1972246f /* of an opacity that is carried along and not used */

int sg_model_refuse_anchors(sg_ctx *ctx, const struct sg_model *m)
{
    return !sg_model_has_anchors(m)
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INPUT,
                         "model: found anchors of Scaffold-GS, whose Gaussians exist only in a "
                         "view, expected a 3D Gaussian model");
}

int sg_model_expect_anchors(sg_ctx *ctx, const struct sg_model *m, const char *name, unsigned parts,
                            size_t photos)
{
    static const char *const names[] = {"no optional part",
                                        "distances",
                                        "the feature bank",
                                        "distances and the feature bank",
                                        "appearances of photos",
                                        "distances and appearances of photos",
                                        "the feature bank and appearances of photos",
                                        "all optional parts"};
    if (!sg_model_has_anchors(m))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found Gaussians, expected anchors of Scaffold-GS",
                       name);
    const struct sg_networks *n = m->columns->networks;
    if (n->parts != parts)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found networks with %s, expected %s", name,
                       names[n->parts & 7], names[parts & 7]);
    if (n->photos != photos)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found the appearances of %zu photos, expected those of the %zu "
                       "training views",
                       name, n->photos, photos);
    return SG_OK;
}

struct sg_networks *sg_networks_create(sg_ctx *ctx, size_t photos)
{
    struct sg_networks *n =
        sg_alloc(ctx, SG_MEM_MODEL, 1, sizeof(*n) + photos * sizeof(n->appearance[0]));
    if (n)
        n->photos = photos;
    return n;
}

void sg_networks_copy(struct sg_networks *to, const struct sg_networks *from)
{
    const size_t photos = to->photos, common = photos < from->photos ? photos : from->photos;
    memcpy(to, from, sizeof(*to));
    to->photos = photos;
    memcpy(to->appearance, from->appearance, common * sizeof(to->appearance[0]));
}

void sg_networks_forget(struct sg_networks *n)
{
    n->moment1 = n->moment2 = (struct sg_weights){0};
    for (size_t i = 0; i < n->photos; i++) {
        memset(n->appearance[i].moment1, 0, sizeof(n->appearance[i].moment1));
        memset(n->appearance[i].moment2, 0, sizeof(n->appearance[i].moment2));
    }
}

int sg_anchors_add(sg_ctx *ctx, struct sg_model *m, size_t photos)
{
    if (!m->columns && !(m->columns = sg_alloc(ctx, SG_MEM_MODEL, 1, sizeof(*m->columns))))
        return SG_ERR_BUDGET;
    m->columns->capacity = m->capacity;
    m->columns->at[SG_C_ANCHOR] =
        sg_alloc(ctx, SG_MEM_MODEL, m->capacity, SG_A_PLANES * sizeof(float));
    m->columns->networks = sg_networks_create(ctx, photos);
    return m->columns->at[SG_C_ANCHOR] && m->columns->networks ? SG_OK : SG_ERR_BUDGET;
}

void sg_anchor_set(struct sg_model *m, size_t i, const float position[3], float log_unit,
                   float log_size)
{
    float *anchor = m->columns->at[SG_C_ANCHOR] + sg_param_index(SG_A_PLANES, i, 0);
    for (int k = 0; k < 3; k++) {
        *sg_model_at(m, i, SG_P_XYZ + k) = position[k];
        *sg_model_at(m, i, SG_P_SCALE + k) = log_unit;
        anchor[(SG_A_SIZE + k) * SG_LANES] = log_size;
    }
    *sg_model_at(m, i, SG_P_OPACITY) = LOGIT;
    *sg_model_at(m, i, SG_P_ROT) = 1;
}

/* Inputs of the layer that weight i belongs to; 0: of a part that is not there. */
static int fan_in(const struct sg_networks *n, const struct sg_anchor_sizes *sizes, size_t i)
{
    const enum sg_network network = sg_weight_network(i);
    int inputs = sg_network_inputs(network, n->parts);
    if (network != SG_N_BANK)
        inputs -= SG_ANCHOR_FEATURES - sizes->features;
    if (network == SG_N_COLOUR && n->parts & SG_PART_APPEARANCE)
        inputs -= SG_APPEARANCE - sizes->appearance;
    if (i < SG_WEIGHTS_PLAIN)
        return i < SG_WEIGHT_AT(output) ? inputs : sizes->hidden;
    if (i < SG_WEIGHT_AT(bank_input))
        return n->parts & SG_PART_DISTANCE ? inputs : 0;
    if (i >= SG_WEIGHT_AT(appearance))
        return n->parts & SG_PART_APPEARANCE ? inputs : 0;
    return !(n->parts & SG_PART_BANK) ? 0 : i < SG_WEIGHT_AT(bank_output) ? inputs : sizes->hidden;
}

/* Takes the weights out that lead to or from what is not in use. */
static void cut_weights(const struct sg_anchor_sizes *sizes, struct sg_weights *w)
{
    for (int f = sizes->features; f < SG_ANCHOR_FEATURES; f++)
        memset(w->input[f], 0, sizeof(w->input[f]));
    for (int k = sizes->appearance; k < SG_APPEARANCE; k++)
        memset(w->appearance[k], 0, sizeof(w->appearance[k]));
    for (int h = sizes->hidden; h < SG_NETWORK_HIDDEN; h++) {
        for (int i = 0; i <= SG_NETWORK_INPUTS; i++)
            for (int n = 0; n < SG_NETWORKS; n++)
                w->input[i][n * SG_NETWORK_HIDDEN + h] = 0;
        for (int n = 0; n < SG_NETWORKS; n++)
            w->distance[n * SG_NETWORK_HIDDEN + h] = 0;
        for (int i = 0; i <= SG_BANK_INPUTS; i++)
            w->bank_input[i][h] = 0;
        for (int k = 0; k < SG_APPEARANCE; k++)
            w->appearance[k][h] = 0;
        for (int o = 0; o < SG_OUTPUTS; o++)
            w->output[o][h] = 0;
        for (int o = 0; o < SG_BANK_OUTPUTS; o++)
            w->bank_output[o][h] = 0;
    }
    for (int o = 0; o < SG_OUTPUTS; o++) {
        const int gaussian = o < SG_O_COVARIANCE ? o
                             : o < SG_O_COLOUR   ? (o - SG_O_COVARIANCE) / 7
                                                 : (o - SG_O_COLOUR) / 3;
        if (gaussian < sizes->offsets)
            continue;
        memset(w->output[o], 0, sizeof(w->output[o]));
        w->bias[o] = o < SG_O_COVARIANCE ? -1 : 0; /* below 0: no view makes the Gaussian */
    }
}

/* Uniform, as wide as the root of the inputs' number asks for. Appearances are normal. */
static void draw_networks(struct sg_networks *n, const struct sg_anchor_sizes *sizes, uint64_t seed)
{
    float *w = (float *) &n->value;
    for (size_t i = 0; i < SG_WEIGHTS; i++) {
        const int inputs = fan_in(n, sizes, i);
        w[i] = inputs
                   ? (2 * sg_rng_uniform(seed, SG_RNG_NETWORKS, 0, i) - 1) / sqrtf((float) inputs)
                   : 0;
    }
    cut_weights(sizes, &n->value);
    for (size_t i = 0; i < n->photos; i++)
        for (size_t k = 0; k < (size_t) sizes->appearance; k++)
            n->appearance[i].value[k] =
                sg_rng_normal(seed, SG_RNG_NETWORKS, 1, SG_APPEARANCE * i + k);
}

static struct sg_anchor_sizes sizes_in_use(const struct sg_anchor_sizes *asked)
{
    return (struct sg_anchor_sizes){asked->offsets ? asked->offsets : SG_ANCHOR_GAUSSIANS,
                                    asked->features ? asked->features : SG_ANCHOR_FEATURES,
                                    asked->hidden ? asked->hidden : SG_NETWORK_HIDDEN,
                                    asked->appearance ? asked->appearance : SG_APPEARANCE};
}

static size_t weights_of(unsigned parts)
{
    return parts ? SG_WEIGHTS : SG_WEIGHTS_PLAIN;
}

size_t sg_networks_floats(unsigned parts, size_t photos)
{
    return 3 * weights_of(parts) + photos * sizeof(struct sg_appearance) / sizeof(float) + 1;
}

void sg_networks_pack(const struct sg_networks *n, float *out)
{
    const size_t each = weights_of(n->parts);
    const struct sg_weights *const from[] = {&n->value, &n->moment1, &n->moment2};
    for (int k = 0; k < 3; k++, out += each)
        memcpy(out, from[k], each * sizeof(float));
    memcpy(out, n->appearance, n->photos * sizeof(n->appearance[0]));
    out[n->photos * sizeof(n->appearance[0]) / sizeof(float)] = n->voxel;
}

void sg_networks_unpack(const float *values, struct sg_networks *n)
{
    const size_t each = weights_of(n->parts);
    struct sg_weights *const to[] = {&n->value, &n->moment1, &n->moment2};
    for (int k = 0; k < 3; k++, values += each)
        memcpy(to[k], values, each * sizeof(float));
    memcpy(n->appearance, values, n->photos * sizeof(n->appearance[0]));
    n->voxel = values[n->photos * sizeof(n->appearance[0]) / sizeof(float)];
}

bool sg_networks_square(unsigned parts, size_t i)
{
    const size_t each = weights_of(parts);
    return i < 3 * each ? i >= 2 * each : (i - 3 * each) % (3 * SG_APPEARANCE) >= 2 * SG_APPEARANCE;
}

static bool all_finite(const float *values, size_t n)
{
    size_t i = 0;
    while (i < n && isfinite(values[i]))
        i++;
    return i == n;
}

bool sg_networks_finite(const struct sg_networks *n)
{
    return all_finite(n->value.input[0], 3 * SG_WEIGHTS) &&
           all_finite(n->appearance[0].value, n->photos * sizeof(n->appearance[0]) / sizeof(float));
}

bool sg_anchor_cell(float position, float size, int64_t *cell)
{
    const float at = rintf(position / size);
    if (!(fabsf(at) <= 0x1p62f))
        return false;
    *cell = (int64_t) at;
    return true;
}

static int cell_ascending(const void *a, const void *b)
{
    const int64_t *x = a, *y = b;
    for (int k = 0; k < 3; k++)
        if (x[k] != y[k])
            return x[k] < y[k] ? -1 : 1;
    return 0;
}

/* The element that the released code takes for the median. */
static int median_voxel(sg_ctx *ctx, const float *xyz, size_t n, float *out)
{
    float *d2 = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*d2));
    int code = d2 ? sg_nearest3(ctx, xyz, n, d2) : SG_ERR_BUDGET;
    if (!code) {
        qsort(d2, n, sizeof(*d2), sg_float_ascending);
        *out = d2[n / 2 - 1];
        if (!(*out > 0))
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "points: found half of them on others, expected a voxel size");
    }
    sg_free(d2);
    return code;
}

/* The cells of all points, sorted, each once. */
static int find_cells(sg_ctx *ctx, const float *xyz, size_t n, float voxel, int64_t (**out)[3],
                      size_t *count)
{
    int64_t(*cells)[3] = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*cells));
    *out = cells;
    if (!cells)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < 3; k++)
            if (!sg_anchor_cell(xyz[3 * i + k], voxel, &cells[i][k]))
                return sg_fail(ctx, SG_ERR_INPUT,
                               "points: point %zu: found coordinate %g, expected at most 2^62 "
                               "voxels of %g",
                               i, (double) xyz[3 * i + k], (double) voxel);
    qsort(cells, n, sizeof(*cells), cell_ascending);
    size_t unique = 0;
    for (size_t i = 0; i < n; i++)
        if (!i || cell_ascending(cells[i], cells[unique - 1]) != 0)
            memmove(cells[unique++], cells[i], sizeof(*cells));
    *count = unique;
    return unique >= 4 ? SG_OK
                       : sg_fail(ctx, SG_ERR_INPUT,
                                 "points: found %zu voxels of %g with a point, expected at least 4",
                                 unique, (double) voxel);
}

static int make_anchors(sg_ctx *ctx, const float *xyz, size_t n, size_t photos,
                        struct sg_model **out)
{
    float *d2 = sg_alloc_raw(ctx, SG_MEM_MISC, n, sizeof(*d2));
    struct sg_model *m = NULL;
    int code = d2 ? sg_nearest3(ctx, xyz, n, d2) : SG_ERR_BUDGET;
    if (!code)
        code = sg_model_create(ctx, n, 0, &m);
    if (!code)
        code = sg_anchors_add(ctx, m, photos);
    for (size_t i = 0; i < n && !code; i++) {
        const float scale = 0.5f * logf(fminf(fmaxf(d2[i], MIN_SQUARED_SCALE), 1e30f));
        sg_anchor_set(m, i, xyz + 3 * i, scale, scale);
    }
    sg_free(d2);
    if (code)
        sg_model_destroy(&m);
    *out = m;
    return code;
}

int sg_anchors_init(sg_ctx *ctx, const float *xyz, size_t n, const struct sg_anchor_start *start,
                    size_t *cells, struct sg_model **out)
{
    int64_t(*cell)[3] = NULL;
    float voxel = start->voxel, *at = NULL;
    *out = NULL;
    if (n < 4)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "points: found %zu, expected at least 4: scales come from 3 neighbours", n);
    int code = voxel > 0 ? SG_OK : median_voxel(ctx, xyz, n, &voxel);
    if (!code)
        code = find_cells(ctx, xyz, n, voxel, &cell, cells);
    if (!code) {
        const size_t kept = start->limit && *cells > start->limit ? start->limit : *cells;
        at = sg_alloc_raw(ctx, SG_MEM_MISC, kept, 3 * sizeof(*at));
        code = at ? SG_OK : SG_ERR_BUDGET;
        for (size_t i = 0; i < 3 * kept && !code; i++) /* thinned out evenly */
            at[i] = (float) cell[(size_t) ((uint64_t) *cells * (i / 3) / kept)][i % 3] * voxel;
        sg_free(cell);
        cell = NULL;
        if (!code)
            code = make_anchors(ctx, at, kept, start->photos, out);
    }
    if (!code) {
        (*out)->columns->networks->voxel = voxel;
        (*out)->columns->networks->parts = start->parts;
        const struct sg_anchor_sizes sizes = sizes_in_use(&start->sizes);
        draw_networks((*out)->columns->networks, &sizes, start->seed);
    }
    sg_free(cell);
    sg_free(at);
    return code;
}
