/* SPDX-License-Identifier: Apache-2.0 */
/* A shell offers the names of commands and options, the words of choices, and files where a value
 * or an argument is one. It offers nothing for numbers. */
#include "completion.h"

#include <string.h>

#define SPECIAL "help version"

/* What a shell can offer for the value of an option. */
enum value { VALUE_NONE, VALUE_WORDS, VALUE_FILE, VALUE_OTHER };

static enum value value_of(const struct sg_option *o)
{
    if (o->type == SG_OPTION_FLAG)
        return VALUE_NONE;
    if (o->choices || o->words)
        return VALUE_WORDS;
    /* Texts are files and folders, but for names and lists such as X,Y,W,H. */
    const bool file = o->type == SG_OPTION_TEXT && o->unit && strcmp(o->unit, "VARIANT") &&
                      !strpbrk(o->unit, ",/");
    return file ? VALUE_FILE : VALUE_OTHER;
}

/* The words of "one|two[:DEVICE]" with blanks between them, without what may follow them. */
static void put_words(FILE *out, const struct sg_option *o)
{
    for (const char *c = o->choices ? o->choices : o->words; *c;) {
        const size_t n = strcspn(c, "|"), word = strcspn(c, "|[");
        fprintf(out, "%.*s%s", (int) word, c, c[n] ? " " : "");
        c += n + (c[n] == '|');
    }
}

static void put_commands(FILE *out, const struct command *const *commands, size_t n)
{
    for (size_t i = 0; i < n; i++)
        fprintf(out, "%s ", commands[i]->name);
    fputs(SPECIAL, out);
}

/* The first sentence of a help text between apostrophes, without its full stop. `escaped`
 * characters get a backslash; an apostrophe that is not among them is written as POSIX shells want
 * it. */
static void put_sentence(FILE *out, const char *text, const char *escaped)
{
    const char *end = strstr(text, ". ");
    size_t n = end ? (size_t) (end - text) : strlen(text);
    n -= n && text[n - 1] == '.';
    for (size_t i = 0; i < n; i++)
        if (strchr(escaped, text[i]))
            fprintf(out, "\\%c", text[i]);
        else if (text[i] == '\'')
            fputs("'\\''", out);
        else
            fputc(text[i], out);
}

static void bash_command(const struct command *c, FILE *out)
{
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(c, list);
    fprintf(out, "    %s)\n        options='", c->name);
    for (size_t i = 0; i < n; i++)
        fprintf(out, "--%s ", list[i].row->name);
    fputs("--help --help-all'\n        case $previous in\n", out);
    for (size_t i = 0; i < n; i++) {
        const struct sg_option *o = list[i].row;
        if (value_of(o) == VALUE_NONE)
            continue;
        fputs("        ", out);
        if (o->letter)
            fprintf(out, "-%c | ", o->letter);
        fprintf(out, "--%s) ", o->name);
        if (value_of(o) == VALUE_WORDS) {
            fputs("words='", out);
            put_words(out, o);
            fputs("' ;;\n", out);
        } else {
            fputs(value_of(o) == VALUE_FILE ? "words=FILE ;;\n" : "words=NONE ;;\n", out);
        }
    }
    fputs("        esac\n        ;;\n", out);
}

static void bash(const struct command *const *commands, size_t n, FILE *out)
{
    fputs("# bash completion for splatguard: splatguard help --completion bash\n"
          "_splatguard() {\n"
          "    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]}\n"
          "    local commands='",
          out);
    put_commands(out, commands, n);
    fputs("' options='' words=''\n"
          "    COMPREPLY=()\n"
          "    # bash takes --name=value apart at the \"=\".\n"
          "    if [[ $current == = ]]; then\n"
          "        current=\n"
          "    elif [[ $previous == = ]]; then\n"
          "        previous=${COMP_WORDS[COMP_CWORD - 2]}\n"
          "    fi\n"
          "    if ((COMP_CWORD == 1)); then\n"
          "        mapfile -t COMPREPLY < <(compgen -W \"$commands --help --version\" -- "
          "\"$current\")\n"
          "        return\n"
          "    fi\n"
          "    case ${COMP_WORDS[1]} in\n"
          "    help) words=$commands ;;\n"
          "    version) words=NONE ;;\n",
          out);
    for (size_t i = 0; i < n; i++)
        bash_command(commands[i], out);
    fputs("    esac\n"
          "    case $words in\n"
          "    NONE) return ;;\n"
          "    '') [[ $current != -* ]] || words=$options ;;\n"
          "    esac\n"
          "    if [[ $words && $words != FILE ]]; then\n"
          "        mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$current\")\n"
          "    else\n"
          "        compopt -o filenames\n"
          "        mapfile -t COMPREPLY < <(compgen -f -- \"$current\")\n"
          "    fi\n"
          "}\n"
          "complete -F _splatguard splatguard\n",
          out);
}

#define ZSH_ESCAPED "[]:\\"

static void zsh_option(const struct sg_option *o, FILE *out)
{
    const enum value value = value_of(o);
    const char *equals = value == VALUE_NONE ? "" : "=";
    if (o->letter)
        fprintf(out, "            '(-%c --%s)'{-%c,--%s%s}'[", o->letter, o->name, o->letter,
                o->name, equals);
    else
        fprintf(out, "            '--%s%s[", o->name, equals);
    put_sentence(out, o->help, ZSH_ESCAPED);
    fputs("]", out);
    if (value != VALUE_NONE)
        fprintf(out, ":%s:", o->unit ? o->unit : "VALUE");
    if (value == VALUE_WORDS) {
        fputs("(", out);
        put_words(out, o);
        fputs(")", out);
    } else if (value == VALUE_FILE) {
        fputs("_files", out);
    }
    fputs("' \\\n", out);
}

static void zsh(const struct command *const *commands, size_t n, FILE *out)
{
    fputs("#compdef splatguard\n"
          "# zsh completion for splatguard: splatguard help --completion zsh\n"
          "_splatguard() {\n"
          "    local -a commands=(\n",
          out);
    for (size_t i = 0; i < n; i++) {
        fprintf(out, "        '%s:", commands[i]->name);
        put_sentence(out, commands[i]->summary, ":\\");
        fputs("'\n", out);
    }
    fputs("        'help:Lists commands, or the options of one' 'version:Prints the version'\n"
          "    )\n"
          "    if ((CURRENT == 2)); then\n"
          "        _describe -t commands command commands\n"
          "        return\n"
          "    fi\n"
          "    local command=$words[2]\n"
          "    shift words\n"
          "    ((CURRENT--))\n"
          "    case $command in\n"
          "    (help) _describe -t commands command commands ;;\n",
          out);
    for (size_t i = 0; i < n; i++) {
        struct option_place list[OPTIONS_MAX];
        const size_t count = options_list(commands[i], list);
        fprintf(out, "    (%s)\n        _arguments \\\n", commands[i]->name);
        for (size_t k = 0; k < count; k++)
            zsh_option(list[k].row, out);
        fputs("            '(- *)--help[List the options]' \\\n"
              "            '(- *)--help-all[List all options]' \\\n"
              "            '*:file:_files'\n"
              "        ;;\n",
              out);
    }
    fputs("    esac\n"
          "}\n"
          "if [[ $funcstack[1] == _splatguard ]]; then\n"
          "    _splatguard \"$@\"\n"
          "else\n"
          "    compdef _splatguard splatguard\n"
          "fi\n",
          out);
}

#define FISH_ESCAPED "'\\"

static void fish_option(const char *command, const struct sg_option *o, FILE *out)
{
    fprintf(out, "complete -c splatguard -n '__fish_seen_subcommand_from %s' -l %s", command,
            o->name);
    if (o->letter)
        fprintf(out, " -s %c", o->letter);
    switch (value_of(o)) {
    case VALUE_NONE:
        break;
    case VALUE_WORDS:
        fputs(" -x -a '", out);
        put_words(out, o);
        fputs("'", out);
        break;
    case VALUE_FILE:
        fputs(" -r -F", out);
        break;
    case VALUE_OTHER:
        fputs(" -x", out);
        break;
    }
    fputs(" -d '", out);
    put_sentence(out, o->help, FISH_ESCAPED);
    fputs("'\n", out);
}

static void fish(const struct command *const *commands, size_t n, FILE *out)
{
    fputs("# fish completion for splatguard: splatguard help --completion fish\n", out);
    for (size_t i = 0; i < n; i++) {
        fprintf(out, "complete -c splatguard -f -n __fish_use_subcommand -a %s -d '",
                commands[i]->name);
        put_sentence(out, commands[i]->summary, FISH_ESCAPED);
        fputs("'\n", out);
    }
    fputs("complete -c splatguard -f -n __fish_use_subcommand -a help -d 'Lists commands, or the "
          "options of one'\n"
          "complete -c splatguard -f -n __fish_use_subcommand -a version -d 'Prints the version'\n"
          "complete -c splatguard -f -n '__fish_seen_subcommand_from help' -a '",
          out);
    put_commands(out, commands, n);
    fputs("'\n", out);
    for (size_t i = 0; i < n; i++) {
        struct option_place list[OPTIONS_MAX];
        const size_t count = options_list(commands[i], list);
        for (size_t k = 0; k < count; k++)
            fish_option(commands[i]->name, list[k].row, out);
        fprintf(out,
                "complete -c splatguard -n '__fish_seen_subcommand_from %s' -l help -d 'List the "
                "options'\n"
                "complete -c splatguard -n '__fish_seen_subcommand_from %s' -l help-all -d 'List "
                "all options'\n",
                commands[i]->name, commands[i]->name);
    }
}

bool completion_write(const char *shell, const struct command *const *commands, size_t n, FILE *out)
{
    static const struct {
        const char *name;
        void (*write)(const struct command *const *commands, size_t n, FILE *out);
    } shells[] = {{"bash", bash}, {"zsh", zsh}, {"fish", fish}};
    for (size_t i = 0; i < sizeof(shells) / sizeof(*shells); i++)
        if (!strcmp(shell, shells[i].name)) {
            shells[i].write(commands, n, out);
            return true;
        }
    return false;
}
