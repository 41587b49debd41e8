/* SPDX-License-Identifier: Apache-2.0 */
#include "options.h"

#include <string.h>

#include "exit_status.h"

/* Where a name is in "one|two|three", or their number. */
static size_t place_of(const char *list, const char *name)
{
    size_t i = 0;
    for (; list && *list; i++) {
        const size_t n = strcspn(list, "|");
        if (name && strlen(name) == n && !memcmp(list, name, n))
            return i + 1;
        list += n + (list[n] == '|');
    }
    return name ? i + 1 : 0;
}

bool is_in(const char *list, const char *name)
{
    return list && place_of(list, name) < place_of(list, "");
}

static size_t add_group(const struct command *c, size_t group, struct option_place *list, size_t n)
{
    for (const struct sg_option *o = c->options; o->name; o++)
        if (n < OPTIONS_MAX && place_of(c->groups, o->group) == group)
            list[n++] = (struct option_place){o, 0};
    for (const struct option_part *p = c->parts; p && p->rows; p++)
        for (const struct sg_option *o = p->rows(); o->name; o++)
            if (n < OPTIONS_MAX && place_of(c->groups, o->group) == group &&
                !is_in(p->without, o->name))
                list[n++] = (struct option_place){o, p->at};
    return n;
}

size_t options_list(const struct command *c, struct option_place list[OPTIONS_MAX])
{
    size_t n = 0;
    for (size_t group = 0; group <= place_of(c->groups, ""); group++)
        n = add_group(c, group, list, n);
    return n;
}

static size_t offset_of(const struct option_place *p)
{
    return p->at + p->row->offset;
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

/* The name that is most like another one, or NULL; more than half of it is right. */
static const char *nearest(const struct option_place *list, size_t count, const char *name,
                           size_t n)
{
    const char *near = NULL;
    size_t best = n < 6 ? n / 2 + 1 : 4;
    for (size_t i = 0; i <= count; i++) {
        const char *other = i < count ? list[i].row->name : "help"; /* every command has it */
        const size_t d = n > 2 && !strncmp(name, other, n) ? 0      /* the beginning of a name */
                                                           : name_distance(name, n, other);
        if (d < best)
            best = d, near = other;
    }
    return near;
}

static int unknown(const struct command *c, const struct option_place *list, size_t count,
                   const char *name, size_t n)
{
    const char *near = nearest(list, count, name, n);
    say(stderr, "splatguard %s: unknown option %s%.*s", c->name, n > 1 ? "--" : "-", (int) n, name);
    const struct option_hint *hint = c->hints;
    while (hint && hint->name && name_distance(name, n, hint->name))
        hint++;
    if (hint && hint->name)
        say(stderr, "; %s", hint->text);
    else if (near)
        say(stderr, "; did you mean --%s?", near);
    say(stderr, "\n");
    return STATUS_USAGE;
}

/* Index of the option with that name, older name or letter, or count. */
static size_t find(const struct option_place *list, size_t count, const char *name, size_t n)
{
    for (size_t i = 0; i < count; i++) {
        const struct sg_option *o = list[i].row;
        if (same_name(name, o->name, n) || (o->alias && same_name(name, o->alias, n)) ||
            (n == 1 && *name == o->letter))
            return i;
    }
    return count;
}

/* The name or letter of the option in a word: --name, --name=value, -j, -j2. Returns its length.
 * text: the value in the same word, or NULL. */
static size_t split_word(const char *word, const char **name, const char **text)
{
    const bool brief = word[1] != '-';
    *name = word + (brief ? 1 : 2);
    const char *equals = brief ? NULL : strchr(*name, '=');
    *text = equals ? equals + 1 : brief && (*name)[0] && (*name)[1] ? *name + 1 : NULL;
    return brief ? 1 : equals ? (size_t) (equals - *name) : strlen(*name);
}

const struct sg_option *options_find(const struct command *c, const char *word, const char **text,
                                     const char **near)
{
    struct option_place list[OPTIONS_MAX];
    const char *name;
    const size_t count = options_list(c, list), n = split_word(word, &name, text);
    const size_t found = find(list, count, name, n);
    *near = nearest(list, count, name, n);
    return found < count ? list[found].row : NULL;
}

/* An option given twice is refused, since it is not clear which value was meant. Two rows with the
 * same field are two names of one option. */
static bool is_repeated(const struct command *c, const struct option_place *list, size_t count,
                        size_t now, const bool *given)
{
    const struct sg_option *o = list[now].row;
    for (size_t i = 0; i < count; i++) {
        if (offset_of(&list[i]) != offset_of(&list[now]) || !given[i])
            continue;
        if (i == now)
            say(stderr, "splatguard %s: --%s%s%s: found twice, expected once\n", c->name, o->name,
                o->alias ? ", also called --" : "", o->alias ? o->alias : "");
        else
            say(stderr,
                "splatguard %s: found --%s and --%s, which mean the same, expected one of them\n",
                c->name, list[i].row->name, o->name);
        return true;
    }
    return false;
}

static int set(const struct command *c, const struct option_place *p, void *config,
               const char *text)
{
    char expected[256];
    if (sg_option_set(p->row, (char *) config + p->at, text, expected, sizeof(expected)))
        return 0;
    say(stderr, "splatguard %s: --%s: found \"%s\", expected %s\n", c->name, p->row->name, text,
        expected);
    return STATUS_USAGE;
}

int options_parse(const struct command *c, int argc, char **argv, void *config,
                  const char **positional, int *count, bool given[OPTIONS_MAX])
{
    struct option_place list[OPTIONS_MAX];
    const size_t options = options_list(c, list);
    c->defaults(config);
    memset(given, 0, OPTIONS_MAX * sizeof(*given));
    *count = 0;
    bool only_positional = false;
    for (int i = 0; i < argc; i++) {
        const char *a = argv[i];
        if (!a[0]) {
            say(stderr, "splatguard %s: found an empty argument\n", c->name);
            return STATUS_USAGE;
        }
        if (only_positional || a[0] != '-' || !a[1]) {
            if (*count >= c->max_positional) {
                say(stderr, "splatguard %s: unexpected argument \"%s\"\n", c->name, a);
                return STATUS_USAGE;
            }
            positional[(*count)++] = a;
            continue;
        }
        if (!strcmp(a, "--")) {
            only_positional = true;
            continue;
        }
        if (!strcmp(a, "--help") || !strcmp(a, "-h") || !strcmp(a, "--help-all")) {
            options_help(c, !strcmp(a, "--help-all"), stdout);
            return -1;
        }
        const char *name, *text;
        const size_t n = split_word(a, &name, &text);
        const size_t found = find(list, options, name, n);
        if (found == options)
            return unknown(c, list, options, name, n);
        const struct sg_option *o = list[found].row;
        if (o->type == SG_OPTION_FLAG) {
            if (text) {
                say(stderr, "splatguard %s: --%s takes no value\n", c->name, o->name);
                return STATUS_USAGE;
            }
            text = "true";
        }
        text = text ? text : i + 1 < argc ? argv[++i] : NULL;
        if (!text) {
            say(stderr, "splatguard %s: --%s: found no value, expected %s\n", c->name, o->name,
                o->unit);
            return STATUS_USAGE;
        }
        if (is_repeated(c, list, options, found, given) || set(c, &list[found], config, text))
            return STATUS_USAGE;
        given[found] = true;
    }
    return 0;
}

void warn_unused(const char *option, const char *why)
{
    say(stderr, "warning: --%s has no effect %s\n", option, why);
}

const char *vram_unused(const char *engine, const char *cpu)
{
    const bool automatic = !engine || !strcmp(engine, "auto");
    return automatic                ? cpu ? "with --cpu" : NULL
           : !strcmp(engine, "cpu") ? "with --engine cpu"
           : !strcmp(engine, "ref") ? "with --engine ref"
                                    : NULL;
}

json_t *number_json(double v)
{
    return v - v == 0 ? json_real(v) : json_null();
}

bool options_given(const struct command *c, const bool *given, size_t offset)
{
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(c, list);
    for (size_t i = 0; i < n; i++)
        if (offset_of(&list[i]) == offset && given[i])
            return true;
    return false;
}

const char *options_given_of(const struct command *c, const bool *given,
                             const struct option_part *part, const char *without)
{
    for (const struct sg_option *o = part->rows(); o->name; o++)
        if (options_given(c, given, part->at + o->offset) && !is_in(without, o->name))
            return o->name;
    return NULL;
}

void options_preset(const struct command *c, const bool *given, void *config, const char *name,
                    const char *text)
{
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(c, list), i = find(list, n, name, strlen(name));
    if (i < n && !options_given(c, given, offset_of(&list[i])))
        set(c, &list[i], config, text);
}

const char *options_name(const struct command *c, const char *message)
{
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(c, list), length = strcspn(message, ":");
    for (size_t i = 0; i < n; i++) {
        const char *field = list[i].row->field;
        if (field && strlen(field) == length && !memcmp(field, message, length))
            return list[i].row->name;
    }
    return NULL;
}

int options_conflict(const struct command *c, const bool *given, const void *config,
                     const void *run)
{
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(c, list);
    for (size_t i = 0; i < n; i++) {
        char now[4096], then[4096];
        const struct sg_option *o = list[i].row;
        if (!o->field || o->transient || !given[i]) /* its own rows are of one process */
            continue;
        const bool set = sg_option_get(o, (const char *) run + list[i].at, then, sizeof(then));
        const bool shown = sg_option_get(o, (const char *) config + list[i].at, now, sizeof(now));
        if ((shown && set && !strcmp(now, then)) || (o->words && !strcmp(now, "preset")))
            continue; /* what is left to the preset does not differ */
        const bool flag = o->type == SG_OPTION_FLAG;
        say(stderr,
            "splatguard %s: --%s: found %s, but the run has %s, and a resumed run keeps its "
            "options\n",
            c->name, o->name, flag ? "on" : now,
            flag  ? "off"
            : set ? then
                  : "not set");
        return STATUS_USAGE;
    }
    return 0;
}
