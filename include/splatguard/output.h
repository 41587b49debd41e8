/* SPDX-License-Identifier: Apache-2.0 */
/* Where a program may write: runs, attacks and the tool's commands ask here before they write.
 *
 * - No output lies in a scene's folder, or around something that is read.
 * - A folder is new, empty, or made by the same maker before.
 * - A file is new, or carries the mark of an earlier output.
 * - A folder has one owner at a time: FOLDER/.splatguard is locked while it is written to. The
 *   system drops the lock when the process ends, however it ends. */
#ifndef SPLATGUARD_OUTPUT_H
#define SPLATGUARD_OUTPUT_H

#include <stdbool.h>

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sg_output sg_output;

/* Makes the folder and locks it; the caller releases *out. maker: one word that the mark names,
 * "render". adds: to what it made there before, else the folder must be new or empty. inputs: up to
 * two places that are read, ends with NULL; or NULL. Errors: SG_ERR_INPUT for a place that is
 * in use, in a scene, around an input or holds what another made; SG_ERR_BUDGET. */
SG_API int sg_output_claim(sg_ctx *ctx, const char *folder, const char *maker, bool adds,
                           const char *const *inputs, sg_output **out);

/* Unlocks. Where nothing was written, what was made goes too. NULL-safe; sets *output to NULL. */
SG_API void sg_output_release(sg_output **output);

/* SG_ERR_INPUT where no file can or may be written: without its folder, in a scene, or in place of
 * another's file. */
SG_API int sg_output_check_file(sg_ctx *ctx, const char *path);

/* In a folder that is claimed: SG_ERR_INPUT unless a PNG or page there carries the library's mark.
 */
SG_API int sg_output_check_replaced(sg_ctx *ctx, const char *path);

#ifdef __cplusplus
}
#endif

#endif
