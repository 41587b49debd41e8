/* SPDX-License-Identifier: Apache-2.0 */
/* Files of runs: untrusted JSON, and logs with one JSON object per line. */
#ifndef SG_RUN_FILES_H
#define SG_RUN_FILES_H

#include <jansson.h>
#include <stdio.h>

#include "core/context.h"

/* RUN/NAME exists. */
bool sg_run_has(sg_ctx *ctx, const char *run, const char *name);

/* SG_ERR_INPUT where RUN/NAME leads out of the run, whose links can be somebody else's. That there
 * is no run or no such file is no error: opening it reports that. */
int sg_run_check_inside(sg_ctx *ctx, const char *run, const char *name);

/* RUN/NAME, of at most so many bytes. *path: for messages. sg_free both, also after an error. */
int sg_run_read_file(sg_ctx *ctx, const char *run, const char *name, uint64_t most, char **path,
                     char **text, size_t *size);

/* The folder holds files that are not hidden. Some systems put hidden files everywhere. */
bool sg_run_has_files(const char *folder);

/* SG_ERR_BUDGET with its message, where another library could not allocate. */
int sg_no_memory(sg_ctx *ctx);

/* A number as JSON; null if it is not finite. */
json_t *sg_number_json(double v);

/* RUN/NAME as JSON; json_decref(*out). what: "config.json of a run", for messages. */
int sg_run_read_json(sg_ctx *ctx, const char *run, const char *name, const char *what,
                     json_t **out);
/* The same for a file of up to so many bytes. *room: what the values take, for the ledger; sg_free
 * after json_decref. */
int sg_run_read_large_json(sg_ctx *ctx, const char *run, const char *name, const char *what,
                           size_t bytes, void **room, json_t **out);
/* Indented. Releases the value. */
int sg_run_write_json(sg_ctx *ctx, const char *run, const char *name, json_t *value);

/* The key of a photo's map in exposure.json: its name, or for one that is not UTF-8 "/" and the
 * name with %XX for bytes; no name of a photo has a "/". NULL: SG_ERR_BUDGET. */
char *sg_run_exposure_key(sg_ctx *ctx, const char *name);

/* An absolute path, byte for byte. */
json_t *sg_place_json(const char *folder);

/* RUN/NAME is a config.json, or the like, of this library, with that option among its options. */
bool sg_run_has_option(sg_ctx *ctx, const char *run, const char *name, const char *option);

/* log.jsonl of a run or an attack. Gets every line that is JSON; whether to keep it. */
typedef bool (*sg_run_log_take)(void *arg, const json_t *line);

/* Sets what a line has of a view, see sg_engine_read_view, once that is known. wait: until it is.
 */
typedef int (*sg_run_log_fill)(void *arg, json_t *line, uint64_t view, bool wait, bool *known);

#define SG_RUN_LATE 4 /* lines */

struct sg_run_log {
    sg_ctx *ctx;
    FILE *stream;
    char *path;
    sg_run_log_fill fill;
    void *arg;
    struct sg_run_late {
        json_t *line;
        uint64_t view;
    } late[SG_RUN_LATE]; /* in order: their views are on their way */
    int late_count;
};

/* To append; take decides which lines of an earlier log stay. take NULL: a new log. arg: of both.
 */
int sg_run_log_open(sg_ctx *ctx, const char *run, const char *name, sg_run_log_take take,
                    sg_run_log_fill fill, void *arg, struct sg_run_log *log);
/* Writes and releases a line, after those that are late, for which it waits. */
int sg_run_log_line(struct sg_run_log *log, json_t *line);
/* A line with values of the newest view: sg_run_log_settle writes it when they have arrived. */
int sg_run_log_later(struct sg_run_log *log, json_t *line, uint64_t view);
/* For a sg_run_log_fill: sets the values, an object that it releases. NULL: there was no memory. */
int sg_run_log_set(const struct sg_run_log *log, json_t *line, json_t *values);
/* Writes the lines whose values have arrived. wait: all. After an error none are left. */
int sg_run_log_settle(struct sg_run_log *log, bool wait);
/* SG_ERR_INPUT if an earlier write failed. Safe on a zeroed log. */
int sg_run_log_close(struct sg_run_log *log);
/* Passes every line to take and ignores its result. Without a log there are no lines. */
int sg_run_log_read(sg_ctx *ctx, const char *path, sg_run_log_take take, void *arg);

/* After an error that says nothing of a run's state, such as the loss of a device: adds the name of
 * the checkpoint, and of its iteration, to the message. Returns the code. */
int sg_run_name_checkpoint(sg_ctx *ctx, int code, const char *folder, const char *name,
                           int iteration);

#endif
