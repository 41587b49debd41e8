/* SPDX-License-Identifier: Apache-2.0 */
/* The engines that tests run on: the oracle and every variant of the CPU engine that this machine
 * runs. */
#ifndef TESTS_VARIANTS_H
#define TESTS_VARIANTS_H

#include "engine/cpu/dispatch.h"

static const char *variant_names[5]; /* of the CPU engine; NULL: the oracle */
static int variant_count;

/* A group's setup. */
static int find_variants(void **state)
{
    (void) state;
    const struct cpu_kernels *variants[4];
    variant_count = sg_cpu_variants(variants);
    for (int i = 0; i < variant_count; i++)
        variant_names[i] = variants[i]->name;
    variant_names[variant_count++] = NULL;
    return 0;
}

/* The engine of a variant. */
static inline const char *engine_name(int variant)
{
    return variant_names[variant] ? "cpu" : "ref";
}

#endif
