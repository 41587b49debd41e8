/* SPDX-License-Identifier: Apache-2.0 */
/* The option tables as text for people: --help, docs/options.md and the man page. */
#include <string.h>

#include "options.h"

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
static const char *argument_of(const struct option *o)
{
    return o->choices ? o->choices : o->argument ? o->argument : "";
}

void options_help(const struct command *c, FILE *out)
{
    fprintf(out, "splatguard %s %s\n\n", c->name, c->arguments);
    wrap(out, c->description, 0, 0);
    for (const struct option *o = c->options; o->name; o++) {
        char left[64], value[128], help[512];
        if (o->type == OPT_GROUP) {
            fprintf(out, "\n%s:\n", o->name);
            continue;
        }
        const char brief[] = {'-', o->letter, ',', ' ', 0};
        snprintf(left, sizeof(left), "  %s--%s %s", o->letter ? brief : "    ", o->name,
                 argument_of(o));
        const bool has_value = options_show(o, c->defaults, value, sizeof(value));
        snprintf(help, sizeof(help), has_value ? "%s [%s]" : "%s", o->help, value);
        if (strlen(left) >= HELP_INDENT)
            fprintf(out, "%s\n%*s", left, HELP_INDENT, "");
        else
            fprintf(out, "%-*s", HELP_INDENT, left);
        wrap(out, help, HELP_INDENT, HELP_INDENT);
    }
}

/* A bar would end the cell. */
static void cell(FILE *out, const char *text)
{
    for (; *text; text++)
        fprintf(out, *text == '|' ? "\\|" : "%c", *text);
}

void options_markdown(const struct command *c, FILE *out)
{
    fprintf(out, "\n## splatguard %s\n\n    splatguard %s %s\n\n%s\n", c->name, c->name,
            c->arguments, c->description);
    if (c->options->name && c->options->type != OPT_GROUP)
        fprintf(out, "\n| option | meaning | default |\n|---|---|---|\n");
    for (const struct option *o = c->options; o->name; o++) {
        char value[128];
        if (o->type == OPT_GROUP) {
            fprintf(out, "\n### %s: %s\n\n| option | meaning | default |\n|---|---|---|\n", c->name,
                    o->name);
            continue;
        }
        fprintf(out, "| `--%s%s", o->name, argument_of(o)[0] ? " " : "");
        cell(out, argument_of(o));
        fprintf(out, "`");
        if (o->letter)
            fprintf(out, ", `-%c`", o->letter);
        fprintf(out, " | ");
        cell(out, o->help);
        fprintf(out, " | %s |\n", options_show(o, c->defaults, value, sizeof(value)) ? value : "");
    }
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
    fprintf(out, ".SS splatguard %s ", c->name);
    options_roff(out, c->arguments);
    fprintf(out, "\n");
    options_roff(out, c->description);
    fprintf(out, "\n");
    for (const struct option *o = c->options; o->name; o++) {
        char value[128];
        if (o->type == OPT_GROUP) {
            fprintf(out, ".PP\n%s:\n", o->name);
            continue;
        }
        fprintf(out, ".TP\n\\fB");
        if (o->letter)
            fprintf(out, "\\-%c, ", o->letter);
        fprintf(out, "\\-\\-");
        options_roff(out, o->name);
        fprintf(out, "\\fR \\fI%s\\fR\n", argument_of(o));
        options_roff(out, o->help);
        if (options_show(o, c->defaults, value, sizeof(value))) {
            fprintf(out, " Default: ");
            options_roff(out, value);
            fprintf(out, ".");
        }
        fprintf(out, "\n");
    }
}
