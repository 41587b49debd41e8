/* SPDX-License-Identifier: Apache-2.0 */
/* The options of a command: the library's tables of its parameters and rows of its own. Parsing,
 * --help, the man page and docs/options.md all come from them. */
#ifndef CLI_OPTIONS_H
#define CLI_OPTIONS_H

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "splatguard/option.h"

/* Prints what may quote files or options: control characters other than line ends become "?". */
__attribute__((format(printf, 2, 3))) void say(FILE *to, const char *format, ...);

/* A command's own rows; after the help text other members may follow. */
#define FLAG_ROW(name_, at, help_, ...)                                                            \
    {                                                                                              \
        .name = name_, .type = SG_OPTION_FLAG, .offset = at, .help = help_, __VA_ARGS__            \
    }
#define TEXT_ROW(name_, at, unit_, help_, ...)                                                     \
    {                                                                                              \
        .name = name_, .type = SG_OPTION_TEXT, .offset = at, .unit = unit_, .help = help_,         \
        __VA_ARGS__                                                                                \
    }
#define CHOICE_ROW(name_, at, choices_, unit_, help_, ...)                                         \
    {                                                                                              \
        .name = name_, .type = SG_OPTION_CHOICE, .offset = at, .choices = choices_, .unit = unit_, \
        .help = help_, __VA_ARGS__                                                                 \
    }
#define NUMBER_ROW(name_, type_, at, low_, high_, unit_, help_, ...)                               \
    {                                                                                              \
        .name = name_, .type = type_, .offset = at, .low = low_, .high = high_, .unit = unit_,     \
        .help = help_, __VA_ARGS__                                                                 \
    }

/* A table of the library, whose struct is at an offset of the config. */
struct option_part {
    const struct sg_option *(*rows)(void);
    size_t at;
    const char *without; /* rows to leave out, "one|two", or NULL */
};

/* An option of the reference that has another name here, or none. */
struct option_hint {
    const char *name, *text;
};

struct command {
    const char *name, *arguments, *summary, *description;
    const char *groups;              /* their order: "Run|Scene"; rows without a group come first */
    const struct sg_option *options; /* rows of its own, ends with a NULL name */
    const struct option_part *parts; /* ends with NULL rows; or NULL */
    const struct option_hint *hints; /* ends with a NULL name; or NULL */
    size_t config_size;
    void (*defaults)(void *config);
    int min_positional, max_positional;
    /* given: one bool for each option in the order of options_list, set where the command line has
     * it. Returns an exit code. */
    int (*run)(const void *config, const bool *given, const char *const *positional, int count);
};

#define OPTIONS_MAX_POSITIONAL 64
#define OPTIONS_MAX 160

struct option_place {
    const struct sg_option *row;
    size_t at; /* of its table's struct in the config */
};

/* All options of a command by groups; returns their number, at most OPTIONS_MAX. */
size_t options_list(const struct command *c, struct option_place list[OPTIONS_MAX]);

/* Fills config (defaults first) and positional. Returns 0, or STATUS_USAGE after printing what is
 * wrong, or -1 if --help was printed. */
int options_parse(const struct command *c, int argc, char **argv, void *config,
                  const char **positional, int *count, bool given[OPTIONS_MAX]);

/* The option of a word, --name, --name=value, -w or -w2, or NULL. text: the value in the word, or
 * NULL. near: the name that is most like it, or NULL. */
const struct sg_option *options_find(const struct command *c, const char *word, const char **text,
                                     const char **near);

/* How many letters differ between a word of n bytes and a name; dashes and underscores are the
 * same. */
size_t name_distance(const char *word, size_t n, const char *name);

/* Replaces control characters, and bytes that are not UTF-8, by "?". */
void make_printable(char *text);

/* A JSON string; of text that is not UTF-8, what is not ASCII becomes "?". */
json_t *text_json(const char *text);

/* Whether the name is one of the list "one|two", which may be NULL. */
bool is_in(const char *list, const char *name);

/* Warns of an option that was given and changes nothing. why: "with --save png". */
void warn_unused(const char *option, const char *why);

/* Why --max-vram changes nothing: these take no GPU. NULL where they may. */
const char *vram_unused(const char *engine, const char *cpu);

/* For JSON: a number that is not finite becomes null. */
json_t *number_json(double v);

/* Whether the command line has the option of the config's member at an offset. */
bool options_given(const struct command *c, const bool *given, size_t offset);
/* The name of one of a part's options that the command line has, or NULL. without: names that do
 * not count, "one|two", or NULL. */
const char *options_given_of(const struct command *c, const bool *given,
                             const struct option_part *part, const char *without);

/* Gives an option that the command line does not have a value, by its name. */
void options_preset(const struct command *c, const bool *given, void *config, const char *name,
                    const char *text);

/* The name of the option for a field that begins a message of the library, or NULL. */
const char *options_name(const struct command *c, const char *message);

/* Refuses lasting options of the command line that differ from those of the run being continued. */
int options_conflict(const struct command *c, const bool *given, const void *config,
                     const void *run);

/* everything: --help-all, else without what most users never need. */
void options_help(const struct command *c, bool everything, FILE *out);
void options_markdown(const struct command *c, FILE *out);
void options_man(const struct command *c, FILE *out);

/* Text with what roff would take for a command escaped. */
void options_roff(FILE *out, const char *text);

#endif
