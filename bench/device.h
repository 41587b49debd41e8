/* SPDX-License-Identifier: Apache-2.0 */
/* What the benchmark asks of an engine's device, below the interface of engines. */
#ifndef BENCH_DEVICE_H
#define BENCH_DEVICE_H

#include <stdbool.h>
#include <stdint.h>

#include "core/context.h"

struct sg_engine;

/* What a machine does at best. */
struct rates {
    double bytes;      /* read and written by copies, a second */
    double operations; /* multiply-adds of a lane that wait for nothing, a second */
    double dependent;  /* the same where each waits for the one before; 0: not measured */
    double dispatch;   /* seconds of a kernel that does nothing; 0: there are no dispatches */
};

/* Whether the engine has a device. The functions below are for such engines. */
bool device_has(const struct sg_engine *e);
/* Between iterations. Returns what an engine's functions return, as do the others. */
int device_rates(struct sg_engine *e, struct rates *out);
/* Kernels that were recorded so far. */
uint64_t device_dispatches(const struct sg_engine *e);

/* Parts of kernels that can be left out: "raster.pairs". */
struct device_part {
    const char *name;
    const char *stage; /* that it belongs to, as in stages.c */
};
int device_parts(const struct device_part **out);
/* Leaves out the parts whose bits are set, and no other, in the kernels that have run. */
int device_leave_out(struct sg_engine *e, unsigned parts);

/* From here on what each kernel takes is summed, and nothing of stages. */
int device_profile_begin(struct sg_engine *e);
/* Prints a row for each kernel: milliseconds in one of `iterations`. */
void device_profile_print(struct sg_engine *e, int iterations);

#endif
