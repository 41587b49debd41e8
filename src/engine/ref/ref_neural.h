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
        bias[SG_OUTPUTS];
};

struct ref_anchor {
    real position[3], reach[3], anchor[SG_A_PLANES];
};

/* What the networks compute on the way. */
struct ref_neural {
    real input[SG_NETWORK_INPUTS + 1], hidden[SG_HIDDEN], output[SG_OUTPUTS];
};

/* The hidden values that an output is made of. */
static inline int ref_first_hidden(int output)
{
    return (int) sg_output_network(output) * SG_NETWORK_HIDDEN;
}

static inline void ref_networks(const struct ref_weights *w, const struct ref_anchor *a,
                                const real *centre, struct ref_neural *n)
{
    real d[3], length = 0;
    for (int k = 0; k < 3; k++)
        d[k] = a->position[k] - centre[k], length += d[k] * d[k];
    length = r_sqrt(length);
    for (int i = 0; i < SG_ANCHOR_FEATURES; i++)
        n->input[i] = a->anchor[SG_A_FEATURE + i];
    for (int k = 0; k < 3; k++)
        n->input[SG_ANCHOR_FEATURES + k] = d[k] / length;
    n->input[SG_NETWORK_INPUTS] = 1;
    for (int h = 0; h < SG_HIDDEN; h++) {
        real sum = 0;
        for (int i = 0; i <= SG_NETWORK_INPUTS; i++)
            sum += w->input[i][h] * n->input[i];
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
    struct neural out = {.y = n->output[SG_O_OPACITY + k]};
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
                                      const real *centre, real (*drawn)[SG_NEURAL_PLANES],
                                      bool *exists)
{
    struct ref_neural n;
    ref_networks(w, a, centre, &n);
    for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++) {
        const struct neural g = ref_neural_of(a, &n, k);
        exists[k] = g.y > 0;
        neural_forward(&g, drawn[k]);
    }
}

/* Adds to the gradient of the weights. out: gradients of reach and anchor. */
static inline void ref_neural_backward(const struct ref_weights *w, const struct ref_anchor *a,
                                       const real *centre, real (*gradient)[SG_NEURAL_PLANES],
                                       real volume, struct ref_anchor *out, struct ref_weights *sum)
{
    struct ref_neural n, d;
    memset(&d, 0, sizeof(d));
    memset(out, 0, sizeof(*out));
    ref_networks(w, a, centre, &n);
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
    }
}

#endif
