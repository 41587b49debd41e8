/* SPDX-License-Identifier: Apache-2.0 */
/* The low-pass term's differences. The window is symmetric, and outside of the image differences
 * are 0. So the filter is its own transpose, and the gradient is the difference filtered twice. */
#include "photo.glsl"
#include "window.glsl"

/* The difference at a place of a channel of the image, if it counts, else 0. */
float low_pass_difference(uint at, uint channel, uint pixels, out bool counts)
{
    const uint word = a.photo.v[at % pixels];
    const float photo = a.planes != 0 ? a.given.v[at] : photo_value(word, channel);
    const float d = a.image.v[at] - photo;
    counts = (a.masked == 0 || photo_counts(word)) && low_pass_counts(d, photo, a.tolerance);
    return counts ? d : 0.0;
}

shared float staged[WIDE * WIDE], along[WIDE][SIDE];

/* The window around pixel t of the tile, of what is staged. */
float windowed(uint t)
{
    barrier(); /* all is staged */
    for (uint k = t; k < WIDE * SIDE; k += SIDE * SIDE) {
        const uint row = k / SIDE, column = k % SIDE;
        float sum = 0.0;
        for (uint i = 0; i < SG_SSIM_TAPS; i++)
            sum += sg_ssim_window[i] * staged[row * WIDE + column + i];
        along[row][column] = sum;
    }
    barrier(); /* all rows are there */
    float sum = 0.0;
    for (uint i = 0; i < SG_SSIM_TAPS; i++)
        sum += sg_ssim_window[i] * along[t / SIDE + i][t % SIDE];
    return sum;
}
