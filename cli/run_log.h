/* SPDX-License-Identifier: Apache-2.0 */
/* log.jsonl of a run or an attack: a line of JSON each time. Functions return an exit code after
 * printing what is
 * wrong. */
#ifndef CLI_RUN_LOG_H
#define CLI_RUN_LOG_H

#include <jansson.h>
#include <stdbool.h>
#include <stdio.h>

/* Gets every line that is JSON. Whether to keep it. */
typedef bool (*run_log_take)(void *arg, const json_t *line);

/* To append; take and its arg decide which lines of an earlier log stay. take NULL: a new log. */
int run_log_open(const char *path, run_log_take take, void *arg, FILE **log);

/* Writes and releases a line. path: for messages. */
int run_log_line(FILE *log, const char *path, json_t *line);

/* Shows every line to take, whose answer does not matter. No log: no lines. */
int run_log_read(const char *path, run_log_take take, void *arg);

#endif
