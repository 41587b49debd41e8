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

#define SG_ANCHOR_OPTIONS                                                                          \
    SG_ANCHOR_FLOAT(                                                                               \
        "voxel-size", scaffold.voxel, 0, 1e6,                                                      \
        "Side of the cells that get an anchor from points, scene units; 0 = by the points' "       \
        "distances."),                                                                             \
        SG_ANCHOR_INT("anchor-cells", scaffold.cells, 1, 4096,                                     \
                      "Cells of the coarsest grid of growth, in voxels; a quarter and a "          \
                      "sixteenth of it for "                                                       \
                      "the finer grids."),                                                         \
        SG_ANCHOR_INT("anchors-from-iter", scaffold.from, 0, 1e9,                                  \
                      "Anchors grow after this iteration."),                                       \
        SG_ANCHOR_FLAG("anchor-distance", scaffold.distance,                                       \
                       "The networks read the distance from the camera to the anchor too."),       \
        SG_ANCHOR_FLAG("feature-bank", scaffold.bank,                                              \
                       "The networks read a mixture of the anchor's feature with coarser copies "  \
                       "of itself. One "                                                           \
                       "more network makes the shares, from direction and distance."),             \
        SG_ANCHOR_FLAG("photo-appearance", scaffold.appearance,                                    \
                       "The network of colours reads 32 numbers of the photo too, which are "      \
                       "learned. --appearance "                                                    \
                       "of eval and render says whose numbers they use."),                         \
        SG_ANCHOR_FLOAT("offset-lr-init", scaffold.offset_lr_init, 1e-12, 1000,                    \
                        "Offsets, at the start, in scene extents."),                               \
        SG_ANCHOR_FLOAT("offset-lr-final", scaffold.offset_lr_final, 1e-12, 1000,                  \
                        "Offsets, at the end, in scene extents."),                                 \
        SG_ANCHOR_FLOAT("anchor-feature-lr", scaffold.feature_lr, 0, 1000, "Features."),           \
        SG_ANCHOR_FLOAT("anchor-scaling-lr", scaffold.scaling_lr, 0, 1000, "Scales."),             \
        SG_ANCHOR_FLOAT("opacity-network-lr-init", scaffold.opacity_lr_init, 1e-12, 1000,          \
                        "Network of opacities, at the start."),                                    \
        SG_ANCHOR_FLOAT("opacity-network-lr-final", scaffold.opacity_lr_final, 1e-12, 1000,        \
                        "At the end."),                                                            \
        SG_ANCHOR_FLOAT("covariance-network-lr-init", scaffold.covariance_lr_init, 1e-12, 1000,    \
                        "Network of scales and rotations, at the start."),                         \
        SG_ANCHOR_FLOAT("covariance-network-lr-final", scaffold.covariance_lr_final, 1e-12, 1000,  \
                        "At the end."),                                                            \
        SG_ANCHOR_FLOAT("colour-network-lr-init", scaffold.colour_lr_init, 1e-12, 1000,            \
                        "Network of colours, at the start."),                                      \
        SG_ANCHOR_FLOAT("colour-network-lr-final", scaffold.colour_lr_final, 1e-12, 1000,          \
                        "At the end."),                                                            \
        SG_ANCHOR_FLOAT("feature-bank-lr-init", scaffold.bank_lr_init, 1e-12, 1000,                \
                        "Network of the feature bank, at the start."),                             \
        SG_ANCHOR_FLOAT("feature-bank-lr-final", scaffold.bank_lr_final, 1e-12, 1000,              \
                        "At the end."),                                                            \
        SG_ANCHOR_FLOAT("appearance-lr-init", scaffold.appearance_lr_init, 1e-12, 1000,            \
                        "Numbers of photos, at the start."),                                       \
        SG_ANCHOR_FLOAT("appearance-lr-final", scaffold.appearance_lr_final, 1e-12, 1000,          \
                        "At the end.")

#endif
