/* SPDX-License-Identifier: Apache-2.0 */
/* PUP 3D-GS (Hanson et al. 2024): the Fisher information of a Gaussian's position and log scale.
 *
 * F = sum of g g^T over views, pixels and channels, where g is the gradient of one value of the
 * image. In a view g = M u: u are the gradients of the projected Gaussian, which are known for each
 * pixel, and M depends on the Gaussian and the view only. So the moments sum u u^T are added up
 * over the pixels of a tile, and M is applied once for each Gaussian and tile. In double precision:
 * eigenvalues of F span more digits than a float has. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "math/real_f64.h"

#include "engine/ref/render.h"
#include "score.h"
#include "scene/cameras.h"

#define GEOMETRY 5                            /* of u: x, y, A, half B, C */
#define PAIRS (GEOMETRY * (GEOMETRY + 1) / 2) /* of them */
#define CHANNEL (PAIRS + GEOMETRY)            /* moments of a channel: pairs, and with the colour */
#define MOMENTS (3 * CHANNEL + 1)             /* and that of the colour, which channels share */
#define FISHER 21                             /* of a symmetric 6 x 6 matrix */
#define CHUNK_INSTANCES 65536                 /* whose moments are held at once */

/* A projected Gaussian: what pixels need of it. */
struct fisher_splat {
    double x, y, A, B, C, o, rgb[3];
    float z;
    bool visible;
    struct tile_rect rect;
};

struct job {
    const struct sg_model *model;
    struct pinhole view;
    int width, height, grid_x, grid_y, degree;
    double background[3];
    bool cumulative;
    struct fisher_splat *splats;
    size_t *tile_start;        /* tiles + 1 */
    struct ref_entry *entries; /* of all tiles, in drawing order */
    size_t first_tile;         /* of the chunk */
    double *slots;             /* per entry of the chunk: MOMENTS, then FISHER of them are F */
    uint8_t *shown;            /* NULL, or whether a pixel has the Gaussian */
};

static void load(const struct sg_model *m, size_t i, double *planes)
{
    memset(planes, 0, SG_PARAMS_MAX * sizeof(*planes));
    for (int p = 0; p < sg_param_count(m->sh_degree); p++)
        planes[p] = (double) *sg_model_at(m, i, p);
}

#define PIECE 1024 /* Gaussians */

static void project_piece(void *arg, size_t piece, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t n = j->model->count, end = (piece + 1) * PIECE < n ? (piece + 1) * PIECE : n;
    for (size_t i = piece * PIECE; i < end; i++) {
        double planes[SG_PARAMS_MAX];
        struct ref_splat s;
        load(j->model, i, planes);
        ref_project(&j->view, planes, j->degree, j->grid_x, j->grid_y, &s);
        j->splats[i] = (struct fisher_splat){.x = s.s.x,
                                             .y = s.s.y,
                                             .A = s.s.A,
                                             .B = s.s.B,
                                             .C = s.s.C,
                                             .o = s.o,
                                             .rgb = {s.rgb[0], s.rgb[1], s.rgb[2]},
                                             .z = (float) s.s.z,
                                             .visible = s.visible,
                                             .rect = s.rect};
    }
}

/* The lists of all tiles, each in the order of the Gaussians. */
static int list_tiles(sg_ctx *ctx, struct job *j, size_t *capacity)
{
    const size_t tiles = (size_t) j->grid_x * (size_t) j->grid_y, n = j->model->count;
    memset(j->tile_start, 0, (tiles + 1) * sizeof(*j->tile_start));
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < n; i++) {
            const struct fisher_splat *s = &j->splats[i];
            for (int ty = s->rect.y0; s->visible && ty < s->rect.y1; ty++)
                for (int tx = s->rect.x0; tx < s->rect.x1; tx++) {
                    const size_t tile = (size_t) ty * (size_t) j->grid_x + (size_t) tx;
                    if (pass == 0)
                        j->tile_start[tile + 1]++;
                    else
                        j->entries[j->tile_start[tile]++] = (struct ref_entry){s->z, (uint32_t) i};
                }
        }
        if (pass == 0) {
            for (size_t t = 0; t < tiles; t++)
                j->tile_start[t + 1] += j->tile_start[t];
            if (sg_grow(ctx, SG_MEM_INSTANCES, &j->entries, capacity, j->tile_start[tiles] + 1, 0,
                        sizeof(*j->entries)))
                return SG_ERR_BUDGET;
        } else
            memmove(j->tile_start + 1, j->tile_start, tiles * sizeof(*j->tile_start));
    }
    j->tile_start[0] = 0;
    return SG_OK;
}

static bool pair(const struct fisher_splat *s, int ix, int iy, double *dx, double *dy,
                 double *gauss, double *alpha)
{
    *dx = s->x - ix, *dy = s->y - iy;
    const double power = -0.5 * (s->A * *dx * *dx + s->C * *dy * *dy) - s->B * *dx * *dy;
    if (power > 0)
        return false;
    *gauss = exp(power);
    *alpha = fmin((double) SG_ALPHA_MAX, s->o * *gauss);
    return !(*alpha < (double) SG_ALPHA_MIN);
}

/* Adds the moments of a pixel, whose colour is `weight` of the Gaussian's, where `slope` is the
 * gradient of its channels with respect to the Gaussian's value there. */
static void add_moments(double *out, const double *u, const double *slope, double weight)
{
    double pairs[PAIRS];
    for (int i = 0, k = 0; i < GEOMETRY; i++)
        for (int l = i; l < GEOMETRY; l++)
            pairs[k++] = u[i] * u[l];
    for (int ch = 0; ch < 3; ch++, out += CHANNEL) {
        const double square = slope[ch] * slope[ch], cross = slope[ch] * weight;
        for (int k = 0; k < PAIRS; k++)
            out[k] += square * pairs[k];
        for (int i = 0; i < GEOMETRY; i++)
            out[PAIRS + i] += cross * u[i];
    }
    *out += weight * weight;
}

/* Front to back for the last Gaussian and the transmittance, then back to front. */
static void add_pixel(const struct job *j, const struct ref_entry *list, size_t m, int ix, int iy,
                      double *slots)
{
    double t = 1, dx, dy, gauss, alpha, acc[3] = {0}, alpha_behind = 0, behind[3] = {0};
    size_t last = 0;
    for (size_t k = 0; k < m; k++) {
        if (!pair(&j->splats[list[k].id], ix, iy, &dx, &dy, &gauss, &alpha))
            continue;
        const double next = t * (1 - alpha);
        if (next < (double) SG_T_MIN)
            break;
        t = next;
        last = k + 1;
    }
    const double t_final = t;
    while (last-- > 0) {
        const struct fisher_splat *s = &j->splats[list[last].id];
        if (!pair(s, ix, iy, &dx, &dy, &gauss, &alpha))
            continue;
        t /= 1 - alpha;
        double slope[3];
        for (int ch = 0; ch < 3; ch++) {
            acc[ch] = alpha_behind * behind[ch] + (1 - alpha_behind) * acc[ch];
            behind[ch] = s->rgb[ch];
            slope[ch] =
                s->o * (t * (s->rgb[ch] - acc[ch]) - t_final / (1 - alpha) * j->background[ch]);
        }
        alpha_behind = alpha;
        const double hx = gauss * dx, hy = gauss * dy;
        const double u[GEOMETRY] = {-hx * s->A - hy * s->B, -hy * s->C - hx * s->B, -0.5 * hx * dx,
                                    -0.5 * hx * dy, -0.5 * hy * dy};
        add_moments(slots + last * MOMENTS, u, slope, alpha * t);
    }
}

/* M: columns of the geometry, then one of each channel's colour. Rows: position, log scale. */
static void make_map(const struct job *j, size_t i, double map[GEOMETRY + 3][6])
{
    double planes[SG_PARAMS_MAX], rotation[4], weight[16], d[3];
    struct ref_splat s;
    load(j->model, i, planes);
    ref_project(&j->view, planes, j->degree, j->grid_x, j->grid_y, &s);
    for (int k = 0; k < GEOMETRY; k++) {
        const struct splat_grad unit = {k == 0, k == 1, k == 2, k == 3, k == 4, 0};
        project_backward(&j->view, &s.p, &s.s, &unit, map[k], map[k] + 3, rotation);
    }
    for (int ch = 0; ch < 3; ch++) {
        double *column = map[GEOMETRY + ch];
        memset(column, 0, 6 * sizeof(*column));
        for (int k = 0; k < (j->degree + 1) * (j->degree + 1); k++)
            weight[k] = s.clamped[ch] ? 0 : planes[SG_P_SH + 3 * k + ch];
        sh_direction_gradient(j->degree, s.dir[0], s.dir[1], s.dir[2], weight, d);
        const double dot = d[0] * s.dir[0] + d[1] * s.dir[1] + d[2] * s.dir[2];
        for (int k = 0; k < 3; k++)
            column[k] = (d[k] - s.dir[k] * dot) / s.dist;
        for (int k = 0; k < 3 && j->cumulative && ch > 0; k++)
            column[k] += map[GEOMETRY + ch - 1][k];
    }
}

/* Moments become their part of F, in place. */
static void apply_map(const double map[GEOMETRY + 3][6], double *slot)
{
    double f[FISHER] = {0};
    for (int ch = 0; ch < 3; ch++) {
        const double *moment = slot + ch * CHANNEL;
        double u[GEOMETRY + 1][GEOMETRY + 1], left[6][GEOMETRY + 1];
        const double *column[GEOMETRY + 1];
        for (int i = 0, k = 0; i < GEOMETRY; i++)
            for (int l = i; l < GEOMETRY; l++)
                u[i][l] = u[l][i] = moment[k++];
        for (int i = 0; i < GEOMETRY; i++) {
            u[i][GEOMETRY] = u[GEOMETRY][i] = moment[PAIRS + i];
            column[i] = map[i];
        }
        u[GEOMETRY][GEOMETRY] = slot[3 * CHANNEL];
        column[GEOMETRY] = map[GEOMETRY + ch];
        for (int row = 0; row < 6; row++)
            for (int l = 0; l <= GEOMETRY; l++) {
                left[row][l] = 0;
                for (int i = 0; i <= GEOMETRY; i++)
                    left[row][l] += column[i][row] * u[i][l];
            }
        for (int row = 0, k = 0; row < 6; row++)
            for (int col = row; col < 6; col++, k++)
                for (int l = 0; l <= GEOMETRY; l++)
                    f[k] += left[row][l] * column[l][col];
    }
    memcpy(slot, f, sizeof(f));
}

static bool in_pixel(const double *slot)
{
    return slot[3 * CHANNEL] > 0;
}

static void do_tile(void *arg, size_t index, int thread)
{
    (void) thread;
    const struct job *j = arg;
    const size_t tile = j->first_tile + index, first = j->tile_start[tile],
                 m = j->tile_start[tile + 1] - first;
    struct ref_entry *list = j->entries + first;
    double *slots = j->slots + (first - j->tile_start[j->first_tile]) * MOMENTS;
    if (!m)
        return;
    qsort(list, m, sizeof(*list), ref_entry_compare);
    memset(slots, 0, m * MOMENTS * sizeof(*slots));
    const int x0 = (int) (tile % (size_t) j->grid_x) * SG_TILE,
              y0 = (int) (tile / (size_t) j->grid_x) * SG_TILE;
    for (int y = y0; y < y0 + SG_TILE && y < j->height; y++)
        for (int x = x0; x < x0 + SG_TILE && x < j->width; x++)
            add_pixel(j, list, m, x, y, slots);
    for (size_t k = 0; k < m; k++) {
        double map[GEOMETRY + 3][6];
        if (!in_pixel(slots + k * MOMENTS))
            continue;
        make_map(j, list[k].id, map);
        apply_map(map, slots + k * MOMENTS);
    }
}

/* A view that is `reduce` times smaller, with the same field of view. */
static struct sg_camera reduced(const struct sg_camera *c, int reduce)
{
    struct sg_camera small = *c;
    small.width = (c->width + reduce - 1) / reduce,
    small.height = (c->height + reduce - 1) / reduce;
    const double x = (double) small.width / c->width, y = (double) small.height / c->height;
    small.fx *= x, small.cx *= x, small.fy *= y, small.cy *= y;
    return small;
}

/* Adds the part of one view, in the order of the tiles: the same bytes for any number of threads.
 * f: FISHER values per Gaussian. */
static int add_view(sg_ctx *ctx, struct job *j, size_t capacity[3], double *f)
{
    const size_t tiles = (size_t) j->grid_x * (size_t) j->grid_y;
    if (sg_grow(ctx, SG_MEM_INSTANCES, &j->tile_start, &capacity[0], tiles + 1, 0,
                sizeof(*j->tile_start)))
        return SG_ERR_BUDGET;
    sg_parallel_for(ctx, (j->model->count + PIECE - 1) / PIECE, project_piece, j);
    if (list_tiles(ctx, j, &capacity[1]))
        return SG_ERR_BUDGET;
    for (size_t first = 0, end; first < tiles; first = end) {
        const size_t from = j->tile_start[first];
        for (end = first + 1; end < tiles && j->tile_start[end + 1] - from <= CHUNK_INSTANCES;)
            end++;
        const size_t m = j->tile_start[end] - from;
        if (sg_grow(ctx, SG_MEM_INSTANCES, &j->slots, &capacity[2], m + 1, 0,
                    MOMENTS * sizeof(*j->slots)))
            return SG_ERR_BUDGET;
        j->first_tile = first;
        sg_parallel_for(ctx, end - first, do_tile, j);
        for (size_t k = 0; k < m; k++) {
            const double *slot = j->slots + k * MOMENTS;
            const size_t id = j->entries[from + k].id;
            for (size_t v = 0; v < FISHER; v++)
                f[id * FISHER + v] += slot[v];
            if (j->shown && in_pixel(slot))
                j->shown[id] = 1;
        }
    }
    return SG_OK;
}

/* f: FISHER values per Gaussian. shown: zeros, see struct job. */
static int accumulate(sg_ctx *ctx, const struct sg_camera *const *views, size_t n,
                      const struct sg_model *m, const struct sg_prune_params *p, double *f,
                      uint8_t *shown)
{
    struct job j = {.model = m,
                    .degree = m->active_sh_degree,
                    .cumulative = p->released_gradient,
                    .shown = shown};
    size_t capacity[3] = {0};
    int code = SG_OK;
    for (int ch = 0; ch < 3; ch++)
        j.background[ch] = p->white_background;
    memset(f, 0, m->count * FISHER * sizeof(*f));
    j.splats = sg_alloc_raw(ctx, SG_MEM_SPLATS, m->count, sizeof(*j.splats));
    code = j.splats ? SG_OK : SG_ERR_BUDGET;
    for (size_t v = 0; v < n && !code; v++) {
        const struct sg_camera camera = reduced(views[v], p->reduce);
        j.view = view_make(&camera);
        j.width = camera.width, j.height = camera.height;
        j.grid_x = (camera.width + SG_TILE - 1) / SG_TILE,
        j.grid_y = (camera.height + SG_TILE - 1) / SG_TILE;
        if (!(code = sg_progress(ctx, SG_STAGE_COUNT, v, n)))
            code = add_view(ctx, &j, capacity, f);
    }
    sg_free(j.splats);
    sg_free(j.tile_start);
    sg_free(j.entries);
    sg_free(j.slots);
    return code;
}

static void unpack(const double *f, double *matrix)
{
    for (int row = 0, k = 0; row < 6; row++)
        for (int col = row; col < 6; col++, k++)
            matrix[6 * row + col] = matrix[6 * col + row] = f[k];
}

int sg_pup_fisher(sg_ctx *ctx, const struct sg_camera *const *views, size_t n,
                  const struct sg_model *m, const struct sg_prune_params *p, double *fisher)
{
    double *f = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, m->count, FISHER * sizeof(*f));
    const int code = f ? accumulate(ctx, views, n, m, p, f, NULL) : SG_ERR_BUDGET;
    for (size_t i = 0; i < m->count && !code; i++)
        unpack(f + i * FISHER, fisher + 36 * i);
    sg_free(f);
    return code;
}

/* By the factors of Cholesky. Rows and columns are scaled first, so that parameters of different
 * size do not take each other's digits. */
double sg_log_det6(const double *matrix)
{
    double l[36], scale[6], sum = 0;
    for (int i = 0; i < 36; i++)
        if (!isfinite(matrix[i]))
            return NAN;
    for (int i = 0; i < 6; i++) {
        if (!(matrix[7 * i] > 0))
            return -INFINITY;
        scale[i] = 1 / sqrt(matrix[7 * i]);
        sum += log(matrix[7 * i]);
    }
    for (int i = 0; i < 6; i++)
        for (int k = 0; k <= i; k++) {
            double v = matrix[6 * i + k] * scale[i] * scale[k];
            for (int s = 0; s < k; s++)
                v -= l[6 * i + s] * l[6 * k + s];
            if (i == k) {
                if (!(v > 1e-15)) /* rounding errors of 0 */
                    return -INFINITY;
                l[7 * i] = sqrt(v);
                sum += log(v);
            } else
                l[6 * i + k] = v / l[7 * k];
        }
    return sum;
}

int sg_pup(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_model *m,
           const struct sg_prune_params *p, double *score, size_t *unseen)
{
    const struct sg_camera **views = sg_training_cameras(ctx, scene);
    double *f = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, m->count, FISHER * sizeof(*f));
    uint8_t *shown = sg_alloc(ctx, SG_MEM_OPTIMISER, m->count, 1);
    int code = views && f && shown ? SG_OK : SG_ERR_BUDGET;
    if (!code)
        code = accumulate(ctx, views, scene->n_train, m, p, f, shown);
    *unseen = 0;
    for (size_t i = 0; i < m->count && !code; i++) {
        double matrix[36];
        unpack(f + i * FISHER, matrix);
        score[i] = sg_log_det6(matrix);
        *unseen += !shown[i];
    }
    sg_free(views);
    sg_free(f);
    sg_free(shown);
    return code;
}
