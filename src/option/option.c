/* SPDX-License-Identifier: Apache-2.0 */
#include "option.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/numbers.h"
#include "quantities.h"

#define LEVELS 255.0

const struct sg_option *sg_option_find(const struct sg_option *options, const char *name)
{
    for (const struct sg_option *o = options; o->name; o++)
        for (int k = 0; k < 2; k++) {
            const char *a = name, *b = k ? o->alias : o->name;
            while (b && *a && (*a == '_' ? '-' : *a) == *b)
                a++, b++;
            if (b && !*a && !*b)
                return o;
        }
    return NULL;
}

int sg_word_index(const char *list, const char *text)
{
    for (int i = 0; list && *list; i++) {
        const size_t n = strcspn(list, "|");
        if (strlen(text) == n && !memcmp(list, text, n))
            return i;
        list += n + (list[n] == '|');
    }
    return -1;
}

/* The i-th of them. */
static void copy_word(const char *list, int i, char *text, size_t size)
{
    for (; i > 0; i--)
        list += strcspn(list, "|") + 1;
    snprintf(text, size, "%.*s", (int) strcspn(list, "|"), list);
}

static int count_words(const char *list)
{
    int n = list ? 1 : 0;
    for (; list && *list; list++)
        n += *list == '|';
    return n;
}

double sg_round_digits(double v)
{
    char text[32];
    const locale_t before = uselocale(sg_c_locale());
    snprintf(text, sizeof(text), "%.15g", v);
    uselocale(before);
    return sg_strtod(text, NULL);
}

static double number_of(const struct sg_option *o, const void *params)
{
    const void *value = (const char *) params + o->offset;
    switch (o->type) {
    case SG_OPTION_INT:
    case SG_OPTION_CHOICE:
        return *(const int *) value;
    case SG_OPTION_U64:
    case SG_OPTION_BYTES:
        return (double) *(const uint64_t *) value;
    case SG_OPTION_FLOAT:
    case SG_OPTION_LEVELS:
        return (double) *(const float *) value;
    default:
        return *(const double *) value;
    }
}

static bool is_number(const struct sg_option *o)
{
    return o->type != SG_OPTION_FLAG && o->type != SG_OPTION_SWITCH && o->type != SG_OPTION_TEXT &&
           o->type != SG_OPTION_CHOICE;
}

/* As the field has it. */
static double rounded(const struct sg_option *o, double v)
{
    return o->type == SG_OPTION_FLOAT || o->type == SG_OPTION_LEVELS ? (double) (float) v : v;
}

static bool in_range(const struct sg_option *o, double value)
{
    const double v = rounded(o, value);
    return (v >= rounded(o, o->low) && v <= rounded(o, o->high) && !(o->nonzero && v == 0)) ||
           (o->or_zero && v == 0);
}

/* Exceptions of a range, for messages. */
static const char *exception(const struct sg_option *o)
{
    return o->or_zero ? ", or 0" : o->nonzero ? ", but not 0" : "";
}

/* Which of the words a value stands for, or -1. */
static int word_of(const struct sg_option *o, double v)
{
    const double i = o->first_word - v;
    return o->words && i >= 0 && i < count_words(o->words) && i == floor(i) ? (int) i : -1;
}

/* Whether a number in a text is one that is allowed. */
static bool is_allowed(const struct sg_option *o, double v)
{
    return in_range(o, v) || (o->numbered && word_of(o, v) >= 0);
}

/* A range, and the words that stand for more. */
static void describe_range(const struct sg_option *o, char *text, size_t size)
{
    const bool whole = o->type == SG_OPTION_INT || o->type == SG_OPTION_U64;
    const int n = snprintf(
        text, size, whole ? "a whole number from %.0f to %.0f%s" : "a number from %g to %g%s",
        o->low, o->high, exception(o));
    if (o->words && n >= 0 && (size_t) n < size)
        snprintf(text + n, size - (size_t) n,
                 strchr(o->words, '|') ? " or one of %s" : " or \"%s\"", o->words);
}

/* What is expected of a number in a text, or of a field. */
static void describe(const struct sg_option *o, char *text, size_t size)
{
    const locale_t before = uselocale(sg_c_locale());
    switch (o->type) {
    case SG_OPTION_FLAG:
        snprintf(text, size, "true or false");
        break;
    case SG_OPTION_TEXT:
    case SG_OPTION_CHOICE:
    case SG_OPTION_SWITCH:
        snprintf(text, size, o->choices ? "one of %s" : "a name", o->choices);
        break;
    case SG_OPTION_BYTES:
        snprintf(text, size, "a size from %.0f to %.0f bytes, such as 500MB, 1.5G or 2GiB", o->low,
                 o->high);
        break;
    case SG_OPTION_TIME:
        snprintf(text, size, "a time from %g to %g seconds, such as 90s, 1h30m or 1d", o->low,
                 o->high);
        break;
    case SG_OPTION_LEVELS:
        snprintf(text, size,
                 o->whole ? "a whole number of grey levels, %g to %g, or inf"
                          : "a number from %g to %g",
                 o->low, o->high);
        break;
    default:
        if (o->negative)
            snprintf(text, size, "a number from 0 to %g, %s:X with X up to %g, or %s", o->high,
                     o->negative, -o->low, o->words);
        else
            describe_range(o, text, size);
    }
    uselocale(before);
}

/* The number in a text, without regard to the range. */
static bool read_number(const struct sg_option *o, const char *text, double *v)
{
    char *end;
    if (o->type == SG_OPTION_TIME)
        return sg_quantity_seconds(text, v);
    const size_t word = o->negative ? strlen(o->negative) : 0;
    const bool negative = word && !strncmp(text, o->negative, word) && text[word] == ':';
    text += negative ? word + 1 : 0;
    errno = 0;
    *v = sg_strtod(text, &end);
    const bool overflow = errno == ERANGE && isinf(*v); /* 1e999 does not mean inf */
    if (end == text || *end || overflow || (negative && !(*v > 0 && -*v >= o->low)))
        return false;
    *v = negative ? -*v : *v;
    return true;
}

static bool set_real(const struct sg_option *o, void *value, const char *text)
{
    const int word = sg_word_index(o->words, text);
    double v = o->first_word - word;
    if (word < 0) {
        const bool known = read_number(o, text, &v);
        const bool unbound = o->whole && isinf(v) && v > 0;
        if (!known || !(is_allowed(o, v) || unbound) || (o->whole && !unbound && v != floor(v)))
            return false;
    }
    if (o->type == SG_OPTION_FLOAT)
        *(float *) value = (float) v;
    else if (o->type == SG_OPTION_LEVELS)
        *(float *) value = (float) (v / LEVELS);
    else
        *(double *) value = sg_round_digits(v);
    return true;
}

static bool set_whole(const struct sg_option *o, void *value, const char *text)
{
    char *end;
    uint64_t bytes = 0;
    errno = 0;
    if (o->type == SG_OPTION_BYTES) {
        if (!sg_quantity_bytes(text, &bytes) || !in_range(o, (double) bytes))
            return false;
        *(uint64_t *) value = bytes;
        return true;
    }
    const int word = sg_word_index(o->words, text);
    const long long v = word < 0 ? strtoll(text, &end, 10) : (long long) o->first_word - word;
    if (word < 0 && (end == text || *end || errno || !is_allowed(o, (double) v)))
        return false;
    if (o->type == SG_OPTION_INT)
        *(int *) value = (int) v;
    else
        *(uint64_t *) value = (uint64_t) v;
    return true;
}

/* A word "name[:MORE]" of the list stands for "name" and for "name:" with anything behind it. */
static bool is_listed(const char *list, const char *text)
{
    if (sg_word_index(list, text) >= 0)
        return true;
    const size_t name = strcspn(text, ":|");
    for (const char *word = list; word; word = strchr(word, '|')) {
        word += *word == '|';
        if (!strncmp(word, text, name) && word[name] == '[' &&
            (!text[name] || (text[name] == ':' && text[name + 1])))
            return true;
    }
    return false;
}

static bool set(const struct sg_option *o, void *value, const char *text)
{
    const int index = sg_word_index(o->choices, text);
    switch (o->type) {
    case SG_OPTION_FLAG:
        if (strcmp(text, "true") && strcmp(text, "false"))
            return false;
        *(bool *) value = text[0] == 't';
        return true;
    case SG_OPTION_TEXT:
        if (!text[0] ||
            (o->choices &&
             !is_listed(o->choices, text))) /* an empty folder name would mean the root */
            return false;
        *(const char **) value = text;
        return true;
    case SG_OPTION_CHOICE:
        if (index < 0)
            return false;
        *(int *) value = index;
        return true;
    case SG_OPTION_SWITCH:
        if (index < 0)
            return false;
        *(bool *) value = index;
        return true;
    case SG_OPTION_INT:
    case SG_OPTION_U64:
    case SG_OPTION_BYTES:
        return set_whole(o, value, text);
    default:
        return set_real(o, value, text);
    }
}

bool sg_option_set(const struct sg_option *o, void *params, const char *text, char *expected,
                   size_t size)
{
    const bool done = set(o, (char *) params + o->offset, text);
    if (!done && expected)
        describe(o, expected, size);
    return done;
}

/* The shortest text that reads back the same. */
static void print_float(const struct sg_option *o, float value, char *text, size_t size)
{
    const double v = o->type == SG_OPTION_LEVELS ? LEVELS * (double) value : (double) value;
    for (int digits = 6; digits <= 9; digits++) {
        snprintf(text, size, "%.*g", digits, v);
        const double back = sg_strtod(text, NULL);
        if ((float) (o->type == SG_OPTION_LEVELS ? back / LEVELS : back) == value)
            break;
    }
}

bool sg_option_get(const struct sg_option *o, const void *params, char *text, size_t size)
{
    const void *value = (const char *) params + o->offset;
    const int word = o->words ? word_of(o, number_of(o, params)) : -1;
    const locale_t before = uselocale(sg_c_locale());
    bool shown = true;
    if (word >= 0)
        copy_word(o->words, word, text, size);
    else
        switch (o->type) {
        case SG_OPTION_FLAG:
            snprintf(text, size, *(const bool *) value ? "true" : "false");
            break;
        case SG_OPTION_INT:
            snprintf(text, size, "%d", *(const int *) value);
            break;
        case SG_OPTION_U64:
        case SG_OPTION_BYTES:
            snprintf(text, size, "%llu", (unsigned long long) *(const uint64_t *) value);
            break;
        case SG_OPTION_FLOAT:
        case SG_OPTION_LEVELS:
            print_float(o, *(const float *) value, text, size);
            break;
        case SG_OPTION_DOUBLE:
        case SG_OPTION_TIME:
            snprintf(text, size, "%.15g", *(const double *) value);
            break;
        case SG_OPTION_TEXT:
            shown = *(const char *const *) value != NULL;
            snprintf(text, size, "%s", shown ? *(const char *const *) value : "");
            break;
        case SG_OPTION_CHOICE:
            copy_word(o->choices, *(const int *) value, text, size);
            break;
        case SG_OPTION_SWITCH:
            copy_word(o->choices, *(const bool *) value, text, size);
        }
    uselocale(before);
    return shown;
}

/* The range in the field's own unit. */
static int refuse(sg_ctx *ctx, const struct sg_option *o, double v)
{
    const double unit = o->type == SG_OPTION_LEVELS ? LEVELS : 1;
    if (o->type == SG_OPTION_CHOICE)
        return sg_fail(ctx, SG_ERR_USAGE, "%s: found %d, expected 0 to %d: one of %s", o->field,
                       (int) v, count_words(o->choices) - 1, o->choices);
    const int digits = o->type == SG_OPTION_INT || o->type == SG_OPTION_U64 ? 17 : 6;
    return sg_fail(ctx, SG_ERR_USAGE, "%s: found %.*g, expected %.*g to %.*g%s", o->field, digits,
                   v, digits, o->low / unit, digits, o->high / unit, exception(o));
}

int sg_check_options(sg_ctx *ctx, const struct sg_option *options, const void *params)
{
    for (const struct sg_option *o = options; o->name; o++) {
        const bool choice = o->type == SG_OPTION_CHOICE;
        if (o->any || !(is_number(o) || choice))
            continue;
        const double v = number_of(o, params);
        const double scaled = o->type == SG_OPTION_LEVELS ? LEVELS * v : v;
        const bool good = choice ? v >= 0 && v < count_words(o->choices)
                                 : in_range(o, scaled) || (o->whole && isinf(v) && v > 0);
        if (!good)
            return refuse(ctx, o, v);
    }
    return SG_OK;
}

void sg_option_copy(const struct sg_option *o, void *to, const void *from)
{
    static const size_t sizes[] = {
        [SG_OPTION_FLAG] = sizeof(bool),         [SG_OPTION_INT] = sizeof(int),
        [SG_OPTION_U64] = sizeof(uint64_t),      [SG_OPTION_BYTES] = sizeof(uint64_t),
        [SG_OPTION_FLOAT] = sizeof(float),       [SG_OPTION_DOUBLE] = sizeof(double),
        [SG_OPTION_TIME] = sizeof(double),       [SG_OPTION_LEVELS] = sizeof(float),
        [SG_OPTION_TEXT] = sizeof(const char *), [SG_OPTION_CHOICE] = sizeof(int),
        [SG_OPTION_SWITCH] = sizeof(bool)};
    memcpy((char *) to + o->offset, (const char *) from + o->offset, sizes[o->type]);
}
