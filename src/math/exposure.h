/* SPDX-License-Identifier: Apache-2.0 */
/* The exposure of a photo: an affine map of colours as in Kerbl et al.'s code since 2024, 3 rows of
 * 4. Channel c of the photo is the sum over k of colour[k] row[k][c], and row[c][3]. */
#ifndef SG_MATH_EXPOSURE_H
#define SG_MATH_EXPOSURE_H

#define SG_EXPOSURE 12 /* numbers */

static inline void sg_expose(const float *e, const float *colour, float *out)
{
    for (int c = 0; c < 3; c++)
        out[c] = colour[0] * e[c] + colour[1] * e[4 + c] + colour[2] * e[8 + c] + e[4 * c + 3];
}

/* dL/dcolour from dL/dout. */
static inline void sg_expose_backward(const float *e, const float *out, float *colour)
{
    for (int k = 0; k < 3; k++)
        colour[k] = out[0] * e[4 * k] + out[1] * e[4 * k + 1] + out[2] * e[4 * k + 2];
}

#endif
