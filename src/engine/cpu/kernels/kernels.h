/* SPDX-License-Identifier: Apache-2.0 */
/* For the files compiled once per instruction set: SG_ISA is the variant's name. */
#ifndef SG_KERNELS_LOCAL_H
#define SG_KERNELS_LOCAL_H

#include "simd.h"

#include "engine/cpu/kernels.h"
#include "math/constants.h"

#define SG_PASTE_(a, b) a##_##b
#define SG_PASTE(a, b) SG_PASTE_(a, b)
#define KERNEL(name) SG_PASTE(sg_cpu_##name, SG_ISA)

#define K(kernel, result, arguments) result KERNEL(kernel) arguments;
CPU_KERNELS(K)
#undef K

void KERNEL(fft_columns)(const struct sg_fft *, const float *, float *, bool, float *);
void KERNEL(fft_rows)(const struct sg_fft *, const struct sg_fft_rows *, const float *const *,
                      float *);
void KERNEL(fft_rows_back)(const struct sg_fft *, const struct sg_fft_rows *, float *const *, float,
                           float *);

#endif
