/* SPDX-License-Identifier: Apache-2.0 */
/* splatguard compare: what runs cost and what they give, next to each other. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "interrupt.h"
#include "model_views.h"
#include "page.h"

struct compare_config {
    struct model_options m;
    bool json, csv;
    const char *html;
};

static const struct sg_option compare_options[] = {
    FLAG_ROW("json", offsetof(struct compare_config, json), "Print a JSON array, one object a run.",
             .group = "Output"),
    FLAG_ROW("csv", offsetof(struct compare_config, csv),
             "Print comma-separated values, one line a run.", .group = "Output"),
    TEXT_ROW("html", offsetof(struct compare_config, html), "FILE",
             "Write a page with the table and bars to FILE instead.", .group = "Output"),
    MODEL_ROWS(struct compare_config),
    {0},
};

static const struct option_part compare_parts[] = MODEL_PARTS(struct compare_config);

static void defaults(void *config)
{
    *(struct compare_config *) config = (struct compare_config){.m = model_options_default()};
}

/* The instance list is apart from the model, since it is most of what a poisoned scene costs. */
enum {
    MAX_GAUSSIANS,
    FINAL_GAUSSIANS,
    SECONDS,
    RSS,
    LEDGER,
    MODEL,
    INSTANCES,
    IMAGES,
    PAIRS,
    FPS,
    PSNR,
    SSIM,
    METRICS
};

static const struct {
    const char *key, *title, *format; /* NULL: three digits, or all before the point */
    double scale;
    bool ratio; /* means something */
    bool whole; /* a count */
} metrics[METRICS] = {
    [MAX_GAUSSIANS] = {"max_gaussians", "Gaussians, most", "%.0f", 1, true, true},
    [FINAL_GAUSSIANS] = {"final_gaussians", "Gaussians, final", "%.0f", 1, true, true},
    [SECONDS] = {"train_seconds", "training, s", NULL, 1, true, false},
    [RSS] = {"peak_rss_bytes", "process peak, MB", NULL, 1e-6, true, true},
    [LEDGER] = {"peak_ledger_bytes", "own peak, MB", NULL, 1e-6, true, true},
    [MODEL] = {"model_bytes", "  model and moments, MB", NULL, 1e-6, true, true},
    [INSTANCES] = {"instance_bytes", "  instance list, MB", NULL, 1e-6, true, true},
    [IMAGES] = {"image_bytes", "  images, MB", NULL, 1e-6, true, true},
    [PAIRS] = {"max_instances", "instances, most", "%.0f", 1, true, true},
    [FPS] = {"fps", "frames a second", "%.1f", 1, true, false},
    [PSNR] = {"psnr", "PSNR, dB", "%.2f", 1, false, false},
    [SSIM] = {"ssim", "SSIM", "%.4f", 1, false, false},
};

struct run {
    const char *path;
    double value[METRICS]; /* NaN = not known */
    double tested[2];      /* views and pixels that quality was measured on; NaN = not known */
};

static int read_run(struct run *r, const char *path)
{
    sg_ctx *ctx;
    sg_run_summary *s = NULL;
    int code = open_context(&ctx, 1, 0, true);
    r->path = path;
    if (!code)
        code = report(ctx, sg_run_summary_read(ctx, path, &s));
    for (int m = 0; m < METRICS && !code; m++)
        r->value[m] = sg_run_summary_number(s, metrics[m].key);
    if (!code) {
        r->value[MODEL] = sg_run_summary_number(s, "peak_ledger_bytes_by_tag.model") +
                          sg_run_summary_number(s, "peak_ledger_bytes_by_tag.optimiser");
        r->value[INSTANCES] = sg_run_summary_number(s, "peak_ledger_bytes_by_tag.instances");
        r->value[IMAGES] = sg_run_summary_number(s, "peak_ledger_bytes_by_tag.images");
        r->tested[0] = sg_run_summary_number(s, "test_views");
        r->tested[1] = sg_run_summary_number(s, "test_pixels");
        if (sg_run_summary_number(s, "interrupted") == 1)
            say(stderr, "warning: %s: the run was interrupted\n", path);
    }
    sg_run_summary_destroy(&s);
    sg_ctx_destroy(&ctx);
    return code;
}

/* Measured on the views of --scene, instead of by the run itself. */
static int measure(struct run *r, const struct compare_config *config, const bool *given)
{
    struct compare_config c = *config;
    struct model_views v;
    struct sg_eval e = {0};
    int code = model_views_open(&v, r->path, &command_compare, given, &c, &c.m);
    if (!code) {
        v.eval.fps = true;
        const int error = sg_evaluate(v.ctx, v.renderer, v.views, v.n, &v.eval, &e);
        code = error ? report(v.ctx, error) : 0;
        r->value[FPS] = e.fps, r->value[PSNR] = e.psnr, r->value[SSIM] = e.ssim;
        r->tested[0] = (double) v.n, r->tested[1] = 0;
        for (size_t i = 0; i < v.n; i++)
            r->tested[1] += (double) v.views[i].camera.width * (double) v.views[i].camera.height;
        sg_eval_clear(&e);
    }
    model_views_close(&v);
    return code;
}

/* Runs that were measured on other views than the first one, as far as that is known. With --scene
 * each has the options of its own photos, where the command line has none. */
static void warn_of_views(const struct run *runs, int n, bool scene)
{
    for (int i = 1; i < n; i++) {
        const struct run *a = &runs[0], *b = &runs[i];
        if (isfinite(a->value[PSNR]) && isfinite(b->value[PSNR]) &&
            (fabs(a->tested[0] - b->tested[0]) > 0 || fabs(a->tested[1] - b->tested[1]) > 0))
            say(stderr,
                "warning: %s: measured on %.0f test views with %.0f pixels, %s on %.0f with %.0f: "
                "%s\n",
                b->path, b->tested[0], b->tested[1], a->path, a->tested[0], a->tested[1],
                scene ? "options of the scene, as --downscale N, hold for all runs"
                      : "--scene measures all on the same");
    }
}

static double ratio(const struct run *runs, int i, int m)
{
    return runs[i].value[m] / runs[0].value[m];
}

/* Summaries are untrusted: a count may not be a whole number, or may be too large. */
static bool is_count(int metric, double value)
{
    return metrics[metric].whole && fabs(value) < 9e15 && value == floor(value);
}

/* The end of a path, of at most 20 bytes and whole characters. */
static void print_name(const char *path)
{
    char *text = strdup(path);
    if (text)
        make_printable(text); /* a line end in it too */
    const size_t length = text ? strlen(text) : 0;
    const char *end = text ? text + (length > 20 ? length - 20 : 0) : "";
    while ((*end & 0xc0) == 0x80)
        end++;
    printf("  %20s", end);
    free(text);
}

static int print_table(const struct run *runs, int n)
{
    char text[64];
    printf("%-24s", "");
    for (int i = 0; i < n; i++)
        print_name(runs[i].path);
    printf("\n");
    for (int m = 0; m < METRICS; m++) {
        printf("%-24s", metrics[m].title);
        for (int i = 0; i < n; i++) {
            char times[24] = "";
            const double v = runs[i].value[m] * metrics[m].scale;
            if (i && metrics[m].ratio && isfinite(ratio(runs, i, m)))
                snprintf(times, sizeof(times), " (%.2fx)", ratio(runs, i, m));
            snprintf(text, sizeof(text),
                     metrics[m].format ? metrics[m].format
                     : fabs(v) < 100   ? "%.3g"
                                       : "%.0f",
                     v);
            snprintf(text + strlen(text), sizeof(text) - strlen(text), "%s", times);
            printf("  %20s", isfinite(v) ? text : "-");
        }
        printf("\n");
    }
    return 0;
}

struct compared {
    const struct run *runs;
    int n;
};

static void put_value(FILE *f, const struct run *runs, int i, int m)
{
    const double v = runs[i].value[m] * metrics[m].scale;
    if (!isfinite(v)) {
        fprintf(f, "-");
        return;
    }
    fprintf(f, metrics[m].format ? metrics[m].format : fabs(v) < 100 ? "%.3g" : "%.0f", v);
    if (i && metrics[m].ratio && isfinite(ratio(runs, i, m)))
        fprintf(f, " (%.2fx)", ratio(runs, i, m));
}

/* A bar for each run, of a metric that can be compared by lengths. */
static void put_bars_of(FILE *f, const struct compared *c, int m)
{
    double most = 0;
    for (int i = 0; i < c->n; i++)
        most = fmax(most, isfinite(c->runs[i].value[m]) ? c->runs[i].value[m] : 0);
    if (!(most > 0))
        return;
    fprintf(f, "<h2>%s</h2>\n<div class=wide><table class=bars>\n", metrics[m].title);
    for (int i = 0; i < c->n; i++) {
        fprintf(f, "<tr><th scope=row>");
        put_name(f, c->runs[i].path);
        fprintf(f, "<td>");
        put_value(f, c->runs, i, m);
        put_bar(f, fmax(0, c->runs[i].value[m] / most)); /* 0 of NAN */
    }
    fprintf(f, "</table></div>\n");
}

static int put_comparison(FILE *f, const void *what)
{
    static const int shown[] = {MAX_GAUSSIANS, SECONDS, RSS, FPS};
    const struct compared *c = what;
    put_page_head(f, "Comparison", false);
    fprintf(f, "<div class=wide><table><tr><th>");
    for (int i = 0; i < c->n; i++) {
        fprintf(f, "<th scope=col>");
        put_name(f, c->runs[i].path);
    }
    for (int m = 0; m < METRICS; m++) {
        fprintf(f, "\n<tr><th scope=row>%s", metrics[m].title);
        for (int i = 0; i < c->n; i++) {
            fprintf(f, "<td>");
            put_value(f, c->runs, i, m);
        }
    }
    fprintf(f, "\n</table></div>\n<p>In brackets: how many times the first run's.\n");
    for (size_t k = 0; k < sizeof(shown) / sizeof(shown[0]); k++)
        put_bars_of(f, c, shown[k]);
    fprintf(f, "</body></html>\n");
    return STATUS_DONE;
}

/* Before runs are drawn, which can take long. */
static int check_html(const char *path)
{
    sg_ctx *ctx;
    int code = open_context(&ctx, 1, 0, true);
    if (!code)
        code = report(ctx, sg_output_check_file(ctx, path));
    sg_ctx_destroy(&ctx);
    return code;
}

static int print_csv(const struct run *runs, int n)
{
    printf("run");
    for (int m = 0; m < METRICS; m++)
        printf(",%s", metrics[m].key);
    printf("\n");
    for (int i = 0; i < n; i++) {
        put_csv_text(stdout, runs[i].path);
        for (int m = 0; m < METRICS; m++)
            if (isfinite(runs[i].value[m]))
                printf(is_count(m, runs[i].value[m]) ? ",%.0f" : ",%.10g", runs[i].value[m]);
            else
                printf(",");
        printf("\n");
    }
    return 0;
}

static int print_json(const struct run *runs, int n)
{
    json_t *list = json_array();
    for (int i = 0; i < n; i++) {
        json_t *r = json_pack("{s:o}", "run", text_json(runs[i].path)), *ratios = json_object();
        for (int m = 0; m < METRICS; m++) {
            const double v = runs[i].value[m];
            json_object_set_new(r, metrics[m].key,
                                is_count(m, v) ? json_integer((json_int_t) v) : number_json(v));
            if (metrics[m].ratio)
                json_object_set_new(ratios, metrics[m].key, number_json(ratio(runs, i, m)));
        }
        json_object_set_new(r, "ratios_to_first", ratios);
        json_array_append_new(list, r);
    }
    return json_print(list, 2);
}

/* Without --scene nothing is drawn: the numbers are those that the runs have written. */
static int check_unmeasured(const bool *given)
{
    const char *scene = options_given_of(&command_compare, given, &compare_parts[0], NULL),
               *render = options_given_of(&command_compare, given, &compare_parts[1], NULL),
               *name = scene ? scene : render;
    for (const struct sg_option *o = compare_options; o->name; o++)
        if (!strcmp(o->group, MODEL_GROUP) && strcmp(o->name, "quiet") &&
            options_given(&command_compare, given, o->offset))
            name = o->name;
    if (!name)
        return STATUS_DONE;
    say(stderr, "splatguard compare: --%s: found without effect, expected --scene with it\n", name);
    return STATUS_USAGE;
}

static int run_compare(const void *config, const bool *given, const char *const *positional,
                       int count)
{
    const struct compare_config *c = config;
    struct run *runs = calloc((size_t) count, sizeof(*runs));
    int code = runs ? 0 : no_memory();
    if (c->json + c->csv + !!c->html > 1) {
        say(stderr, "splatguard compare: --json, --csv and --html exclude each other\n");
        code = STATUS_USAGE;
    }
    if (!code && !c->m.scene_path)
        code = check_unmeasured(given);
    if (!code && c->html)
        code = check_html(c->html);
    if (!code)
        model_views_warn(&c->m);
    interrupt_catch();
    for (int i = 0; i < count && !code; i++) {
        code = read_run(&runs[i], positional[i]);
        if (!code && c->m.scene_path)
            code = measure(&runs[i], c, given);
    }
    if (!code)
        warn_of_views(runs, count, c->m.scene_path);
    if (!code && c->html) {
        code = write_whole("compare", c->html, &(struct compared){runs, count}, put_comparison);
        if (!code && !c->m.quiet)
            say(stderr, "page of %d run%s written to %s\n", count, count == 1 ? "" : "s", c->html);
    } else if (!code)
        code = (c->json ? print_json : c->csv ? print_csv : print_table)(runs, count);
    free(runs);
    return code;
}

const struct command command_compare = {
    .name = "compare",
    .arguments = "RUN... [--scene SCENE] [options]",
    .summary = "Compares the cost and the quality of runs.",
    .description = "Gaussians, time, memory by kind, rendering speed and quality of runs of "
                   "`splatguard train`, with ratios to the first. With --scene, PSNR, SSIM and "
                   "speed are measured anew on its views: give the clean scene to runs on poisoned "
                   "copies of it (and --downscale as the attack had it).",
    .groups = "Output|" MODEL_GROUPS,
    .options = compare_options,
    .parts = compare_parts,
    .config_size = sizeof(struct compare_config),
    .defaults = defaults,
    .min_positional = 1,
    .max_positional = OPTIONS_MAX_POSITIONAL,
    .run = run_compare,
};
