/* SPDX-License-Identifier: Apache-2.0 */
/* A column that is no parameter, from its row in the table alone: PLY files have it, copies of a
 * model keep it and edits do with it what the row says. */
#include "engine/host/host_model.h"

#include <stdio.h>
#include <unistd.h>

#include "models.h"

#define N 37
#define DEGREE 1

/* A model whose toys are known. */
static struct sg_model *make_toys(sg_ctx *ctx)
{
    struct sg_model *m = make_model(ctx, N, DEGREE, 91);
    assert_null(m->columns);
    assert_int_equal(sg_model_add_columns(ctx, m, NULL), SG_OK);
    for (size_t i = 0; i < N; i++)
        for (int p = 0; p < 2; p++)
            m->columns->at[SG_C_TOY][sg_param_index(2, i, p)] = (float) i + 0.5f * (float) p;
    return m;
}

static float toy_of(const struct sg_columns *columns, size_t i, int p)
{
    return columns->at[SG_C_TOY][sg_param_index(2, i, p)];
}

static void path_of(char path[64], const char *name)
{
    snprintf(path, 64, "/tmp/splatguard-%s-%d.ply", name, (int) getpid());
}

/* The text of a file's header. */
static void read_header(const char *path, char *text, size_t size)
{
    FILE *f = fopen(path, "rb");
    assert_non_null(f);
    text[fread(text, 1, size - 1, f)] = 0;
    fclose(f);
    char *end = strstr(text, "end_header");
    assert_non_null(end);
    *end = 0;
}

static void test_ply(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_toys(ctx), *back;
    char path[64], header[4096];
    path_of(path, "toys");
    assert_int_equal(sg_model_write_ply(ctx, m, path), SG_OK);
    read_header(path, header, sizeof(header));
    assert_non_null(strstr(header, "rot_3\nproperty float toy_0\nproperty float toy_1\n"));
    assert_int_equal(sg_model_read_ply(ctx, path, N, &back), SG_OK);
    assert_int_equal(back->count, N);
    assert_int_equal(back->sh_degree, DEGREE);
    for (size_t i = 0; i < N; i++) {
        for (int p = 0; p < sg_param_count(DEGREE); p++)
            assert_true(*sg_model_at(back, i, p) == *sg_model_at(m, i, p));
        for (int p = 0; p < 2; p++)
            assert_true(toy_of(back->columns, i, p) == (float) i + 0.5f * (float) p);
    }
    sg_model_destroy(&back);
    sg_model_destroy(&m);
    unlink(path);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* A file of a plain model has no such column, and one that has a part of it is read without. */
static void test_plain_ply(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 3, 0, 92), *back;
    char path[64], header[4096];
    path_of(path, "plain");
    assert_int_equal(sg_model_write_ply(ctx, m, path), SG_OK);
    read_header(path, header, sizeof(header));
    assert_null(strstr(header, "toy"));
    assert_int_equal(sg_model_read_ply(ctx, path, 3, &back), SG_OK);
    assert_null(back->columns);
    sg_model_destroy(&back);

    FILE *f = fopen(path, "w");
    assert_non_null(f);
    fprintf(f, "ply\nformat ascii 1.0\nelement vertex 1\n");
    static const char *const names[] = {"toy_1",   "x",      "y",       "z",       "f_dc_0",
                                        "f_dc_1",  "f_dc_2", "opacity", "scale_0", "scale_1",
                                        "scale_2", "rot_0",  "rot_1",   "rot_2",   "rot_3"};
    for (size_t k = 0; k < sizeof(names) / sizeof(names[0]); k++)
        fprintf(f, "property float %s\n", names[k]);
    fprintf(f, "end_header\n9 1 2 3 4 5 6 7 8 9 10 1 0 0 0\n");
    fclose(f);
    assert_int_equal(sg_model_read_ply(ctx, path, 1, &back), SG_OK);
    assert_null(back->columns);
    assert_true(*sg_model_at(back, 0, SG_P_OPACITY) == 7);
    sg_model_destroy(&back);
    sg_model_destroy(&m);
    unlink(path);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

static void test_copies(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_toys(ctx), *plain = make_model(ctx, 2, DEGREE, 93), *out;
    assert_int_equal(sg_model_create_like(ctx, m, 2, m->sh_degree, &out), SG_OK);
    sg_model_copy_row(m, 30, out, 0);
    sg_model_copy_row(m, 7, out, 1);
    assert_true(toy_of(out->columns, 0, 1) == 30.5f && toy_of(out->columns, 1, 0) == 7);
    assert_true(*sg_model_at(out, 1, SG_P_SH) == *sg_model_at(m, 7, SG_P_SH));
    sg_model_destroy(&out);
    assert_int_equal(sg_model_create_like(ctx, plain, 2, plain->sh_degree, &out), SG_OK);
    assert_null(out->columns);
    sg_model_destroy(&out);
    sg_model_destroy(&plain);
    sg_model_destroy(&m);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* Kept and copied as the row says; a child has none. */
static void test_edit(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_toys(ctx), *after;
    struct sg_host_model h = {0};
    uint8_t keep[N];
    const uint32_t source[] = {5, 6};
    const uint8_t kind[] = {SG_EDIT_COPY, SG_EDIT_CHILD};
    for (size_t i = 0; i < N; i++)
        keep[i] = i % 2;
    const struct sg_edit edit = {
        .keep = keep, .kept = N / 2, .appended = 2, .source = source, .kind = kind};
    assert_int_equal(sg_host_upload(ctx, &h, m, m->columns), SG_OK);
    assert_int_equal(sg_host_edit(ctx, &h, &edit), SG_OK);
    assert_int_equal(sg_model_create_like(ctx, m, N / 2 + 2, m->sh_degree, &after), SG_OK);
    assert_int_equal(sg_host_download(&h, after, after->columns), SG_OK);
    for (size_t i = 0; i < N / 2; i++)
        assert_true(toy_of(after->columns, i, 1) == (float) (2 * i + 1) + 0.5f);
    assert_true(toy_of(after->columns, N / 2, 0) == 5 && toy_of(after->columns, N / 2 + 1, 0) == 0);
    sg_host_clear(&h);
    sg_model_destroy(&after);
    sg_model_destroy(&m);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ply),
        cmocka_unit_test(test_plain_ply),
        cmocka_unit_test(test_copies),
        cmocka_unit_test(test_edit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
