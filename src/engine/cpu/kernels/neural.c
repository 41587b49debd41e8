/* SPDX-License-Identifier: Apache-2.0 */
/* The networks of Scaffold-GS on blocks of anchors. Values of an anchor are in a lane, but in sums
 * over anchors, where lanes are hidden values: so every product is a broadcast and a vector. */
#include "kernels.h"

#include "math/neural.h"

/* Of a product at once, so that their sums stay in registers: rows, each of WIDE vectors, which
 * share the broadcast of a weight. */
#define WIDE (LANES < SG_LANES ? 2 : 1)
#define ROWS (8 / WIDE)
#define INPUT_ROWS 4
#define OUTPUT_ROWS 5

_Static_assert(SG_HIDDEN % (2 * LANES) == 0 && SG_NETWORK_HIDDEN % (2 * LANES) == 0 &&
                   SG_LANES % (WIDE * LANES) == 0,
               "whole pairs of vectors");
_Static_assert(SG_HIDDEN % ROWS == 0 && SG_ANCHOR_FEATURES % ROWS == 0 &&
                   SG_NETWORK_HIDDEN % ROWS == 0 && SG_O_COVARIANCE % OUTPUT_ROWS == 0 &&
                   SG_O_COLOUR % OUTPUT_ROWS == 0 && SG_OUTPUTS % OUTPUT_ROWS == 0 &&
                   (SG_NETWORK_INPUTS + 1) % INPUT_ROWS == 0 && SG_BANK_INPUTS + 1 <= OUTPUT_ROWS,
               "whole groups of rows");

/* What the networks compute on the way. */
struct layers {
    float input[SG_NETWORK_INPUTS + 1][SG_LANES];
    float hidden[SG_HIDDEN][SG_LANES], output[SG_OUTPUTS][SG_LANES];
    /* of the feature bank; also without it the distance, row 3 of its inputs */
    float bank_input[SG_BANK_INPUTS + 1][SG_LANES], bank_hidden[SG_NETWORK_HIDDEN][SG_LANES];
    float share[SG_BANK_OUTPUTS][SG_LANES];
};

/* Which Gaussians any anchor of a block has, a bit each, and the rows of the networks' outputs: of
 * each network first those of these Gaussians. Of others nothing is computed, but to fill up groups
 * of OUTPUT_ROWS. */
struct present {
    unsigned bits;
    int count[SG_NETWORKS]; /* of rows, in whole groups */
    int row[SG_OUTPUTS];    /* of network n from sg_network_row(n) on */
};

/* Shares of the copies of a feature that the feature bank mixes. */
SIMD void bank_layers(const struct sg_weights *w, struct layers *l)
{
    for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
        for (int i = 0; i < SG_LANES; i += LANES) {
            real sum = r_set(0);
            for (int k = 0; k <= SG_BANK_INPUTS; k++)
                sum = r_fma(r_set(w->bank_input[k][h]), r_load(l->bank_input[k] + i), sum);
            r_store(l->bank_hidden[h] + i, r_max(sum, r_set(0)));
        }
    for (int i = 0; i < SG_LANES; i += LANES) {
        real z[SG_BANK_OUTPUTS];
        for (int j = 0; j < SG_BANK_OUTPUTS; j++) {
            z[j] = r_set(w->bank_bias[j]);
            for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
                z[j] = r_fma(r_set(w->bank_output[j][h]), r_load(l->bank_hidden[h] + i), z[j]);
        }
        neural_shares(z);
        for (int j = 0; j < SG_BANK_OUTPUTS; j++)
            r_store(l->share[j] + i, z[j]);
    }
}

SIMD void mix_features(const struct sg_anchor_block *b, struct layers *l)
{
    for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
        for (int i = 0; i < SG_LANES; i += LANES) {
            real sum = r_set(0);
            for (int j = 0; j < SG_BANK_OUTPUTS; j++)
                sum = r_fma(r_load(l->share[j] + i),
                            r_load(b->anchor[SG_A_FEATURE + sg_bank_source(j, f)] + i), sum);
            r_store(l->input[f] + i, sum);
        }
}

SIMD void fill_inputs(const struct sg_neural_args *a, const struct sg_anchor_block *b,
                      struct layers *l)
{
    for (int i = 0; i < SG_LANES; i += LANES) {
        real d[3];
        for (int k = 0; k < 3; k++)
            d[k] = r_load(b->position[k] + i) - a->centre[k];
        const real length = r_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        for (int k = 0; k < 3; k++)
            r_store(l->input[SG_ANCHOR_FEATURES + k] + i, d[k] / length);
        r_store(l->input[SG_NETWORK_INPUTS] + i, r_set(1));
        r_store(l->bank_input[3] + i, length);
        r_store(l->bank_input[SG_BANK_INPUTS] + i, r_set(1));
    }
    if (!(a->parts & SG_PART_BANK)) {
        memcpy(l->input, b->anchor[SG_A_FEATURE], SG_ANCHOR_FEATURES * sizeof(l->input[0]));
        return;
    }
    memcpy(l->bank_input, l->input[SG_ANCHOR_FEATURES], 3 * sizeof(l->input[0]));
    bank_layers(a->weights, l);
    mix_features(b, l);
}

SIMD void zero(real sum[ROWS][WIDE])
{
    for (int r = 0; r < ROWS; r++)
        for (int v = 0; v < WIDE; v++)
            sum[r][v] = r_set(0);
}

/* sum[r] += x times weight r, of which each is `stride` behind the one before. */
SIMD void add_rows(const float *weight, size_t stride, const float *x, real sum[ROWS][WIDE])
{
    real value[WIDE];
    for (int v = 0; v < WIDE; v++)
        value[v] = r_load(x + v * LANES);
    for (int r = 0; r < ROWS; r++)
        for (int v = 0; v < WIDE; v++)
            sum[r][v] = r_fma(r_set(weight[(size_t) r * stride]), value[v], sum[r][v]);
}

SIMD void hidden_layer(const struct sg_neural_args *a, struct layers *l)
{
    const struct sg_weights *w = a->weights;
    for (int h = 0; h < SG_HIDDEN; h += ROWS)
        for (int i = 0; i < SG_LANES; i += WIDE * LANES) {
            real sum[ROWS][WIDE];
            zero(sum);
            for (int k = 0; k <= SG_NETWORK_INPUTS; k++)
                add_rows(&w->input[k][h], 1, l->input[k] + i, sum);
            if (a->parts & SG_PART_DISTANCE)
                add_rows(&w->distance[h], 1, l->bank_input[3] + i, sum);
            for (int r = 0; r < ROWS; r++)
                for (int v = 0; v < WIDE; v++)
                    r_store(l->hidden[h + r] + i + v * LANES, r_max(sum[r][v], r_set(0)));
        }
}

/* The outputs of one network, in rows of a list. */
SIMD void output_rows(const struct sg_weights *w, int network, const int *row, int count,
                      struct layers *l)
{
    float(*hidden)[SG_LANES] = l->hidden + network * SG_NETWORK_HIDDEN;
    for (int o = 0; o < count; o += OUTPUT_ROWS)
        for (int i = 0; i < SG_LANES; i += WIDE * LANES) {
            real sum[OUTPUT_ROWS][WIDE];
            for (int r = 0; r < OUTPUT_ROWS; r++)
                for (int v = 0; v < WIDE; v++)
                    sum[r][v] = r_set(w->bias[row[o + r]]);
            for (int h = 0; h < SG_NETWORK_HIDDEN; h++) {
                real x[WIDE];
                for (int v = 0; v < WIDE; v++)
                    x[v] = r_load(hidden[h] + i + v * LANES);
                for (int r = 0; r < OUTPUT_ROWS; r++)
                    for (int v = 0; v < WIDE; v++)
                        sum[r][v] = r_fma(r_set(w->output[row[o + r]][h]), x[v], sum[r][v]);
            }
            for (int r = 0; r < OUTPUT_ROWS; r++)
                for (int v = 0; v < WIDE; v++)
                    r_store(l->output[row[o + r]] + i + v * LANES, sum[r][v]);
        }
}

/* Rows of the Gaussians that are there, then of the others. each: rows of a Gaussian. */
SIMD void list_rows(struct present *p, int network, int each)
{
    const int first = sg_network_row(network);
    int n = first;
    for (int other = 0; other < 2; other++) {
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
            for (int j = 0; j < each && (p->bits >> k & 1) != (unsigned) other; j++)
                p->row[n++] = first + each * k + j;
        if (!other)
            p->count[network] = (n - first + OUTPUT_ROWS - 1) / OUTPUT_ROWS * OUTPUT_ROWS;
    }
}

/* Those that are hidden do not exist. */
SIMD void hide(const struct sg_anchor_block *b, struct layers *l)
{
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
        for (int i = 0; i < SG_LANES; i += LANES) {
            const mask shown = neural_shown(r_load(b->anchor[SG_A_OFFSET + 3 * k] + i));
            float *y = l->output[SG_O_OPACITY + k] + i;
            r_store(y, r_keep(shown, r_load(y)));
        }
}

SIMD void output_layer(const struct sg_weights *w, const struct sg_anchor_block *b,
                       struct layers *l, struct present *p)
{
    p->bits = (1u << SG_ANCHOR_GAUSSIANS) - 1;
    list_rows(p, SG_N_OPACITY, 1);
    output_rows(w, SG_N_OPACITY, p->row, p->count[SG_N_OPACITY], l);
    hide(b, l);
    p->bits = 0;
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
        for (int i = 0; i < SG_LANES; i += LANES)
            if (m_any(r_lt(r_set(0), r_load(l->output[SG_O_OPACITY + k] + i))))
                p->bits |= 1u << k;
    list_rows(p, SG_N_OPACITY, 1);
    list_rows(p, SG_N_COVARIANCE, 7);
    list_rows(p, SG_N_COLOUR, 3);
    for (int n = SG_N_COVARIANCE; n < SG_NETWORKS; n++)
        output_rows(w, n, p->row + sg_network_row(n), p->count[n], l);
}

/* Gaussian k of the anchors from lane i on. */
SIMD struct neural neural_of(const struct sg_anchor_block *b, const struct layers *l, int k, int i)
{
    struct neural n = {.y = r_load(l->output[SG_O_OPACITY + k] + i)};
    for (int j = 0; j < 7; j++)
        n.cov[j] = r_load(l->output[SG_O_COVARIANCE + 7 * k + j] + i);
    for (int j = 0; j < 3; j++) {
        n.colour[j] = r_load(l->output[SG_O_COLOUR + 3 * k + j] + i);
        n.offset[j] = r_load(b->anchor[SG_A_OFFSET + 3 * k + j] + i);
        n.anchor[j] = r_load(b->position[j] + i);
        n.reach[j] = r_load(b->reach[j] + i);
        n.size[j] = r_load(b->anchor[SG_A_SIZE + j] + i);
    }
    return n;
}

void KERNEL(neural)(const struct sg_neural_args *a, const struct sg_anchor_block *b,
                    float (*drawn)[SG_DRAWN_PLANES][SG_LANES])
{
    struct layers l;
    struct present present;
    fill_inputs(a, b, &l);
    hidden_layer(a, &l);
    output_layer(a->weights, b, &l, &present);
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
        for (int i = 0; i < SG_LANES; i += LANES) {
            if (!(present.bits >> k & 1)) {
                r_store(drawn[k][SG_P_OPACITY] + i, r_set(-__builtin_inff()));
                continue;
            }
            const struct neural n = neural_of(b, &l, k, i);
            real planes[SG_DRAWN_PLANES];
            neural_forward(&n, planes);
            planes[SG_P_OPACITY] =
                r_sel(r_lt(r_set(0), n.y), planes[SG_P_OPACITY], r_set(-__builtin_inff()));
            for (int p = 0; p < SG_DRAWN_PLANES; p++)
                r_store(drawn[k][p] + i, planes[p]);
        }
}

/* Gradients of the outputs, and of the anchors' own values. */
SIMD void pull_outputs(const struct sg_neural_args *a, const struct sg_anchor_block *b,
                       const struct layers *l, unsigned present,
                       float (*gradient)[SG_DRAWN_PLANES][SG_LANES], float (*output)[SG_LANES],
                       struct sg_anchor_gradient *out)
{
    for (int i = 0; i < SG_LANES; i += LANES) {
        real reach[3] = {r_set(0), r_set(0), r_set(0)}, size[3] = {r_set(0), r_set(0), r_set(0)};
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
            if (!(present >> k & 1)) {
                r_store(output[SG_O_OPACITY + k] + i, r_set(0));
                for (int j = 0; j < 7; j++)
                    r_store(output[SG_O_COVARIANCE + 7 * k + j] + i, r_set(0));
                for (int j = 0; j < 3; j++) {
                    r_store(output[SG_O_COLOUR + 3 * k + j] + i, r_set(0));
                    r_store(out->anchor[SG_A_OFFSET + 3 * k + j] + i, r_set(0));
                }
                continue;
            }
            const struct neural n = neural_of(b, l, k, i);
            const mask exists = r_lt(r_set(0), n.y);
            real planes[SG_DRAWN_PLANES], g[SG_DRAWN_PLANES];
            struct neural d;
            neural_forward(&n, planes);
            for (int p = 0; p < SG_DRAWN_PLANES; p++)
                g[p] = r_keep(exists, r_load(gradient[k][p] + i));
            neural_backward(&n, planes, g, r_keep(exists, r_set(a->volume)), &d);
            r_store(output[SG_O_OPACITY + k] + i, d.y);
            for (int j = 0; j < 7; j++)
                r_store(output[SG_O_COVARIANCE + 7 * k + j] + i, r_keep(exists, d.cov[j]));
            for (int j = 0; j < 3; j++) {
                r_store(output[SG_O_COLOUR + 3 * k + j] + i, d.colour[j]);
                r_store(out->anchor[SG_A_OFFSET + 3 * k + j] + i, d.offset[j]);
                reach[j] += r_keep(exists, d.reach[j]);
                size[j] += r_keep(exists, d.size[j]);
            }
        }
        for (int j = 0; j < 3; j++) {
            r_store(out->reach[j] + i, reach[j]);
            r_store(out->anchor[SG_A_SIZE + j] + i, size[j]);
        }
    }
}

/* Gradients of the hidden values before the ReLU. */
SIMD void pull_hidden(const struct sg_weights *w, const struct layers *l, const struct present *p,
                      float (*output)[SG_LANES], float (*hidden)[SG_LANES])
{
    for (int network = 0; network < SG_NETWORKS; network++)
        for (int h = 0; h < SG_NETWORK_HIDDEN; h += ROWS) {
            const int at = network * SG_NETWORK_HIDDEN + h;
            const int *row = p->row + sg_network_row(network);
            for (int i = 0; i < SG_LANES; i += WIDE * LANES) {
                real sum[ROWS][WIDE];
                zero(sum);
                for (int o = 0; o < p->count[network]; o++)
                    add_rows(&w->output[row[o]][h], 1, output[row[o]] + i, sum);
                for (int r = 0; r < ROWS; r++)
                    for (int v = 0; v < WIDE; v++) {
                        const int lane = i + v * LANES;
                        const mask on = r_lt(r_set(0), r_load(l->hidden[at + r] + lane));
                        r_store(hidden[at + r] + lane, r_keep(on, sum[r][v]));
                    }
            }
        }
}

SIMD void pull_features(const struct sg_weights *w, float (*hidden)[SG_LANES],
                        struct sg_anchor_gradient *out)
{
    for (int f = 0; f < SG_ANCHOR_FEATURES; f += ROWS)
        for (int i = 0; i < SG_LANES; i += WIDE * LANES) {
            real sum[ROWS][WIDE];
            zero(sum);
            for (int h = 0; h < SG_HIDDEN; h++)
                add_rows(&w->input[f][h], SG_HIDDEN, hidden[h] + i, sum);
            for (int r = 0; r < ROWS; r++)
                for (int v = 0; v < WIDE; v++)
                    r_store(out->anchor[SG_A_FEATURE + f + r] + i + v * LANES, sum[r][v]);
        }
}

SIMD void transpose(float (*rows)[SG_LANES], int count, float (*out)[SG_HIDDEN])
{
    for (int h = 0; h < count; h++)
        for (int lane = 0; lane < SG_LANES; lane++)
            out[lane][h] = rows[h][lane];
}

/* sums[r][c] += the sum over the anchors of rows[r] times the c-th of their hidden values. row: the
 * numbers r, NULL: 0, 1, ... together: rows whose sums stay in registers; a constant, at most
 * OUTPUT_ROWS, that divides their number. */
SIMD void add_products(float (*rows)[SG_LANES], const int *row, int count, int together,
                       float (*hidden)[SG_HIDDEN], int first, int columns, float *sums)
{
    for (int r = 0; r < count; r += together) {
        int at[OUTPUT_ROWS];
        for (int k = 0; k < together; k++)
            at[k] = row ? row[r + k] : r + k;
        for (int c = 0; c < columns; c += 2 * LANES) {
            real even[OUTPUT_ROWS], odd[OUTPUT_ROWS];
            for (int k = 0; k < together; k++) {
                even[k] = r_load(sums + at[k] * columns + c);
                odd[k] = r_load(sums + at[k] * columns + c + LANES);
            }
            for (int lane = 0; lane < SG_LANES; lane++) {
                const real x = r_load(&hidden[lane][first + c]),
                           y = r_load(&hidden[lane][first + c + LANES]);
                for (int k = 0; k < together; k++) {
                    const real g = r_set(rows[at[k]][lane]);
                    even[k] = r_fma(g, x, even[k]);
                    odd[k] = r_fma(g, y, odd[k]);
                }
            }
            for (int k = 0; k < together; k++) {
                r_store(sums + at[k] * columns + c, even[k]);
                r_store(sums + at[k] * columns + c + LANES, odd[k]);
            }
        }
    }
}

/* The same of biases, by lane. */
SIMD void add_biases(float (*rows)[SG_LANES], int count, float (*sums)[SG_LANES])
{
    for (int r = 0; r < count; r++)
        for (int i = 0; i < SG_LANES; i += LANES)
            r_store(sums[r] + i, r_load(sums[r] + i) + r_load(rows[r] + i));
}

/* Gradients of mixtures, in out->anchor, to those of features and of the shares' arguments. */
SIMD void pull_mixtures(const struct sg_anchor_block *b, const struct layers *l,
                        struct sg_anchor_gradient *out, float (*argument)[SG_LANES])
{
    float(*feature)[SG_LANES] = out->anchor + SG_A_FEATURE;
    for (int i = 0; i < SG_LANES; i += LANES) {
        real g[SG_ANCHOR_FEATURES], d[SG_ANCHOR_FEATURES], share[SG_BANK_OUTPUTS], mean = r_set(0);
        for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
            g[f] = r_load(feature[f] + i), d[f] = r_set(0);
        for (int j = 0; j < SG_BANK_OUTPUTS; j++) {
            const real own = r_load(l->share[j] + i);
            share[j] = r_set(0);
            for (int f = 0; f < SG_ANCHOR_FEATURES; f++) {
                const int from = sg_bank_source(j, f);
                share[j] = r_fma(g[f], r_load(b->anchor[SG_A_FEATURE + from] + i), share[j]);
                d[from] = r_fma(own, g[f], d[from]);
            }
            mean = r_fma(own, share[j], mean);
        }
        for (int j = 0; j < SG_BANK_OUTPUTS; j++)
            r_store(argument[j] + i, r_load(l->share[j] + i) * (share[j] - mean));
        for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
            r_store(feature[f] + i, d[f]);
    }
}

SIMD void pull_bank(const struct sg_weights *w, const struct sg_anchor_block *b, struct layers *l,
                    struct sg_anchor_gradient *out, struct sg_weight_sums *sums)
{
    float argument[SG_BANK_OUTPUTS][SG_LANES], hidden[SG_NETWORK_HIDDEN][SG_LANES];
    float across[SG_LANES][SG_HIDDEN];
    pull_mixtures(b, l, out, argument);
    for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
        for (int i = 0; i < SG_LANES; i += LANES) {
            real sum = r_set(0);
            for (int j = 0; j < SG_BANK_OUTPUTS; j++)
                sum = r_fma(r_set(w->bank_output[j][h]), r_load(argument[j] + i), sum);
            r_store(hidden[h] + i, r_keep(r_lt(r_set(0), r_load(l->bank_hidden[h] + i)), sum));
        }
    transpose(l->bank_hidden, SG_NETWORK_HIDDEN, across);
    add_products(argument, NULL, SG_BANK_OUTPUTS, SG_BANK_OUTPUTS, across, 0, SG_NETWORK_HIDDEN,
                 sums->bank_output[0]);
    transpose(hidden, SG_NETWORK_HIDDEN, across);
    add_products(l->bank_input, NULL, SG_BANK_INPUTS + 1, SG_BANK_INPUTS + 1, across, 0,
                 SG_NETWORK_HIDDEN, sums->bank_input[0]);
    add_biases(argument, SG_BANK_OUTPUTS, sums->bank_bias);
}

void KERNEL(neural_backward)(const struct sg_neural_args *a, const struct sg_anchor_block *b,
                             float (*gradient)[SG_DRAWN_PLANES][SG_LANES],
                             struct sg_anchor_gradient *out, struct sg_weight_sums *sums)
{
    struct layers l;
    struct present present;
    float output[SG_OUTPUTS][SG_LANES], hidden[SG_HIDDEN][SG_LANES];
    float across[SG_LANES][SG_HIDDEN];
    fill_inputs(a, b, &l);
    hidden_layer(a, &l);
    output_layer(a->weights, b, &l, &present);
    pull_outputs(a, b, &l, present.bits, gradient, output, out);
    pull_hidden(a->weights, &l, &present, output, hidden);
    pull_features(a->weights, hidden, out);
    transpose(l.hidden, SG_HIDDEN, across);
    for (int n = 0; n < SG_NETWORKS; n++)
        add_products(output, present.row + sg_network_row(n), present.count[n], OUTPUT_ROWS, across,
                     n * SG_NETWORK_HIDDEN, SG_NETWORK_HIDDEN, sums->output[0]);
    transpose(hidden, SG_HIDDEN, across);
    add_products(l.input, NULL, SG_NETWORK_INPUTS + 1, INPUT_ROWS, across, 0, SG_HIDDEN,
                 sums->input[0]);
    if (a->parts & SG_PART_DISTANCE)
        add_products(l.bank_input + 3, NULL, 1, 1, across, 0, SG_HIDDEN, sums->distance);
    if (a->parts & SG_PART_BANK)
        pull_bank(a->weights, b, &l, out, sums);
    add_biases(output, SG_OUTPUTS, sums->bias);
}
