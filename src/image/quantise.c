/* SPDX-License-Identifier: Apache-2.0 */
#include "splatguard/eval.h"

void sg_quantise(const float *planar, int width, int height, uint8_t *rgb)
{
    const size_t n = (size_t) width * (size_t) height;
    for (size_t ch = 0; ch < 3; ch++)
        for (size_t i = 0; i < n; i++) {
            const float v = planar[ch * n + i] * 255.0f + 0.5f;
            rgb[3 * i + ch] = (uint8_t) (v > 0 ? v < 255 ? v : 255 : 0); /* NaN: 0 */
        }
}
