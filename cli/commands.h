/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_COMMANDS_H
#define CLI_COMMANDS_H

#include <sys/types.h>

#include "exit_status.h"
#include "options.h"
#include "splatguard/splatguard.h"

extern const struct command command_train, command_eval, command_render, command_synth,
    command_info, command_attack, command_compare, command_spectrum, command_audit, command_prune,
    command_smooth, command_bench, command_report, command_convert, command_view, command_export;

/* For every command that reads untrusted files. */
#define MEMORY_ROW(config, field, ...)                                                             \
    NUMBER_ROW("max-memory", SG_OPTION_BYTES, offsetof(config, field), 0, 9e15, "BYTES",           \
               "Most memory of the process; 0 = no limit.", __VA_ARGS__)
/* For those of them that have an engine. */
#define VRAM_ROW(config, field, ...)                                                               \
    NUMBER_ROW("max-vram", SG_OPTION_BYTES, offsetof(config, field), 0, 9e15, "BYTES",             \
               "Most memory of the device; 0 = nine tenths of what is free.", __VA_ARGS__)

/* The scene that a command line names by its place, unless another option names one too. Returns an
 * exit code. */
int take_scene(const struct command *c, const char *place, const char **source);

/* For a command that takes one place and goes on by --resume: the command line has two. Returns an
 * exit code. */
int refuse_second(const struct command *c, bool resume, const char *const *positional);

/* Of a scene that only the run names, if it does: if it is not there, hints at the option. */
void say_moved(const char *scene);

/* Prints the command that continues an interrupted run. */
void say_resume(const char *command, const char *folder);

/* Text as one word of a shell; the short form has no quotes where none are needed. */
void put_word(FILE *to, const char *text);
void put_short_word(FILE *to, const char *text);

/* A text as a cell of comma-separated values. Spreadsheets compute what begins like a formula: a
 * quote before it makes it a text. */
void put_csv_text(FILE *f, const char *text);

/* The path of this program, for commands that start it again. Returns an exit code. */
int own_program(const struct command *c, char *path, size_t size);

/* Says what the command line lacks, and the usage; returns the exit code 1. */
int missing(const struct command *c, const char *what);

/* --iteration belongs to runs. Returns an exit code. */
int check_iteration(const struct command *c, const char *model, int iteration);

/* The format of a model to write: by the file's ending, unless another is given. Refuses one that
 * is only read. To be called before anything takes its time. Returns an exit code. */
int choose_format(const struct command *c, const char *out, enum sg_model_format *format);

/* Says that the command itself could not allocate something small; returns the exit code 3. */
int no_memory(void);

/* Writes what is printed so far. Output that cannot be written is a failure too: it is said once,
 * but not of a pipe without a reader, as behind `| head`. Returns the code, or another where that
 * is 0.
 */
int flush_output(int code);

/* Prints and releases a value, on one line or indented. Returns an exit code. */
int json_print(json_t *value, int indent);
json_t *numbers_json(const double *values, int n);

bool is_folder(const char *path);
/* The folder that a path is in, with a slash at its end; false where it has no room. */
bool folder_of(const char *path, char *out, size_t size);
/* Whether a path is in the folder or is the folder. Both are absolute and without links. */
bool is_below(const char *path, const char *folder);
bool is_run_folder(const char *path); /* by the files in it */
/* A folder that is no run, or an archive, by its ending .zip: models are archives too. */
bool is_scene(const char *path);
/* By number: the training views, then the test views. */
const struct sg_view *scene_view(const struct sg_scene *scene, size_t i);

/* The same file or folder under any name. */
bool is_same(const char *a, const char *b);

/* Prints the last error; returns its exit code. */
int report(const sg_ctx *ctx, int error);

/* Bytes of a process, 0 = this one, that are in memory now; 0 where the system does not say. */
uint64_t resident_bytes(pid_t process);

/* On a clock that is never set. */
double clock_seconds(void);

/* Explains how --max-memory relates to the limit in a message. */
void say_limit(const char *message);

/* The same as report for a check of parameters, whose error names the field of an option. */
int report_option(const sg_ctx *ctx, const struct command *command, int error);

/* The same for what is done with a model that is read: the path replaces its word for it. */
int report_model(const sg_ctx *ctx, const char *path, int error);

/* While it is held, nothing is logged. */
void hold_log(bool hold);

/* A context that logs warnings to stderr (info too unless quiet). Returns an exit code. */
int open_context(sg_ctx **ctx, int threads, uint64_t max_memory, bool quiet);
/* The same, and a limit on the memory of a device. */
int open_engine_context(sg_ctx **ctx, int threads, uint64_t max_memory, uint64_t max_vram,
                        bool quiet);

/* --cpu, else SG_CPU, else NULL. */
const char *cpu_variant(const char *option);

#endif
