/* SPDX-License-Identifier: Apache-2.0 */
/* The tables of a report, as Markdown and as HTML. */
#include <math.h>
#include <string.h>

#include "page.h"
#include "report.h"

static void put_text(FILE *f, enum format format, const char *text)
{
    if (format == HTML) {
        put_escaped(f, text);
        return;
    }
    for (const char *c = text; *c;) {
        const char shown = take_printable(&c);
        if (strchr("|\\<>*`[]", shown))
            fputc('\\', f);
        fputc(shown, f);
    }
}

static void heading(FILE *f, enum format format, int level, const char *text)
{
    fprintf(f, format == HTML ? "<h%d>" : "\n%.*s ", level, "######");
    put_text(f, format, text);
    fprintf(f, format == HTML ? "</h%d>\n" : "\n\n", level);
}

static void begin_table(FILE *f, enum format format, const char *const *titles, int n)
{
    fprintf(f, format == HTML ? "<table><thead><tr>" : "|");
    for (int i = 0; i < n; i++)
        fprintf(f, format == HTML ? "<th>%s</th>" : " %s |", titles[i]);
    fprintf(f, format == HTML ? "</tr></thead><tbody>\n" : "\n|");
    for (int i = 0; i < n && format == MARKDOWN; i++)
        fprintf(f, i ? "---:|" : "---|");
    fprintf(f, format == HTML ? "" : "\n");
}

static void begin_row(FILE *f, enum format format, const char *name)
{
    fprintf(f, format == HTML ? "<tr><th>" : "| ");
    put_text(f, format, name);
    fprintf(f, format == HTML ? "</th>" : " |");
}

static void end_row(FILE *f, enum format format)
{
    fprintf(f, format == HTML ? "</tr>\n" : "\n");
}

static void end_table(FILE *f, enum format format)
{
    fprintf(f, format == HTML ? "</tbody></table>\n" : "\n");
}

static void put_cell(FILE *f, enum format format, const char *text)
{
    fprintf(f, format == HTML ? "<td>" : " ");
    put_text(f, format, text);
    fprintf(f, format == HTML ? "</td>" : " |");
}

static void put_number(FILE *f, enum format format, double mean, double deviation, int digits)
{
    char text[96] = "";
    if (isfinite(mean))
        snprintf(text, sizeof(text), "%.*f", digits, mean);
    if (isfinite(mean) && isfinite(deviation))
        snprintf(text + strlen(text), sizeof(text) - strlen(text), " \u00b1 %.*f", digits,
                 deviation);
    put_cell(f, format, text);
}

static void put_ratio(FILE *f, enum format format, const struct group *g, const struct group *to)
{
    put_number(f, format, to ? g->mean[M_MAX_GAUSSIANS] / to->mean[M_MAX_GAUSSIANS] : NAN, NAN, 2);
}

static bool same_scene(const struct result *a, const struct result *b)
{
    return !strcmp(a->plan, b->plan) && !strcmp(a->scene, b->scene) && !strcmp(a->model, b->model);
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
            put_ratio(f, format, g, clean);
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

/* Ratios of Gaussians, Lu et al.'s attack and the spectral defense as their paper prints them, at
 * epsilon 16 and full size. */
static const struct {
    const char *scene;
    double poison, defense;
} published[] = {{"lego", 2.35, 2.89},  {"bonsai", 4.82, 5.92}, {"garden", 1.36, 4.57},
                 {"train", 1.19, 2.67}, {"chair", 1.96, 3.46},  {"hotdog", 6.14, 3.71}};
/* Quality on poisoned photos, measured on clean ones. */
static const struct {
    const char *scene, *defense;
    double psnr, ssim;
} quality[] = {{"bonsai", "off", 27.14, 0.64},
               {"bonsai", "ut", 22.68, 0.75},
               {"bonsai", "lightgaussian", 27.05, 0.67},
               {"bonsai", "pup", 26.81, 0.69},
               {"bonsai", "spectral", 29.07, 0.84},
               {"garden", "off", 24.63, 0.65},
               {"garden", "ut", 18.99, 0.47},
               {"garden", "lightgaussian", 24.05, 0.64},
               {"garden", "pup", 23.77, 0.64},
               {"garden", "spectral", 25.13, 0.73},
               {"chair", "off", 24.60, 0.22},
               {"chair", "spectral", 25.00, 0.23}};
#define COUNT(list) (sizeof(list) / sizeof(list[0]))

static void put_published(FILE *f, const struct report *r, enum format format)
{
    static const char *const titles[] = {"scene", "poison of clean", "paper", "poison of spectral",
                                         "paper"};
    bool any = false;
    for (size_t i = 0; i < r->n_groups; i++) {
        const struct group *g = &r->groups[i], *poison = report_find(r, g, "eps16", OFF),
                           *defense = report_find(r, g, "eps16", "spectral");
        size_t k = 0;
        while (k < COUNT(published) && strcmp(published[k].scene, g->first->scene))
            k++;
        if (k == COUNT(published) || strcmp(g->first->photos, CLEAN) ||
            strcmp(g->first->defense, OFF) || !poison)
            continue;
        if (!any) {
            heading(f, format, 2, "Next to the paper: most Gaussians, epsilon 16");
            begin_table(f, format, titles, 5);
        }
        any = true;
        begin_row(f, format, g->first->scene);
        put_ratio(f, format, poison, g);
        put_number(f, format, published[k].poison, NAN, 2);
        if (defense)
            put_ratio(f, format, poison, defense);
        else
            put_cell(f, format, "");
        put_number(f, format, published[k].defense, NAN, 2);
        end_row(f, format);
    }
    if (any)
        end_table(f, format);
}

static void put_quality(FILE *f, const struct report *r, enum format format)
{
    static const char *const titles[] = {"scene, defense", "PSNR", "paper", "SSIM", "paper"};
    bool any = false;
    for (size_t i = 0; i < r->n_groups; i++) {
        const struct group *g = &r->groups[i];
        char name[128];
        for (size_t k = 0; k < COUNT(quality); k++) {
            if (strcmp(quality[k].scene, g->first->scene) ||
                strcmp(quality[k].defense, g->first->defense) || strcmp(g->first->photos, "eps16"))
                continue;
            if (!any) {
                heading(f, format, 2, "Next to the paper: quality on poisoned photos");
                begin_table(f, format, titles, 5);
            }
            any = true;
            snprintf(name, sizeof(name), "%s, %s", g->first->scene, g->first->defense);
            begin_row(f, format, name);
            put_number(f, format, g->mean[M_PSNR], g->deviation[M_PSNR], 2);
            put_number(f, format, quality[k].psnr, NAN, 2);
            put_number(f, format, g->mean[M_SSIM], g->deviation[M_SSIM], 4);
            put_number(f, format, quality[k].ssim, NAN, 2);
            end_row(f, format);
        }
    }
    if (any)
        end_table(f, format);
}

static bool is_limited(const struct report *r, const struct group *g)
{
    return g->runs && report_limit(r, g->first) > 0;
}

/* Those of one scene, from its first one on: who is better with as many Gaussians. */
static void put_limited(FILE *f, const struct report *r, enum format format, size_t from)
{
    static const char *const titles[] = {"limit, defense, photos", "n", "Gaussians", "PSNR", "SSIM",
                                         "PSNR without a limit"};
    const struct result *scene = r->groups[from].first;
    char name[256], n[16];
    snprintf(name, sizeof(name), "%s: %s, limits in shares of the clean count", scene->plan,
             scene->scene);
    heading(f, format, 2, name);
    begin_table(f, format, titles, 6);
    for (size_t i = from; i < r->n_groups; i++) {
        const struct group *g = &r->groups[i], *off = report_find(r, g, g->first->photos, OFF);
        if (!is_limited(r, g) || !same_scene(g->first, scene))
            continue;
        snprintf(name, sizeof(name), "%.2f, %s, %s", report_limit(r, g->first), g->first->defense,
                 g->first->photos);
        begin_row(f, format, name);
        snprintf(n, sizeof(n), "%d", g->runs);
        put_cell(f, format, n);
        put_number(f, format, g->mean[M_GAUSSIANS], g->deviation[M_GAUSSIANS], 0);
        put_number(f, format, g->mean[M_PSNR], g->deviation[M_PSNR], 2);
        put_number(f, format, g->mean[M_SSIM], g->deviation[M_SSIM], 4);
        put_number(f, format, off ? off->mean[M_PSNR] : NAN, NAN, 2);
        end_row(f, format);
    }
    end_table(f, format);
}

static void put_limits(FILE *f, const struct report *r, enum format format)
{
    for (size_t i = 0; i < r->n_groups; i++) {
        bool first = is_limited(r, &r->groups[i]);
        for (size_t k = 0; k < i && first; k++)
            first = !is_limited(r, &r->groups[k]) ||
                    !same_scene(r->groups[k].first, r->groups[i].first);
        if (first)
            put_limited(f, r, format, i);
    }
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
        heading(f, format, 2, title);
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
    static const char *const titles[] = {"run", "status", "message"};
    bool any = false;
    for (size_t i = 0; i < r->n; i++) {
        const struct result *x = &r->results[i];
        char name[256];
        if (!strcmp(x->status, "done"))
            continue;
        if (!any) {
            heading(f, format, 2, "Runs without a result");
            begin_table(f, format, titles, 3);
        }
        any = true;
        snprintf(name, sizeof(name), "%s, %s, %s, %s, seed %d", x->scene, x->photos, x->defense,
                 x->model, x->seed);
        begin_row(f, format, name);
        put_cell(f, format, *x->status ? x->status : "not run");
        put_cell(f, format, x->message);
        end_row(f, format);
    }
    if (any)
        end_table(f, format);
}

static void put_about(FILE *f, const struct report *r, enum format format)
{
    size_t done = 0, beside = 0;
    const struct result *last = NULL;
    for (size_t i = 0; i < r->n; i++)
        if (!strcmp(r->results[i].status, "done")) {
            last = &r->results[i];
            done++, beside += !last->alone;
        }
    fprintf(f, "%s%zu of %zu runs are done.", format == HTML ? "<p>" : "", done, r->n);
    if (last) {
        fprintf(f, " The last one is of commit ");
        put_text(f, format, last->commit);
        fprintf(f, ", on ");
        put_text(f, format, last->machine);
        fprintf(f, ".");
    }
    fprintf(f,
            "%sn: seeds; after \u00b1: standard deviation over them. PSNR and SSIM are means "
            "over the test views of the clean scene.%s%s",
            format == HTML ? " " : "\n",
            beside ? " Times and frames per second of runs that shared "
                     "the machine are not comparable."
                   : "",
            format == HTML ? "</p>\n" : "\n");
}

void put_tables(FILE *f, const struct report *r, enum format format)
{
    put_about(f, r, format);
    put_published(f, r, format);
    put_quality(f, r, format);
    for (size_t i = 0; i < r->n_groups; i++) {
        const struct result *x = r->groups[i].first;
        char title[256];
        if (!begins_block(r, i))
            continue;
        snprintf(title, sizeof(title), "%s: %s, photos %s%s%s", x->plan, x->scene, x->photos,
                 strcmp(x->model, "default") ? ", model " : "",
                 strcmp(x->model, "default") ? x->model : "");
        heading(f, format, 2, title);
        put_defenses(f, r, format, i);
    }
    put_limits(f, r, format);
    put_audits(f, r, format);
    put_failures(f, r, format);
}

/* Spreadsheets compute what begins like a formula: a quote before it makes it a text. */
static void put_csv_text(FILE *f, const char *text)
{
    const bool quoted = strpbrk(text, ",\"\n\r");
    fputs(quoted ? "\"" : "", f);
    fputs(*text && strchr("=+-@", *text) ? "'" : "", f);
    for (const char *c = text; *c;) {
        const char shown = take_printable(&c);
        if (shown == '"')
            fputc('"', f);
        fputc(shown, f);
    }
    fputs(quoted ? "\"," : ",", f);
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
            put_csv_text(f, texts[k]);
        fprintf(f, "%d,", x->seed);
        put_csv_text(f, *x->status ? x->status : "not run");
        fprintf(f, "%d,", x->alone);
        put_csv_text(f, x->commit);
        put_csv_text(f, x->machine);
        put_csv_text(f, x->engine);
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
