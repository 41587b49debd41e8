/* SPDX-License-Identifier: Apache-2.0 */
/* Parameters of runs as the "options" of config.json. */
#ifndef SG_RUN_CONFIG_H
#define SG_RUN_CONFIG_H

#include <jansson.h>

#include "core/context.h"
#include "splatguard/option.h"

/* A table whose struct is at an offset of the run's params. */
struct sg_config_part {
    const struct sg_option *(*rows)(void);
    size_t at;
    const char *without; /* rows to leave out, "one|two", or NULL */
};

/* End with NULL rows. */
extern const struct sg_config_part sg_run_config[], sg_attack_run_config[];

/* Rounds doubles to what JSON files keep of them, so that what is resumed has the same numbers. */
void sg_config_round(const struct sg_config_part *parts, void *params);

/* All lasting options; the caller owns the object. NULL without memory. */
json_t *sg_config_to_json(const struct sg_config_part *parts, const void *params);

/* SG_ERR_USAGE for a number that the library accepts and JSON cannot carry. */
int sg_config_check(sg_ctx *ctx, const struct sg_config_part *parts, const void *params);

/* The reverse. Options that the object lacks are left unchanged. Texts live as long as the object.
 * path: of the file, for messages. SG_ERR_INPUT for values out of range and, if strict, unknown
 * options. */
int sg_config_from_json(sg_ctx *ctx, const struct sg_config_part *parts, void *params,
                        const json_t *object, bool strict, const char *path);

#endif
