/* SPDX-License-Identifier: Apache-2.0 */
/* A run's folder: the reference's layout (point_cloud/iteration_N/point_cloud.ply, cameras.json,
 * input.ply, cfg_args) plus config.json, summary.json, log.jsonl and checkpoint.bin. Every file but
 * the log appears whole. */
#ifndef CLI_RUN_FOLDER_H
#define CLI_RUN_FOLDER_H

#include "train_config.h"

/* Paths are RUN/name; the caller frees. */
char *run_path(const char *run, const char *name);

/* Whether RUN/name is there. */
bool run_has(const char *run, const char *name);

/* Says so, with errno; returns the exit code 2. */
int run_cannot(const char *what, const char *path);

/* Writes JSON, indented. Returns an exit code after printing what is wrong. */
int run_write_json(const char *path, const json_t *value);

/* A run may come from a stranger. To read: only a file, and of at most so many bytes; NULL with
 * errno. */
FILE *run_open(const char *path, uint64_t most);
/* NULL after saying what was expected there, "the config.json of a run". */
json_t *run_read_json(const char *path, const char *what);
/* An absolute path, byte for byte. */
json_t *run_place_json(const char *folder);

/* The folder holds files that are not hidden. */
bool run_has_other_files(const char *folder);

/* To a temporary name, synced, then renamed. */
int run_write_file(const char *path, const char *text, size_t size);

/* config.json: the version, the CPU variant and all lasting options. */
int run_write_config(const struct train_config *c, const char *variant);

/* FOLDER/NAME is a config.json, or the like, of this tool, with that option among its options. */
bool run_options_in(const char *folder, const char *name, const char *option);
bool run_is_ours(const char *folder); /* made by `splatguard train` */

/* Creates the folder and writes what is known before training. What an earlier run
 * left goes. */
int run_create(sg_ctx *ctx, const struct train_config *c, const struct sg_scene *scene,
               const struct sg_model *initial, const char *variant);

/* No model, no checkpoint and no summary: a run that failed or was killed before its first save. */
bool run_is_lost(const char *run);

/* Removes all that run_create and a training without any save wrote, so that the same command works
 * again. */
void run_forget(const char *run);

/* Removes what killed processes were writing. */
void run_clean(const char *run);

/* Model and checkpoint of the trainer's present iteration. */
int run_save_model(sg_ctx *ctx, const char *run, sg_trainer *trainer);
int run_save_checkpoint(sg_ctx *ctx, const char *run, sg_trainer *trainer);

/* Reads RUN/config.json into p; *keep owns the strings. Returns an exit code. */
int run_read_config(sg_ctx *ctx, const char *run, struct sg_run_params *p, json_t **keep);

#endif
