/* SPDX-License-Identifier: Apache-2.0 */
/* A photo to audit, of a known scene and known noise. */
#ifndef TESTS_PHOTOS_H
#define TESTS_PHOTOS_H

#include "models.h"

#define W 160
#define H 112

static uint8_t image[3 * W * H];

static inline uint8_t clamp(double v)
{
    return (uint8_t) (v < 0 ? 0 : v > 255 ? 255 : v + 0.5);
}

/* Smooth shading with a few edges, and `noise` grey levels on top: in rows only, or in every
 * pixel. */
static inline void paint(double noise, bool rows, uint64_t seed)
{
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int ch = 0; ch < 3; ch++) {
                const double base =
                    90 + 40 * sin(x * 0.05 + ch) + 30 * cos(y * 0.04) + (x / 40 + y / 30) % 2 * 30;
                const uint64_t at = rows ? (uint64_t) y : (uint64_t) ((y * W + x) * 3 + ch);
                const double sign = draw(seed, at, -1, 1) > 0 ? 1 : -1;
                image[3 * (y * W + x) + ch] = clamp(base + noise * (rows ? y % 2 ? 1 : -1 : sign));
            }
}

#endif
