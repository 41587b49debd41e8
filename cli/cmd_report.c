/* SPDX-License-Identifier: Apache-2.0 */
#include <errno.h>
#include <limits.h>
#include <string.h>
#include <unistd.h>

#include "report.h"

struct report_config {
    const char *output;
    bool quiet;
};

static const struct sg_option report_options[] = {
    TEXT_ROW("output", offsetof(struct report_config, output), "DIR",
             "Folder to write report.md, results.csv and report.html to.", .letter = 'o'),
    FLAG_ROW("quiet", offsetof(struct report_config, quiet), "Warnings only.", .letter = 'q'),
    {0},
};

static void defaults(void *config)
{
    memset(config, 0, sizeof(struct report_config));
}

static void put_markdown(FILE *f, const struct report *r)
{
    fprintf(f, "# Report\n\n");
    put_tables(f, r, MARKDOWN);
}

/* The file appears whole or not at all. */
static int write_file(const char *folder, const char *name, const struct report *r,
                      void (*put)(FILE *, const struct report *))
{
    char path[PATH_MAX], temporary[PATH_MAX];
    if (snprintf(path, sizeof(path), "%s/%s", folder, name) >= (int) sizeof(path) - 8)
        return STATUS_USAGE;
    snprintf(temporary, sizeof(temporary), "%.*s.tmp", (int) sizeof(temporary) - 5, path);
    unlink(temporary);
    FILE *f = fopen(temporary, "wx");
    errno = f ? 0 : errno;
    if (f)
        put(f, r);
    const bool whole = f && !fflush(f) && !ferror(f) && !fsync(fileno(f));
    const int error = errno;
    if (f)
        fclose(f);
    if (whole && !rename(temporary, path))
        return STATUS_DONE;
    say(stderr, "splatguard report: %s: cannot write: %s\n", path, strerror(error ? error : EIO));
    unlink(temporary);
    return STATUS_INPUT;
}

static int run_report(const void *config, const bool *given, const char *const *positional,
                      int count)
{
    (void) given;
    const struct report_config *c = config;
    struct report r = {0};
    sg_output *output = NULL;
    sg_ctx *ctx = NULL;
    if (!c->output)
        return missing(&command_report, "-o DIR");
    int code = STATUS_DONE;
    for (int i = 0; i < count && !code; i++)
        code = report_load(&r, positional[i]);
    if (!code && !r.n) {
        say(stderr, "splatguard report: %s: found no plan, expected the database of a bench\n",
            positional[0]);
        code = STATUS_INPUT;
    }
    if (!code)
        code = report_group(&r);
    if (!code)
        code = open_context(&ctx, 1, 0, c->quiet);
    if (!code)
        code = report(ctx, sg_output_claim(ctx, c->output, "report", true, NULL, &output));
    if (!code)
        code = write_file(c->output, "report.md", &r, put_markdown);
    if (!code)
        code = write_file(c->output, "results.csv", &r, put_csv);
    if (!code)
        code = write_file(c->output, "report.html", &r, put_page);
    sg_output_release(&output);
    sg_ctx_destroy(&ctx);
    report_clear(&r);
    return code;
}

const struct command command_report = {
    .name = "report",
    .arguments = "DB... -o DIR",
    .summary = "Makes tables and figures of the results of a bench.",
    .description =
        "Reads databases of `splatguard bench` and writes report.md, results.csv and report.html, "
        "one page with tables and figures that needs no other file and no network.",
    .options = report_options,
    .config_size = sizeof(struct report_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = OPTIONS_MAX_POSITIONAL,
    .run = run_report,
};
