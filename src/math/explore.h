/* SPDX-License-Identifier: Apache-2.0 */
/* The noise on positions of Kheradmand et al. 2024, for one Gaussian. Include a real_*.h first. */
#ifndef SG_MATH_EXPLORE_H
#define SG_MATH_EXPLORE_H

#include "constants.h"

/* The rotation matrix of a quaternion of any length, by rows. */
SG_FN void rotation_of(IN_ARRAY(real, rot, 4), OUT_ARRAY(real, R, 9))
{
    const real len = r_max(
        r_sqrt(rot[0] * rot[0] + rot[1] * rot[1] + rot[2] * rot[2] + rot[3] * rot[3]), NUM(1e-12));
    const real r = rot[0] / len, x = rot[1] / len, y = rot[2] / len, z = rot[3] / len;
    const scalar one = NUM(1), two = NUM(2);
    R[0] = one - two * (y * y + z * z), R[1] = two * (x * y - r * z), R[2] = two * (x * z + r * y);
    R[3] = two * (x * y + r * z), R[4] = one - two * (x * x + z * z), R[5] = two * (y * z - r * x);
    R[6] = two * (x * z - r * y), R[7] = two * (y * z + r * x), R[8] = one - two * (x * x + y * y);
}

/* How much of the noise a Gaussian gets: little where it is opaque; 0 where that moves nothing. */
SG_FN real explore_gate(real logit, real steepness, real dead)
{
    const real opacity = NUM(1) / (NUM(1) + r_exp(-logit));
    const real gate = NUM(1) / (NUM(1) + r_exp(steepness * (opacity - dead)));
    return gate > NUM(1e-12) ? gate : NUM(0);
}

/* Adds covariance x n to a position. scales: logarithms. */
SG_FN void explore_move(IN_ARRAY(real, rot, 4), IN_ARRAY(real, scales, 3), IN_ARRAY(real, n, 3),
                        INOUT_ARRAY(real, xyz, 3))
{
    real R[9], along[3];
    rotation_of(rot, R);
    for (int k = 0; k < 3; k++)
        along[k] = r_exp(NUM(2) * scales[k]) * (R[k] * n[0] + R[3 + k] * n[1] + R[6 + k] * n[2]);
    for (int k = 0; k < 3; k++)
        xyz[k] += R[3 * k] * along[0] + R[3 * k + 1] * along[1] + R[3 * k + 2] * along[2];
}

#endif
