/* SPDX-License-Identifier: Apache-2.0 */
#include <limits.h>
#include <string.h>

#include "interrupt.h"
#include "model_views.h"
#include "page.h"
#include "report.h"

struct report_config {
    struct model_options m; /* of a run's pictures */
    const char *output;
};

static const struct sg_option report_options[] = {
    TEXT_ROW("output", offsetof(struct report_config, output), "DIR",
             "Folder to write report.html to, and of a bench report.md and results.csv.",
             .letter = 'o'),
    TEXT_ROW("scene", offsetof(struct report_config, m.scene_path), "SCENE",
             "The photos of a run; it knows its own.", .letter = 's'),
    NUMBER_ROW("max-memory", SG_OPTION_BYTES, offsetof(struct report_config, m.max_memory), 0, 9e15,
               "BYTES", "Most memory of the process for the report of a run; 0 = no limit."),
    FLAG_ROW("quiet", offsetof(struct report_config, m.quiet), "Warnings only.", .letter = 'q'),
    {0},
};

static void defaults(void *config)
{
    *(struct report_config *) config = (struct report_config){.m = model_options_default()};
}

/* Tables end early then, and are not kept. */
static int cancelled(void)
{
    return interrupted() ? report(NULL, SG_ERR_INTERRUPTED) : STATUS_DONE;
}

static int put_markdown(FILE *f, const void *r)
{
    fprintf(f, "# Report\n\n");
    put_tables(f, r, MARKDOWN);
    return cancelled();
}

static int put_values(FILE *f, const void *r)
{
    put_csv(f, r);
    return STATUS_DONE;
}

static int put_html(FILE *f, const void *r)
{
    put_page(f, r);
    return cancelled();
}

static int write_file(const char *folder, const char *name, const void *what,
                      int (*put)(FILE *, const void *))
{
    char path[PATH_MAX];
    if (snprintf(path, sizeof(path), "%s/%s", folder, name) >= (int) sizeof(path) - 32) {
        say(stderr, "splatguard report: %s: the name is too long\n", folder);
        return STATUS_INPUT;
    }
    return write_whole("report", path, what, put);
}

struct run_page {
    const char *folder;
    sg_run_summary *summary;
    struct sg_run_params params;
    struct model_views views;
    bool pictures;
};

static int put_run_page(FILE *f, const void *what)
{
    const struct run_page *r = what;
    struct model_views views = r->views;
    return put_run(f, r->folder, r->summary, &r->params, r->pictures ? &views : NULL);
}

/* Without its photos a run still has a page. A scene that was named must be there. */
static int open_pictures(struct run_page *r, struct report_config *c, const bool *given)
{
    const bool named = c->m.scene_path;
    c->m.split = r->params.scene.eval ? 0 : 1;
    const int code = model_views_open(&r->views, r->folder, &command_report, given, c, &c->m);
    r->pictures = !code;
    if (named || (code != STATUS_INPUT && code != STATUS_USAGE))
        return code;
    say(stderr, "warning: the page has no pictures\n");
    return STATUS_DONE;
}

static int report_of_run(const char *folder, struct report_config *c, const bool *given)
{
    struct run_page r = {.folder = folder, .params = sg_run_params_default()};
    sg_ctx *ctx = NULL;
    sg_output *output = NULL;
    int code = open_context(&ctx, 1, c->m.max_memory, c->m.quiet);
    if (!code)
        code = report(ctx, sg_run_summary_read(ctx, folder, &r.summary));
    if (!code)
        code = report(ctx, sg_run_read_params(ctx, folder, &r.params));
    if (!code)
        code = report(ctx, sg_output_claim(ctx, c->output, "report", true,
                                           (const char *[]){folder, NULL}, &output));
    if (!code)
        code = open_pictures(&r, c, given);
    if (!code)
        code = write_file(c->output, "report.html", &r, put_run_page);
    if (!code && !c->m.quiet)
        say(stderr, "page of %s written to %s/report.html\n", folder, c->output);
    model_views_close(&r.views);
    sg_output_release(&output);
    sg_run_summary_destroy(&r.summary);
    sg_run_params_clear(&r.params);
    sg_ctx_destroy(&ctx);
    return code;
}

static int run_report(const void *config, const bool *given, const char *const *positional,
                      int count)
{
    struct report_config copy = *(const struct report_config *) config, *c = &copy;
    struct report r = {0};
    sg_output *output = NULL;
    sg_ctx *ctx = NULL;
    if (!c->output)
        return missing(&command_report, "-o DIR");
    interrupt_catch();
    if (count == 1 && is_folder(positional[0]))
        return report_of_run(positional[0], c, given);
    if (c->m.scene_path || c->m.max_memory) {
        say(stderr,
            "splatguard report: --%s: found without effect on a database, expected the folder of a "
            "run\n",
            c->m.scene_path ? "scene" : "max-memory");
        return STATUS_USAGE;
    }
    int code = STATUS_DONE;
    for (int i = 0; i < count && !code && !interrupted(); i++)
        if (is_folder(positional[i])) {
            say(stderr,
                "splatguard report: %s: found a folder among several arguments, expected one run, "
                "or databases of benches\n",
                positional[i]);
            code = STATUS_USAGE;
        } else
            code = report_load(&r, positional[i]);
    if (!code && !interrupted() && !r.n) {
        say(stderr, "splatguard report: %s: found no plan, expected the database of a bench\n",
            positional[0]);
        code = STATUS_INPUT;
    }
    if (!code)
        code = report_group(&r);
    if (!code)
        code = report_audits(&r);
    if (!code)
        code = cancelled();
    if (!code)
        code = open_context(&ctx, 1, 0, c->m.quiet);
    if (!code)
        code = report(ctx, sg_output_claim(ctx, c->output, "report", true, NULL, &output));
    if (!code)
        code = write_file(c->output, "report.md", &r, put_markdown);
    if (!code)
        code = write_file(c->output, "results.csv", &r, put_values);
    if (!code)
        code = write_file(c->output, "report.html", &r, put_html);
    if (!code && !c->m.quiet)
        say(stderr, "results of %zu runs written to %s/report.html, report.md and results.csv\n",
            r.n, c->output);
    sg_output_release(&output);
    sg_ctx_destroy(&ctx);
    report_clear(&r);
    return code;
}

const struct command command_report = {
    .name = "report",
    .arguments = "RUN|DB... -o DIR",
    .summary = "Makes a page of a run, or of the results of a bench.",
    .description =
        "Of a run of `splatguard train`: report.html with its growth, its budgets, where time and "
        "memory went, and pictures next to the photos. Of databases of `splatguard bench`: "
        "report.md, "
        "results.csv and report.html with tables and figures. A page needs no other file and no "
        "network.",
    .options = report_options,
    .config_size = sizeof(struct report_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = OPTIONS_MAX_POSITIONAL,
    .run = run_report,
};
