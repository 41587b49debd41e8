/* SPDX-License-Identifier: Apache-2.0 */
/* One table per command: parsing, --help, the man page, docs/options.md and config.json all come
 * from it. */
#ifndef CLI_OPTIONS_H
#define CLI_OPTIONS_H

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "core/json_text.h"

/* Prints what may quote files or options: control characters other than line ends become "?". */
__attribute__((format(printf, 2, 3))) void say(FILE *to, const char *format, ...);

enum option_type {
    OPT_FLAG,
    OPT_INT,
    OPT_U64,
    OPT_BYTES,
    OPT_FLOAT,
    OPT_DOUBLE,
    OPT_TIME,
    OPT_STRING,
    OPT_CHOICE,
    OPT_GROUP
};

struct option {
    const char *name;  /* without dashes in front; underscores are accepted for its dashes.
                          OPT_GROUP: a heading */
    const char *alias; /* an older name that is still accepted, or NULL */
    char letter;       /* short form or 0 */
    enum option_type type;
    size_t offset;       /* of the value in the command's config */
    double low, high;    /* allowed range of numbers */
    bool nonzero;        /* 0 is not in it */
    const char *choices; /* OPT_CHOICE: "auto|blender|..."; the value is an int index */
    const char
        *words; /* OPT_FLOAT: NULL, or what else it may be: "auto|preset" stand for -1 and -2 */
    const char *argument; /* shown in --help, NULL for flags */
    const char *help;
    bool transient; /* not part of a run: left out of config.json, allowed when resuming */
};

/* Rows of a table; after the help text other fields may follow: .letter = 'o', .transient =
 * true. */
#define GROUP_ROW(title)                                                                           \
    {                                                                                              \
        .name = title, .type = OPT_GROUP                                                           \
    }
#define FLAG_ROW(name_, at, help_, ...)                                                            \
    {                                                                                              \
        .name = name_, .type = OPT_FLAG, .offset = at, .help = help_, __VA_ARGS__                  \
    }
#define TEXT_ROW(name_, at, argument_, help_, ...)                                                 \
    {                                                                                              \
        .name = name_, .type = OPT_STRING, .offset = at, .argument = argument_, .help = help_,     \
        __VA_ARGS__                                                                                \
    }
#define CHOICE_ROW(name_, at, choices_, argument_, help_, ...)                                     \
    {                                                                                              \
        .name = name_, .type = OPT_CHOICE, .offset = at, .choices = choices_,                      \
        .argument = argument_, .help = help_, __VA_ARGS__                                          \
    }
#define NUMBER_ROW(name_, type_, at, low_, high_, argument_, help_, ...)                           \
    {                                                                                              \
        .name = name_, .type = type_, .offset = at, .low = low_, .high = high_,                    \
        .argument = argument_, .help = help_, __VA_ARGS__                                          \
    }

struct command {
    const char *name, *arguments, *summary, *description;
    const struct option *options; /* ends with a NULL name */
    size_t config_size;
    const void *defaults;
    int min_positional, max_positional;
    /* given: one bool per table entry, set where the command line has the option. Returns an exit
     * code. */
    int (*run)(const void *config, const bool *given, const char *const *positional, int count);
};

#define OPTIONS_MAX_POSITIONAL 64

/* Fills config (defaults first) and positional. Returns 0, or 1 after printing what is wrong, or -1
 * if --help was printed. given: one bool per table entry, set where the command line has it. */
int options_parse(const struct command *c, int argc, char **argv, void *config,
                  const char **positional, int *count, bool *given);

/* Sets one option from text. Returns 0 or 1 after printing what is wrong. */
int options_set(const struct command *c, const struct option *o, void *config, const char *text);

/* How many letters differ between a word of n bytes and a name; dashes and underscores are the
 * same. */
size_t name_distance(const char *word, size_t n, const char *name);

/* For JSON: a number that is not finite becomes null. */
json_t *number_json(double v);

/* All lasting options as a JSON object, and back (unknown keys are refused by name). Strings set
 * from JSON live as long as the object. */
json_t *options_to_json(const struct command *c, const void *config);
int options_from_json(const struct command *c, void *config, const json_t *object,
                      const char *path);

/* Takes the options of one group of the table that the command line did not give from a run's
 * options. */
int options_adopt(const struct command *c, const char *group, const bool *given, void *config,
                  const json_t *object, const char *path);

/* v as config.json keeps it, so that a resumed run has the same number. */
double options_number(double v);

bool options_given(const struct command *c, const bool *given, size_t offset);
size_t options_count(const struct command *c);

/* Refuses lasting options of the command line that differ from those of the run being continued. */
int options_conflict(const struct command *c, const bool *given, const void *config,
                     const void *run);

/* The value as text; returns false if there is nothing to show: flags, unset names. */
bool options_show(const struct option *o, const void *config, char *text, size_t size);

void options_help(const struct command *c, FILE *out);
void options_markdown(const struct command *c, FILE *out);
void options_man(const struct command *c, FILE *out);

/* Text with what roff would take for a command escaped. */
void options_roff(FILE *out, const char *text);

#endif
