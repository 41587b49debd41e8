/* SPDX-License-Identifier: Apache-2.0 */
/* The scalar engine: ref/render.h behind the stage table. Slow on purpose. */
#include <string.h>

#include "math/real_f32.h"

#include "engine/host/host_model.h"
#include "engine/ops.h"
#include "math/adam.h"
#include "math/photometric.h"
#include "ref_losses.h"
#include "render.h"

struct ref_engine {
    struct sg_engine base;
    struct sg_host_model model;
    struct ref_splat *splats;
    size_t splats_capacity;
    struct ref_entry *list;
    size_t list_capacity;
    struct ref_image image;
    size_t pixels_capacity;
    float *gradient, *scratch; /* 3 planes; 5 planes */
    struct pinhole view;
    struct sg_render_params params;
    int degree, grid_x, grid_y;
};

static void destroy(struct sg_engine *base)
{
    struct ref_engine *b = (struct ref_engine *) base;
    sg_host_clear(&b->model);
    sg_free(b->splats);
    sg_free(b->list);
    sg_free(b->image.rgb);
    sg_free(b->image.t);
    sg_free(b->image.depth);
    sg_free(b->image.last);
    sg_free(b->gradient);
    sg_free(b->scratch);
    sg_free(b);
}

static const char *variant(const struct sg_engine *base)
{
    (void) base;
    return "ref";
}

static int upload(struct sg_engine *base, const struct sg_model *m,
                  const struct sg_columns *columns)
{
    return sg_host_upload(base->ctx, &((struct ref_engine *) base)->model, m, columns);
}

static int adopt(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    sg_host_adopt(&((struct ref_engine *) base)->model, m, columns);
    return SG_OK;
}

static int download(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    return sg_host_download(&((struct ref_engine *) base)->model, m, columns);
}

static struct sg_host_model *host_model(struct sg_engine *base)
{
    return &((struct ref_engine *) base)->model;
}

static size_t count(const struct sg_engine *base)
{
    return ((const struct ref_engine *) base)->model.count;
}

static void gather(const struct ref_engine *b, size_t i, float *planes)
{
    memset(planes, 0, SG_PARAMS_MAX * sizeof(*planes));
    for (int p = 0; p < b->model.planes; p++)
        planes[p] = sg_host_effective(&b->model)[sg_param_index(b->model.planes, i, p)];
}

static int reserve_frame(struct ref_engine *b, size_t pixels)
{
    if (pixels <= b->pixels_capacity)
        return SG_OK;
    sg_ctx *ctx = b->base.ctx;
    size_t c[6] = {0};
    sg_free(b->image.rgb);
    sg_free(b->image.t);
    sg_free(b->image.depth);
    sg_free(b->image.last);
    sg_free(b->gradient);
    sg_free(b->scratch);
    b->image = (struct ref_image){0};
    b->gradient = b->scratch = NULL;
    b->pixels_capacity = 0;
    if (sg_grow(ctx, SG_MEM_FRAME, &b->image.rgb, &c[0], pixels, 0, 3 * sizeof(float)) ||
        sg_grow(ctx, SG_MEM_FRAME, &b->image.t, &c[1], pixels, 0, sizeof(float)) ||
        sg_grow(ctx, SG_MEM_FRAME, &b->image.depth, &c[2], pixels, 0, sizeof(float)) ||
        sg_grow(ctx, SG_MEM_FRAME, &b->image.last, &c[3], pixels, 0, sizeof(int)) ||
        sg_grow(ctx, SG_MEM_FRAME, &b->gradient, &c[4], pixels, 0, 3 * sizeof(float)) ||
        sg_grow(ctx, SG_MEM_FRAME, &b->scratch, &c[5], pixels, 0, 5 * sizeof(float)))
        return SG_ERR_BUDGET;
    b->pixels_capacity = pixels;
    return SG_OK;
}

static int do_project(struct sg_engine *base, const struct sg_camera *camera, int sh_degree,
                      const struct sg_render_params *params)
{
    struct ref_engine *b = (struct ref_engine *) base;
    const size_t n = b->model.count;
    if (sg_grow(base->ctx, SG_MEM_SPLATS, &b->splats, &b->splats_capacity, n, 0,
                sizeof(*b->splats)) ||
        sg_grow(base->ctx, SG_MEM_INSTANCES, &b->list, &b->list_capacity, n, 0, sizeof(*b->list)) ||
        reserve_frame(b, (size_t) camera->width * (size_t) camera->height))
        return SG_ERR_BUDGET;
    b->view = view_make_mip(camera, params->mip_kernel);
    b->params = *params;
    b->degree = sh_degree;
    b->image.width = camera->width, b->image.height = camera->height;
    b->grid_x = (camera->width + SG_TILE - 1) / SG_TILE,
    b->grid_y = (camera->height + SG_TILE - 1) / SG_TILE;
    for (size_t i = 0; i < n; i++) {
        float planes[SG_PARAMS_MAX];
        gather(b, i, planes);
        ref_project(&b->view, planes, sh_degree, b->grid_x, b->grid_y, &b->splats[i]);
    }
    return SG_OK;
}

/* Calls fn for every pixel of every tile with the tile's list. */
static void each_pixel(struct ref_engine *b, struct sg_render_stats *stats,
                       void (*fn)(struct ref_engine *, size_t entries, int x, int y))
{
    for (int ty = 0; ty < b->grid_y; ty++)
        for (int tx = 0; tx < b->grid_x; tx++) {
            const size_t m = ref_tile_list(b->splats, b->model.count, tx, ty, b->list);
            if (stats) {
                stats->instances += m;
                stats->max_tile = m > stats->max_tile ? m : stats->max_tile;
            }
            for (int y = ty * SG_TILE; y < (ty + 1) * SG_TILE && y < b->image.height; y++)
                for (int x = tx * SG_TILE; x < (tx + 1) * SG_TILE && x < b->image.width; x++)
                    fn(b, m, x, y);
        }
}

static void pixel_forward(struct ref_engine *b, size_t entries, int x, int y)
{
    ref_pixel_forward(b->splats, b->list, entries, x, y, b->params.background, &b->image);
}

static void pixel_backward(struct ref_engine *b, size_t entries, int x, int y)
{
    (void) entries;
    ref_pixel_backward(b->splats, b->list, x, y, b->params.background, &b->image, b->gradient);
}

/* Each tile's list is made when the tile is drawn. */
static int do_bin(struct sg_engine *base)
{
    struct ref_engine *b = (struct ref_engine *) base;
    struct sg_render_stats s = {.bands = 1};
    for (size_t i = 0; i < b->model.count; i++)
        s.visible += b->splats[i].visible;
    base->step.stats = s;
    return SG_OK;
}

static int raster(struct sg_engine *base, bool auxiliary)
{
    (void) auxiliary;
    each_pixel((struct ref_engine *) base, &base->step.stats, pixel_forward);
    return SG_OK;
}

static int raster_backward(struct sg_engine *base)
{
    struct ref_engine *b = (struct ref_engine *) base;
    for (size_t i = 0; i < b->model.count; i++) {
        struct ref_splat *s = &b->splats[i];
        s->g = (struct splat_grad){0};
        s->g_o = s->g_rgb[0] = s->g_rgb[1] = s->g_rgb[2] = 0;
        s->absolute[0] = s->absolute[1] = 0;
    }
    each_pixel(b, NULL, pixel_backward);
    return SG_OK;
}

static size_t pixels(const struct ref_engine *b)
{
    return (size_t) b->image.width * (size_t) b->image.height;
}

static int read_image(struct sg_engine *base, float *rgb, float *alpha, float *depth)
{
    const struct ref_engine *b = (const struct ref_engine *) base;
    memcpy(rgb, b->image.rgb, 3 * pixels(b) * sizeof(float));
    for (size_t i = 0; alpha && i < pixels(b); i++)
        alpha[i] = 1 - b->image.t[i];
    if (depth)
        memcpy(depth, b->image.depth, pixels(b) * sizeof(float));
    return SG_OK;
}

static int write_image_gradient(struct sg_engine *base, const float *gradient)
{
    struct ref_engine *b = (struct ref_engine *) base;
    memcpy(b->gradient, gradient, 3 * pixels(b) * sizeof(float));
    return SG_OK;
}

/* Sum of the window over values at (x, y), zero outside. */
static float window_sum(const float *values, int width, int height, int x, int y)
{
    double sum = 0;
    for (int j = -SG_SSIM_RADIUS; j <= SG_SSIM_RADIUS; j++)
        for (int i = -SG_SSIM_RADIUS; i <= SG_SSIM_RADIUS; i++)
            if (x + i >= 0 && x + i < width && y + j >= 0 && y + j < height)
                sum += (double) sg_ssim_window[i + SG_SSIM_RADIUS] *
                       (double) sg_ssim_window[j + SG_SSIM_RADIUS] *
                       (double) values[(size_t) (y + j) * (size_t) width + (size_t) (x + i)];
    return (float) sum;
}

/* The low-pass term of one channel: its sum of squares; adds the gradient. D, P: scratch. */
static double low_pass(const struct ref_engine *b, const float *image,
                       const struct sg_target_pixels *target, size_t ch,
                       const struct sg_photometric *p, float *D, float *P, float *gradient)
{
    const int w = b->image.width, h = b->image.height;
    const size_t n = pixels(b);
    const float dark = p->tolerance, scale = 2 * p->low_pass / (3 * (float) n);
    double sum = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < n; i++) {
            const float photo = target->planes ? target->planes[ch * n + i]
                                               : (float) target->rgb[3 * i + ch] / 255.0f;
            const float d = image[i] - photo;
            const bool counts = !(target->mask && !target->mask[i]) && !(photo < dark && d < 0) &&
                                !(photo > 1 - dark && d > 0);
            if (pass == 0)
                D[i] = counts ? d : 0;
            else if (counts)
                gradient[i] +=
                    scale * window_sum(P, w, h, (int) (i % (size_t) w), (int) (i / (size_t) w));
        }
        for (size_t i = 0; i < n && pass == 0; i++) {
            P[i] = window_sum(D, w, h, (int) (i % (size_t) w), (int) (i / (size_t) w));
            sum += (double) P[i] * (double) P[i];
        }
    }
    return sum;
}

/* image: the render, or what the target's exposure makes of it. */
static void compare(struct sg_engine *base, const float *image,
                    const struct sg_target_pixels *target, const struct sg_photometric *p)
{
    struct ref_engine *b = (struct ref_engine *) base;
    const int w = b->image.width, h = b->image.height;
    const size_t n = pixels(b);
    const float unit = 1 / (3 * (float) n);
    double l1 = 0, mse = 0, ssim = 0, passed = 0;
    float *X = b->scratch, *Y = X + n, *M = X + 2 * n, *XX = X + 3 * n, *XY = X + 4 * n;
    for (int ch = 0; ch < 3; ch++) {
        const float *img = image + (size_t) ch * n;
        float *grad = b->gradient + (size_t) ch * n;
        for (size_t i = 0; i < n; i++) {
            X[i] = img[i];
            Y[i] = target->mask && !target->mask[i] ? img[i]
                   : target->planes                 ? target->planes[(size_t) ch * n + i]
                                    : (float) target->rgb[3 * i + (size_t) ch] / 255.0f;
            if (p->tolerance > 0)
                Y[i] = fminf(fmaxf(X[i], Y[i] - p->tolerance), Y[i] + p->tolerance);
            const float d = X[i] - Y[i];
            l1 += (double) fabsf(d);
            mse += (double) d * (double) d;
            grad[i] = (1 - p->lambda_dssim) * unit * (float) ((d > 0) - (d < 0));
        }
        for (int y = 0; y < h; y++)
            for (int x = 0; x < w; x++) {
                double m1 = 0, m2 = 0, xx = 0, yy = 0, xy = 0;
                for (int j = -SG_SSIM_RADIUS; j <= SG_SSIM_RADIUS; j++)
                    for (int i = -SG_SSIM_RADIUS; i <= SG_SSIM_RADIUS; i++) {
                        if (x + i < 0 || x + i >= w || y + j < 0 || y + j >= h)
                            continue;
                        const size_t at = (size_t) (y + j) * (size_t) w + (size_t) (x + i);
                        const double k = (double) sg_ssim_window[i + SG_SSIM_RADIUS] *
                                         (double) sg_ssim_window[j + SG_SSIM_RADIUS];
                        const double a = (double) X[at], c = (double) Y[at];
                        m1 += k * a, m2 += k * c, xx += k * a * a, yy += k * c * c, xy += k * a * c;
                    }
                const size_t at = (size_t) y * (size_t) w + (size_t) x;
                const struct ssim s =
                    ssim_point((float) m1, (float) m2, (float) (xx + yy), (float) xy);
                ssim += (double) s.s;
                M[at] = s.d_m, XX[at] = s.d_xx, XY[at] = s.d_xy;
            }
        for (int y = 0; y < h; y++)
            for (int x = 0; x < w; x++) {
                const size_t at = (size_t) y * (size_t) w + (size_t) x;
                const float ds = window_sum(M, w, h, x, y) +
                                 2 * X[at] * window_sum(XX, w, h, x, y) +
                                 Y[at] * window_sum(XY, w, h, x, y);
                grad[at] -= p->lambda_dssim * unit * ds;
            }
        for (size_t i = 0; i < n; i++)
            if ((target->mask && !target->mask[i]) || (p->tolerance > 0 && X[i] == Y[i]))
                grad[i] = 0; /* the target is the image itself there */
        if (p->low_pass > 0)
            passed += low_pass(b, img, target, (size_t) ch, p, M, XX, grad);
    }
    const double values = 3 * (double) n;
    base->step.photometric =
        sg_photometric_value_of(l1 / values, mse / values, ssim / values, p->lambda_dssim);
    base->step.photometric.total += (double) p->low_pass * passed / values;
    base->step.loss[SG_LOSS_PHOTOMETRIC] = base->step.photometric.total;
}

static int photometric(struct sg_engine *base, const struct sg_target_pixels *target,
                       const struct sg_photometric *p)
{
    struct ref_engine *b = (struct ref_engine *) base;
    const size_t n = pixels(b);
    const float *e = target->exposure, *rgb = b->image.rgb;
    if (!e) {
        compare(base, rgb, target, p);
        return SG_OK;
    }
    float *image = sg_alloc(base->ctx, SG_MEM_FRAME, n, 3 * sizeof(float));
    if (!image)
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++) {
            for (size_t k = 0; k < 3; k++)
                image[c * n + i] += rgb[k * n + i] * e[4 * k + c];
            image[c * n + i] += e[4 * c + 3];
        }
    compare(base, image, target, p);
    memset(base->step.exposure, 0, sizeof(base->step.exposure));
    for (size_t i = 0; i < n; i++) {
        double g[3];
        for (size_t c = 0; c < 3; c++)
            g[c] = (double) b->gradient[c * n + i];
        for (size_t k = 0; k < 3; k++) {
            double sum = 0;
            for (size_t c = 0; c < 3; c++) {
                sum += g[c] * (double) e[4 * k + c];
                base->step.exposure[4 * k + c] += g[c] * (double) rgb[k * n + i];
            }
            base->step.exposure[4 * k + 3] += g[k];
            b->gradient[k * n + i] = (float) sum;
        }
    }
    sg_free(image);
    return SG_OK;
}

static int loss(struct sg_engine *base, const struct sg_target_pixels *target,
                const struct sg_loss *l)
{
    struct ref_engine *b = (struct ref_engine *) base;
    if (l->kind == SG_LOSS_PHOTOMETRIC)
        return photometric(base, target, &l->photometric);
    const size_t values = 3 * pixels(b);
    double *g = sg_alloc_raw(base->ctx, SG_MEM_FRAME, values, sizeof(*g));
    const int code = g ? sg_ref_image_loss(base->ctx, l, b->image.rgb, b->image.width,
                                           b->image.height, g, &base->step.loss[l->kind])
                       : SG_ERR_BUDGET;
    for (size_t i = 0; i < values && !code; i++)
        b->gradient[i] = target->mask && !target->mask[i % pixels(b)]
                             ? 0
                             : b->gradient[i] + (float) (l->weight * g[i]);
    sg_free(g);
    return code;
}

static void pixel_pairs(struct ref_engine *b, size_t entries, int x, int y)
{
    ref_pixel_count(b->splats, b->list, entries, x, y, SG_HIT_PIXELS);
}

static void pixel_weights(struct ref_engine *b, size_t entries, int x, int y)
{
    ref_pixel_count(b->splats, b->list, entries, x, y, SG_HIT_WEIGHT);
}

static void pixel_transmittances(struct ref_engine *b, size_t entries, int x, int y)
{
    ref_pixel_count(b->splats, b->list, entries, x, y, SG_HIT_TRANSMITTANCE);
}

static int count_hits(struct sg_engine *base, const struct sg_camera *view,
                      const struct sg_render_params *params, enum sg_hit kind, double *hits)
{
    struct ref_engine *b = (struct ref_engine *) base;
    const int code = do_project(base, view, 0, params);
    if (code)
        return code;
    each_pixel(b, NULL,
               kind == SG_HIT_WEIGHT          ? pixel_weights
               : kind == SG_HIT_TRANSMITTANCE ? pixel_transmittances
                                              : pixel_pairs);
    for (size_t i = 0; i < b->model.count; i++)
        hits[i] += kind == SG_HIT_VIEWS ? b->splats[i].hits > 0 : b->splats[i].hits;
    return SG_OK;
}

static int do_project_backward(struct sg_engine *base, bool statistics)
{
    struct ref_engine *b = (struct ref_engine *) base;
    struct sg_host_model *h = &b->model;
    if ((statistics && sg_host_alloc_saved(base->ctx, h)) ||
        (base->statistic == SG_GRADIENT_MIP && sg_host_alloc(base->ctx, h, SG_C_GRAD_ABSOLUTE)) ||
        sg_host_alloc(base->ctx, h, SG_C_GRADIENT))
        return SG_ERR_BUDGET;
    for (size_t i = 0; i < h->count; i++) {
        const struct ref_splat *s = &b->splats[i];
        if (statistics && s->visible) {
            const bool absolute = base->statistic == SG_GRADIENT_ABSOLUTE;
            const float gx = (absolute ? s->absolute[0] : s->g.x) * b->view.half_w,
                        gy = (absolute ? s->absolute[1] : s->g.y) * b->view.half_h;
            h->at[SG_C_GRAD_SUM][i] += sqrtf(gx * gx + gy * gy);
            h->at[SG_C_GRAD_COUNT][i] += 1;
            if (base->statistic == SG_GRADIENT_MIP)
                h->at[SG_C_GRAD_ABSOLUTE][i] +=
                    s->absolute[0] * b->view.half_w + s->absolute[1] * b->view.half_h;
        }
        float planes[SG_PARAMS_MAX], g[SG_PARAMS_MAX];
        gather(b, i, planes);
        ref_parameter_gradient(&b->view, s, planes, b->degree, g);
        for (int p = 0; p < h->planes; p++)
            h->at[SG_C_GRADIENT][sg_param_index(h->planes, i, p)] = g[p];
    }
    return SG_OK;
}

static int optimise(struct sg_engine *base, const struct sg_update *u)
{
    struct sg_host_model *h = &((struct ref_engine *) base)->model;
    if (sg_host_alloc_saved(base->ctx, h) ||
        (u->accumulate && sg_host_alloc(base->ctx, h, SG_C_ACCUMULATED)))
        return SG_ERR_BUDGET;
    float *params = h->at[SG_C_PARAMETERS], *sums = h->at[SG_C_ACCUMULATED];
    for (int c = 0; c < SG_COLUMNS && sg_column_is_parameter(c); c++)
        for (size_t i = 0; i < h->count; i++)
            for (int p = sg_columns[c].first; p < sg_column_end(c, h->planes); p++) {
                const enum sg_group group = sg_columns[c].group;
                const size_t at = sg_param_index(h->planes, i, p);
                float g = h->at[SG_C_GRADIENT][at];
                if (u->accumulate) {
                    g += sums[at];
                    sums[at] = u->adam ? 0 : g;
                }
                const float o = 1 / (1 + expf(-params[at]));
                if (p == SG_P_OPACITY)
                    g += u->mean_opacity / (float) h->count * o * (1 - o);
                if (p >= SG_P_SCALE && p < SG_P_SCALE + 3)
                    g += u->mean_scale / (3 * (float) h->count) * expf(params[at]);
                if (!u->adam || !(u->rate[group] > 0))
                    continue;
                float *m = &h->at[SG_C_MOMENT1][at], *v = &h->at[SG_C_MOMENT2][at];
                const struct adam_state s = adam_step((struct adam_state){params[at], *m, *v}, g,
                                                      u->rate[group], u->root[group]);
                params[at] = s.p, *m = s.m, *v = s.v;
            }
    return SG_OK;
}

static int read_gradients(struct sg_engine *base, struct sg_model *out)
{
    const struct sg_host_model *h = &((struct ref_engine *) base)->model;
    memcpy(out->params, h->at[SG_C_GRADIENT], out->capacity * (size_t) h->planes * sizeof(float));
    return SG_OK;
}

static int shape(struct sg_engine *base, const struct sg_shape *how)
{
    return sg_host_shape(base->ctx, &((struct ref_engine *) base)->model, how);
}

static int shape_backward(struct sg_engine *base, const struct sg_shape *how)
{
    return sg_host_shape_backward(base->ctx, &((struct ref_engine *) base)->model, how);
}

static int read_statistics(struct sg_engine *base, const struct sg_statistics *out)
{
    sg_host_statistics(base->ctx, &((struct ref_engine *) base)->model, out);
    return SG_OK;
}

static int edit(struct sg_engine *base, const struct sg_edit *e)
{
    return sg_host_edit(base->ctx, &((struct ref_engine *) base)->model, e);
}

static int floor_scale(struct sg_engine *base, float smallest)
{
    sg_host_floor_scale(&((struct ref_engine *) base)->model, smallest);
    return SG_OK;
}

static int reset_opacity(struct sg_engine *base, float limit)
{
    sg_host_reset_opacity(&((struct ref_engine *) base)->model, limit, base->shape);
    return SG_OK;
}

static int count_radii(struct sg_engine *base)
{
    struct ref_engine *b = (struct ref_engine *) base;
    if (sg_host_alloc(base->ctx, &b->model, SG_C_RADIUS))
        return SG_ERR_BUDGET;
    float *largest = b->model.at[SG_C_RADIUS];
    for (size_t i = 0; i < b->model.count; i++)
        if (b->splats[i].visible)
            largest[i] = fmaxf(largest[i], (float) b->splats[i].rect.radius);
    return SG_OK;
}

static int relocate(struct sg_engine *base, const struct sg_relocation *r)
{
    sg_host_relocate(&((struct ref_engine *) base)->model, r);
    return SG_OK;
}

static int filter(struct sg_engine *base, const struct sg_camera *const *cameras, size_t n,
                  const struct sg_mip_filter *how)
{
    return sg_host_filter(base->ctx, &((struct ref_engine *) base)->model, cameras, n, how);
}

static int explore(struct sg_engine *base, const struct sg_exploration *x)
{
    sg_host_explore(base->ctx, &((struct ref_engine *) base)->model, x);
    return SG_OK;
}

static const struct sg_engine_ops ops = {
    .name = "ref",
    .absolute = true,
    .exposure = true,
    .mip_kernel = true,
    .destroy = destroy,
    .variant = variant,
    .upload = upload,
    .adopt = adopt,
    .download = download,
    .host_model = host_model,
    .count = count,
    .read_statistics = read_statistics,
    .edit = edit,
    .floor_scale = floor_scale,
    .reset_opacity = reset_opacity,
    .count_radii = count_radii,
    .relocate = relocate,
    .explore = explore,
    .filter = filter,
    .project = do_project,
    .bin = do_bin,
    .raster = raster,
    .read_image = read_image,
    .loss = loss,
    .write_image_gradient = write_image_gradient,
    .raster_backward = raster_backward,
    .shape = shape,
    .shape_backward = shape_backward,
    .project_backward = do_project_backward,
    .optimise = optimise,
    .read_gradients = read_gradients,
    .count_hits = count_hits,
};

static int create(sg_ctx *ctx, const char *variant_name, struct sg_engine **out)
{
    (void) variant_name;
    struct ref_engine *b = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*b));
    if (!b)
        return SG_ERR_BUDGET;
    b->base = (struct sg_engine){.ops = &ops, .ctx = ctx};
    *out = &b->base;
    return SG_OK;
}

static struct sg_footprint footprint(const struct sg_work *w)
{
    const uint64_t projection = sizeof(struct ref_splat) + sizeof(struct ref_entry);
    return (struct sg_footprint){
        .gaussian = sg_host_footprint(w, true) + projection + projection / 2,
        .view = (uint64_t) w->width * (uint64_t) w->height *
                ((w->exposure ? 24 : 21) * sizeof(float) + sizeof(int)),
    };
}

static bool describe(size_t index, struct sg_engine_info *out)
{
    if (index == 0 && out) {
        out->description = "scalar and slow: what the others are tested against";
        out->available = out->chosen = true;
    }
    return index == 0;
}

const struct sg_engine_kind sg_engine_ref = {
    .name = "ref", .create = create, .footprint = footprint, .describe = describe};
