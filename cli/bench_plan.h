/* SPDX-License-Identifier: Apache-2.0 */
/* Inside `splatguard bench`: a plan file while it is read. */
#ifndef CLI_BENCH_PLAN_H
#define CLI_BENCH_PLAN_H

#include "bench.h"

#define DEFENSES "defenses" /* the plan's table */

/* A plan that is read. */
struct reader {
    struct plan *plan;
    const char *path, *data;
    int shard, shards, capacity;
    json_t *scenes;      /* the job of each, by its name */
    json_t *parts;       /* scenes and photos: the shard of each */
    int poisons, cleans; /* among them */
    bool follows_links;  /* some options have --follow-links */
    int code;            /* why a job could not be added, which has been said */
};

/* Says what is wrong with the plan. Returns STATUS_INPUT. */
__attribute__((format(printf, 2, 3))) int plan_wrong(const struct reader *r, const char *format,
                                                     ...);

/* object.a.b, or NULL. */
const json_t *plan_at(const json_t *object, const char *a, const char *b);
/* A list of options of a scene: "size", "options", "train" or "attack". */
const json_t *plan_scene_options(const struct reader *r, const char *scene, const char *list);
/* Whether the plan has true for "pictures", "audit" or "alone". */
bool plan_is_on(const struct reader *r, const char *what);

/* Whether a word of a list of options is an option, not a value. */
bool is_option(const char *word);

/* Checks that an option of the command, the word "--name", takes the scene's preset. Returns an
 * exit code. */
int plan_check_preset(const struct reader *r, const char *scene, const struct command *command,
                      const char *word, const char *preset);

/* Loops over a list of names of a block of runs, and one of them. */
#define EACH(i, list) for (size_t i = 0; i < json_array_size(json_object_get(block, list)); i++)
#define NAME(i, list) json_string_value(json_array_get(json_object_get(block, list), i))

/* Checks the whole plan, but for files that it names. Fills its settings. From then on each option
 * of its lists is in its only form: "--backend=ref" is "--engine" and "ref". Returns an exit code.
 */
int plan_check(const struct reader *r);

#endif
