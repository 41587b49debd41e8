/* SPDX-License-Identifier: Apache-2.0 */
/* Tables of a report that compare: with the paper, photos side by side, at equal count. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "interrupt.h"
#include "report.h"

/* Ratios are to runs with the same seeds. */
static void put_spread(FILE *f, enum format format, struct spread s, int digits)
{
    put_number(f, format, s.mean, s.deviation, digits);
}

/* ---- next to the paper ---- */

static double ratio(double a, double b)
{
    return a > 0 && b > 0 ? a / b : NAN;
}

static void put_paper_row(FILE *f, const struct report *r, enum format format,
                          const struct group *g, const struct paper_row *p)
{
    const struct group *clean = report_find(r, g, CLEAN, OFF),
                       *off = report_find(r, g, g->first->photos, OFF);
    const struct paper_row *paper_clean = report_paper(p->scene, CLEAN, OFF, p->model),
                           *paper_off = report_paper(p->scene, p->photos, OFF, p->model);
    char name[256];
    snprintf(name, sizeof(name), "%s, %s, %s%s%s", p->scene, p->photos, p->defense,
             strcmp(p->model, "default") ? ", " : "", strcmp(p->model, "default") ? p->model : "");
    begin_row(f, format, name);
    snprintf(name, sizeof(name), "%d", g->runs);
    put_cell(f, format, name);
    put_spread(f, format, report_shares(g, clean, M_MAX_GAUSSIANS), 2);
    put_number(f, format, report_paper_growth(p), NAN, 2);
    put_spread(f, format, report_shares(g, off, M_MAX_GAUSSIANS), 2);
    put_number(f, format, paper_off ? ratio(p->gaussians, paper_off->gaussians) : NAN, NAN, 2);
    put_number(f, format, g->mean[M_PSNR], g->deviation[M_PSNR], 2);
    put_number(f, format, ratio(p->psnr, 1), NAN, 2);
    put_number(f, format, g->mean[M_SSIM], g->deviation[M_SSIM], 3);
    put_number(f, format, ratio(p->ssim, 1), NAN, 2);
    put_spread(f, format, report_shares(g, off, M_FPS), 2);
    put_number(f, format, paper_off ? ratio(p->fps, paper_off->fps) : NAN, NAN, 2);
    put_spread(f, format, report_shares(g, clean, M_MEMORY), 2);
    put_number(f, format, paper_clean ? ratio(p->megabytes, paper_clean->megabytes) : NAN, NAN, 2);
    end_row(f, format);
}

void put_papers(FILE *f, const struct report *r, enum format format)
{
    static const char *const titles[] = {
        "run",  "n",     "of clean",          "paper", "of undefended",   "paper", "PSNR", "paper",
        "SSIM", "paper", "FPS of undefended", "paper", "memory of clean", "paper"};
    bool any = false;
    for (size_t i = 0; i < r->n_groups; i++) {
        const struct group *g = &r->groups[i];
        const struct result *x = g->first;
        const struct paper_row *p = report_paper_of(r, x);
        if (!p || !g->runs)
            continue;
        if (!any) {
            put_heading(f, format, 2, "Next to the paper");
            begin_table(f, format, titles, 14);
        }
        any = true;
        put_paper_row(f, r, format, g, p);
    }
    if (!any)
        return;
    end_table(f, format);
    fprintf(f,
            "%sPaper: Chen et al. 2026, at full size, on another machine. Most Gaussians, frames "
            "per second and memory are ratios, since sizes and machines differ. A cell is empty "
            "where the paper has no number, or a run that it is a share of is missing.%s\n",
            format == HTML ? "<p>" : "", format == HTML ? "</p>" : "");
}

/* ---- photos side by side ---- */

#define SIDES 32   /* most kinds of photos */
#define SCENES 256 /* most scenes that means are over */

/* What a table is of: a scene, or all scenes with one preset. */
struct side {
    const struct result *first;
    const char *preset; /* or NULL */
};

static const char *preset_of(const struct report *r, const struct result *x)
{
    const char *name = json_string_value(json_object_get(report_scene(r, x), "preset"));
    return name ? name : "";
}

static bool is_of(const struct report *r, const struct side *s, const struct result *x)
{
    return s->preset ? !strcmp(x->plan, s->first->plan) && !strcmp(x->model, s->first->model) &&
                           !strcmp(preset_of(r, x), s->preset)
                     : same_scene(x, s->first);
}

static bool has_run(const struct report *r, const struct group *like, const char *photos,
                    const char *defense)
{
    const struct group *g = report_find(r, like, photos, defense);
    return g && g->runs;
}

/* Scenes of a table, each by one of its groups. */
struct scenes {
    const struct group *of[SCENES];
    int n;
};

/* The scene, or the scenes with the preset that were to have a clean run without a defense. */
static void find_scenes(const struct report *r, const struct side *s, struct scenes *out)
{
    for (size_t i = 0; i < r->n_groups && out->n < (s->preset ? SCENES : 1); i++) {
        const struct group *g = &r->groups[i];
        if (is_of(r, s, g->first) &&
            (!s->preset || (!strcmp(g->first->photos, CLEAN) && !strcmp(g->first->defense, OFF))))
            out->of[out->n++] = g;
    }
}

static int count_runs(const struct report *r, const struct scenes *scenes, const char *photos,
                      const char *defense)
{
    int n = 0;
    for (int i = 0; i < scenes->n; i++)
        n += has_run(r, scenes->of[i], photos, defense);
    return n;
}

/* The scenes that have a result of a defense for each kind of photos that any of them has one for:
 * a row is of the same scenes in all columns. */
static void select_scenes(const struct report *r, const struct scenes *scenes, const char *defense,
                          const char *const *photos, int n, struct scenes *out)
{
    bool has[SCENES];
    for (int i = 0; i < scenes->n; i++)
        has[i] = true;
    for (int c = 0; c < n; c++)
        if (count_runs(r, scenes, photos[c], defense))
            for (int i = 0; i < scenes->n; i++)
                has[i] &= has_run(r, scenes->of[i], photos[c], defense);
    out->n = 0;
    for (int i = 0; i < scenes->n; i++)
        if (has[i])
            out->of[out->n++] = scenes->of[i];
}

static struct spread value_of(const struct report *r, const struct group *like, const char *photos,
                              const char *defense, enum report_metric m)
{
    const struct group *g = report_find(r, like, photos, defense),
                       *clean = report_find(r, like, CLEAN, OFF);
    return m == M_MAX_GAUSSIANS ? report_common_shares(g, clean, m) : report_common(g, m);
}

/* Seeds that a table's means are over: those that all runs of a scene have, the fewest and the most
 * of its scenes, and those that were asked for. */
struct seeds {
    int least, most, all;
    bool differ; /* a scene has runs, but no seed that all of its runs have */
};

static struct seeds count_seeds(const struct report *r, const struct scenes *scenes)
{
    struct seeds n = {.least = INT_MAX};
    for (int i = 0; i < scenes->n; i++) {
        int common = INT_MAX;
        for (size_t k = 0; k < r->n_groups; k++) {
            const struct group *g = &r->groups[k];
            if (!same_scene(g->first, scenes->of[i]->first))
                continue;
            n.all = g->cells > n.all ? g->cells : n.all;
            n.differ |= g->runs && !g->common;
            if (g->runs && g->common < common)
                common = g->common;
        }
        if (common == INT_MAX) /* no runs */
            common = 0;
        n.least = common < n.least ? common : n.least;
        n.most = common > n.most ? common : n.most;
    }
    return n;
}

/* Of several scenes without a deviation, which would be another than that over seeds. */
static struct spread mean_of(const struct report *r, const struct scenes *scenes,
                             const char *photos, const char *defense, enum report_metric m)
{
    double sum = 0;
    if (scenes->n == 1)
        return value_of(r, scenes->of[0], photos, defense, m);
    for (int i = 0; i < scenes->n; i++)
        sum += value_of(r, scenes->of[i], photos, defense, m).mean;
    return (struct spread){scenes->n ? sum / scenes->n : NAN, NAN};
}

/* Why a cell that the plan asks for has no value; "" for others. */
static const char *why_none(const struct report *r, const struct scenes *scenes, const char *photos,
                            const char *defense)
{
    for (int i = 0; i < scenes->n; i++) {
        const struct group *g = report_find(r, scenes->of[i], photos, defense);
        if (g && !g->runs)
            return g->why;
    }
    return "";
}

static bool begins(const struct report *r, const struct side *s, size_t i, bool by_defense)
{
    const struct result *b = r->groups[i].first;
    if (!is_of(r, s, b))
        return false;
    for (size_t k = 0; k < i; k++) {
        const struct result *a = r->groups[k].first;
        if (is_of(r, s, a) &&
            (by_defense ? !strcmp(a->defense, b->defense) : !strcmp(a->photos, b->photos)))
            return false;
    }
    return true;
}

/* The kinds of photos of a scene; of several scenes those that most of them have undefended runs
 * of. Returns their number. */
static int find_photos(const struct report *r, const struct side *s, const struct scenes *all,
                       const char *photos[SIDES])
{
    int n = 0;
    for (size_t i = 0; i < r->n_groups && n < SIDES; i++) {
        const char *name = r->groups[i].first->photos;
        if (begins(r, s, i, false) && (!s->preset || 2 * count_runs(r, all, name, OFF) > all->n))
            photos[n++] = name;
    }
    return n;
}

static void put_side(FILE *f, const struct report *r, enum format format, const struct side *s)
{
    static const struct {
        enum report_metric metric;
        const char *name;
        int digits;
    } parts[] = {{M_PSNR, "PSNR, dB", 2}, {M_SSIM, "SSIM", 3}, {M_MAX_GAUSSIANS, "of clean", 2}};
    const char *titles[SIDES + 1] = {"defense"}, **photos = titles + 1;
    struct scenes all = {.n = 0}, scenes;
    char title[320], over[64] = "of different seeds";
    find_scenes(r, s, &all);
    const int n = find_photos(r, s, &all, photos);
    scenes = all;
    if (s->preset)
        select_scenes(r, &all, OFF, photos, n, &scenes);
    if (n < 2 || (s->preset && scenes.n < 2))
        return;
    const struct seeds seeds = count_seeds(r, &scenes);
    if (!seeds.differ && seeds.least < seeds.most)
        snprintf(over, sizeof(over), "over %d to %d of %d seeds", seeds.least, seeds.most,
                 seeds.all);
    else if (!seeds.differ)
        snprintf(over, sizeof(over), "over %d of %d seeds", seeds.least, seeds.all);
    if (s->preset)
        snprintf(title, sizeof(title), "%s: means over %d of %d scenes of the preset %s, %s",
                 s->first->plan, scenes.n, all.n, s->preset, over);
    else
        snprintf(title, sizeof(title), "%s: %s, photos side by side, %s", s->first->plan,
                 s->first->scene, over);
    put_run_heading(f, format, title, s->first);
    for (size_t k = 0; k < sizeof(parts) / sizeof(parts[0]); k++) {
        put_heading(f, format, 3,
                    parts[k].metric == M_MAX_GAUSSIANS
                        ? "Most Gaussians, of the clean undefended run"
                        : parts[k].name);
        begin_table(f, format, titles, n + 1);
        for (size_t i = 0; i < r->n_groups && !interrupted(); i++) {
            const char *defense = r->groups[i].first->defense;
            struct scenes of = scenes;
            struct spread values[SIDES];
            char row[256];
            bool any = !s->preset; /* not all scenes may have a defense */
            if (!begins(r, s, i, true))
                continue;
            if (s->preset)
                select_scenes(r, &scenes, defense, photos, n, &of);
            for (int c = 0; c < n; c++) {
                values[c] = mean_of(r, &of, photos[c], defense, parts[k].metric);
                any |= isfinite(values[c].mean);
            }
            if (!any)
                continue;
            snprintf(row, sizeof(row), "%s", defense);
            if (of.n < scenes.n)
                snprintf(row, sizeof(row), "%s (%d of these scenes)", defense, of.n);
            begin_row(f, format, row);
            for (int c = 0; c < n; c++)
                if (isfinite(values[c].mean))
                    put_spread(f, format, values[c], parts[k].digits);
                else
                    put_cell(f, format, why_none(r, &of, photos[c], defense));
            end_row(f, format);
        }
        end_table(f, format);
    }
}

void put_sides(FILE *f, const struct report *r, enum format format)
{
    for (int one = 0; one < 2; one++) /* means first */
        for (size_t i = 0; i < r->n_groups && !interrupted(); i++) {
            const struct result *x = r->groups[i].first;
            const struct side s = {x, one ? NULL : preset_of(r, x)};
            bool first = one || *s.preset;
            for (size_t k = 0; k < i && first; k++)
                first = !is_of(r, &s, r->groups[k].first);
            if (first)
                put_side(f, r, format, &s);
        }
}

/* ---- at equal count ---- */

static bool is_limited(const struct report *r, const struct group *g)
{
    return g->runs && report_limit(r, g->first) > 0;
}

/* Those of one scene, from its first one on: who is better with as many Gaussians. */
static void put_limited(FILE *f, const struct report *r, enum format format, size_t from)
{
    static const char *const titles[] = {"limit, defense, photos", "n", "Gaussians", "PSNR", "SSIM",
                                         "PSNR without a defense"};
    const struct result *scene = r->groups[from].first;
    char name[256], n[16];
    snprintf(name, sizeof(name), "%s: %s, limits in shares of the clean count", scene->plan,
             scene->scene);
    put_run_heading(f, format, name, scene);
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
        put_spread(f, format, report_pairs(g, off, M_PSNR), 2);
        end_row(f, format);
    }
    end_table(f, format);
    fprintf(f, "%sThe universal threshold can exceed its limit: growth stops after it is met.%s\n",
            format == HTML ? "<p>" : "", format == HTML ? "</p>" : "");
}

void put_limits(FILE *f, const struct report *r, enum format format)
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

/* ---- the plans ---- */

#define PLAN_COLUMNS 9

/* Appends a text, or the texts of a list. */
static void add_words(char *text, size_t size, const json_t *value)
{
    const size_t words = json_is_array(value) ? json_array_size(value) : value != NULL;
    for (size_t i = 0; i < words; i++) {
        const char *word =
            json_string_value(json_is_array(value) ? json_array_get(value, i) : value);
        const size_t n = strlen(text);
        snprintf(text + n, size - n, "%s%s", n ? " " : "", word ? word : "");
    }
}

/* What stands for a name: a list of options, or an object with one. */
static void put_options(FILE *f, enum format format, const json_t *value)
{
    const json_t *prune = json_object_get(value, "prune");
    const char *from = json_string_value(json_object_get(value, "from"));
    char text[1024] = "";
    if (prune)
        snprintf(text, sizeof(text), "prune %s:", from ? from : "off");
    add_words(text, sizeof(text),
              json_is_array(value) ? value
              : prune              ? prune
                                   : json_object_get(value, "train"));
    put_cell(f, format, text);
}

/* A table of names and their options, or of the members that they have. */
static void put_list(FILE *f, enum format format, const char *title, const json_t *object,
                     const char *const *members)
{
    const char *name, *titles[PLAN_COLUMNS] = {title, "options"};
    json_t *value;
    int n = 1;
    for (; members && members[n - 1]; n++)
        titles[n] = members[n - 1];
    if (!json_object_size(object))
        return;
    begin_table(f, format, titles, members ? n : 2);
    json_object_foreach((json_t *) object, name, value)
    {
        begin_row(f, format, name);
        if (!members)
            put_options(f, format, value);
        for (int i = 1; members && i < n; i++) {
            char text[1024] = "";
            add_words(text, sizeof(text), json_object_get(value, members[i - 1]));
            put_cell(f, format, text);
        }
        end_row(f, format);
    }
    end_table(f, format);
}

/* The members that a scene has. */
static void put_scenes(FILE *f, enum format format, const json_t *scenes)
{
    static const char *const all[] = {"path", "synth",   "layout", "preset",
                                      "size", "options", "train",  "attack"};
    const char *members[PLAN_COLUMNS] = {NULL}, *name;
    json_t *scene;
    for (size_t i = 0, n = 0; i < sizeof(all) / sizeof(all[0]); i++) {
        bool any = false;
        json_object_foreach((json_t *) scenes, name, scene) any |=
            json_object_get(scene, all[i]) != NULL;
        if (any)
            members[n++] = all[i];
    }
    put_list(f, format, "scene", scenes, members);
}

/* A paragraph, whatever its text begins with: of Markdown neither a heading nor a list nor code. */
static void put_paragraph(FILE *f, enum format format, const char *text)
{
    if (format == MARKDOWN) {
        text += strspn(text, " \t\n");
        const size_t digits = strspn(text, "0123456789");
        fwrite(text, 1, digits, f);
        text += digits;
        if (*text && strchr("#+-=_~.)", *text))
            fputc('\\', f);
    }
    put_text(f, format, text);
}

void put_plans(FILE *f, const struct report *r, enum format format)
{
    const char *name;
    json_t *plan;
    json_object_foreach(r->plans, name, plan)
    {
        const char *about = json_string_value(json_object_get(plan, "about"));
        char title[256];
        snprintf(title, sizeof(title), "The plan %s", name);
        put_heading(f, format, 2, title);
        fputs(format == HTML ? "<p>" : "", f);
        put_paragraph(f, format, about ? about : "");
        fputs(format == HTML ? "</p>\n<div class=plan>\n" : "\n\n", f);
        json_t *all = json_pack("{s:O*}", "all trainings", json_object_get(plan, "train"));
        put_list(f, format, "trainings", all, NULL);
        json_decref(all);
        put_scenes(f, format, json_object_get(plan, "scenes"));
        put_list(f, format, "photos", json_object_get(plan, "photos"), NULL);
        put_list(f, format, "defense", json_object_get(plan, "defenses"), NULL);
        put_list(f, format, "model", json_object_get(plan, "models"), NULL);
        fputs(format == HTML ? "</div>\n" : "", f);
    }
}
