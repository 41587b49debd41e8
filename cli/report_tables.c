/* SPDX-License-Identifier: Apache-2.0 */
/* The tables of a report, as Markdown and as HTML. */
#include <math.h>
#include <string.h>

#include "page.h"
#include "report.h"

void put_text(FILE *f, enum format format, const char *text)
{
    if (format == HTML) {
        put_escaped(f, text);
        return;
    }
    for (const char *c = text; *c;) {
        char shown[SG_CHARACTER];
        const size_t n = sg_take_printable(&c, shown);
        if (strchr("|\\<>*`[]", *shown))
            fputc('\\', f);
        fwrite(shown, 1, n, f);
    }
}

void put_heading(FILE *f, enum format format, int level, const char *text)
{
    fprintf(f, format == HTML ? "<h%d>" : "\n%.*s ", level, "######");
    put_text(f, format, text);
    fprintf(f, format == HTML ? "</h%d>\n" : "\n\n", level);
}

void put_run_heading(FILE *f, enum format format, const char *text, const struct result *x)
{
    const bool named = strcmp(x->model, "default");
    char title[512];
    snprintf(title, sizeof(title), "%s%s%s", text, named ? ", model " : "", named ? x->model : "");
    put_heading(f, format, 2, title);
}

void begin_table(FILE *f, enum format format, const char *const *titles, int n)
{
    fprintf(f, format == HTML ? "<div class=wide><table><thead><tr>" : "|");
    for (int i = 0; i < n; i++) {
        fprintf(f, format == HTML ? "<th>" : " ");
        put_text(f, format, titles[i]);
        fprintf(f, format == HTML ? "</th>" : " |");
    }
    fprintf(f, format == HTML ? "</tr></thead><tbody>\n" : "\n|");
    for (int i = 0; i < n && format == MARKDOWN; i++)
        fprintf(f, i ? "---:|" : "---|");
    fprintf(f, format == HTML ? "" : "\n");
}

void begin_row(FILE *f, enum format format, const char *name)
{
    fprintf(f, format == HTML ? "<tr><th>" : "| ");
    put_text(f, format, name);
    fprintf(f, format == HTML ? "</th>" : " |");
}

void end_row(FILE *f, enum format format)
{
    fprintf(f, format == HTML ? "</tr>\n" : "\n");
}

void end_table(FILE *f, enum format format)
{
    fprintf(f, format == HTML ? "</tbody></table></div>\n" : "\n");
}

void put_cell(FILE *f, enum format format, const char *text)
{
    fprintf(f, format == HTML ? "<td>" : " ");
    put_text(f, format, text);
    fprintf(f, format == HTML ? "</td>" : " |");
}

/* A stranger's database may have numbers of hundreds of digits. */
static const char *text_of(double x, int digits, char text[48])
{
    snprintf(text, 48, fabs(x) < 1e15 ? "%.*f" : "%.*e", digits, x);
    return text;
}

void put_number(FILE *f, enum format format, double mean, double deviation, int digits)
{
    char text[112] = "", a[48], b[48];
    if (isfinite(mean) && isfinite(deviation))
        snprintf(text, sizeof(text), "%s \u00b1 %s", text_of(mean, digits, a),
                 text_of(deviation, digits, b));
    else if (isfinite(mean))
        snprintf(text, sizeof(text), "%s", text_of(mean, digits, a));
    put_cell(f, format, text);
}

static bool same_block(const struct result *a, const struct result *b)
{
    return same_scene(a, b) && !strcmp(a->photos, b->photos);
}

/* A scene's runs on some photos: one row a defense. */
static void put_defenses(FILE *f, const struct report *r, enum format format, size_t from)
{
    static const char *const titles[] = {
        "defense", "n",   "Gaussians at most", "of clean",  "left", "PSNR",
        "SSIM",    "FPS", "training, s",       "memory, MB"};
    const struct result *x = r->groups[from].first;
    const struct group *clean = report_find(r, &r->groups[from], CLEAN, OFF);
    begin_table(f, format, titles, 10);
    for (size_t i = from; i < r->n_groups; i++) {
        const struct group *g = &r->groups[i];
        char n[32];
        if (!same_block(g->first, x))
            continue;
        begin_row(f, format, g->first->defense);
        snprintf(n, sizeof(n), g->runs < g->cells ? "%d of %d" : "%d", g->runs, g->cells);
        put_cell(f, format, n);
        if (g->runs) {
            put_number(f, format, g->mean[M_MAX_GAUSSIANS], g->deviation[M_MAX_GAUSSIANS], 0);
            const struct spread of = report_shares(g, clean, M_MAX_GAUSSIANS);
            put_number(f, format, of.mean, of.deviation, 2);
            for (int m = M_GAUSSIANS; m <= M_MEMORY; m++)
                put_number(f, format, g->mean[m], g->deviation[m], metric_columns[m].digits);
        } else
            for (int k = 0; k < 8; k++) /* a cell without a run says so */
                put_cell(f, format, k ? "" : g->why);
        end_row(f, format);
    }
    end_table(f, format);
}

/* The first of its scene, photos and model. */
static bool begins_block(const struct report *r, size_t i)
{
    for (size_t k = 0; k < i; k++)
        if (same_block(r->groups[k].first, r->groups[i].first))
            return false;
    return true;
}

static void put_share(FILE *f, enum format format, size_t part, size_t whole)
{
    put_number(f, format, whole ? 100 * (double) part / (double) whole : NAN, NAN, 0);
}

static void put_audit_row(FILE *f, enum format format, const struct audit_row *row)
{
    const struct audit *a = row->first;
    char text[256];
    snprintf(text, sizeof(text), "%s, %s", row->all ? "all scenes" : a->scene, a->photos);
    begin_row(f, format, text);
    if (!row->n) { /* an audit without a result says so */
        put_cell(f, format, *a->status ? a->status : "not run");
        for (int k = 0; k < 6; k++)
            put_cell(f, format, "");
        end_row(f, format);
        return;
    }
    put_cell(f, format, row->all ? "" : a->verdict);
    snprintf(text, sizeof(text), "%zu", row->n);
    put_cell(f, format, text);
    put_share(f, format, row->verdicts[SG_AUDIT_POISONED], row->n);
    put_share(f, format, row->verdicts[SG_AUDIT_SUSPICIOUS], row->n);
    put_share(f, format, row->verdicts[SG_AUDIT_CLEAN], row->n);
    const struct roc *roc = &row->roc;
    put_number(f, format, roc->points ? roc->area : NAN, NAN, 3);
    if (roc->points)
        snprintf(text, sizeof(text), "%.3f to %.3f", roc->interval[0], roc->interval[1]);
    else
        snprintf(text, sizeof(text), "%s", strcmp(a->photos, CLEAN) ? "no clean photos" : "");
    put_cell(f, format, text);
    end_row(f, format);
}

static void put_audits(FILE *f, const struct report *r, enum format format)
{
    static const char *const titles[] = {"scene, photos", "set",      "n",   "poisoned, %",
                                         "suspicious, %", "clean, %", "AUC", "95 % interval"};
    for (size_t i = 0; i < r->n_audit_rows; i++) {
        const char *plan = r->audit_rows[i].first->plan;
        bool first = true;
        char title[256];
        for (size_t k = 0; k < i && first; k++)
            first = strcmp(r->audit_rows[k].first->plan, plan);
        if (!first)
            continue;
        snprintf(title, sizeof(title), "%s: verdicts of the audit on single photos", plan);
        put_heading(f, format, 2, title);
        begin_table(f, format, titles, 8);
        for (size_t k = i; k < r->n_audit_rows; k++)
            if (!strcmp(r->audit_rows[k].first->plan, plan))
                put_audit_row(f, format, &r->audit_rows[k]);
        end_table(f, format);
        fprintf(f,
                "%sAUC: how often one of these photos scores higher than a clean one; a tie counts "
                "one half. Interval: of 1 000 bootstrap samples of the photos.%s\n",
                format == HTML ? "<p>" : "", format == HTML ? "</p>" : "");
    }
}

static void put_failures(FILE *f, const struct report *r, enum format format)
{
    static const char *const titles[] = {"run", "status", "message"}, *const obstacles[] = {
                                                                          "job", "status",
                                                                          "message", "command"};
    bool any = false;
    for (size_t i = 0; i < r->n; i++) {
        const struct result *x = &r->results[i];
        char name[256];
        if (!strcmp(x->status, "done"))
            continue;
        if (!any) {
            put_heading(f, format, 2, "Runs without a result");
            begin_table(f, format, titles, 3);
        }
        any = true;
        snprintf(name, sizeof(name), "%s: %s, %s, %s, %s, seed %d", x->plan, x->scene, x->photos,
                 x->defense, x->model, x->seed);
        begin_row(f, format, name);
        put_cell(f, format, *x->status ? x->status : "not run");
        put_cell(f, format, x->message);
        end_row(f, format);
    }
    if (any)
        end_table(f, format);
    for (size_t i = 0; i < r->n_obstacles; i++) {
        const struct obstacle *o = &r->obstacles[i];
        if (!i) {
            put_heading(f, format, 2, "Jobs without a result, also those of earlier plans");
            begin_table(f, format, obstacles, 4);
        }
        begin_row(f, format, o->kind);
        put_cell(f, format, o->status), put_cell(f, format, o->message);
        put_cell(f, format, o->command);
        end_row(f, format);
    }
    if (r->n_obstacles)
        end_table(f, format);
}

/* The commits and machines of the runs, each once. */
static void put_each(FILE *f, const struct report *r, enum format format, const char *what,
                     bool machine)
{
    int n = 0;
    fputs(what, f);
    for (size_t i = 0; i < r->n; i++) {
        const char *name = machine ? r->results[i].machine : r->results[i].commit;
        bool first = *name;
        for (size_t k = 0; k < i && first; k++)
            first = strcmp(machine ? r->results[k].machine : r->results[k].commit, name);
        if (!first)
            continue;
        fputs(n++ ? "; " : "", f);
        put_text(f, format, name);
    }
}

/* Whether all that is done ran on one machine, with one version and number of threads. Prunings do
 * not say their threads. */
static bool times_agree(const struct report *r)
{
    const struct result *first = NULL;
    double threads = NAN;
    for (size_t i = 0; i < r->n; i++) {
        const struct result *x = &r->results[i];
        const double n = x->value[M_THREADS];
        if (strcmp(x->status, "done"))
            continue;
        first = first ? first : x;
        threads = isnan(threads) ? n : threads;
        if (strcmp(x->machine, first->machine) || strcmp(x->commit, first->commit) || n < threads ||
            n > threads)
            return false;
    }
    return true;
}

static void put_about(FILE *f, const struct report *r, enum format format)
{
    const bool agree = times_agree(r);
    size_t done = 0, beside = 0;
    for (size_t i = 0; i < r->n; i++)
        if (!strcmp(r->results[i].status, "done"))
            done++, beside += !r->results[i].alone;
    fprintf(f, "%s%zu of %zu runs are done", format == HTML ? "<p>" : "", done, r->n);
    if (done) {
        put_each(f, r, format, ": commits ", false);
        put_each(f, r, format, ", on ", true);
    }
    fprintf(
        f,
        ".%sn: seeds of the training, after \u00b1 the standard deviation over them; proxies "
        "and poisons have one seed. PSNR and SSIM are means over the test views of the clean "
        "scene. Ratios are to runs with the same seed. Memory is what the library holds.%s%s%s%s",
        format == HTML ? " " : "\n",
        beside ? " Times and frames per second of runs that shared the machine are not "
                 "comparable."
               : "",
        agree ? ""
              : " Times and frames per second of runs with different machines, commits or "
                "numbers of threads are not comparable.",
        done && !beside && agree
            ? " One of these runs ran at a time: times can be compared if nothing else used "
              "the machine."
            : "",
        format == HTML ? "</p>\n" : "\n");
}

void put_tables(FILE *f, const struct report *r, enum format format)
{
    put_about(f, r, format);
    put_sides(f, r, format);
    put_limits(f, r, format);
    put_papers(f, r, format);
    for (size_t i = 0; i < r->n_groups; i++) {
        const struct result *x = r->groups[i].first;
        char title[256];
        if (!begins_block(r, i))
            continue;
        snprintf(title, sizeof(title), "%s: %s, photos %s", x->plan, x->scene, x->photos);
        put_run_heading(f, format, title, x);
        put_defenses(f, r, format, i);
    }
    put_audits(f, r, format);
    put_failures(f, r, format);
    put_plans(f, r, format);
}

void put_csv(FILE *f, const struct report *r)
{
    fprintf(f, "plan,scene,photos,defense,model,seed,status,alone,commit,machine,engine,seconds");
    for (int m = 0; m < M_METRICS; m++)
        fprintf(f, ",%s", metric_columns[m].name);
    fprintf(f, "\n");
    for (size_t i = 0; i < r->n; i++) {
        const struct result *x = &r->results[i];
        const char *const texts[] = {x->plan, x->scene, x->photos, x->defense, x->model};
        for (int k = 0; k < 5; k++)
            put_csv_text(f, texts[k]), fputc(',', f);
        fprintf(f, "%d,", x->seed);
        put_csv_text(f, *x->status ? x->status : "not run");
        fprintf(f, ",%d,", x->alone);
        put_csv_text(f, x->commit), fputc(',', f);
        put_csv_text(f, x->machine), fputc(',', f);
        put_csv_text(f, x->engine), fputc(',', f);
        if (isfinite(x->seconds))
            fprintf(f, "%.3f", x->seconds);
        for (int m = 0; m < M_METRICS; m++) {
            fputc(',', f);
            if (isfinite(x->value[m]))
                fprintf(f, "%.10g", x->value[m]);
        }
        fprintf(f, "\n");
    }
}
