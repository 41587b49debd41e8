/* SPDX-License-Identifier: Apache-2.0 */
/* The window of SSIM on numbers that a workgroup has staged, along the rows and then along the
 * columns. WINDOWED: their type, float or a vector. */
#include "window.glsl"

shared WINDOWED staged[WIDE * WIDE], along[WIDE][SIDE];

/* Around pixel t of the tile. */
WINDOWED windowed(uint t)
{
    barrier(); /* all is staged */
    for (uint k = t; k < WIDE * SIDE; k += SIDE * SIDE) {
        const uint row = k / SIDE, column = k % SIDE;
        WINDOWED sum = WINDOWED(0.0);
        for (uint i = 0; i < SG_SSIM_TAPS; i++)
            sum += sg_ssim_window[i] * staged[row * WIDE + column + i];
        along[row][column] = sum;
    }
    barrier(); /* all rows are there */
    WINDOWED sum = WINDOWED(0.0);
    for (uint i = 0; i < SG_SSIM_TAPS; i++)
        sum += sg_ssim_window[i] * along[t / SIDE + i][t % SIDE];
    return sum;
}
