/* SPDX-License-Identifier: Apache-2.0 */
/* The numbers of the anisotropy loss, for C and GLSL. */
#ifndef SG_MATH_SPECTRUM_H
#define SG_MATH_SPECTRUM_H

#define SG_LUMA 0.299, 0.587, 0.114 /* of red, green and blue */
#define SG_OUTSIDE 255              /* bin of a coefficient outside of the band; bins are fewer */

/* With at most this energy, times the number of coefficients, an image is flat but for rounding.
 * Power is the square of the amplitude, and so is its number of coefficients squared. */
#define SG_FLAT_AMPLITUDE 1e-6
#define SG_FLAT_POWER 1e-12

#endif
