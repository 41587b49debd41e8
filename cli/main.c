/* SPDX-License-Identifier: Apache-2.0 */
#include <ctype.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif
#include <unistd.h>

#include "commands.h"
#include "completion.h"

static const struct command *const commands[] = {
    &command_train,  &command_eval,    &command_render,  &command_synth,
    &command_info,   &command_attack,  &command_compare, &command_spectrum,
    &command_audit,  &command_prune,   &command_smooth,  &command_bench,
    &command_report, &command_convert, &command_view,    &command_export};
#define COMMANDS (sizeof(commands) / sizeof(commands[0]))

static void usage(FILE *out)
{
    fprintf(out, "splatguard %s: 3D Gaussian Splatting from untrusted photos\n\n", sg_version());
    for (size_t i = 0; i < COMMANDS; i++)
        fprintf(out, "  splatguard %-7s %s\n      %s\n", commands[i]->name, commands[i]->arguments,
                commands[i]->summary);
    fprintf(out, "\nsplatguard COMMAND --help lists the options of a command, --help-all lists all "
                 "of them.\n\nExit status:\n");
    for (const struct exit_meaning *e = exit_meanings; e->meaning; e++)
        fprintf(out, "  %3d  %s\n", (int) e->status, e->meaning);
}

/* "splatguard-train" in capitals, and what comes before SYNOPSIS. */
static void man_title(const char *name, const char *summary)
{
    printf(".TH SPLATGUARD");
    for (const char *c = name ? name : ""; *c; c++)
        printf("%s%c", c == name ? "\\-" : "", toupper((unsigned char) *c));
    printf(" 1 \"\" \"splatguard %s\"\n.SH NAME\nsplatguard%s%s \\- ", sg_version(),
           name ? "\\-" : "", name ? name : "");
    options_roff(stdout, summary);
    printf("\n.SH SYNOPSIS\n");
}

static void man_synopsis(const struct command *c)
{
    printf(".B splatguard %s\n", c->name);
    options_roff(stdout, c->arguments);
    printf("\n");
}

static void man_exit_status(void)
{
    printf(".SH EXIT STATUS\n");
    for (const struct exit_meaning *e = exit_meanings; e->meaning; e++) {
        printf(".TP\n.B %d\n", (int) e->status);
        options_roff(stdout, e->meaning);
        printf("\n");
    }
}

/* splatguard(1) */
static void man(void)
{
    man_title(NULL, "train, render and measure 3D Gaussian Splatting scenes");
    for (size_t i = 0; i < COMMANDS; i++) {
        man_synopsis(commands[i]);
        printf(".br\n");
    }
    printf(".B splatguard help\n[COMMAND]\n.br\n.B splatguard \\-\\-version\n.SH COMMANDS\n");
    for (size_t i = 0; i < COMMANDS; i++) {
        printf(".TP\n.BR splatguard\\-%s (1)\n", commands[i]->name);
        options_roff(stdout, commands[i]->summary);
        printf("\n");
    }
    man_exit_status();
    printf(".SH ENVIRONMENT\n.TP\n.B SG_CPU\nCPU variant to use, as \\-\\-cpu.\n"
           ".TP\n.B TMPDIR\nFolder for the model that\n.BR splatguard\\-view (1)\n"
           "hands to a browser, in a file without a name; /tmp by default.\n"
           ".TP\n.B XDG_RUNTIME_DIR\nFolder for the page by which\n"
           ".B splatguard view \\-\\-open\nleads a browser to the view; /tmp by default.\n");
}

/* splatguard-COMMAND(1) */
static void man_command(const struct command *c)
{
    man_title(c->name, c->summary);
    man_synopsis(c);
    options_man(c, stdout);
    man_exit_status();
    printf(".SH SEE ALSO\n.BR splatguard (1)\n");
}

static void markdown(void)
{
    printf("# Options\n\nMade by `splatguard help --markdown`; a test keeps it up to date. Names "
           "may be written with underscores as in the reference, the program of Kerbl et al. 2023 "
           "(`--densify_grad_threshold`), values as `--name value` or `--name=value`. No option "
           "may be given twice. `--help` leaves out the options with a star, "
           "`--help-all` lists them too.\n\nSizes: "
           "`1500M`, `1.5G`, `2GiB`, `500MB`; K, M, G, T and KiB, MiB, GiB, TiB are powers of "
           "1024, KB, MB, GB, TB of 1000. Times: seconds, or `90s`, `10m`, `1h30m`, `1d`.\n");
    for (size_t i = 0; i < COMMANDS; i++)
        options_markdown(commands[i], stdout);
    printf("\n## Exit status\n\n| status | meaning |\n|---|---|\n");
    for (const struct exit_meaning *e = exit_meanings; e->meaning; e++)
        printf("| %d | %s |\n", (int) e->status, e->meaning);
}

static int run(const struct command *c, int argc, char **argv)
{
    const char *positional[OPTIONS_MAX_POSITIONAL];
    int count, code;
    void *config = malloc(c->config_size);
    bool given[OPTIONS_MAX];
    if (!config)
        return no_memory();
    code = options_parse(c, argc, argv, config, positional, &count, given);
    if (code == 0 && count < c->min_positional) {
        code = missing(c, "argument");
    }
    if (code == 0)
        code = c->run(config, given, positional, count);
    free(config);
    return code < 0 ? 0 : code;
}

static const struct command *find(const char *name)
{
    for (size_t i = 0; i < COMMANDS; i++)
        if (!strcmp(name, commands[i]->name))
            return commands[i];
    return NULL;
}

static int unknown(const char *name)
{
    const char *near = NULL;
    size_t best = 3; /* two letters may differ, or the end be missing */
    for (size_t i = 0; i < COMMANDS; i++) {
        const char *other = commands[i]->name;
        const size_t n = strlen(name),
                     d = n > 1 && !strncmp(name, other, n) ? 0 : name_distance(name, n, other);
        if (d < best)
            best = d, near = other;
    }
    say(stderr, "splatguard: unknown command \"%s\"; ", name);
    if (near)
        say(stderr, "did you mean %s? ", near);
    say(stderr, "splatguard --help lists them\n");
    return STATUS_USAGE;
}

static int unknown_shell(const char *name)
{
    say(stderr, "splatguard help: --completion: found \"%s\", expected bash, zsh or fish\n", name);
    return STATUS_USAGE;
}

/* If the caller closed a standard stream, no file may get its number. Writing to standard output
 * then fails. */
static bool hold_standard_streams(void)
{
    for (int fd = 0; fd < 3; fd++)
        if (fcntl(fd, F_GETFD) < 0 && open("/dev/null", fd == 2 ? O_WRONLY : O_RDONLY) != fd)
            return false;
    return true;
}

int main(int argc, char **argv)
{
    const char *name = argc > 1 ? argv[1] : "--help";
    if (!hold_standard_streams())
        return STATUS_INTERNAL;
#ifdef __linux__
    prctl(PR_SET_NAME, "splatguard"); /* a job of bench is started by another name */
#endif
    /* `| head` or a full disk must not end a training: failed writes are noticed at the end. */
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN);
    if (!strcmp(name, "--version") || !strcmp(name, "-V") || !strcmp(name, "version")) {
        printf("splatguard %s\n", sg_version());
        return flush_output(0);
    }
    if (!strcmp(name, "--help") || !strcmp(name, "-h") || !strcmp(name, "help")) {
        const char *of = argc > 3 ? argv[3] : "";
        if (argc > 2 && !strcmp(argv[2], "--completion")) {
            if (!completion_write(of, commands, COMMANDS, stdout))
                return unknown_shell(of);
        } else if (argc > 2 && !strcmp(argv[2], "--man")) {
            if (*of && !find(of))
                return unknown(of);
            if (*of)
                man_command(find(of));
            else
                man();
        } else if (argc > 2 && !strcmp(argv[2], "--markdown"))
            markdown();
        else if (argc > 2 && find(argv[2]))
            options_help(find(argv[2]), false, stdout);
        else if (argc > 2 && strcmp(argv[2], "help") && strcmp(argv[2], "version"))
            return unknown(argv[2]);
        else
            usage(argc > 1 ? stdout : stderr);
        return argc > 1 ? flush_output(0) : STATUS_USAGE;
    }
    if (find(name))
        return flush_output(run(find(name), argc - 2, argv + 2));
    return unknown(name);
}
