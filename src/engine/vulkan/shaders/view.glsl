/* SPDX-License-Identifier: Apache-2.0 */
#include "math/projection.h"

/* A struct pinhole as the host wrote it: all of it are floats, in this order. */
pinhole view_load(Floats from)
{
    pinhole v;
    for (int i = 0; i < 9; i++)
        v.R[i] = from.v[i];
    for (int i = 0; i < 3; i++) {
        v.t[i] = from.v[9 + i];
        v.centre[i] = from.v[12 + i];
    }
    v.fx = from.v[15], v.fy = from.v[16], v.cx = from.v[17], v.cy = from.v[18];
    for (int i = 0; i < 4; i++)
        v.lim[i] = from.v[19 + i];
    v.half_w = from.v[23], v.half_h = from.v[24];
    v.blur = from.v[25], v.compensated = from.v[26];
    return v;
}
