/* SPDX-License-Identifier: Apache-2.0 */
/* Rows of the tables of options, and their checks. */
#ifndef SG_OPTION_OPTION_H
#define SG_OPTION_OPTION_H

#include "core/context.h"
#include "splatguard/engine.h"
#include "splatguard/option.h"

/* A row of a table of STRUCT, a macro of the file. Other members may follow the help text. */
#define SG_FLAG(name_, field_, help_, ...)                                                         \
    {                                                                                              \
        .name = name_, .field = #field_, .type = SG_OPTION_FLAG,                                   \
        .offset = offsetof(STRUCT, field_), .help = help_, __VA_ARGS__                             \
    }
#define SG_TEXT(name_, field_, unit_, help_, ...)                                                  \
    {                                                                                              \
        .name = name_, .field = #field_, .type = SG_OPTION_TEXT,                                   \
        .offset = offsetof(STRUCT, field_), .unit = unit_, .help = help_, __VA_ARGS__              \
    }
#define SG_CHOICE(name_, field_, choices_, unit_, help_, ...)                                      \
    {                                                                                              \
        .name = name_, .field = #field_, .type = SG_OPTION_CHOICE,                                 \
        .offset = offsetof(STRUCT, field_), .choices = choices_, .unit = unit_, .help = help_,     \
        __VA_ARGS__                                                                                \
    }
#define SG_SWITCH(name_, field_, choices_, unit_, help_, ...)                                      \
    {                                                                                              \
        .name = name_, .field = #field_, .type = SG_OPTION_SWITCH,                                 \
        .offset = offsetof(STRUCT, field_), .choices = choices_, .unit = unit_, .help = help_,     \
        __VA_ARGS__                                                                                \
    }
#define SG_NUMBER(type_, name_, field_, low_, high_, unit_, help_, ...)                            \
    {                                                                                              \
        .name = name_, .field = #field_, .type = type_, .offset = offsetof(STRUCT, field_),        \
        .low = low_, .high = high_, .unit = unit_, .help = help_, __VA_ARGS__                      \
    }

/* Of training and rendering alike. */
#define SG_OPTION_ENGINE(...)                                                                      \
    SG_TEXT("engine", engine, "NAME", SG_ENGINE_HELP, .choices = SG_ENGINE_CHOICES,                \
            .alias = "backend", __VA_ARGS__)
#define SG_OPTION_CPU(...)                                                                         \
    SG_TEXT("cpu", cpu, "VARIANT",                                                                 \
            "Instruction set: baseline, avx2, avx512 or neon; the best by default (or SG_CPU).",   \
            __VA_ARGS__)

/* SG_ERR_USAGE for the first number or choice of *params that is out of range; the message begins
 * with its field. Words that a run replaces are out of range. */
int sg_check_options(sg_ctx *ctx, const struct sg_option *options, const void *params);

/* Which of "one|two|three" a text is, or -1. */
int sg_word_index(const char *list, const char *text);

/* A double as config.json keeps it, with 15 digits: a resumed run has the same number. */
double sg_round_digits(double v);

#endif
