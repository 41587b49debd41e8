/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_RUN_OUTPUT_H
#define SG_RUN_OUTPUT_H

#include "core/context.h"
#include "splatguard/output.h"

#define SG_OUTPUT_MARK ".splatguard" /* in a folder: who made it */

struct sg_output_rules {
    const char *maker;   /* the mark names it */
    const char *earlier; /* what is continued or replaced, "run"; NULL: there is no such thing */
    bool adds;           /* to a folder that it made before */
    /* Whether the maker made it, regardless of its mark; NULL: the mark decides. */
    bool (*is_own)(sg_ctx *ctx, const char *folder);
    /* Whether nothing in it is worth keeping, so that it may be replaced without asking; NULL:
     * never. */
    bool (*is_lost)(sg_ctx *ctx, const char *folder);
    const char *within; /* what is written below it: no folder on the way may be a link; or NULL */
    bool makes_scenes;  /* a scene in the folder may be the maker's own */
    bool replace, resume;
    bool nested;           /* inside the output of a maker that holds the lock already */
    const char *inputs[3]; /* what is read, NULL at the end */
};

int sg_output_claim_by(sg_ctx *ctx, const char *folder, const struct sg_output_rules *rules,
                       sg_output **out);

#endif
