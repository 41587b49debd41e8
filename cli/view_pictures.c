/* SPDX-License-Identifier: Apache-2.0 */
#include "view_pictures.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "model_views.h"

#define EXAGGERATED 4 /* grey levels of a difference, to see small ones */
#define SAMPLED 100000

static size_t view_count(const struct view_pictures *v)
{
    return v->scene ? v->scene->n_train + v->scene->n_test : 0;
}

/* ---- the scene ---- */

/* Of a rotation, as w x y z (Shepperd 1978). */
static void to_quaternion(const double *R, double *q)
{
    const double square[4] = {1 + R[0] + R[4] + R[8], 1 + R[0] - R[4] - R[8],
                              1 - R[0] + R[4] - R[8], 1 - R[0] - R[4] + R[8]};
    const double a = R[7] - R[5], b = R[2] - R[6], c = R[3] - R[1], d = R[1] + R[3],
                 e = R[2] + R[6], f = R[5] + R[7];
    const double rows[4][4] = {
        {square[0], a, b, c}, {a, square[1], d, e}, {b, d, square[2], f}, {c, e, f, square[3]}};
    int best = 0;
    for (int i = 1; i < 4; i++)
        best = square[i] > square[best] ? i : best;
    for (int i = 0; i < 4; i++)
        q[i] = rows[best][i] / (2 * sqrt(square[best]));
}

static json_t *camera_json(const struct sg_camera *c, const char *name, const char *split)
{
    double q[4];
    to_quaternion(c->R, q);
    return json_pack("{s:o,s:s,s:i,s:i,s:f,s:f,s:f,s:f,s:[f,f,f,f],s:[f,f,f]}", "name",
                     text_json(name), "split", split, "width", c->width, "height", c->height, "fx",
                     c->fx, "fy", c->fy, "cx", c->cx, "cy", c->cy, "q", q[0], q[1], q[2], q[3], "t",
                     c->t[0], c->t[1], c->t[2]);
}

int view_publish_scene(const struct view_pictures *v, view_server *server, const char *title,
                       bool training)
{
    json_t *views = json_array();
    const double extent = v->scene ? v->scene->extent : v->extent;
    for (size_t i = 0; i < view_count(v); i++)
        json_array_append_new(views, camera_json(&scene_view(v->scene, i)->camera,
                                                 scene_view(v->scene, i)->name,
                                                 i < v->scene->n_train ? "train" : "test"));
    if (!view_count(v))
        json_array_append_new(views, camera_json(&v->camera, "", ""));
    json_t *all =
        json_pack("{s:o,s:b,s:b,s:b,s:b,s:b,s:b,s:f,s:[f,f,f],s:o}", "title", text_json(title),
                  "training", training, "model", v->model, "browser", v->browser, "scores",
                  v->scores, "next", v->next, "photos", view_count(v) > 0, "extent",
                  extent > 0 ? extent : 1, "background", (double) v->background[0],
                  (double) v->background[1], (double) v->background[2], "views", views);
    char *text = all ? json_dumps(all, JSON_COMPACT) : NULL;
    if (text)
        view_server_set_scene(server, text);
    free(text);
    json_decref(all);
    return text ? STATUS_DONE : no_memory();
}

static int by_value(const void *a, const void *b)
{
    const float x = *(const float *) a, y = *(const float *) b;
    return (x > y) - (x < y);
}

int view_place_camera(struct view_pictures *v, sg_ctx *ctx, const struct sg_model *model)
{
    float *all = sg_mem_alloc(ctx, SG_MEM_MISC, model->count, 3 * sizeof(float));
    float *some = sg_mem_alloc(ctx, SG_MEM_MISC, SAMPLED, sizeof(float));
    const size_t step = model->count / SAMPLED + 1, n = (model->count + step - 1) / step;
    double middle[3] = {0}, far = 0;
    int error = all && some ? sg_model_get_array(ctx, model, "position", all, 0) : SG_ERR_BUDGET;
    for (int k = 0; k < 3 && !error && n; k++) {
        for (size_t i = 0; i < n; i++)
            some[i] = all[3 * i * step + (size_t) k];
        qsort(some, n, sizeof(*some), by_value);
        middle[k] = (double) some[n / 2];
        far = fmax(far, (double) some[n * 9 / 10] - (double) some[n / 10]);
    }
    sg_mem_free(all);
    sg_mem_free(some);
    far = far > 0 ? far : 1; /* of a single Gaussian */
    v->camera = (struct sg_camera){.width = 960,
                                   .height = 720,
                                   .fx = 900,
                                   .fy = 900,
                                   .cx = 480,
                                   .cy = 360,
                                   .R = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                   .t = {-middle[0], -middle[1], -middle[2] + 1.5 * far}};
    v->extent = far;
    return error;
}

/* ---- pictures ---- */

/* The photo's camera at the size that is asked for, in the page's pose. */
static struct sg_camera camera_of(const struct view_pictures *v, const struct view_ask *ask)
{
    struct sg_camera c = view_count(v) ? scene_view(v->scene, ask->view)->camera : v->camera;
    const double most = sqrt((double) VIEW_PIXELS / ((double) c.width * (double) c.height)),
                 scale = fmin(ask->scale, most);
    const int w = (int) fmax(1, floor(c.width * scale)), h = (int) fmax(1, floor(c.height * scale));
    const double x = (double) w / c.width, y = (double) h / c.height, *q = ask->pose;
    const double n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), a = q[0] / n,
                 b = q[1] / n, d = q[2] / n, e = q[3] / n;
    const double R[9] = {1 - 2 * (d * d + e * e), 2 * (b * d - a * e),     2 * (b * e + a * d),
                         2 * (b * d + a * e),     1 - 2 * (b * b + e * e), 2 * (d * e - a * b),
                         2 * (b * e - a * d),     2 * (d * e + a * b),     1 - 2 * (b * b + d * d)};
    c.width = w, c.height = h;
    c.fx *= x, c.cx *= x, c.fy *= y, c.cy *= y;
    memcpy(c.R, R, sizeof(R));
    memcpy(c.t, ask->pose + 4, sizeof(c.t));
    return c;
}

/* The mean of the pixels that become one. */
static void shrink(const uint8_t *from, int fw, int fh, uint8_t *to, int w, int h)
{
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            const int x0 = (int) ((int64_t) x * fw / w), x1 = (int) ((int64_t) (x + 1) * fw / w),
                      y0 = (int) ((int64_t) y * fh / h), y1 = (int) ((int64_t) (y + 1) * fh / h);
            for (int ch = 0; ch < 3; ch++) {
                unsigned sum = 0, n = 0;
                for (int b = y0; b < y1; b++)
                    for (int a = x0; a < x1; a++, n++)
                        sum += from[3 * ((size_t) b * (size_t) fw + (size_t) a) + (size_t) ch];
                to[3 * ((size_t) y * (size_t) w + (size_t) x) + (size_t) ch] =
                    (uint8_t) ((sum + n / 2) / n);
            }
        }
}

static bool put_photo(const struct view_pictures *v, size_t i, uint8_t *to, int w, int h)
{
    const struct sg_view *view = scene_view(v->scene, i);
    const uint8_t *rgb;
    if (sg_view_pixels(v->ctx, view, &rgb))
        return false;
    shrink(rgb, view->camera.width, view->camera.height, to, w, h);
    sg_view_release(view);
    return true;
}

static void put_grey(uint8_t *to, size_t i, float value)
{
    memset(to + 3 * i, (int) (255 * (value < 0 ? 0 : value > 1 ? 1 : value) + 0.5f), 3);
}

static bool make_room(struct view_pictures *v, size_t n)
{
    if (n <= v->pixels)
        return true;
    sg_mem_free(v->planes);
    v->planes = sg_mem_alloc(v->own, SG_MEM_FRAME, n, 5 * sizeof(float));
    v->pixels = v->planes ? n : 0;
    return v->planes;
}

/* Whether the picture could be drawn. */
static bool draw(struct view_pictures *v, const struct view_ask *ask, sg_renderer *renderer,
                 const struct sg_camera *camera, uint8_t *to)
{
    const int w = camera->width, h = camera->height;
    const size_t n = (size_t) w * (size_t) h;
    if (ask->kind == VIEW_PHOTO || ask->kind == VIEW_DIFFERENCE)
        if (!view_count(v) || !put_photo(v, ask->view, to, w, h))
            return false;
    if (ask->kind == VIEW_PHOTO)
        return true;
    if (!renderer || !make_room(v, n))
        return false;
    float *rgb = v->planes, *alpha = rgb + 3 * n, *depth = alpha + n;
    const bool more = ask->kind == VIEW_DEPTH || ask->kind == VIEW_ALPHA;
    if (v->appearances)
        sg_renderer_set_photo(renderer, sg_scene_photo(v->scene, scene_view(v->scene, ask->view)));
    if (sg_render(renderer, camera, rgb, more ? alpha : NULL, more ? depth : NULL, NULL))
        return false;
    if (ask->kind == VIEW_COLOUR || ask->kind >= VIEW_SCORE)
        sg_quantise(rgb, w, h, to);
    else if (ask->kind == VIEW_DEPTH)
        depth_to_grey(depth, alpha, n, 3, to);
    else if (ask->kind == VIEW_ALPHA)
        for (size_t i = 0; i < n; i++)
            put_grey(to, i, alpha[i]);
    else
        for (size_t i = 0; i < 3 * n; i++) {
            const float render = rgb[i % 3 * n + i / 3];
            const float level = render < 0   ? 0
                                : render > 1 ? 255
                                             : 255 * render,
                        off = EXAGGERATED * fabsf(level - (float) to[i]);
            to[i] = (uint8_t) (off > 255 ? 255 : off);
        }
    return true;
}

void view_draw(struct view_pictures *v, view_server *server, const struct view_ask *ask,
               sg_renderer *renderer)
{
    uint8_t *pixels = NULL;
    struct sg_camera camera = {0};
    if (ask->view < view_count(v) || (!view_count(v) && !ask->view)) {
        camera = camera_of(v, ask);
        pixels =
            sg_mem_alloc(v->own, SG_MEM_FRAME, (size_t) camera.width * (size_t) camera.height, 3);
    }
    if (pixels && !draw(v, ask, renderer, &camera, pixels)) {
        sg_mem_free(pixels);
        pixels = NULL;
    }
    view_server_answer(server, pixels, camera.width, camera.height);
}

void view_pictures_clear(struct view_pictures *v)
{
    sg_mem_free(v->planes);
    v->planes = NULL, v->pixels = 0;
}
