/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "splatguard/eval.h"

double sg_psnr_u8(const uint8_t *a, const uint8_t *b, int width, int height)
{
    const size_t n = 3 * (size_t) width * (size_t) height;
    uint64_t sum = 0; /* at most 255^2 x 3 x 2^28: exact */
    for (size_t i = 0; i < n; i++) {
        const int d = a[i] - b[i];
        sum += (uint64_t) (d * d);
    }
    return 10 * log10(255.0 * 255.0 * (double) n / (double) sum);
}
