/* SPDX-License-Identifier: Apache-2.0 */
#include "kernels.h"

#define SG_STRING_(a) #a
#define SG_STRING(a) SG_STRING_(a)

const struct cpu_kernels KERNEL(kernels) = {
    .name = SG_STRING(SG_ISA),
    .project = KERNEL(project),
    .raster = KERNEL(raster),
    .raster_backward = KERNEL(raster_backward),
    .raster_count = KERNEL(raster_count),
    .update = KERNEL(update),
    .loss = KERNEL(loss),
    .ascend = KERNEL(ascend),
    .fft = {.columns = KERNEL(fft_columns), .rows = KERNEL(fft_rows), .rows_back = KERNEL(fft_rows_back)},
};
