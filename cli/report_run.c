/* SPDX-License-Identifier: Apache-2.0 */
/* The page of one run: what it grew to, where the time and the memory went, and how its pictures
 * look next to the photos. Names are untrusted: all text is escaped. */
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "interrupt.h"
#include "model_views.h"
#include "page.h"
#include "report.h"
#include "report_chart.h"

#define LINE_MAX_BYTES (1 << 20) /* of log.jsonl */
#define POINTS_MAX 4000 /* of a curve; of a longer log every second is left out, and so on */

static const char *const column_names[COLUMNS] = {"iteration", "gaussians", "loss",
                                                  "psnr",      "instances", "ledger_bytes"};

/* ---- the log ---- */

static double number_of(const json_t *line, const char *key)
{
    const json_t *v = json_object_get(line, key);
    return json_is_number(v) ? json_number_value(v) : NAN;
}

/* seen: lines of iterations before it. */
static void take_line(struct curves *c, const json_t *line, size_t stride, size_t *seen)
{
    const double test = number_of(line, "test_psnr"), iteration = number_of(line, "iteration");
    if (!isfinite(iteration))
        return;
    if (isfinite(test) && c->n_tests < POINTS_MAX) {
        c->tests[c->n_tests][0] = iteration;
        c->tests[c->n_tests++][1] = test;
    } else if (!isfinite(test) && (*seen)++ % stride == 0 && c->n < POINTS_MAX) {
        for (int k = 0; k < COLUMNS; k++)
            c->rows[c->n][k] = number_of(line, column_names[k]);
        c->n++;
    }
}

#define LOG_BYTES (INT64_C(1) << 32) /* as runs read them */

/* NULL where it is not there, too large, or no file of the run's: a pipe would be waited for, and a
 * link can lead anywhere. */
static FILE *open_log(const char *folder)
{
    char *path = NULL;
    struct stat st;
    const int fd = asprintf(&path, "%s/log.jsonl", folder) < 0
                       ? -1
                       : open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
    FILE *f = fd < 0 || fstat(fd, &st) || !S_ISREG(st.st_mode) || st.st_size > LOG_BYTES
                  ? NULL
                  : fdopen(fd, "r");
    if (!f && fd >= 0)
        close(fd);
    free(path);
    return f;
}

/* A run without a log has no curves. A line that is torn or none of ours is left out; one that is
 * too long ends the log. */
static int read_log(const char *folder, struct curves *c)
{
    char *line = malloc(LINE_MAX_BYTES);
    size_t lines = 0, seen = 0;
    c->rows = calloc(POINTS_MAX, sizeof(*c->rows));
    c->tests = calloc(POINTS_MAX, sizeof(*c->tests));
    const bool room = line && c->rows && c->tests;
    FILE *f = room ? open_log(folder) : NULL;
    for (int byte; f && (byte = getc_unlocked(f)) != EOF;)
        lines += byte == '\n';
    if (f)
        rewind(f);
    while (f && fgets(line, LINE_MAX_BYTES, f) && strlen(line) < LINE_MAX_BYTES - 1) {
        json_t *object = json_loads(line, JSON_REJECT_DUPLICATES, NULL);
        take_line(c, object, lines / POINTS_MAX + 1, &seen);
        json_decref(object);
    }
    free(line);
    if (f)
        fclose(f);
    return room ? STATUS_DONE : no_memory();
}

/* ---- facts ---- */

static double fact(const sg_run_summary *s, const char *key)
{
    return sg_run_summary_number(s, key);
}

static void put_row(FILE *f, const char *name, double value, double scale, int digits,
                    const char *unit)
{
    if (isfinite(value))
        fprintf(f, "<tr><th scope=row>%s<td>%.*f%s\n", name, digits, value * scale, unit);
}

static void put_facts(FILE *f, const sg_run_summary *s)
{
    fprintf(f, "<div class=wide><table>\n");
    put_row(f, "PSNR of the test views", fact(s, "psnr"), 1, 2, " dB");
    put_row(f, "SSIM of the test views", fact(s, "ssim"), 1, 4, "");
    put_row(f, "Gaussians", fact(s, "final_gaussians"), 1, 0, "");
    put_row(f, "Gaussians, most", fact(s, "max_gaussians"), 1, 0, "");
    put_row(f, "iterations", fact(s, "iterations"), 1, 0, "");
    put_row(f, "training", fact(s, "train_seconds"), 1, 1, " s");
    put_row(f, "memory of the process, most", fact(s, "peak_rss_bytes"), 1e-6, 0, " MB");
    put_row(f, "frames a second", fact(s, "fps"), 1, 1, "");
    put_row(f, "photos trained on", fact(s, "train_views"), 1, 0, "");
    put_row(f, "removed by the defense", fact(s, "defense.filter_removed"), 1, 0, "");
    fprintf(f, "</table></div>\n");
}

static void put_limit(FILE *f, const char *name, double used, double limit, double scale,
                      int digits, const char *unit)
{
    if (!(limit > 0 && isfinite(used)))
        return;
    fprintf(f, "<tr><th scope=row>%s<td>%.*f%s<td>%.*f%s<td>%.0f %%", name, digits, used * scale,
            unit, digits, limit * scale, unit, 100 * used / limit);
    put_bar(f, fmin(1, used / limit));
}

static void put_budgets(FILE *f, const sg_run_summary *s)
{
    const double gaussians = fact(s, "budget.max_gaussians"), memory = fact(s, "budget.max_memory"),
                 time = fact(s, "budget.max_time");
    fprintf(f, "<h2>Budgets</h2>\n");
    if (!(gaussians > 0) && !(memory > 0) && !(time > 0)) {
        fprintf(f, "<p>The run had none.\n");
        return;
    }
    fprintf(f, "<div class=wide><table class=bars><tr><th scope=col>budget<th scope=col>used<th "
               "scope=col>limit<th scope=col>share<th>\n");
    put_limit(f, "Gaussians", fact(s, "max_gaussians"), gaussians, 1, 0, "");
    put_limit(f, "memory", fact(s, "peak_rss_bytes"), memory, 1e-6, 0, " MB");
    put_limit(f, "time", fact(s, "train_seconds"), time, 1, 0, " s");
    fprintf(f, "</table></div>\n");
}

static void put_shares(FILE *f, const sg_run_summary *s)
{
    static const char *const stages[][2] = {{"project", "projection"},
                                            {"bin", "tile lists"},
                                            {"raster", "rasteriser"},
                                            {"loss", "loss"},
                                            {"raster_backward", "rasteriser, backward"},
                                            {"update", "gradients and update"},
                                            {"densify", "densification"},
                                            {"count", "hits for the defense"}};
    struct bar bars[SG_MEM_TAGS + 8];
    char key[64];
    size_t n = 0;
    for (; n < sizeof(stages) / sizeof(stages[0]); n++) {
        snprintf(key, sizeof(key), "stage_seconds.%s", stages[n][0]);
        bars[n] = (struct bar){stages[n][1], fact(s, key)};
    }
    put_bars(f, bars, n, 1, 2, "s", "Where the time went");
    for (n = 0; n < SG_MEM_TAGS; n++) {
        const char *tag = sg_mem_tag_name((enum sg_mem_tag) n);
        snprintf(key, sizeof(key), "peak_ledger_bytes_by_tag.%s", tag);
        bars[n] = (struct bar){tag, fact(s, key)};
    }
    put_bars(f, bars, n, 1e-6, 1, "MB", "Where the memory went: the most of each kind");
}

/* Options that are not the default's, of one table. */
static void put_changed(FILE *f, const struct sg_option *rows, const void *run,
                        const void *standard)
{
    char now[4096], then[4096];
    for (; rows->name; rows++) {
        const bool set = sg_option_get(rows, run, now, sizeof(now)),
                   usual = sg_option_get(rows, standard, then, sizeof(then));
        if (rows->transient || !set || (usual && !strcmp(now, then)))
            continue;
        fprintf(f, "<tr><th scope=row>--%s<td>", rows->name);
        put_name(f, now);
        fprintf(f, "<td>");
        put_name(f, usual ? then : "");
        fprintf(f, "\n");
    }
}

static void put_options(FILE *f, const struct sg_run_params *p)
{
    const struct sg_run_params standard = sg_run_params_default();
    fprintf(f,
            "<h2>Options that differ from their defaults</h2>\n<p>Where the default is a word, the "
            "run can have found the value itself.\n<div class=wide><table><tr><th "
            "scope=col>option<th scope=col>value<th scope=col>default\n");
    put_changed(f, sg_run_options(), p, &standard);
    put_changed(f, sg_scene_options(), &p->scene, &standard.scene);
    put_changed(f, sg_train_options(), &p->train, &standard.train);
    fprintf(f, "</table></div>\n");
}

/* ---- pictures ---- */

#define CROP_WIDE 240
#define CROP_HIGH 180
#define CROP_STEP 16
#define EXAGGERATED 4

struct crop {
    int x, y, w, h;
};

/* Where the render is farthest from the photo, over the used pixels. columns: w numbers of scratch.
 */
static struct crop worst_crop(const uint8_t *a, const uint8_t *b, const uint8_t *mask, int w, int h,
                              double *columns)
{
    struct crop best = {.w = w < CROP_WIDE ? w : CROP_WIDE, .h = h < CROP_HIGH ? h : CROP_HIGH};
    double most = -1;
    for (int y = 0; y + best.h <= h; y += CROP_STEP) {
        memset(columns, 0, (size_t) w * sizeof(*columns));
        for (int v = y; v < y + best.h; v++)
            for (int u = 0; u < 3 * w; u++) {
                const size_t at = 3 * (size_t) v * (size_t) w + (size_t) u;
                if (mask && !mask[at / 3])
                    continue;
                columns[u / 3] += (a[at] - b[at]) * (a[at] - b[at]);
            }
        for (int x = 0; x + best.w <= w; x += CROP_STEP) {
            double sum = 0;
            for (int u = x; u < x + best.w; u++)
                sum += columns[u];
            if (sum > most)
                most = sum, best.x = x, best.y = y;
        }
    }
    return best;
}

/* what: 0 the photo, 1 the render, 2 their difference. */
static int put_crop(FILE *f, sg_ctx *ctx, const uint8_t *photo, const uint8_t *render, int width,
                    const struct crop *c, int what)
{
    static const char *const titles[] = {"photo", "render", "difference, 4 times"};
    uint8_t pixels[CROP_WIDE * CROP_HIGH * 3];
    void *png = NULL;
    size_t size = 0;
    for (int y = 0; y < c->h; y++)
        for (int x = 0; x < 3 * c->w; x++) {
            const size_t at = 3 * (size_t) (c->y + y) * (size_t) width + (size_t) (3 * c->x + x);
            const int off = EXAGGERATED * abs(photo[at] - render[at]);
            pixels[3 * y * c->w + x] = what == 0   ? photo[at]
                                       : what == 1 ? render[at]
                                                   : (uint8_t) (off > 255 ? 255 : off);
        }
    const int error = sg_picture_encode(ctx, SG_PICTURE_PNG, pixels, c->w, c->h, &png, &size);
    char *text = error ? NULL : base64(png, size);
    if (text)
        fprintf(f,
                "<figure><img alt=\"%s\" width=%d height=%d src=\"data:image/png;base64,%s\">"
                "<figcaption>%s</figcaption></figure>\n",
                titles[what], c->w, c->h, text, titles[what]);
    free(text);
    sg_mem_free(png);
    return error || text ? error : SG_ERR_BUDGET;
}

static int put_view(FILE *f, struct model_views *v, size_t i, double psnr)
{
    const struct sg_view *view = &v->views[i];
    const int w = view->camera.width, h = view->camera.height;
    const size_t n = (size_t) w * (size_t) h;
    float *planes = sg_mem_alloc(v->ctx, SG_MEM_FRAME, n, 3 * sizeof(float));
    uint8_t *render = sg_mem_alloc(v->ctx, SG_MEM_FRAME, n, 3);
    double *columns = sg_mem_alloc(v->ctx, SG_MEM_FRAME, (size_t) w, sizeof(*columns));
    const uint8_t *photo = NULL;
    int error = planes && render && columns ? SG_OK : SG_ERR_BUDGET;
    model_views_choose(v, i);
    if (!error)
        error = sg_render(v->renderer, &view->camera, planes, NULL, NULL, NULL);
    if (!error)
        error = sg_view_pixels(v->ctx, view, &photo);
    if (!error) {
        sg_quantise(planes, w, h, render);
        const struct crop c = worst_crop(photo, render, view->mask, w, h, columns);
        fprintf(f, "<h3>");
        put_name(f, view->name);
        fprintf(f, ": %.2f dB, %d x %d pixels from %d, %d</h3>\n<div class=row>\n", psnr, c.w, c.h,
                c.x, c.y);
        for (int what = 0; what < 3 && !error; what++)
            error = put_crop(f, v->ctx, photo, render, w, &c, what);
        fprintf(f, "</div>\n");
        sg_view_release(view);
    }
    sg_mem_free(planes);
    sg_mem_free(render);
    sg_mem_free(columns);
    return error;
}

static int by_psnr(const void *a, const void *b, void *eval)
{
    const struct sg_view_score *s = ((const struct sg_eval *) eval)->per_view;
    const double x = s[*(const size_t *) a].psnr, y = s[*(const size_t *) b].psnr;
    return (x > y) - (x < y);
}

/* The worst, the middle and the best view. */
static int put_pictures(FILE *f, struct model_views *v, const char *split)
{
    struct sg_eval e = {0};
    size_t *order = sg_mem_alloc(v->ctx, SG_MEM_MISC, v->n, sizeof(*order)), n = 0;
    int error =
        order ? sg_evaluate(v->ctx, v->renderer, v->views, v->n, &v->eval, &e) : SG_ERR_BUDGET;
    for (size_t i = 0; i < v->n && !error; i++)
        if (!isnan(e.per_view[i].psnr))
            order[n++] = i;
    if (!error && n) {
        qsort_r(order, n, sizeof(*order), by_psnr, &e);
        const size_t shown[] = {0, n / 2, n - 1};
        fprintf(f,
                "<h2>Pictures</h2>\n<p>The %s views of the lowest, the middle and the highest "
                "PSNR, each where its error is largest.\n",
                split);
        for (size_t k = 0; k < 3 && !error; k++)
            if (!k || shown[k] != shown[k - 1])
                error = interrupted()
                            ? SG_ERR_INTERRUPTED
                            : put_view(f, v, order[shown[k]], e.per_view[order[shown[k]]].psnr);
    }
    sg_eval_clear(&e);
    sg_mem_free(order);
    return report(v->ctx, error);
}

/* ---- the page ---- */

int put_run(FILE *f, const char *folder, const sg_run_summary *summary,
            const struct sg_run_params *params, struct model_views *views)
{
    struct curves c = {0};
    int code = read_log(folder, &c);
    put_page_head(f, folder, false);
    if (fact(summary, "interrupted") == 1)
        fprintf(f, "<p class=suspicious>The run was interrupted.\n");
    put_facts(f, summary);
    fprintf(f, "<h2>Growth and quality</h2>\n<div class=row>\n");
    put_curve(f, &c, C_GAUSSIANS, fact(summary, "budget.max_gaussians"), false,
              "Gaussians over the iterations");
    put_curve(f, &c, C_PSNR, 0, true,
              "PSNR of the view of an iteration, dB; marks: of the test views");
    put_curve(f, &c, C_LOSS, 0, false, "Loss of the view of an iteration");
    put_curve(f, &c, C_INSTANCES, 0, false, "(Gaussian, tile) pairs of the view of an iteration");
    put_curve(f, &c, C_MEMORY, 0, false, "Memory of the library over the iterations, bytes");
    fprintf(f, "</div>\n");
    put_budgets(f, summary);
    put_shares(f, summary);
    if (!code && views)
        code = put_pictures(f, views, params->scene.eval ? "test" : "training");
    put_options(f, params);
    fprintf(f, "</body></html>\n");
    free(c.rows);
    free(c.tests);
    return code;
}
