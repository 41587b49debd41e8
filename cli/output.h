/* SPDX-License-Identifier: Apache-2.0 */
/* What the tool may write, and where: every command asks here before it writes a file.
 *
 * - No output lies in a scene's folder, or around something that the command reads.
 * - A folder is new, empty, or made by the same command before.
 * - A file is new, or carries the mark of an earlier output of the tool.
 * - A folder has one owner at a time: FOLDER/.splatguard is locked while a command writes there.
 * The system drops the lock when the process ends, however it ends. */
#ifndef CLI_OUTPUT_H
#define CLI_OUTPUT_H

#include "commands.h"

struct output_rules {
    const char *command; /* "train": the mark names it */
    const char *earlier; /* what --resume continues and --force replaces, "run"; NULL: there is no
                            such thing */
    bool adds;           /* to a folder that it made before */
    /* Made by the command, whatever its mark says; NULL: the mark alone tells. */
    bool (*is_own)(const char *folder);
    /* Nothing in what it made is worth keeping: replaced without --force; NULL: never so. */
    bool (*is_lost)(const char *folder);
    const char *within; /* what is written below it: no folder on the way may be a link; or NULL */
    bool makes_scenes;  /* a scene in the folder may be the command's own */
    bool force, resume;
    bool nested;           /* in the output of a command that has asked for itself */
    const char *inputs[3]; /* what is read, NULL at the end */
};

struct output {
    char *folder, *mark;
    const char *command;
    int lock;    /* descriptor, -1 = not ours */
    size_t made; /* length of the first folder that was made on the way, 0 = none */
};
#define OUTPUT_NONE                                                                                \
    {                                                                                              \
        .lock = -1                                                                                 \
    }

/* Makes the folder and locks it. Returns an exit code after printing what is wrong. */
int output_claim(struct output *o, sg_ctx *ctx, const char *folder,
                 const struct output_rules *rules);

/* Where nothing was written, what was made goes too. Safe if nothing was claimed. */
void output_release(struct output *o);

/* Whether a file may be written there. Returns an exit code after printing what is wrong. */
int output_check_file(sg_ctx *ctx, const char *path);

/* In a folder that is claimed: a PNG or page there must be one that the tool made. */
int output_check_replaced(const char *path);

#endif
