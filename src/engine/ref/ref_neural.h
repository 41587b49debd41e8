/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle of Scaffold-GS: one anchor in one view, as plainly as its equations allow. Include
 * real_f32.h or real_f64.h first. */
#ifndef SG_REF_NEURAL_H
#define SG_REF_NEURAL_H

#include <string.h>

#include "math/neural.h"
#include "model/anchor.h"

/* struct sg_weights in the precision of the arithmetic. */
struct ref_weights {
    real input[SG_NETWORK_INPUTS + 1][SG_HIDDEN], output[SG_OUTPUTS][SG_NETWORK_HIDDEN],
        bias[SG_OUTPUTS], distance[SG_HIDDEN], bank_input[SG_BANK_INPUTS + 1][SG_NETWORK_HIDDEN],
        bank_output[SG_BANK_OUTPUTS][SG_NETWORK_HIDDEN], bank_bias[SG_BANK_OUTPUTS],
        appearance[SG_APPEARANCE][SG_NETWORK_HIDDEN];
};

/* What the networks know of a view. */
struct ref_view {
    real centre[3]; /* of the camera */
    unsigned parts; /* of enum sg_network_part */
    real appearance[SG_APPEARANCE];
};

struct ref_anchor {
    real position[3], reach[3], anchor[SG_A_PLANES];
};

/* What the networks compute on the way. */
struct ref_neural {
    real input[SG_NETWORK_INPUTS + 1], hidden[SG_HIDDEN], output[SG_OUTPUTS], distance;
    real bank_input[SG_BANK_INPUTS + 1], bank_hidden[SG_NETWORK_HIDDEN], share[SG_BANK_OUTPUTS];
};

/* The hidden values that an output is made of. */
static inline int ref_first_hidden(int output)
{
    return (int) sg_output_network(output) * SG_NETWORK_HIDDEN;
}

/* The feature becomes a mixture, in shares that sum up to 1. */
static inline void ref_bank(const struct ref_weights *w, const struct ref_anchor *a,
                            struct ref_neural *n)
{
    real sum = 0;
    for (int k = 0; k < 3; k++)
        n->bank_input[k] = n->input[SG_ANCHOR_FEATURES + k];
    n->bank_input[3] = n->distance, n->bank_input[SG_BANK_INPUTS] = 1;
    for (int h = 0; h < SG_NETWORK_HIDDEN; h++) {
        real s = 0;
        for (int i = 0; i <= SG_BANK_INPUTS; i++)
            s += w->bank_input[i][h] * n->bank_input[i];
        n->bank_hidden[h] = s > 0 ? s : 0;
    }
    real most = -INFINITY;
    for (int j = 0; j < SG_BANK_OUTPUTS; j++) {
        n->share[j] = w->bank_bias[j];
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            n->share[j] += w->bank_output[j][h] * n->bank_hidden[h];
        most = r_max(most, n->share[j]);
    }
    for (int j = 0; j < SG_BANK_OUTPUTS; j++)
        sum += n->share[j] = r_exp(n->share[j] - most);
    for (int j = 0; j < SG_BANK_OUTPUTS; j++)
        n->share[j] /= sum;
    for (int i = 0; i < SG_ANCHOR_FEATURES; i++) {
        n->input[i] = 0;
        for (int j = 0; j < SG_BANK_OUTPUTS; j++)
            n->input[i] += n->share[j] * a->anchor[SG_A_FEATURE + sg_bank_source(j, i)];
    }
}

/* From the gradients of the mixture, in out->anchor, to those of the feature and the weights. */
static inline void ref_bank_backward(const struct ref_weights *w, const struct ref_anchor *a,
                                     const struct ref_neural *n, struct ref_anchor *out,
                                     struct ref_weights *sum)
{
    real d[SG_ANCHOR_FEATURES], share[SG_BANK_OUTPUTS] = {0}, mean = 0;
    for (int i = 0; i < SG_ANCHOR_FEATURES; i++) {
        d[i] = out->anchor[SG_A_FEATURE + i];
        out->anchor[SG_A_FEATURE + i] = 0;
    }
    for (int j = 0; j < SG_BANK_OUTPUTS; j++) {
        for (int i = 0; i < SG_ANCHOR_FEATURES; i++) {
            const int from = SG_A_FEATURE + sg_bank_source(j, i);
            share[j] += d[i] * a->anchor[from];
            out->anchor[from] += n->share[j] * d[i];
        }
        mean += n->share[j] * share[j];
    }
    real hidden[SG_NETWORK_HIDDEN] = {0};
    for (int j = 0; j < SG_BANK_OUTPUTS; j++) {
        const real g = n->share[j] * (share[j] - mean);
        sum->bank_bias[j] += g;
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++) {
            sum->bank_output[j][h] += g * n->bank_hidden[h];
            hidden[h] += w->bank_output[j][h] * g;
        }
    }
    for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
        for (int i = 0; i <= SG_BANK_INPUTS && n->bank_hidden[h] > 0; i++)
            sum->bank_input[i][h] += hidden[h] * n->bank_input[i];
}

/* Whether hidden value h does. */
static inline bool ref_reads_appearance(const struct ref_view *view, int h)
{
    return view->parts & SG_PART_APPEARANCE && h / SG_NETWORK_HIDDEN == SG_N_COLOUR;
}

static inline void ref_networks(const struct ref_weights *w, const struct ref_anchor *a,
                                const struct ref_view *view, struct ref_neural *n)
{
    real d[3], length = 0;
    for (int k = 0; k < 3; k++)
        d[k] = a->position[k] - view->centre[k], length += d[k] * d[k];
    n->distance = length = r_sqrt(length);
    for (int i = 0; i < SG_ANCHOR_FEATURES; i++)
        n->input[i] = a->anchor[SG_A_FEATURE + i];
    for (int k = 0; k < 3; k++)
        n->input[SG_ANCHOR_FEATURES + k] = d[k] / length;
    n->input[SG_NETWORK_INPUTS] = 1;
    if (view->parts & SG_PART_BANK)
        ref_bank(w, a, n);
    for (int h = 0; h < SG_HIDDEN; h++) {
        real sum = 0;
        for (int i = 0; i <= SG_NETWORK_INPUTS; i++)
            sum += w->input[i][h] * n->input[i];
        if (view->parts & SG_PART_DISTANCE)
            sum += w->distance[h] * n->distance;
        for (int i = 0; i < SG_APPEARANCE && ref_reads_appearance(view, h); i++)
            sum += w->appearance[i][h - SG_N_COLOUR * SG_NETWORK_HIDDEN] * view->appearance[i];
        n->hidden[h] = sum > 0 ? sum : 0;
    }
    for (int o = 0; o < SG_OUTPUTS; o++) {
        n->output[o] = w->bias[o];
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            n->output[o] += w->output[o][h] * n->hidden[ref_first_hidden(o) + h];
    }
}

/* Gaussian k of an anchor. */
static inline struct neural ref_neural_of(const struct ref_anchor *a, const struct ref_neural *n,
                                          int k)
{
    const bool shown = neural_shown(a->anchor[SG_A_OFFSET + 3 * k]);
    struct neural out = {.y = shown ? n->output[SG_O_OPACITY + k] : 0};
    for (int i = 0; i < 7; i++)
        out.cov[i] = n->output[SG_O_COVARIANCE + 7 * k + i];
    for (int i = 0; i < 3; i++) {
        out.colour[i] = n->output[SG_O_COLOUR + 3 * k + i];
        out.offset[i] = a->anchor[SG_A_OFFSET + 3 * k + i];
        out.anchor[i] = a->position[i], out.reach[i] = a->reach[i];
        out.size[i] = a->anchor[SG_A_SIZE + i];
    }
    return out;
}

/* exists: which Gaussians are drawn. */
static inline void ref_neural_forward(const struct ref_weights *w, const struct ref_anchor *a,
                                      const struct ref_view *view, real (*drawn)[SG_NEURAL_PLANES],
                                      bool *exists)
{
    struct ref_neural n;
    ref_networks(w, a, view, &n);
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
        const struct neural g = ref_neural_of(a, &n, k);
        exists[k] = g.y > 0;
        neural_forward(&g, drawn[k]);
    }
}

/* Adds to the gradients of weights and appearance. out: gradients of reach and anchor. */
static inline void ref_neural_backward(const struct ref_weights *w, const struct ref_anchor *a,
                                       const struct ref_view *view,
                                       real (*gradient)[SG_NEURAL_PLANES], real volume,
                                       struct ref_anchor *out, struct ref_weights *sum,
                                       real appearance[SG_APPEARANCE])
{
    struct ref_neural n, d;
    memset(&d, 0, sizeof(d));
    memset(out, 0, sizeof(*out));
    ref_networks(w, a, view, &n);
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
        const struct neural g = ref_neural_of(a, &n, k);
        struct neural dg;
        real planes[SG_NEURAL_PLANES];
        if (!(g.y > 0))
            continue;
        neural_forward(&g, planes);
        neural_backward(&g, planes, gradient[k], volume, &dg);
        d.output[SG_O_OPACITY + k] = dg.y;
        for (int i = 0; i < 7; i++)
            d.output[SG_O_COVARIANCE + 7 * k + i] = dg.cov[i];
        for (int i = 0; i < 3; i++) {
            d.output[SG_O_COLOUR + 3 * k + i] = dg.colour[i];
            out->anchor[SG_A_OFFSET + 3 * k + i] = dg.offset[i];
            out->anchor[SG_A_SIZE + i] += dg.size[i];
            out->reach[i] += dg.reach[i];
        }
    }
    for (int o = 0; o < SG_OUTPUTS; o++) {
        sum->bias[o] += d.output[o];
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++) {
            const int at = ref_first_hidden(o) + h;
            sum->output[o][h] += d.output[o] * n.hidden[at];
            d.hidden[at] += w->output[o][h] * d.output[o];
        }
    }
    for (int h = 0; h < SG_HIDDEN; h++) {
        if (!(n.hidden[h] > 0))
            continue;
        for (int i = 0; i <= SG_NETWORK_INPUTS; i++) {
            sum->input[i][h] += d.hidden[h] * n.input[i];
            if (i < SG_ANCHOR_FEATURES)
                out->anchor[SG_A_FEATURE + i] += w->input[i][h] * d.hidden[h];
        }
        if (view->parts & SG_PART_DISTANCE)
            sum->distance[h] += d.hidden[h] * n.distance;
        for (int i = 0; i < SG_APPEARANCE && ref_reads_appearance(view, h); i++) {
            const int at = h - SG_N_COLOUR * SG_NETWORK_HIDDEN;
            sum->appearance[i][at] += d.hidden[h] * view->appearance[i];
            appearance[i] += d.hidden[h] * w->appearance[i][at];
        }
    }
    if (view->parts & SG_PART_BANK)
        ref_bank_backward(w, a, &n, out, sum);
}

#endif
