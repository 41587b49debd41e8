/* SPDX-License-Identifier: Apache-2.0 */
#include "options.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "quantities.h"

static void *value_of(const struct option *o, void *config)
{
    return (char *) config + o->offset;
}

/* Dashes and underscores are the same in option names. */
static bool same_name(const char *a, const char *b, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const char x = a[i] == '_' ? '-' : a[i], y = b[i] == '_' ? '-' : b[i];
        if (x != y || !x)
            return false;
    }
    return !b[n];
}

/* Levenshtein's, of short names. */
size_t name_distance(const char *a, size_t n, const char *b)
{
    size_t row[64], m = strlen(b);
    if (n > 62 || m > 62)
        return 64;
    for (size_t j = 0; j <= m; j++)
        row[j] = j;
    for (size_t i = 1; i <= n; i++) {
        size_t diagonal = row[0];
        row[0] = i;
        for (size_t j = 1; j <= m; j++) {
            const char x = a[i - 1] == '_' ? '-' : a[i - 1];
            size_t best = diagonal + (x != b[j - 1]);
            diagonal = row[j];
            best = row[j] + 1 < best ? row[j] + 1 : best;
            row[j] = row[j - 1] + 1 < best ? row[j - 1] + 1 : best;
        }
    }
    return row[m];
}

static int unknown(const struct command *c, const char *name, size_t n)
{
    const struct option *near = NULL;
    size_t best = 4;
    for (const struct option *o = c->options; o->name; o++) {
        size_t d = o->type == OPT_GROUP ? 64 : name_distance(name, n, o->name);
        if (o->type != OPT_GROUP && n > 2 && !strncmp(name, o->name, n))
            d = 0; /* the beginning of a name */
        if (d < best)
            best = d, near = o;
    }
    say(stderr, "splatguard %s: unknown option %s%.*s", c->name, n > 1 ? "--" : "-", (int) n, name);
    if (near)
        say(stderr, "; did you mean --%s?", near->name);
    say(stderr, "\n");
    return 1;
}

static int bad_value(const struct command *c, const struct option *o, const char *text,
                     const char *expected)
{
    say(stderr, "splatguard %s: --%s: found \"%s\", expected %s\n", c->name, o->name, text,
        expected);
    return 1;
}

/* Which of "one|two|three" a text is, or -1. */
static int index_of(const char *list, const char *text)
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
static void copy_of(const char *list, int i, char *text, size_t size)
{
    for (; i > 0; i--)
        list += strcspn(list, "|") + 1;
    snprintf(text, size, "%.*s", (int) strcspn(list, "|"), list);
}

static int set_choice(const struct command *c, const struct option *o, int *value, const char *text)
{
    const int index = index_of(o->choices, text);
    if (index >= 0) {
        *value = index;
        return 0;
    }
    char expected[160];
    snprintf(expected, sizeof(expected), "one of %s", o->choices);
    return bad_value(c, o, text, expected);
}

double options_number(double v)
{
    char text[32];
    snprintf(text, sizeof(text), "%.15g", v);
    return strtod(text, NULL);
}

int options_set(const struct command *c, const struct option *o, void *config, const char *text)
{
    void *value = value_of(o, config);
    char expected[128], *end;
    errno = 0;
    switch (o->type) {
    case OPT_FLAG:
        *(bool *) value = true;
        return 0;
    case OPT_STRING:
        if (!text[0]) /* an empty folder name would mean the root */
            return bad_value(c, o, text, "a name");
        *(const char **) value = text;
        return 0;
    case OPT_CHOICE:
        return set_choice(c, o, value, text);
    case OPT_FLOAT:
    case OPT_DOUBLE:
    case OPT_TIME: {
        const int word = index_of(o->words, text);
        if (word >= 0) {
            *(float *) value = (float) (-1 - word);
            return 0;
        }
        double v = strtod(text, &end);
        const bool known = o->type == OPT_TIME ? quantity_seconds(text, &v) : end != text && !*end;
        snprintf(expected, sizeof(expected),
                 o->type == OPT_TIME ? "a time from %g to %g seconds, such as 90s, 1h30m or 1d"
                 : o->words          ? "a number from %g to %g or one of %s"
                                     : "a number from %g to %g",
                 o->low, o->high, o->words ? o->words : "");
        if (!known || !(v >= o->low && v <= o->high))
            return bad_value(c, o, text, expected);
        if (o->type == OPT_FLOAT)
            *(float *) value = (float) v;
        else
            *(double *) value = options_number(v);
        return 0;
    }
    case OPT_BYTES:
        snprintf(expected, sizeof(expected),
                 "a size from %.0f to %.0f bytes, such as 500MB, 1.5G or 2GiB", o->low, o->high);
        uint64_t bytes;
        if (!quantity_bytes(text, &bytes) || (double) bytes < o->low || (double) bytes > o->high)
            return bad_value(c, o, text, expected);
        *(uint64_t *) value = bytes;
        return 0;
    default: {
        snprintf(expected, sizeof(expected), "a whole number from %.0f to %.0f%s", o->low, o->high,
                 o->nonzero ? ", but not 0" : "");
        const long long v = strtoll(text, &end, 10);
        if (end == text || *end || errno || (double) v < o->low || (double) v > o->high ||
            (o->nonzero && !v))
            return bad_value(c, o, text, expected);
        if (o->type == OPT_INT)
            *(int *) value = (int) v;
        else
            *(uint64_t *) value = (uint64_t) v;
        return 0;
    }
    }
}

static const struct option *find(const struct command *c, const char *name, size_t n)
{
    for (const struct option *o = c->options; o->name; o++)
        if (o->type != OPT_GROUP &&
            (same_name(name, o->name, n) || (o->alias && same_name(name, o->alias, n)) ||
             (n == 1 && *name == o->letter)))
            return o;
    return NULL;
}

/* Which of two values was meant cannot be known. Two rows of one value are two names of it. */
static bool is_repeated(const struct command *c, const struct option *o, const bool *given)
{
    for (const struct option *other = c->options; other->name; other++) {
        if (other->type == OPT_GROUP || other->offset != o->offset || !given[other - c->options])
            continue;
        if (other == o)
            say(stderr, "splatguard %s: --%s%s%s: found twice, expected once\n", c->name, o->name,
                o->alias ? ", also called --" : "", o->alias ? o->alias : "");
        else
            say(stderr,
                "splatguard %s: found --%s and --%s, which mean the same, expected one of them\n",
                c->name, other->name, o->name);
        return true;
    }
    return false;
}

int options_parse(const struct command *c, int argc, char **argv, void *config,
                  const char **positional, int *count, bool *given)
{
    memcpy(config, c->defaults, c->config_size);
    memset(given, 0, options_count(c) * sizeof(*given));
    *count = 0;
    bool only_positional = false;
    for (int i = 0; i < argc; i++) {
        const char *a = argv[i];
        if (!a[0]) {
            say(stderr, "splatguard %s: found an empty argument\n", c->name);
            return 1;
        }
        if (only_positional || a[0] != '-' || !a[1]) {
            if (*count >= c->max_positional) {
                say(stderr, "splatguard %s: unexpected argument \"%s\"\n", c->name, a);
                return 1;
            }
            positional[(*count)++] = a;
            continue;
        }
        if (!strcmp(a, "--")) {
            only_positional = true;
            continue;
        }
        if (!strcmp(a, "--help") || !strcmp(a, "-h")) {
            options_help(c, stdout);
            return -1;
        }
        const bool brief = a[1] != '-'; /* -w, -j 2, -j2 */
        const char *name = a + (brief ? 1 : 2),
                   *text = brief && name[1] ? name + 1 : strchr(name, '=');
        const size_t n = brief ? 1 : text ? (size_t) (text - name) : strlen(name);
        const struct option *o = find(c, name, n);
        if (!o)
            return unknown(c, name, n);
        if (!brief && text)
            text++;
        if (o->type == OPT_FLAG && text) {
            say(stderr, "splatguard %s: --%s takes no value\n", c->name, o->name);
            return 1;
        }
        if (o->type != OPT_FLAG) {
            text = text ? text : i + 1 < argc ? argv[++i] : NULL;
            if (!text) {
                say(stderr, "splatguard %s: --%s: found no value, expected %s\n", c->name, o->name,
                    o->argument);
                return 1;
            }
        }
        if (is_repeated(c, o, given) || options_set(c, o, config, text))
            return 1;
        given[o - c->options] = true;
    }
    return 0;
}

bool options_show(const struct option *o, const void *config, char *text, size_t size)
{
    const void *value = (const char *) config + o->offset;
    switch (o->type) {
    case OPT_INT:
        snprintf(text, size, "%d", *(const int *) value);
        return true;
    case OPT_U64:
    case OPT_BYTES:
        snprintf(text, size, "%llu", (unsigned long long) *(const uint64_t *) value);
        return true;
    case OPT_FLOAT:
        if (o->words && *(const float *) value < 0) {
            copy_of(o->words, (int) -*(const float *) value - 1, text, size);
            return true;
        }
        for (int digits = 6; digits <= 9; digits++) { /* the shortest that reads back the same */
            snprintf(text, size, "%.*g", digits, (double) *(const float *) value);
            if (strtof(text, NULL) == *(const float *) value)
                break;
        }
        return true;
    case OPT_DOUBLE:
    case OPT_TIME:
        snprintf(text, size, "%.15g", *(const double *) value);
        return true;
    case OPT_STRING:
        if (!*(const char *const *) value)
            return false;
        snprintf(text, size, "%s", *(const char *const *) value);
        return true;
    case OPT_CHOICE:
        copy_of(o->choices, *(const int *) value, text, size);
        return true;
    default:
        return false;
    }
}

json_t *number_json(double v)
{
    return v - v == 0 ? json_real(v) : json_null();
}

json_t *options_to_json(const struct command *c, const void *config)
{
    json_t *object = json_object();
    for (const struct option *o = c->options; o->name; o++) {
        char text[4096];
        const void *value = (const char *) config + o->offset;
        if (o->type == OPT_GROUP || o->transient)
            continue;
        json_t *v = json_null();
        if (o->type == OPT_FLAG)
            v = json_boolean(*(const bool *) value);
        else if (o->type == OPT_INT)
            v = json_integer(*(const int *) value);
        else if (o->type == OPT_U64 || o->type == OPT_BYTES)
            v = json_integer((json_int_t) * (const uint64_t *) value);
        else if (o->type == OPT_STRING && *(const char *const *) value)
            v = sg_bytes_to_json(*(const char *const *) value);
        else if (o->words && *(const float *) value < 0 &&
                 options_show(o, config, text, sizeof(text)))
            v = sg_text_to_json(text);
        else if (options_show(o, config, text, sizeof(text)))
            v = o->type == OPT_FLOAT || o->type == OPT_DOUBLE || o->type == OPT_TIME
                    ? json_real(strtod(text, NULL))
                    : sg_text_to_json(text);
        json_object_set_new(object, o->name, v);
    }
    return object;
}

/* One value of a run's options. */
static int set_json(const struct command *c, const struct option *o, void *config, const json_t *v,
                    const char *path)
{
    const bool number = o->type != OPT_FLAG && o->type != OPT_STRING && o->type != OPT_CHOICE &&
                        !(o->words && json_is_string(v));
    char text[64];
    if (json_is_null(v))
        return 0;
    if (o->type == OPT_FLAG ? !json_is_boolean(v)
        : number            ? !json_is_number(v)
                            : !json_is_string(v)) {
        say(stderr, "splatguard: %s: option \"%s\": found %s, expected %s\n", path, o->name,
            sg_json_show(v, (char[SG_JSON_SHOWN]){0}),
            o->type == OPT_FLAG ? "true or false"
            : number            ? "a number"
                                : "a text");
        return 1;
    }
    if (o->type == OPT_FLAG) {
        *(bool *) value_of(o, config) = json_is_true(v);
        return 0;
    }
    if (json_is_integer(v))
        snprintf(text, sizeof(text), "%lld", (long long) json_integer_value(v));
    else if (json_is_real(v))
        snprintf(text, sizeof(text), "%.17g", json_real_value(v));
    const int code = options_set(c, o, config, number ? text : json_string_value(v));
    if (code)
        say(stderr, "splatguard: in %s\n", path);
    return code;
}

int options_from_json(const struct command *c, void *config, const json_t *object, const char *path)
{
    const char *key;
    json_t *v;
    if (!json_is_object(object)) {
        say(stderr, "splatguard: %s: found no \"options\", expected an object\n", path);
        return 1;
    }
    json_object_foreach((json_t *) object, key, v)
    {
        const struct option *o = find(c, key, strlen(key));
        if (!o || o->transient) {
            say(stderr, "splatguard: %s: found an unknown option \"%s\"\n", path, key);
            return 1;
        }
        if (set_json(c, o, config, v, path))
            return 1;
    }
    return 0;
}

int options_adopt(const struct command *c, const char *group, const bool *given, void *config,
                  const json_t *object, const char *path)
{
    bool inside = false;
    for (const struct option *o = c->options; o->name; o++) {
        if (o->type == OPT_GROUP) {
            inside = !strcmp(o->name, group);
            continue;
        }
        const json_t *v =
            inside && !given[o - c->options] ? json_object_get(object, o->name) : NULL;
        if (!v && inside && o->alias && !given[o - c->options])
            v = json_object_get(object, o->alias);
        if (v && set_json(c, o, config, v, path))
            return 1;
    }
    return 0;
}

bool options_given(const struct command *c, const bool *given, size_t offset)
{
    for (const struct option *o = c->options; o->name; o++)
        if (o->type != OPT_GROUP && o->offset == offset && given[o - c->options])
            return true;
    return false;
}

size_t options_count(const struct command *c)
{
    size_t n = 0;
    while (c->options[n].name)
        n++;
    return n;
}

int options_conflict(const struct command *c, const bool *given, const void *config,
                     const void *run)
{
    for (const struct option *o = c->options; o->name; o++) {
        char now[4096] = "on", then[4096] = "off";
        if (o->type == OPT_GROUP || o->transient || !given[o - c->options])
            continue;
        if (o->type == OPT_FLAG) {
            if (*(const bool *) ((const char *) run + o->offset))
                continue;
        } else {
            if (!options_show(o, run, then, sizeof(then)))
                snprintf(then, sizeof(then), "not set");
            if (options_show(o, config, now, sizeof(now)) && !strcmp(now, then))
                continue;
        }
        say(stderr,
            "splatguard %s: --%s: found %s, but the run has %s, and a resumed run keeps its "
            "options\n",
            c->name, o->name, now, then);
        return 1;
    }
    return 0;
}
