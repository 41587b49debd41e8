/* SPDX-License-Identifier: Apache-2.0 */
/* The numbers of 3D Gaussian Splatting (Kerbl et al. 2023 and its released code), in one place. */
#ifndef SG_MATH_CONSTANTS_H
#define SG_MATH_CONSTANTS_H

#define SG_TILE 16                     /* pixels a side */
#define SG_ALPHA_MIN (1.0f / 255.0f)   /* below it a pair is skipped */
#define SG_LOG2_ALPHA_MIN -7.99435344f /* log2 of it */
#define SG_ALPHA_MAX 0.99f
#define SG_LOG2E 1.4426950408889634f
#define SG_T_MIN 1e-4f    /* transmittance at which a pixel stops */
#define SG_Z_MIN 0.2f     /* cull in front of it */
#define SG_BLUR 0.3f      /* added to the diagonal of the 2D covariance, pixels squared */
#define SG_MIP_LEAST 1e-6 /* in the formulas of Mip-Splatting, as the released code has it */
#define SG_MIP_CAMERA 18  /* numbers of a camera for its 3D filter */
#define SG_GUARD 1.3f     /* tangent clamp, in half fields of view */

#define SG_ADAM_BETA1 0.9f
#define SG_ADAM_BETA2 0.999f
#define SG_ADAM_EPS 1e-15f

#define SG_PRUNE_OPACITY 0.005f
#define SG_RESET_OPACITY 0.01f
#define SG_SPLIT_CHILDREN 2
#define SG_SPLIT_SHRINK 1.6f /* 0.8 x children */
#define SG_PRUNE_EXTENT 0.1f /* largest scale kept after the first reset, in scene extents */

#define SG_OFFSET_HIDDEN 1e30f /* of a Gaussian of an anchor: it is hidden */

#define SG_PRUNE_RADIUS 20 /* pixels: larger ones go too, where radii are not cleared before */

#define SG_TV_ISO_FLOOR 1e-12f /* under the root of SG_ATTACK_TV_ISO */

#define SG_COLOUR_ROUNDING 1e-6f /* a black of -1e-8 is black, not clamped: its gradient passes */
#define SG_COLOUR_MAX 1e6f /* brighter is a broken model: not drawn, so that no loss overflows */
#define SG_SH_C0 0.28209479177387814f

#endif
