/* SPDX-License-Identifier: Apache-2.0 */
/* The members of parameter structs as data. Command lines, configuration files, help and bindings
 * can be made from these tables; the library checks ranges by the same rows. */
#ifndef SPLATGUARD_OPTION_H
#define SPLATGUARD_OPTION_H

#include <stdbool.h>
#include <stddef.h>

#include "version.h"

#ifdef __cplusplus
extern "C" {
#endif

enum sg_option_type {
    SG_OPTION_FLAG,   /* bool */
    SG_OPTION_INT,    /* int */
    SG_OPTION_U64,    /* uint64_t */
    SG_OPTION_BYTES,  /* uint64_t; as text also 1500M, 1.5G, 500MB */
    SG_OPTION_FLOAT,  /* float */
    SG_OPTION_DOUBLE, /* double */
    SG_OPTION_TIME,   /* double, seconds; as text also 90s, 1h30m */
    SG_OPTION_LEVELS, /* float, 1/255 for each grey level; as text a number of grey levels */
    SG_OPTION_TEXT,   /* const char *, or NULL where nothing is set */
    SG_OPTION_CHOICE, /* int or enum: the index of a word in `choices` */
    SG_OPTION_SWITCH  /* bool: the same of two words */
};

struct sg_option {
    const char *name;  /* of command lines and config.json: "densify-grad-threshold" */
    const char *field; /* of the struct: "densify_grad_threshold", "defense.rho" */
    const char *group; /* heading to list it under */
    enum sg_option_type type;
    size_t offset;       /* of the field in the struct */
    double low, high;    /* range of numbers, of SG_OPTION_LEVELS in grey levels */
    bool or_zero;        /* 0 is allowed too, though it is not in the range */
    bool nonzero;        /* 0 is not allowed, though it is in the range */
    bool whole;          /* SG_OPTION_LEVELS: whole numbers, or "inf" for no bound */
    bool any;            /* the library accepts every value; the range is what JSON can carry */
    const char *choices; /* "std|eigen": the words of choices and switches, and of some texts */
    /* NULL, or "auto|preset": words for values that a run replaces by others when it begins. The
     * first stands for first_word, each other for 1 less than the one before. */
    const char *words;
    bool numbered; /* texts may have the numbers of the words too, which the help names */
    /* NULL, or the word for a number below 0: with "growth", the text "growth:0.3" is -0.3. */
    const char *negative;
    double first_word;
    const char *unit;  /* what help shows as the value: "N", "LEVELS"; NULL for flags */
    const char *help;  /* one or two sentences */
    const char *alias; /* an older name that is still read, or NULL */
    char letter;       /* one-letter name, or 0 */
    bool expert;       /* most users never need it */
    bool transient;    /* of one process: not kept in config.json, may change in a resumed run */
};

/* Tables end with a row whose name is NULL. They and their texts are static. */
SG_API const struct sg_option *sg_train_options(void);  /* of struct sg_train_params */
SG_API const struct sg_option *sg_attack_options(void); /* of struct sg_attack_params */
SG_API const struct sg_option *sg_scene_options(void);  /* of struct sg_scene_params */
SG_API const struct sg_option *sg_synth_options(void);  /* of struct sg_synth_params */
SG_API const struct sg_option *sg_render_options(void); /* of struct sg_render_params */

/* The row with this name or alias, in which "-" and "_" are the same; NULL without one. */
SG_API const struct sg_option *sg_option_find(const struct sg_option *options, const char *name);

/* Sets a field of *params from text, of a flag "true" or "false". Texts are not copied: they must
 * live as long as *params is used. Returns false for what is not allowed and leaves the field as it
 * was; `expected` then holds "a number from 0 to 1" or the like. expected: size bytes, or NULL. */
SG_API bool sg_option_set(const struct sg_option *option, void *params, const char *text,
                          char *expected, size_t size);

/* The field as text that sg_option_set reads back to the same value, but for doubles, of which both
 * keep 15 digits. Returns false, and leaves an empty text, for a text field that is NULL. */
SG_API bool sg_option_get(const struct sg_option *option, const void *params, char *text,
                          size_t size);

/* Copies the field from one struct to another of its kind. */
SG_API void sg_option_copy(const struct sg_option *option, void *to, const void *from);

#ifdef __cplusplus
}
#endif

#endif
