/* SPDX-License-Identifier: Apache-2.0 */
/* A block of anchors and what a view makes of it: what the kernels and the oracle share. */
#ifndef SG_SCAFFOLD_NEURAL_H
#define SG_SCAFFOLD_NEURAL_H

#include "model/anchor.h"

#define SG_DRAWN_PLANES 14 /* of a Gaussian of SH degree 0 */

/* Rows of SG_LANES anchors. */
struct sg_anchor_block {
    float position[3][SG_LANES], reach[3][SG_LANES]; /* SG_P_XYZ, SG_P_SCALE */
    float anchor[SG_A_PLANES][SG_LANES];
};

/* Of a block: what its anchors are drawn as. The opacity of a Gaussian that does not exist is
 * -INFINITY. */
typedef float sg_drawn_block[SG_ANCHOR_GAUSSIANS][SG_DRAWN_PLANES][SG_LANES];

/* Gradients of a block's values. */
struct sg_anchor_gradient {
    float reach[3][SG_LANES];
    float anchor[SG_A_PLANES][SG_LANES];
};

/* Gradients of the weights, summed over blocks. */
struct sg_weight_sums {
    float input[SG_NETWORK_INPUTS + 1][SG_HIDDEN];
    float output[SG_OUTPUTS][SG_NETWORK_HIDDEN];
    float bias[SG_OUTPUTS][SG_LANES]; /* by lane */
    float distance[SG_HIDDEN];
    float bank_input[SG_BANK_INPUTS + 1][SG_NETWORK_HIDDEN];
    float bank_output[SG_BANK_OUTPUTS][SG_NETWORK_HIDDEN];
    float bank_bias[SG_BANK_OUTPUTS][SG_LANES]; /* by lane */
};

struct sg_neural_args {
    const struct sg_weights *weights;
    float centre[3]; /* of the camera */
    unsigned parts;  /* as of struct sg_networks; an appearance is among the biases */
    float volume;    /* backward: dL/d (product of the scales) of each Gaussian that exists */
};

/* The oracle, of which the kernels are variants. No anchor is at the camera. */
void sg_ref_neural(const struct sg_neural_args *args, const struct sg_anchor_block *block,
                   float (*drawn)[SG_DRAWN_PLANES][SG_LANES]);
/* gradient: of drawn; not read where a Gaussian does not exist. sums: added to. */
void sg_ref_neural_backward(const struct sg_neural_args *args, const struct sg_anchor_block *block,
                            float (*gradient)[SG_DRAWN_PLANES][SG_LANES],
                            struct sg_anchor_gradient *out, struct sg_weight_sums *sums);

#define SG_NOWHERE UINT32_MAX

/* Values of SG_LANES items of a column, which has `planes` planes: `count` from plane `first` on.
 * item: SG_NOWHERE: zeros. Quickest where items ascend and lie together. */
void sg_ref_pick(const float *column, int planes, int first, int count, const uint32_t *item,
                 float (*out)[SG_LANES]);

#endif
