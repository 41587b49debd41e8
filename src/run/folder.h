/* SPDX-License-Identifier: Apache-2.0 */
/* A run's folder: the reference's layout (point_cloud/iteration_N/point_cloud.ply, cameras.json,
 * input.ply, cfg_args) plus config.json, summary.json, log.jsonl and checkpoint.bin. Every file but
 * the log appears whole. */
#ifndef SG_RUN_FOLDER_H
#define SG_RUN_FOLDER_H

#include "files.h"
#include "splatguard/run.h"

/* config.json: the version, the CPU variant and all lasting options. */
int sg_run_write_config(sg_ctx *ctx, const struct sg_run_params *p, const char *variant);

bool sg_run_is_run(sg_ctx *ctx, const char *folder); /* recognised by its config.json */

/* Creates the folder and writes what is known before training. Removes what an earlier run left. */
int sg_run_create_files(sg_ctx *ctx, const struct sg_run_params *p, const struct sg_scene *scene,
                        const struct sg_model *initial, const char *variant);

/* No model, no checkpoint and no summary: a run that failed or was killed before its first save. */
bool sg_run_is_lost(sg_ctx *ctx, const char *run);

/* Removes all that sg_run_create_files and a training without any save wrote, so that the same
 * call works again. */
void sg_run_remove_files(sg_ctx *ctx, const char *run);

/* Removes all files of a run. */
void sg_run_discard(const char *run);

/* Removes the unfinished files of killed processes. */
void sg_run_remove_temporary(const char *run);

/* The trainer's model as that of an iteration. Models of later ones go: they are of a run that was
 * continued from an earlier checkpoint. */
int sg_run_save_model(sg_ctx *ctx, const char *run, const struct sg_scene *scene,
                      sg_trainer *trainer, int iteration);
int sg_run_save_checkpoint(sg_ctx *ctx, const char *run, sg_trainer *trainer);

#endif
