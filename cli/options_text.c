/* SPDX-License-Identifier: Apache-2.0 */
/* The option tables as text for people: --help, docs/options.md and the man page. */
#include <stdlib.h>
#include <string.h>

#include "commands.h"

#define HELP_WIDTH 100
#define HELP_INDENT 34

/* Words of text from column on; further lines start below the first. */
static void wrap(FILE *out, const char *text, size_t indent, size_t column)
{
    while (*text) {
        const size_t word = strcspn(text, " ");
        if (column > indent && column + 1 + word > HELP_WIDTH) {
            fprintf(out, "\n%*s", (int) indent, "");
            column = indent;
        }
        if (column > indent)
            fputc(' ', out);
        fprintf(out, "%.*s", (int) word, text);
        column += word + (column > indent);
        text += word + (text[word] == ' ');
    }
    fputc('\n', out);
}

/* What is written behind the name: the choices where there are some. */
static const char *argument_of(const struct sg_option *o)
{
    return o->choices ? o->choices : o->unit ? o->unit : "";
}

/* The options of a command with their defaults. */
struct listing {
    struct option_place list[OPTIONS_MAX];
    size_t n;
    void *defaults;
};

static bool list_options(const struct command *c, struct listing *l)
{
    l->n = options_list(c, l->list);
    l->defaults = calloc(1, c->config_size);
    if (l->defaults)
        c->defaults(l->defaults);
    else
        no_memory();
    return l->defaults;
}

/* The heading that the i-th option begins, or NULL. */
static const char *heading(const struct listing *l, size_t i)
{
    const char *group = l->list[i].row->group, *before = i ? l->list[i - 1].row->group : NULL;
    return group && (!before || strcmp(group, before)) ? group : NULL;
}

/* False if there is nothing to show: flags, unset names. */
static bool default_of(const struct listing *l, size_t i, char *text, size_t size)
{
    const struct option_place *p = &l->list[i];
    return p->row->type != SG_OPTION_FLAG &&
           sg_option_get(p->row, (const char *) l->defaults + p->at, text, size);
}

static void help_row(const struct listing *l, size_t i, FILE *out)
{
    char left[128], value[128], help[1024];
    const struct sg_option *o = l->list[i].row;
    const char brief[] = {'-', o->letter, ',', ' ', 0};
    snprintf(left, sizeof(left), "  %s--%s %s", o->letter ? brief : "    ", o->name,
             argument_of(o));
    const bool has_value = default_of(l, i, value, sizeof(value));
    snprintf(help, sizeof(help), has_value ? "%s [%s]" : "%s", o->help, value);
    if (strlen(left) >= HELP_INDENT)
        fprintf(out, "%s\n%*s", left, HELP_INDENT, "");
    else
        fprintf(out, "%-*s", HELP_INDENT, left);
    wrap(out, help, HELP_INDENT, HELP_INDENT);
}

void options_help(const struct command *c, bool everything, FILE *out)
{
    struct listing l;
    size_t hidden = 0;
    const char *title = NULL;
    if (!list_options(c, &l))
        return;
    fprintf(out, "splatguard %s %s\n\n", c->name, c->arguments);
    wrap(out, c->description, 0, 0);
    if (l.n && !l.list[0].row->group)
        fprintf(out, "\n");
    for (size_t i = 0; i < l.n; i++) {
        title = heading(&l, i) ? heading(&l, i) : title;
        if (l.list[i].row->expert && !everything) {
            hidden++;
            continue;
        }
        if (title)
            fprintf(out, "\n%s:\n", title);
        title = NULL;
        help_row(&l, i, out);
    }
    if (hidden)
        fprintf(out, "\nsplatguard %s --help-all lists %zu more options.\n", c->name, hidden);
    free(l.defaults);
}

/* A bar would end the cell. */
static void cell(FILE *out, const char *text)
{
    for (; *text; text++)
        fprintf(out, *text == '|' ? "\\|" : "%c", *text);
}

void options_markdown(const struct command *c, FILE *out)
{
    static const char head[] = "\n| option | meaning | default |\n|---|---|---|\n";
    struct listing l;
    if (!list_options(c, &l))
        return;
    fprintf(out, "\n## splatguard %s\n\n    splatguard %s %s\n\n%s\n", c->name, c->name,
            c->arguments, c->description);
    if (l.n && !l.list[0].row->group)
        fputs(head, out);
    for (size_t i = 0; i < l.n; i++) {
        const struct sg_option *o = l.list[i].row;
        char value[128];
        if (heading(&l, i))
            fprintf(out, "\n### %s: %s\n%s", c->name, heading(&l, i), head);
        fprintf(out, "| `--%s%s", o->name, argument_of(o)[0] ? " " : "");
        cell(out, argument_of(o));
        fprintf(out, "`");
        if (o->letter)
            fprintf(out, ", `-%c`", o->letter);
        fprintf(out, o->expert ? " \\* | " : " | ");
        cell(out, o->help);
        fprintf(out, " | %s |\n", default_of(&l, i, value, sizeof(value)) ? value : "");
    }
    free(l.defaults);
}

/* roff takes a dash for a hyphen and a backslash for a command. */
void options_roff(FILE *out, const char *text)
{
    for (; *text; text++) {
        if (*text == '-' || *text == '\\')
            fputc('\\', out);
        fputc(*text, out);
    }
}

void options_man(const struct command *c, FILE *out)
{
    struct listing l;
    if (!list_options(c, &l))
        return;
    fprintf(out, ".SH DESCRIPTION\n");
    options_roff(out, c->description);
    fprintf(out, "\n.SH OPTIONS\n");
    for (size_t i = 0; i < l.n; i++) {
        const struct sg_option *o = l.list[i].row;
        char value[128];
        if (heading(&l, i))
            fprintf(out, ".SS %s\n", heading(&l, i));
        fprintf(out, ".TP\n\\fB");
        if (o->letter)
            fprintf(out, "\\-%c, ", o->letter);
        fprintf(out, "\\-\\-");
        options_roff(out, o->name);
        fprintf(out, "\\fR \\fI%s\\fR\n", argument_of(o));
        options_roff(out, o->help);
        if (default_of(&l, i, value, sizeof(value))) {
            fprintf(out, " Default: ");
            options_roff(out, value);
            fprintf(out, ".");
        }
        fprintf(out, "\n");
    }
    free(l.defaults);
}
