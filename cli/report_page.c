/* SPDX-License-Identifier: Apache-2.0 */
/* The report as one page without any other file. Names come from a database: all text is escaped.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "page.h"
#include "report.h"

/* The number of a photo in the list, which it is added to where it is new: runs that differ in
 * their defense only have the same photo. */
static json_t *photo_number(json_t *photos, json_t *photo)
{
    size_t i = 0;
    while (i < json_array_size(photos) && !json_equal(json_array_get(photos, i), photo))
        i++;
    if (i == json_array_size(photos))
        json_array_append(photos, photo);
    return json_integer((json_int_t) i);
}

/* shown: by key, how many results before had the curve and the pictures. */
static json_t *result_json(const struct report *r, const struct result *x, json_t *photos,
                           json_t *shown)
{
    const json_int_t before = json_integer_value(json_object_get(shown, x->key));
    const bool show = before < CELLS_OF_JOB;
    json_t *o = json_pack("{s:o,s:o,s:o,s:o,s:o,s:i,s:b}", "plan", text_json(x->plan), "scene",
                          text_json(x->scene), "photos", text_json(x->photos), "defense",
                          text_json(x->defense), "model", text_json(x->model), "seed", x->seed,
                          "alone", x->alone);
    for (int m = 0; m < M_METRICS; m++)
        json_object_set_new(o, metric_columns[m].name, number_json(x->value[m]));
    const struct paper_row *paper = report_paper_of(r, x);
    if (paper)
        json_object_set_new(o, "paper",
                            json_pack("{s:o,s:o}", "psnr",
                                      number_json(paper->psnr > 0 ? paper->psnr : NAN), "growth",
                                      number_json(report_paper_growth(paper))));
    json_object_set_new(shown, x->key, json_integer(before + 1));
    json_t *curve = show ? json_object_get(r->curves, x->key) : NULL;
    json_object_set_new(o, "curve", curve ? json_incref(curve) : json_array());
    json_t *pictures = show ? json_object_get(r->pictures, x->key) : NULL;
    json_t *photo = json_object_get(pictures, "photo");
    if (pictures) {
        json_object_set_new(o, "pictures", pictures = json_copy(pictures));
        if (photo)
            json_object_set_new(pictures, "photo", photo_number(photos, photo));
    }
    return o;
}

/* Nothing in it can end the script element. */
static void put_json(FILE *f, json_t *value)
{
    char *text = json_dumps(value, JSON_COMPACT | JSON_ENSURE_ASCII | JSON_REAL_PRECISION(8));
    for (const char *c = text ? text : "[]"; *c; c++)
        if (*c == '<')
            fputs("\\u003c", f);
        else
            fputc(*c, f);
    free(text);
    json_decref(value);
}

void put_page(FILE *f, const struct report *r)
{
    static const char *const figures[] = {"gaussians", "quality", "tradeoff", "growth", "instances",
                                          "memory",    "radial",  "angular",  "roc"};
    json_t *list = json_array(), *photos = json_array(), *shown = json_object();
    for (size_t i = 0; i < r->n; i++)
        if (!strcmp(r->results[i].status, "done"))
            json_array_append_new(list, result_json(r, &r->results[i], photos, shown));
    put_page_head(f, "Report", true);
    if (json_array_size(list)) {
        fprintf(f, "<p class=choices><label>scene <select id=scene></select></label><label>photos "
                   "<select id=photos><option value=\"\">all</option></select></label></p>\n"
                   "<fieldset id=defenses><legend>defenses</legend></fieldset>\n");
        for (size_t i = 0; i < sizeof(figures) / sizeof(figures[0]); i++)
            fprintf(f, "<figure id=%s></figure>\n", figures[i]);
        fprintf(f, "<section id=crops></section>\n");
    }
    put_tables(f, r, HTML);
    if (json_array_size(list)) {
        fprintf(f, "<script type=application/json id=results>");
        put_json(f, list);
        fprintf(f, "</script>\n<script type=application/json id=photo-list>");
        put_json(f, json_incref(photos));
        fprintf(f, "</script>\n<script type=application/json id=audits>");
        put_json(f, report_audits_json(r));
        fprintf(f, "</script>\n<script>\n%s</script>\n", report_js);
    } else
        json_decref(list);
    json_decref(photos);
    json_decref(shown);
    fprintf(f, "</body></html>\n");
}
