/* SPDX-License-Identifier: Apache-2.0 */
/* The exposure of a photo: an affine map of colours as in Kerbl et al.'s code since 2024, 3 rows of
 * 4. Channel c of the photo is the sum over k of colour[k] row[k][c], and row[c][3]. For C and GLSL
 * (dialect.h); GLSL includes a real_*.h first. */
#ifndef SG_MATH_EXPOSURE_H
#define SG_MATH_EXPOSURE_H

#ifndef SG_GLSL
#include "dialect.h"
#endif

#define SG_EXPOSURE 12       /* numbers */
#define SG_EXPOSURE_EPS 1e-8 /* of Adam: not that of the Gaussians */

SG_FN void sg_expose(IN_ARRAY(float, e, SG_EXPOSURE), IN_ARRAY(float, colour, 3),
                     OUT_ARRAY(float, shown, 3))
{
    for (int c = 0; c < 3; c++)
        shown[c] = colour[0] * e[c] + colour[1] * e[4 + c] + colour[2] * e[8 + c] + e[4 * c + 3];
}

/* dL/dcolour from dL/dshown. */
SG_FN void sg_expose_backward(IN_ARRAY(float, e, SG_EXPOSURE), IN_ARRAY(float, shown, 3),
                              OUT_ARRAY(float, colour, 3))
{
    for (int k = 0; k < 3; k++)
        colour[k] = shown[0] * e[4 * k] + shown[1] * e[4 * k + 1] + shown[2] * e[4 * k + 2];
}

#endif
