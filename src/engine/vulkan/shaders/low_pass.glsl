/* SPDX-License-Identifier: Apache-2.0 */
/* The low-pass term's differences. The window is symmetric, and outside of the image differences
 * are 0. So the filter is its own transpose, and the gradient is the difference filtered twice. */
#include "photo.glsl"
#define WINDOWED float
#include "windowed.glsl"

/* The difference at a place of a channel of the image, if it counts, else 0. */
float low_pass_difference(uint at, uint channel, uint pixels, out bool counts)
{
    const uint word = a.photo.v[at % pixels];
    const float photo = a.planes != 0 ? a.given.v[at] : photo_value(word, channel);
    const float d = a.image.v[at] - photo;
    counts = (a.masked == 0 || photo_counts(word)) && low_pass_counts(d, photo, a.tolerance);
    return counts ? d : 0.0;
}
