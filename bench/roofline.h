/* SPDX-License-Identifier: Apache-2.0 */
#ifndef BENCH_ROOFLINE_H
#define BENCH_ROOFLINE_H

#include "engine/cpu/kernels.h"

/* What this machine does at best: read-modify-write streams of all threads, multiply-adds of one
 * core, and the raster kernels of one core on tiles where every lane of every pair works. */
struct roofline {
    double bandwidth;         /* bytes/s */
    double flops;             /* per second and core */
    double forward, backward; /* pairs/s and core */
};

struct roofline roofline_measure(sg_ctx *ctx, const struct cpu_kernels *kernels);

#endif
