/* SPDX-License-Identifier: Apache-2.0 */
/* The stages of an iteration of any engine, next to what its machine could do. */
#ifndef BENCH_STAGES_H
#define BENCH_STAGES_H

#include <stdbool.h>

#include "splatguard/splatguard.h"

struct stages_options {
    const char *engine, *cpu; /* as of struct sg_train_params */
    int rounds;
    bool defense;        /* its stages too */
    const char *without; /* parts that are left out, with commas between them, or NULL */
    bool parts, kernels; /* times without each part; times of kernels */
    const char *csv;     /* file to write, or NULL */
};

/* Exits with a message where the engine has nothing of that kind. */
void stages_check(sg_ctx *ctx, const struct stages_options *options);
/* Prints Markdown. Exits with a message where something fails. */
void stages_print(sg_ctx *ctx, const struct sg_model *model, const struct sg_view *view,
                  const struct stages_options *options);

#endif
