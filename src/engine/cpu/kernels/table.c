/* SPDX-License-Identifier: Apache-2.0 */
#include "kernels.h"

#define SG_STRING_(a) #a
#define SG_STRING(a) SG_STRING_(a)

const struct cpu_kernels KERNEL(kernels) = {.name = SG_STRING(SG_ISA),
#define K(kernel, result, arguments) .kernel = KERNEL(kernel),
                                            CPU_KERNELS(K)
#undef K
                                                .fft = {
#define K(kernel, result, arguments) .kernel = KERNEL(fft_##kernel),
                                                SG_FFT_KERNELS(K)
#undef K
                                            }};
