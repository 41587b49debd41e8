/* SPDX-License-Identifier: Apache-2.0 */
/* The audit as a single HTML file. Names are untrusted: all text is escaped. */
#include "splatguard/audit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/file.h"
#include "core/json_text.h"
#include "core/numbers.h"
#include "defense/audit_photo.h"
#include "image/image.h"
#include "splatguard/output.h"
#include "scene/photo.h"

#define SHOWN 3   /* photos from each end of the ranking */
#define PANEL 270 /* pixels, the longer side: four in a row */
/* grey levels of oscillation that are drawn white: the most that a bound of 16 allows */
#define HEAT 32.0f
/* grey levels of white noise whose spectrum is drawn black; a thousand times as many are white */
#define FAINT 0.1

extern const char sg_page_css[]; /* page.css */

/* Names need not be UTF-8; the page must be. */
static void put_text(FILE *f, const char *name)
{
    json_t *valid = sg_text_to_json(name);
    for (const char *c = valid ? json_string_value(valid) : ""; *c;) {
        char shown[SG_CHARACTER];
        const size_t n = sg_take_printable(&c, shown);
        if (strchr("<>&\"'", *shown))
            fprintf(f, "&#%d;", *shown);
        else
            fwrite(shown, 1, n, f);
    }
    json_decref(valid);
}

static void put_base64(FILE *f, const uint8_t *data, size_t n)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < n; i += 3) {
        const unsigned a = data[i], b = i + 1 < n ? data[i + 1] : 0,
                       c = i + 2 < n ? data[i + 2] : 0;
        const unsigned word = a << 16 | b << 8 | c;
        fputc(digits[word >> 18], f);
        fputc(digits[word >> 12 & 63], f);
        fputc(i + 1 < n ? digits[word >> 6 & 63] : '=', f);
        fputc(i + 2 < n ? digits[word & 63] : '=', f);
    }
}

/* Black, red, yellow, white. */
static void heat(float t, uint8_t *rgb)
{
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    for (int ch = 0; ch < 3; ch++) {
        const float v = 3 * t - (float) ch;
        rgb[ch] = (uint8_t) (255 * (v < 0 ? 0 : v > 1 ? 1 : v));
    }
}

static int put_picture(sg_ctx *ctx, FILE *f, const uint8_t *rgb, int w, int h, const char *title,
                       const char *of)
{
    const int side = w > h ? w : h, pw = w * PANEL / side > 0 ? w * PANEL / side : 1,
              ph = h * PANEL / side > 0 ? h * PANEL / side : 1;
    uint8_t *small = sg_alloc_raw(ctx, SG_MEM_MISC, 3 * (size_t) pw, (size_t) ph);
    void *png = NULL;
    size_t size = 0;
    int code = small ? sg_resample(ctx, rgb, w, h, 3, small, pw, ph) : SG_ERR_BUDGET;
    if (!code)
        code = sg_image_encode_png(ctx, small, pw, ph, 3, &png, &size);
    if (!code) {
        fprintf(f, "<figure><img alt=\"%s of ", title);
        put_text(f, of);
        fprintf(f, "\" width=%d height=%d src=\"data:image/png;base64,", pw, ph);
        put_base64(f, png, size);
        fprintf(f, "\"><figcaption>%s</figcaption></figure>\n", title);
    }
    sg_free(png);
    sg_free(small);
    return code;
}

/* Bars from -90 to 90 degrees; the other half of a real image's spectrum is the same. */
static void put_directions(FILE *f, const struct sg_spectrum *s)
{
    const int half = s->bins / 2;
    double most = 0;
    for (int b = 0; b < s->bins; b++)
        most = fmax(most, s->angular[b]);
    fprintf(f, "<figure><svg role=img aria-label=\"energy by direction\" width=%d height=120>",
            PANEL);
    for (int b = 0; b < half; b++) {
        const double share = most > 0 ? s->angular[s->bins / 4 + b] / most : 0,
                     wide = (double) PANEL / half;
        fprintf(f, "<rect x=%.1f y=%.1f width=%.1f height=%.1f />", b * wide, 120 - 118 * share,
                wide - 1, 118 * share);
    }
    fprintf(f,
            "</svg><figcaption>energy by direction, -90 to 90 degrees: anisotropy "
            "%.3f</figcaption></figure>\n",
            s->anisotropy);
}

/* The photo, a map of its oscillation, and its spectrum. */
static int put_view(sg_ctx *ctx, FILE *f, const struct sg_view *v,
                    const struct sg_audit_image *image)
{
    const int w = v->camera.width, h = v->camera.height, across = (w + 15) / 16,
              below = (h + 15) / 16;
    const size_t pixels = (size_t) w * (size_t) h;
    float *map = sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) across * (size_t) below, sizeof(*map));
    float *amplitude = sg_alloc_raw(ctx, SG_MEM_MISC, pixels, sizeof(*amplitude));
    uint8_t *rgb = sg_alloc_raw(ctx, SG_MEM_MISC, pixels, 3);
    struct sg_audit_features features;
    struct sg_spectrum spectrum;
    fprintf(f, "<h3>");
    put_text(f, image->name);
    fprintf(f, ": %s, score %.3f</h3>\n<div class=row>\n", sg_audit_verdict_name(image->verdict),
            image->score);
    const uint8_t *photo = NULL;
    int code = map && amplitude && rgb ? sg_photo_pixels(ctx, v, &photo) : SG_ERR_BUDGET;
    const bool held = !code;
    if (!code)
        code = put_picture(ctx, f, photo, w, h, "photo", v->name);
    if (!code)
        code = sg_audit_features_of(ctx, photo, v->mask, w, h, &features, map);
    if (!code) {
        for (size_t i = 0; i < pixels; i++)
            heat(sqrtf(map[i / (size_t) w / 16 * (size_t) across + i % (size_t) w / 16] / HEAT),
                 rgb + 3 * i);
        code = put_picture(
            ctx, f, rgb, w, h,
            "oscillation in grey levels: black 0, red 4, yellow 14, white 32 and more", v->name);
    }
    if (!code)
        code = sg_spectrum_measure(ctx, photo, w, h, NULL, &spectrum, amplitude);
    if (!code) {
        for (size_t i = 0; i < pixels; i++) {
            const double levels = 255 * expm1((double) amplitude[i]) / sqrt((double) pixels);
            heat((float) (log(fmax(levels, FAINT) / FAINT) / log(1000)), rgb + 3 * i);
        }
        code = put_picture(
            ctx, f, rgb, w, h,
            "amplitude spectrum: black = as white noise of 0.1 grey levels, white = 100", v->name);
    }
    if (!code)
        put_directions(f, &spectrum);
    fprintf(f, "</div>\n");
    if (held)
        sg_view_release(v);
    sg_free(map);
    sg_free(amplitude);
    sg_free(rgb);
    return code;
}

/* The highest first, photos without a score last. */
static int by_score(const void *a, const void *b, void *images)
{
    const struct sg_audit_image *ranked_by = images;
    const size_t x = *(const size_t *) a, y = *(const size_t *) b;
    const bool p = ranked_by[x].verdict == SG_AUDIT_UNSEEN,
               q = ranked_by[y].verdict == SG_AUDIT_UNSEEN;
    if (p != q)
        return p - q;
    if (ranked_by[x].score != ranked_by[y].score)
        return ranked_by[x].score < ranked_by[y].score ? 1 : -1;
    return (x > y) - (x < y);
}

static void put_head(FILE *f, const struct sg_scene *scene, const struct sg_audit *a)
{
    char unseen[64] = "";
    if (a->verdicts[SG_AUDIT_UNSEEN])
        snprintf(unseen, sizeof(unseen), ", %zu unseen: masks leave nothing of them",
                 a->verdicts[SG_AUDIT_UNSEEN]);
    fprintf(f,
            "<!doctype html>\n<html lang=en><meta charset=utf-8><meta name=viewport "
            "content=\"width=device-width\">\n"
            "<meta name=generator content=\"splatguard %s\">\n"
            "<title>Audit: %s</title>\n<style>\n"
            "%s</style>\n<h1>",
            sg_version(), sg_audit_verdict_name(a->verdict), sg_page_css);
    put_text(f, scene->path);
    fprintf(f,
            ": <span class=%s>%s</span></h1>\n<p>Score %.3f. Of %zu photos %zu poisoned, %zu "
            "suspicious, %zu clean%s.\n",
            sg_audit_verdict_name(a->verdict), sg_audit_verdict_name(a->verdict), a->score,
            a->count, a->verdicts[SG_AUDIT_POISONED], a->verdicts[SG_AUDIT_SUSPICIOUS],
            a->verdicts[SG_AUDIT_CLEAN], unseen);
    if (a->tau > 0)
        fprintf(
            f,
            "<p>Amplitude of the poison: about %.0f grey levels, with a standard error of %.0f.\n",
            a->tau, a->tau_error);
    if (a->count_reasons) {
        fprintf(f, "<ul>\n");
        for (size_t i = 0; i < a->count_reasons; i++) {
            fprintf(f, "<li>");
            put_text(f, a->reasons[i]);
            fprintf(f, "\n");
        }
        fprintf(f, "</ul>\n");
    }
}

static void put_table(FILE *f, const struct sg_audit *a, const size_t *order)
{
    fprintf(f,
            "<h2>All photos</h2>\n<p>Amplitude and oscillation, also at smaller sizes, are in grey "
            "levels; noisy is a share of the area.\n"
            "<div class=wide><table><tr><th scope=col>photo<th "
            "scope=col>verdict<th scope=col>score"
            "<th scope=col>amplitude<th scope=col>oscillation down<th scope=col>across<th "
            "scope=col>in quiet parts<th scope=col>of colours"
            "<th scope=col>share of variation<th scope=col>noisy<th scope=col>at half size<th "
            "scope=col>at a quarter<th scope=col>spectral slope<th scope=col>anisotropy\n");
    for (size_t i = 0; i < a->count; i++) {
        const struct sg_audit_image *m = &a->images[order[i]];
        const struct sg_audit_features *x = &m->features;
        fprintf(f, "<tr><td>");
        put_text(f, m->name);
        fprintf(f, "<td class=%s>%s", sg_audit_verdict_name(m->verdict),
                sg_audit_verdict_name(m->verdict));
        if (m->verdict == SG_AUDIT_UNSEEN) { /* nothing was measured */
            fprintf(f, "<td colspan=12>\n");
            continue;
        }
        fprintf(f,
                "<td>%.3f<td>%.0f &plusmn; "
                "%.0f<td>%.2f<td>%.2f<td>%.2f<td>%.2f<td>%.2f<td>%.2f<td>%.2f<td>%.2f<td>%.2f<td>%."
                "3f\n",
                m->score, m->tau, m->tau_error, x->osc_down, x->osc_across, x->osc_quiet,
                x->osc_chroma, x->osc_share, x->noisy, x->half_osc, x->quarter_osc, x->slope,
                x->anisotropy);
    }
    fprintf(f, "</table></div>\n");
}

int sg_audit_write_page(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_audit *a,
                        const char *path)
{
    char *page = NULL;
    size_t size = 0;
    sg_clear_error(ctx);
    const locale_t before = uselocale(sg_c_locale());
    size_t *order = sg_alloc(ctx, SG_MEM_MISC, a->count + 1, sizeof(*order));
    FILE *f = open_memstream(&page, &size);
    int code = order && f ? SG_OK : SG_ERR_BUDGET;
    for (size_t i = 0; i < a->count && !code; i++)
        order[i] = i;
    if (!code) {
        qsort_r(order, a->count, sizeof(*order), by_score, a->images);
        put_head(f, scene, a);
        fprintf(f, "<h2>Highest and lowest scores</h2>\n");
    }
    const size_t seen = a->count - a->verdicts[SG_AUDIT_UNSEEN];
    for (size_t i = 0; i < seen && !code; i++)
        if (i < SHOWN || i + SHOWN >= seen)
            code = put_view(ctx, f, &scene->train[order[i]], &a->images[order[i]]);
    if (!code)
        put_table(f, a, order);
    bool lost = f && ferror(f);
    lost |= f && fclose(f);
    if (!f || (lost && !code))
        code = sg_fail(ctx, SG_ERR_BUDGET, "%s: out of memory for the page", path);
    if (!code) /* still */
        code = sg_output_check_replaced(ctx, path);
    if (!code)
        code = sg_file_write(ctx, path, page, size);
    free(page);
    sg_free(order);
    uselocale(before);
    return code;
}
