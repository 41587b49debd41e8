/* SPDX-License-Identifier: Apache-2.0 */
/* Scaffold-GS (Lu et al. 2024): Gaussians that networks make anew for each view, from anchors. An
 * anchor has a position, a feature, SG_ANCHOR_GAUSSIANS offsets and six scales. */
#ifndef SG_MODEL_ANCHOR_H
#define SG_MODEL_ANCHOR_H

#include <stddef.h>

#include "splatguard/model.h"

#define SG_ANCHOR_GAUSSIANS 10 /* of an anchor, of which a view draws those that are opaque */
#define SG_ANCHOR_FEATURES 32
#define SG_ANCHOR_VOLUME 0.01f /* weight in the loss of the mean product of the drawn scales */

/* An anchor is a Gaussian of SH degree 0 to the library: its position is fixed, its scales
 * (SG_P_SCALE) are the unit of its offsets, the rest is not used. The others of its values are in
 * the column SG_C_ANCHOR, in these planes. */
enum sg_anchor_plane {
    SG_A_OFFSET = 0,   /* 3 SG_ANCHOR_GAUSSIANS: of Gaussian k along axis i at 3 k + i */
    SG_A_FEATURE = 30, /* SG_ANCHOR_FEATURES */
    SG_A_SIZE = 62,    /* 3: natural log of the largest scales of its Gaussians */
    SG_A_PLANES = 65
};

/* Of an anchor, in the column SG_C_ANCHOR_STATISTICS. */
enum sg_anchor_statistic {
    SG_A_GRADIENT = 0, /* of each offset: sum of the gradient norms of its Gaussian */
    SG_A_DRAWN = 10,   /* of each offset: views that drew it */
    SG_A_OPACITY = 20, /* sum of its Gaussians' opacities over the views that saw the anchor */
    SG_A_SEEN = 21,    /* those views */
    SG_A_STATISTICS = 22
};

/* The networks: each has one hidden layer of SG_NETWORK_HIDDEN values behind a ReLU. All read the
 * same inputs, so their hidden layers lie side by side. */
enum sg_network {
    SG_N_OPACITY,
    SG_N_COVARIANCE,
    SG_N_COLOUR,
    SG_NETWORKS,
    SG_N_BANK = SG_NETWORKS, /* an optional part, with inputs and outputs of its own */
    SG_N_APPEARANCE,         /* no network, but it learns as they do */
    SG_NETWORK_RATES
};
#define SG_NETWORK_HIDDEN 32
#define SG_NETWORK_INPUTS (SG_ANCHOR_FEATURES + 3) /* the feature, and the direction of view */
#define SG_HIDDEN (SG_NETWORKS * SG_NETWORK_HIDDEN)

/* Outputs: an opacity for each Gaussian, then a size, 3, and a rotation, 4, then a colour. */
#define SG_O_OPACITY 0
#define SG_O_COVARIANCE SG_ANCHOR_GAUSSIANS
#define SG_O_COLOUR (8 * SG_ANCHOR_GAUSSIANS)
#define SG_OUTPUTS (11 * SG_ANCHOR_GAUSSIANS)

/* Rows of `output` before those of a network, and behind the last. */
static inline int sg_network_row(int network)
{
    return network == SG_N_OPACITY      ? SG_O_OPACITY
           : network == SG_N_COVARIANCE ? SG_O_COVARIANCE
           : network == SG_N_COLOUR     ? SG_O_COLOUR
                                        : SG_OUTPUTS;
}

/* The network that has this row of `output`. */
static inline enum sg_network sg_output_network(int row)
{
    return row < SG_O_COVARIANCE ? SG_N_OPACITY : row < SG_O_COLOUR ? SG_N_COVARIANCE : SG_N_COLOUR;
}

/* Optional parts of the networks, as in the released code. */
enum sg_network_part {
    SG_PART_DISTANCE = 1,   /* the distance from camera to anchor is an input too */
    SG_PART_APPEARANCE = 4, /* the colours' network reads SG_APPEARANCE numbers of the photo too */
    SG_PART_BANK = 2 /* the networks read a mixture of the feature with coarser copies of itself,
                        in shares that one more network makes of direction and distance */
};
#define SG_APPEARANCE 32
#define SG_BANK_INPUTS 4  /* direction, distance */
#define SG_BANK_OUTPUTS 3 /* shares: of every fourth value, of every second, of all */

/* What the mixture's copy with this share has in place of value f of a feature. */
static inline int sg_bank_source(int share, int f)
{
    return share == 0   ? f % (SG_ANCHOR_FEATURES / 4) * 4
           : share == 1 ? f % (SG_ANCHOR_FEATURES / 2) * 2
                        : f;
}

struct sg_weights {
    float input[SG_NETWORK_INPUTS + 1][SG_HIDDEN]; /* by input; the last row: biases */
    float output[SG_OUTPUTS][SG_NETWORK_HIDDEN];   /* by output, from its network's hidden values */
    float bias[SG_OUTPUTS];
    /* of optional parts, zeros without */
    float distance[SG_HIDDEN]; /* as a row of `input` */
    float bank_input[SG_BANK_INPUTS + 1][SG_NETWORK_HIDDEN];
    float bank_output[SG_BANK_OUTPUTS][SG_NETWORK_HIDDEN];
    float bank_bias[SG_BANK_OUTPUTS];
    float appearance[SG_APPEARANCE]
                    [SG_NETWORK_HIDDEN]; /* as rows of `input`, of the colours only */
};
#define SG_WEIGHTS (sizeof(struct sg_weights) / sizeof(float))
#define SG_WEIGHT_AT(member) (offsetof(struct sg_weights, member) / sizeof(float))
#define SG_WEIGHTS_PLAIN SG_WEIGHT_AT(distance) /* of no part */

/* The network that a value of struct sg_weights belongs to. */
static inline enum sg_network sg_weight_network(size_t i)
{
    if (i < SG_WEIGHT_AT(output))
        return (enum sg_network)(i % SG_HIDDEN / SG_NETWORK_HIDDEN);
    if (i < SG_WEIGHT_AT(bias))
        return sg_output_network((int) ((i - SG_WEIGHT_AT(output)) / SG_NETWORK_HIDDEN));
    if (i < SG_WEIGHT_AT(distance))
        return sg_output_network((int) (i - SG_WEIGHT_AT(bias)));
    if (i < SG_WEIGHT_AT(bank_input))
        return (enum sg_network)((i - SG_WEIGHT_AT(distance)) / SG_NETWORK_HIDDEN);
    return i < SG_WEIGHT_AT(appearance) ? SG_N_BANK : SG_N_COLOUR;
}

/* Of a network's first layer. */
static inline int sg_network_inputs(enum sg_network network, unsigned parts)
{
    return network == SG_N_BANK
               ? SG_BANK_INPUTS
               : SG_NETWORK_INPUTS + (parts & SG_PART_DISTANCE ? 1 : 0) +
                     (network == SG_N_COLOUR && parts & SG_PART_APPEARANCE ? SG_APPEARANCE : 0);
}

/* Of a photo, and Adam's moments. */
struct sg_appearance {
    float value[SG_APPEARANCE], moment1[SG_APPEARANCE], moment2[SG_APPEARANCE];
};

/* What all anchors of a model share. */
struct sg_networks {
    struct sg_weights value, moment1, moment2; /* moments: of Adam */
    float voxel;                               /* cell of the finest growth, scene units */
    unsigned parts;                            /* bits of enum sg_network_part */
    size_t photos;                             /* with appearances; 0 without SG_PART_APPEARANCE */
    struct sg_appearance appearance[];
};

#endif
