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

#define K(kernel, result, arguments) result KERNEL(fft_##kernel) arguments;
SG_FFT_KERNELS(K)
#undef K

#endif
