/* SPDX-License-Identifier: Apache-2.0 */
#include "math/spectrum.h"

/* Direction of the coefficient in row u of a column: a byte each, columns in whole words. */
uint direction_at(uint column, uint u)
{
    return a.directions.v[column * ((a.points + 3) / 4) + u / 4] >> 8 * (u % 4) & 255;
}
