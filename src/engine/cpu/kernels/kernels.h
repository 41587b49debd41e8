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

void KERNEL(project)(const struct cpu_project_args *, size_t, size_t);
uint64_t KERNEL(raster)(const struct cpu_raster_args *, int);
uint64_t KERNEL(raster_backward)(const struct cpu_raster_args *, int);
uint64_t KERNEL(raster_count)(const struct cpu_raster_args *, int);
void KERNEL(update)(const struct cpu_update_args *, size_t, size_t);
void KERNEL(loss)(const struct cpu_loss_args *, int, int, int, float *);
void KERNEL(ascend)(const struct sg_ascend *, size_t);
void KERNEL(fft_columns)(const struct sg_fft *, const float *, float *, bool, float *);
void KERNEL(fft_rows)(const struct sg_fft *, const struct sg_fft_rows *, const float *const *, float *);
void KERNEL(fft_rows_back)(const struct sg_fft *, const struct sg_fft_rows *, float *const *, float, float *);

#endif
