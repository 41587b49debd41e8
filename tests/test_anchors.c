/* SPDX-License-Identifier: Apache-2.0 */
/* Anchors of Scaffold-GS on their own: cells, start, growth and files. */
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "comma.h"
#include "model/anchors.h"
#include "models.h"
#include "splatguard/format.h"
#include "train/growth.h"
#include "whole_file.h"

#define assert_near(a, b)                                                                          \
    do {                                                                                           \
        const double a_ = (double) (a), b_ = (double) (b);                                         \
        if (!(fabs(a_ - b_) <= 1e-6 * fmax(fabs(b_), 1e-3)))                                       \
            fail_msg("%s: found %.9g, expected %.9g", #a, a_, b_);                                 \
    } while (0)

static float *anchor_at(const struct sg_model *m, size_t i, int plane)
{
    return &m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, plane)];
}

/* Half to even, as the released code rounds. */
static void test_cells(void **state)
{
    (void) state;
    static const struct {
        float position, size;
        int64_t cell;
    } cases[] = {{8, 16, 0}, {24, 16, 2}, {40, 16, 2}, {-24, 16, -2}, {-23, 16, -1}, {0, 1, 0}};
    int64_t cell;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        assert_true(sg_anchor_cell(cases[i].position, cases[i].size, &cell));
        assert_int_equal(cell, cases[i].cell);
    }
    assert_false(sg_anchor_cell(1e30f, 1e-3f, &cell));
    assert_false(sg_anchor_cell(INFINITY, 1, &cell));
    assert_false(sg_anchor_cell(NAN, 1, &cell));
}

static void test_start(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    /* two of them in one cell */
    const float xyz[] = {0.04f, 0, 0, -0.04f, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3.04f};
    struct sg_model *m, *same;
    size_t cells;
    struct sg_anchor_start start = {.voxel = 0.1f, .seed = 3};
    assert_int_equal(sg_anchors_init(ctx, xyz, 5, &start, &cells, &m), SG_OK);
    assert_int_equal(cells, 4);
    assert_int_equal(m->count, 4);
    const float at[4][3] = {{0, 0, 0}, {0, 0, 3}, {0, 2, 0}, {1, 0, 0}}; /* sorted by x, y, z */
    for (size_t i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++)
            assert_near(*sg_model_at(m, i, SG_P_XYZ + k), at[i][k]);
    const double mean = (1 + 4 + 9) / 3.0; /* squared distances of the first to the others */
    for (int k = 0; k < 3; k++) {
        assert_near(*sg_model_at(m, 0, SG_P_SCALE + k), 0.5 * log(mean));
        assert_near(*anchor_at(m, 0, SG_A_SIZE + k), 0.5 * log(mean));
    }
    for (int p = 0; p < SG_A_SIZE; p++)
        assert_true(*anchor_at(m, 2, p) == 0);
    /* weights follow from the seed, and are as wide as their layer's inputs ask for */
    const struct sg_networks *n = m->columns->networks;
    float most = 0;
    for (int h = 0; h < SG_HIDDEN; h++)
        most = fmaxf(most, fabsf(n->value.input[0][h]));
    assert_true(most > 0.12f && most <= 1 / sqrtf(SG_NETWORK_INPUTS));
    assert_int_equal(sg_anchors_init(ctx, xyz, 5, &start, &cells, &same), SG_OK);
    assert_memory_equal(&n->value, &same->columns->networks->value, sizeof(n->value));
    sg_model_destroy(&same);
    sg_model_destroy(&m);
    const float row[] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 4, 0, 0, 5, 0, 0, 6, 0, 0, 7, 0, 0};
    start.limit = 4; /* every other */
    assert_int_equal(sg_anchors_init(ctx, row, 8, &start, &cells, &m), SG_OK);
    assert_int_equal(cells, 8);
    assert_int_equal(m->count, 4);
    assert_near(*sg_model_at(m, 3, SG_P_XYZ), 6);
    sg_model_destroy(&m);
    const float bad[] = {0, 0, 0, 1, 0, 0, 2, 0, 0, NAN, 0, 0};
    start.limit = 0;
    assert_int_equal(sg_anchors_init(ctx, bad, 4, &start, &cells, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "point 3"));
    sg_clear_error(ctx);
    const float crowd[] = {0, 0, 0, 0, 0, 0, 0.01f, 0, 0, 1, 0, 0};
    assert_int_equal(sg_anchors_init(ctx, crowd, 4, &start, &cells, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "found 2 voxels"));
    sg_ctx_destroy(&ctx);
}

/* Without a size of voxels it is the median of the points' mean squared distances to their three
 * nearest; the released code takes element trunc(n / 2), counted from 1. */
static void test_median(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    /* squared distances, in hundredths: 46/3, 10, 22/3, 50/3, and 146/3, with the last point 30;
     * 250/3 of that one */
    const float x[] = {0, 0.1f, 0.3f, 0.6f, 1, 1.5f};
    static const int cells[2][6] = {{0, 1, 3, 6, 10}, {0, 1, 2, 4, 7, 10}};
    const struct sg_anchor_start start = {.seed = 3};
    struct sg_model *m;
    float xyz[18] = {0};
    size_t found;
    for (int i = 0; i < 6; i++)
        xyz[3 * i] = x[5 - i]; /* in no order */
    for (size_t n = 5; n <= 6; n++) {
        const double voxel = n == 5 ? 0.1 : 0.46 / 3;
        assert_int_equal(sg_anchors_init(ctx, xyz + 3 * (6 - n), n, &start, &found, &m), SG_OK);
        assert_near(m->columns->networks->voxel, voxel);
        assert_int_equal(found, n);
        assert_int_equal(m->count, n);
        for (size_t i = 0; i < n; i++)
            assert_near(*sg_model_at(m, i, SG_P_XYZ), cells[n - 5][i] * voxel);
        sg_model_destroy(&m);
    }
    for (int i = 0; i < 18; i++) /* four of six on one place */
        xyz[i] = i == 12 || i == 16;
    assert_int_equal(sg_anchors_init(ctx, xyz, 6, &start, &found, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "found half of them on others"));
    sg_ctx_destroy(&ctx);
}

/* One anchor with one Gaussian that grows, as in the released code. */
struct growing {
    struct sg_model *m;
    float *statistics;
    struct sg_growth_params p;
};

static struct growing make_growing(sg_ctx *ctx, size_t n)
{
    struct growing g = {.p = {.voxel = 0.001f,
                              .factor = 16,
                              .grids = 3,
                              .finer = 4,
                              .gradient = 0.0002f,
                              .drawn = 40,
                              .drop = 0, /* none is left out */
                              .log_size_max = 0.05f,
                              .limit = SIZE_MAX}};
    assert_int_equal(sg_model_create(ctx, n, 0, &g.m), SG_OK);
    assert_int_equal(sg_anchors_add(ctx, g.m, 0), SG_OK);
    g.statistics = calloc(g.m->capacity, SG_A_STATISTICS * sizeof(float));
    assert_non_null(g.statistics);
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++)
            *sg_model_at(g.m, i, SG_P_SCALE + k) = logf(0.01f);
    return g;
}

static void mark(struct growing *g, size_t i, int k, float drawn, float mean)
{
    g->statistics[sg_param_index(SG_A_STATISTICS, i, SG_A_DRAWN + k)] = drawn;
    g->statistics[sg_param_index(SG_A_STATISTICS, i, SG_A_GRADIENT + k)] = drawn * mean;
}

static struct sg_model *grow(sg_ctx *ctx, const struct growing *g, bool *bound)
{
    struct sg_model *rows;
    const struct sg_anchor_view view = {g->m->count, g->m->params, g->m->columns->at[SG_C_ANCHOR],
                                        g->statistics};
    assert_int_equal(sg_grow_anchors(ctx, &view, &g->p, &rows, bound), SG_OK);
    return rows;
}

static void test_growth(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct growing g = make_growing(ctx, 2);
    struct sg_model *rows;
    bool bound;
    *sg_model_at(g.m, 1, SG_P_XYZ) = 5;
    for (int f = 0; f < SG_ANCHOR_FEATURES; f++) {
        *anchor_at(g.m, 0, SG_A_FEATURE + f) = f % 2 ? -1.0f : (float) f;
        *anchor_at(g.m, 1, SG_A_FEATURE + f) = 2;
    }
    /* Along x at 0.017: cell 1 of the coarsest grid. Cell 4 of the next then has that anchor, and
     * the gradient is too small for the finest. */
    *anchor_at(g.m, 0, SG_A_OFFSET) = 1.7f;
    mark(&g, 0, 0, 40, 0.0005f);
    assert_null(grow(ctx, &g, &bound)); /* not drawn often enough */
    mark(&g, 0, 0, 41, 0.0005f);
    rows = grow(ctx, &g, &bound);
    assert_non_null(rows);
    assert_false(bound);
    assert_int_equal(rows->count, 1);
    assert_near(*sg_model_at(rows, 0, SG_P_XYZ), 0.016);
    assert_near(*sg_model_at(rows, 0, SG_P_XYZ + 1), 0);
    for (int k = 0; k < 3; k++) {
        assert_near(*sg_model_at(rows, 0, SG_P_SCALE + k), log(0.016));
        assert_near(*anchor_at(rows, 0, SG_A_SIZE + k), log(0.016));
        assert_true(*anchor_at(rows, 0, SG_A_OFFSET + k) == 0);
    }
    assert_true(*sg_model_at(rows, 0, SG_P_ROT) == 1);
    sg_model_destroy(&rows);

    /* A second one in the same cell: the larger of each feature. */
    *anchor_at(g.m, 1, SG_A_OFFSET + 3 * 4) = (0.018f - 5) / 0.01f;
    mark(&g, 1, 4, 50, 0.0003f);
    rows = grow(ctx, &g, &bound);
    assert_int_equal(rows->count, 1);
    for (int f = 0; f < SG_ANCHOR_FEATURES; f++)
        assert_near(*anchor_at(rows, 0, SG_A_FEATURE + f), f % 2 || f < 2 ? 2 : f);
    sg_model_destroy(&rows);

    /* The finest grid: 1.7 cells of 16 are 6.8 of 4 and 27.2 of 1. */
    *anchor_at(g.m, 0, SG_A_OFFSET + 1) = 1.13f;
    mark(&g, 0, 0, 41, 0.0009f);
    mark(&g, 1, 4, 0, 0);
    rows = grow(ctx, &g, &bound);
    assert_int_equal(rows->count, 3);
    const double x[3] = {0.016, 0.016, 0.017}, y[3] = {0.016, 0.012, 0.011};
    for (size_t i = 0; i < 3; i++) {
        assert_near(*sg_model_at(rows, i, SG_P_XYZ), x[i]);
        assert_near(*sg_model_at(rows, i, SG_P_XYZ + 1), y[i]);
        assert_near(*sg_model_at(rows, i, SG_P_SCALE), log((double[]){0.016, 0.004, 0.001}[i]));
    }
    sg_model_destroy(&rows);
    g.p.limit = 2;
    rows = grow(ctx, &g, &bound);
    assert_true(bound);
    assert_int_equal(rows->count, 2);
    sg_model_destroy(&rows);
    g.p.limit = 0;
    assert_null(grow(ctx, &g, &bound));
    assert_true(bound);
    g.p.limit = SIZE_MAX;
    /* Beyond the first grid nothing grows where that has added nothing; a factor of 4 has no third
     * grid. */
    g.p.factor = 4;
    rows = grow(ctx, &g, &bound);
    assert_int_equal(rows->count, 2);
    sg_model_destroy(&rows);
    /* One grid, and three of which each is twice as fine as the one before, with one threshold. */
    g.p.grids = 1, g.p.factor = 16;
    rows = grow(ctx, &g, &bound);
    assert_int_equal(rows->count, 1);
    sg_model_destroy(&rows);
    g.p.grids = 3, g.p.finer = 2;
    mark(&g, 0, 0, 41, 0.0003f);
    rows = grow(ctx, &g, &bound);
    assert_int_equal(rows->count, 3);
    const double sizes[3] = {0.016, 0.008, 0.004}, at_y[3] = {0.016, 0.008, 0.012};
    for (size_t i = 0; i < 3; i++) { /* y: 0.7, 1.4 and 2.8 cells */
        assert_near(*sg_model_at(rows, i, SG_P_SCALE), log(sizes[i]));
        assert_near(*sg_model_at(rows, i, SG_P_XYZ + 1), at_y[i]);
    }
    sg_model_destroy(&rows);
    g.p.finer = 6; /* thrice the threshold, and less than a voxel on the third grid */
    assert_int_equal((rows = grow(ctx, &g, &bound))->count, 1);
    sg_model_destroy(&rows);
    mark(&g, 0, 0, 41, 0.0009f);
    assert_int_equal((rows = grow(ctx, &g, &bound))->count, 2);
    sg_model_destroy(&rows);
    g.p.finer = 4, g.p.factor = 4;
    *sg_model_at(g.m, 1, SG_P_XYZ) = 0.016f, *sg_model_at(g.m, 1, SG_P_XYZ + 1) = 0.012f;
    assert_null(grow(ctx, &g, &bound));
    /* A Gaussian that has gone beyond all cells is left out. */
    *anchor_at(g.m, 0, SG_A_OFFSET) = 1e30f;
    assert_null(grow(ctx, &g, &bound));
    free(g.statistics);
    sg_model_destroy(&g.m);
    sg_ctx_destroy(&ctx);
}

/* Half of the candidates are left out on the coarsest grid; the draws follow from the seed. */
static void test_drop(void **state)
{
    (void) state;
    enum { N = 400 };
    sg_ctx *ctx = make_context(1);
    struct growing g = make_growing(ctx, N);
    bool bound;
    for (size_t i = 0; i < N; i++) {
        *sg_model_at(g.m, i, SG_P_XYZ) = (float) i;
        *anchor_at(g.m, i, SG_A_OFFSET + 1) = 30; /* 0.3 */
        mark(&g, i, 0, 50, 0.0003f);
    }
    g.p.drop = 0.5f, g.p.factor = 2; /* one grid */
    struct sg_model *rows = grow(ctx, &g, &bound), *again = grow(ctx, &g, &bound);
    assert_in_range(rows->count, N / 2 - 40, N / 2 + 40);
    assert_int_equal(rows->count, again->count);
    assert_memory_equal(rows->params, again->params,
                        rows->capacity * (size_t) sg_param_count(0) * sizeof(float));
    sg_model_destroy(&again);
    g.p.log_size_max = -9; /* of a cell it is -6.2 */
    again = grow(ctx, &g, &bound);
    assert_true(*anchor_at(rows, 0, SG_A_SIZE) > -7 && *anchor_at(again, 0, SG_A_SIZE) == -9);
    sg_model_destroy(&again);
    g.p.stream = 1;
    again = grow(ctx, &g, &bound);
    assert_true(again->count != rows->count ||
                memcmp(rows->params, again->params,
                       rows->capacity * (size_t) sg_param_count(0) * sizeof(float)) != 0);
    sg_model_destroy(&rows);
    sg_model_destroy(&again);
    free(g.statistics);
    sg_model_destroy(&g.m);
    sg_ctx_destroy(&ctx);
}

/* ---- files ---- */

#define ALL_PARTS (SG_PART_DISTANCE | SG_PART_BANK | SG_PART_APPEARANCE)

static char folder[] = "/tmp/sg_anchors_XXXXXX", model_path[64], weights_path[64];

static int make_folder(void **state)
{
    (void) state;
    assert_non_null(mkdtemp(folder));
    snprintf(model_path, sizeof(model_path), "%s/point_cloud.ply", folder);
    snprintf(weights_path, sizeof(weights_path), "%s/" SG_NETWORKS_FILE, folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void) state;
    unlink(model_path);
    unlink(weights_path);
    return rmdir(folder);
}

static struct sg_model *make_random(sg_ctx *ctx, size_t n, unsigned parts)
{
    struct sg_model *m;
    assert_int_equal(sg_model_create(ctx, n, 0, &m), SG_OK);
    assert_int_equal(sg_anchors_add(ctx, m, parts ? 4 : 0), SG_OK);
    for (size_t i = 0; i < n; i++) {
        for (int p = 0; p < SG_P_SH; p++)
            *sg_model_at(m, i, p) = draw(50, SG_P_SH * i + (size_t) p, -1, 1);
        for (int p = 0; p < SG_A_PLANES; p++)
            *anchor_at(m, i, p) = draw(51, SG_A_PLANES * i + (size_t) p, -1, 1);
    }
    float *w = (float *) &m->columns->networks->value;
    for (size_t i = 0; i < (parts ? SG_WEIGHTS : SG_WEIGHTS_PLAIN); i++)
        w[i] = draw(52, i, -1, 1);
    m->columns->networks->parts = parts;
    for (size_t i = 0; i < m->columns->networks->photos; i++)
        for (size_t k = 0; k < SG_APPEARANCE; k++)
            m->columns->networks->appearance[i].value[k] = draw(53, SG_APPEARANCE * i + k, -1, 1);
    m->columns->networks->voxel = 0.0123f;
    return m;
}

static void test_files(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_random(ctx, 21, 0), *read;
    char other[96];
    size_t size;
    assert_int_equal(sg_model_write_ply(ctx, m, model_path), SG_OK);
    assert_int_equal(sg_model_gaussians(m), 210);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_OK);
    assert_int_equal(read->count, 21);
    for (size_t i = 0; i < 21; i++) {
        for (int p = 0; p < SG_P_SH; p++)
            assert_true(*sg_model_at(read, i, p) == *sg_model_at(m, i, p));
        for (int p = 0; p < SG_A_PLANES; p++)
            assert_true(*anchor_at(read, i, p) == *anchor_at(m, i, p));
    }
    assert_memory_equal(&read->columns->networks->value, &m->columns->networks->value,
                        sizeof(struct sg_weights));
    assert_true(read->columns->networks->voxel == m->columns->networks->voxel);
    sg_model_destroy(&read);

    /* the layout of the released code: 79 properties, offsets by axis */
    char *bytes = slurp(model_path, &size);
    int properties = 0;
    for (const char *at = bytes; (at = strstr(at, "property float ")); at++)
        properties++;
    assert_int_equal(properties, 79);
    const char *row = strstr(bytes, "end_header\n") + strlen("end_header\n");
    float value;
    memcpy(&value, row + (6 + 2 * 10 + 3) * sizeof(float), sizeof(value)); /* z of Gaussian 3 */
    assert_true(value == *anchor_at(m, 0, SG_A_OFFSET + 3 * 3 + 2));
    free(bytes);

    /* What does not know anchors says so. */
    assert_int_equal(sg_model_read(ctx, model_path, 100, &read), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "anchors of Scaffold-GS"));
    sg_clear_error(ctx);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 20, &read), SG_ERR_INPUT);
    sg_clear_error(ctx);
    struct sg_prune_params prune = sg_prune_params_default();
    struct sg_scene scene = {.path = (char *) "none"};
    double scores[21];
    assert_int_equal(sg_model_select(ctx, m, NULL, &read), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "anchors of Scaffold-GS"));
    snprintf(other, sizeof(other), "%s/a.splat", folder);
    assert_int_equal(sg_model_write(ctx, m, other, NULL), SG_ERR_INPUT);
    assert_int_equal(access(other, F_OK), -1);
    assert_int_equal(sg_prune_scores(ctx, &scene, m, &prune, scores), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "anchors of Scaffold-GS"));
    sg_clear_error(ctx);
    unlink(weights_path);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), SG_NETWORKS_FILE));
    sg_clear_error(ctx);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* The networks of a model stay what they are where another one is saved beside it, and where saving
 * fails. */
static void test_second(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *first = make_random(ctx, 200, 0), *second = make_random(ctx, 200, ALL_PARTS);
    char other[96];
    size_t size, size_now;
    snprintf(other, sizeof(other), "%s/other.ply", folder);
    assert_int_equal(sg_model_write_ply(ctx, first, model_path), SG_OK);
    char *networks = slurp(weights_path, &size);
    assert_int_equal(sg_model_write_ply(ctx, second, other), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "found the networks of the anchors in"));
    assert_non_null(strstr(sg_last_error(ctx), model_path));
    assert_int_equal(access(other, F_OK), -1);

    /* whatever the names; but not of its own other name, and not where they are the same */
    char unusual[96];
    snprintf(unusual, sizeof(unusual), "%s/model", folder);
    assert_int_equal(rename(model_path, unusual), 0);
    assert_int_equal(sg_model_write_ply(ctx, second, other), SG_ERR_INPUT);
    assert_int_equal(sg_model_write_ply(ctx, first, other), SG_OK);
    unlink(other);
    assert_int_equal(rename(unusual, model_path), 0);
    assert_int_equal(symlink(model_path, unusual), 0);
    assert_int_equal(sg_model_write_ply(ctx, second, model_path), SG_OK);
    assert_int_equal(sg_model_write_ply(ctx, first, model_path), SG_OK);
    unlink(unusual);

    /* no room on the disk for the anchors, but for the networks */
    struct rlimit before;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &(struct rlimit){60000, before.rlim_max});
    const int code = sg_model_write_ply(ctx, second, model_path);
    setrlimit(RLIMIT_FSIZE, &before);
    assert_int_equal(code, SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "point_cloud.ply: cannot write"));
    char *now = slurp(weights_path, &size_now);
    assert_int_equal(size_now, size);
    assert_memory_equal(now, networks, size);
    free(now);

    /* Networks that came from elsewhere; but anchors that do not name theirs take them. */
    struct sg_model *read;
    char *ply = slurp(model_path, &size_now), *name = strstr(ply, "XXH3-64 ");
    float *weight = &first->columns->networks->value.input[0][0];
    *weight += 1;
    assert_int_equal(sg_model_write_ply(ctx, first, model_path), SG_OK);
    *weight -= 1;
    spill(weights_path, networks, size);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 1000, &read), SG_ERR_INPUT);
    assert_non_null(
        strstr(sg_last_error(ctx), "networks.safetensors: found networks with the hash"));
    assert_non_null(name);
    *name = '-'; /* a comment like others */
    memcpy(networks + size - 4, (float[]){0.5f}, 4);
    spill(model_path, ply, size_now);
    spill(weights_path, networks, size);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 1000, &read), SG_OK);
    sg_model_destroy(&read);
    free(ply);

    /* Files that are no anchors do not count. */
    spill(other, "ply\n", 4);
    assert_int_equal(sg_model_write_ply(ctx, second, model_path), SG_OK);
    unlink(other);
    unlink(model_path);
    assert_int_equal(sg_model_write_ply(ctx, first, other), SG_OK);
    unlink(other);
    free(networks);
    sg_model_destroy(&first);
    sg_model_destroy(&second);
    sg_ctx_destroy(&ctx);
}

struct edit {
    const char *find, *replace, *says;
};

/* Each change of the file of networks is refused. */
static void refuse_edits(sg_ctx *ctx, const char *good, size_t size, const struct edit *edits,
                         size_t n)
{
    struct sg_model *read;
    for (size_t i = 0; i < n; i++) {
        char *bad = malloc(size), *at;
        assert_non_null(bad);
        memcpy(bad, good, size);
        at = memmem(bad, size, edits[i].find, strlen(edits[i].find));
        assert_non_null(at);
        memcpy(at, edits[i].replace, strlen(edits[i].replace));
        spill(weights_path, bad, size);
        if (sg_model_read_drawable(ctx, model_path, 100, &read) != SG_ERR_INPUT ||
            !strstr(sg_last_error(ctx), edits[i].says))
            fail_msg("%s: found \"%s\"", edits[i].replace, sg_last_error(ctx));
        sg_clear_error(ctx);
        free(bad);
    }
}

/* Networks with optional parts come back with them, under the names of PyTorch. */
static void test_parts(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_random(ctx, 3, ALL_PARTS), *read;
    size_t size;
    assert_int_equal(sg_model_write_ply(ctx, m, model_path), SG_OK);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_OK);
    assert_int_equal(read->columns->networks->parts, ALL_PARTS);
    assert_int_equal(read->columns->networks->photos, 4);
    assert_memory_equal(read->columns->networks->appearance, m->columns->networks->appearance,
                        4 * sizeof(struct sg_appearance));
    assert_memory_equal(&read->columns->networks->value, &m->columns->networks->value,
                        sizeof(struct sg_weights));
    sg_model_destroy(&read);
    char *good = slurp(weights_path, &size);
    static const char *const has[] = {"\"parts\":\"distance feature_bank appearance\"",
                                      "opacity.0.weight [32,36]",
                                      "colour.0.weight [32,68]",
                                      "feature_bank.0.weight [32,4]",
                                      "feature_bank.2.weight [3,32]",
                                      "feature_bank.2.bias [3]",
                                      "appearance.weight [4,32]"};
    for (size_t i = 0; i < sizeof(has) / sizeof(has[0]); i++) {
        const char *shape = strchr(has[i], ' ');
        char entry[128];
        if (*has[i] == '"')
            snprintf(entry, sizeof(entry), "%s", has[i]);
        else
            snprintf(entry, sizeof(entry), "\"%.*s\":{\"dtype\":\"F32\",\"shape\":%s",
                     (int) (shape - has[i]), has[i], shape + 1);
        if (!memmem(good, size, entry, strlen(entry)))
            fail_msg("the header does not have %s", entry);
    }
    static const struct edit edits[] = {
        {"distance feature", "distance_feature", "found parts other than"},
        {"feature_bank appearance", "feature_bang appearance", "found parts other than"},
        {"distance feature_bank", "feature_bank         ", "found parts other than"},
        {"\"distance feature_bank appearance\"", "\"feature_bank appearance\"         ",
         "opacity.0.weight"},
        {"[4,32]", "[5,32]", "appearance.weight"},
        {"[4,32]", "[0,32]", "expected 1 to 65536"},
        {"[4,32]", "[-1,3]", "expected 1 to 65536"},
        {"appearance.weight", "appearance.waight", "expected 1 to 65536"},
        {"feature_bank.0.bias", "feature_bank.1.bias", "feature_bank.0.bias"}};
    refuse_edits(ctx, good, size, edits, sizeof(edits) / sizeof(edits[0]));
    free(good);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* Networks do not appear without the anchors that they belong to. */
static void test_blocked(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_random(ctx, 3, 0);
    unlink(model_path);
    unlink(weights_path);
    assert_int_equal(mkdir(model_path, 0777), 0);
    assert_int_equal(sg_model_write_ply(ctx, m, model_path), SG_ERR_INPUT);
    assert_int_equal(access(weights_path, F_OK), -1);
    assert_int_equal(rmdir(model_path), 0);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* A program whose locale has a decimal comma writes the same bytes, and reads them. */
static void test_comma(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_random(ctx, 3, 0), *read;
    size_t size, found_size;
    assert_int_equal(sg_model_write_ply(ctx, m, model_path), SG_OK);
    char *expected = slurp(weights_path, &size);
    const bool set = set_comma();
    if (set) {
        const int written = sg_model_write_ply(ctx, m, model_path),
                  code = sg_model_read_drawable(ctx, model_path, 100, &read);
        setlocale(LC_NUMERIC, "C");
        assert_int_equal(written, SG_OK);
        assert_int_equal(code, SG_OK);
        assert_true(read->columns->networks->voxel == m->columns->networks->voxel);
        char *found = slurp(weights_path, &found_size);
        assert_int_equal(found_size, size);
        assert_memory_equal(found, expected, size);
        free(found);
        sg_model_destroy(&read);
    }
    free(expected);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
    if (!set)
        skip();
}

/* Files that are cut or altered are refused; none is read with what they say unchecked. */
static void test_hostile(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_random(ctx, 5, 0), *read;
    size_t size, ply_size;
    assert_int_equal(sg_model_write_ply(ctx, m, model_path), SG_OK);
    char *good = slurp(weights_path, &size), *ply = slurp(model_path, &ply_size);
    uint64_t length;
    memcpy(&length, good, sizeof(length));
    static const struct edit edits[] = {
        {"\"F32\"", "\"F16\"", "found no tensor"},
        {"[32,35]", "[35,32]", "found no tensor"},
        {"\"data_offsets\":[0,", "\"data_offsets\":[9,", "found no tensor"},
        {"\"voxel\":\"0.0", "\"voxel\":\"-.0", "voxel"},
        {"\"voxel\":\"0.0", "\"voxel\":\"nan", "voxel"},
        {"opacity.0.bias", "opacity.0.bais", "opacity.0.bias"},
        {"{\"", "[\"", "header"}};
    refuse_edits(ctx, good, size, edits, sizeof(edits) / sizeof(edits[0]));
    for (size_t cut = 0; cut < size; cut += cut < 1200 ? 37 : 1501) {
        spill(weights_path, good, cut);
        assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_ERR_INPUT);
        sg_clear_error(ctx);
    }
    const float nan = NAN;
    memcpy(good + sizeof(length) + length + 40, &nan, sizeof(nan));
    spill(weights_path, good, size);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "opacity.0.weight"));
    sg_clear_error(ctx);
    length = UINT64_MAX;
    memcpy(good, &length, sizeof(length));
    spill(weights_path, good, size);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_ERR_INPUT);
    sg_clear_error(ctx);
    assert_int_equal(sg_model_write_ply(ctx, m, model_path), SG_OK);
    for (size_t cut = 0; cut < ply_size; cut += 97) {
        spill(model_path, ply, cut);
        assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_ERR_INPUT);
        sg_clear_error(ctx);
    }
    assert_true(ply_size > sizeof(nan));
    memcpy(ply + ply_size - sizeof(nan), &nan, sizeof(nan));
    spill(model_path, ply, ply_size);
    assert_int_equal(sg_model_read_drawable(ctx, model_path, 100, &read), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "anchor 4: found rot_3"));
    sg_clear_error(ctx);
    free(good);
    free(ply);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* As many weights as the released networks have. */
static void test_weights(void **state)
{
    (void) state;
    size_t count[SG_N_COLOUR + 1] = {0};
    for (size_t i = 0; i < SG_WEIGHTS_PLAIN; i++)
        count[sg_weight_network(i)]++;
    assert_int_equal(count[SG_N_OPACITY], 1482);
    assert_int_equal(count[SG_N_COVARIANCE], 3462);
    assert_int_equal(count[SG_N_COLOUR], 2142);
    for (size_t i = SG_WEIGHT_AT(appearance); i < SG_WEIGHTS; i++)
        count[sg_weight_network(i)]++;
    assert_int_equal(count[SG_N_COLOUR], 3166);
    size_t bank = 0;
    for (size_t i = SG_WEIGHTS_PLAIN; i < SG_WEIGHTS; i++)
        bank += sg_weight_network(i) == SG_N_BANK;
    assert_int_equal(bank, 259);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_weights), cmocka_unit_test(test_cells),
        cmocka_unit_test(test_start),   cmocka_unit_test(test_median),
        cmocka_unit_test(test_growth),  cmocka_unit_test(test_drop),
        cmocka_unit_test(test_files),   cmocka_unit_test(test_parts),
        cmocka_unit_test(test_blocked), cmocka_unit_test(test_comma),
        cmocka_unit_test(test_hostile), cmocka_unit_test(test_second)};
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
