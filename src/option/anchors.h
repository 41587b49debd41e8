/* SPDX-License-Identifier: Apache-2.0 */
/* Rows for the member `scaffold` (struct sg_scaffold_params) of STRUCT: a training and an attack
 * have the same options for anchors. */
#ifndef SG_OPTION_ANCHORS_H
#define SG_OPTION_ANCHORS_H

#include "option.h"

#define SG_ANCHOR_GROUP .group = "Anchors of --model scaffold", .expert = true
#define SG_ANCHOR_FLAG(name, field, help) SG_FLAG(name, field, help, SG_ANCHOR_GROUP)
#define SG_ANCHOR_INT(name, field, low, high, help)                                                \
    SG_NUMBER(SG_OPTION_INT, name, field, low, high, "N", help, SG_ANCHOR_GROUP)
#define SG_ANCHOR_FLOAT(name, field, low, high, help)                                              \
    SG_NUMBER(SG_OPTION_FLOAT, name, field, low, high, "X", help, SG_ANCHOR_GROUP)

/* A learning rate that falls: start and end are the help of both rows. */
#define SG_ANCHOR_RATES(name, field, start, end)                                                   \
    SG_ANCHOR_FLOAT(name "-lr-init", scaffold.field##_lr_init, 1e-12, 1000, start),                \
        SG_ANCHOR_FLOAT(name "-lr-final", scaffold.field##_lr_final, 1e-12, 1000, end)

/* clang-format off */
#define SG_ANCHOR_OPTIONS                                                                          \
    SG_ANCHOR_FLOAT("voxel-size", scaffold.voxel, 0, 1e6,                                          \
        "Side of the cells that get an anchor from points, scene units; 0 = by the points' "       \
        "distances."),                                                                             \
    SG_ANCHOR_INT("anchor-every", scaffold.every, 1, 1e6,                                          \
        "Anchors begin at every Nth point."),                                                      \
    SG_ANCHOR_INT("anchor-cells", scaffold.cells, 1, 4096,                                         \
        "Cells of the coarsest grid of growth, in voxels."),                                       \
    SG_ANCHOR_INT("anchor-grids", scaffold.grids, 1, 8,                                            \
        "Grids of growth. Below one voxel there is none."),                                        \
    SG_ANCHOR_INT("anchor-finer", scaffold.finer, 2, 64,                                           \
        "How many times finer each grid is than the one before. Half of that, rounded down, is "   \
        "how many times higher its threshold is."),                                                \
    SG_ANCHOR_FLOAT("anchor-drop", scaffold.drop, 0, 1,                                            \
        "Share of the candidates for growth that chance leaves out on the coarsest grid; its "     \
        "square on the next, and so on."),                                                         \
    SG_ANCHOR_FLOAT("anchor-log-size-max", scaffold.log_size_max, -100, 100,                       \
        "After growth, largest logarithm of the factor of an anchor's Gaussians' scales."),        \
    SG_ANCHOR_FLOAT("anchor-seen", scaffold.seen, 0, 1,                                            \
        "An anchor is removed for its opacity only if it was seen in more than this share of the " \
        "iterations between two growths. A Gaussian grows only if it was drawn in half of that "   \
        "share."),                                                                                 \
    SG_ANCHOR_FLOAT("anchor-min-opacity", scaffold.min_opacity, 0, 10,                             \
        "Anchors go where the opacities of their Gaussians, added up, have a mean below this."),   \
    SG_ANCHOR_FLOAT("anchor-volume", scaffold.volume, 0, 1000,                                     \
        "Weight in the loss of the mean product of the drawn Gaussians' scales."),                 \
    SG_ANCHOR_INT("anchors-from-iter", scaffold.from, 0, 1e9,                                      \
        "Anchors grow after this iteration."),                                                     \
    SG_ANCHOR_FLAG("anchor-distance", scaffold.distance,                                           \
        "The networks read the distance from the camera to the anchor too."),                      \
    SG_ANCHOR_FLAG("feature-bank", scaffold.bank,                                                  \
        "The networks read a mixture of the anchor's feature with coarser copies of itself. One "  \
        "more network makes the shares, from direction and distance."),                            \
    SG_ANCHOR_FLAG("photo-appearance", scaffold.appearance,                                        \
        "The network of colours reads numbers of the photo too, which are learned. "              \
        "--appearance of eval and render says whose numbers they use."),                           \
    SG_ANCHOR_INT("anchor-offsets", scaffold.offsets, 1, 10,                                       \
        "Gaussians of an anchor. Files, memory and counts have room for 10."),                     \
    SG_ANCHOR_INT("anchor-features", scaffold.features, 1, 32,                                     \
        "Numbers of an anchor's feature; 32 with --feature-bank."),                                \
    SG_ANCHOR_INT("anchor-hidden", scaffold.hidden, 1, 32, "Hidden neurons of each network."),     \
    SG_ANCHOR_INT("appearance-numbers", scaffold.numbers, 1, 32,                                   \
        "Numbers of a photo with --photo-appearance."),                                            \
    SG_ANCHOR_RATES("offset", offset, "Offsets, at the start, in scene extents.",                  \
        "Offsets, at the end, in scene extents."),                                                 \
    SG_ANCHOR_FLOAT("anchor-feature-lr", scaffold.feature_lr, 0, 1000, "Features."),               \
    SG_ANCHOR_FLOAT("anchor-scaling-lr", scaffold.scaling_lr, 0, 1000, "Scales."),                 \
    SG_ANCHOR_RATES("opacity-network", opacity,                                                    \
        "Network of opacities, at the start.", "At the end."),                                     \
    SG_ANCHOR_RATES("covariance-network", covariance,                                              \
        "Network of scales and rotations, at the start.", "At the end."),                          \
    SG_ANCHOR_RATES("colour-network", colour,                                                      \
        "Network of colours, at the start.", "At the end."),                                       \
    SG_ANCHOR_RATES("feature-bank", bank,                                                          \
        "Network of the feature bank, at the start.", "At the end."),                              \
    SG_ANCHOR_RATES("appearance", appearance, "Numbers of photos, at the start.", "At the end.")
/* clang-format on */

#endif
