/* SPDX-License-Identifier: Apache-2.0 */
/* Rules for every reader of untrusted files: missing photos, byte-order marks, files that are huge
 * and empty. */
#include "scene_files.h"

#include <errno.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>

#include "splatguard/model.h"

#define POSE "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"
#define CAMERAS "1 PINHOLE 20 10 30 30 10 5\n"
#define IMAGES                                                                                     \
    "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n3 1 0 0 0 2 0 0 1 c.png\n1 2 -1\n"
#define FRAMES                                                                                     \
    "\"frames\":[{\"file_path\":\"images/a.png\"," POSE "},{\"file_path\":\"images/b.png\"," POSE  \
    "},"                                                                                           \
    "{\"file_path\":\"images/c.png\"," POSE "}]}"

/* One scene with two of three photos in each layout. */
static const struct {
    const char *files[2], *texts[2];
} layouts[] = {
    {{"sparse/0/cameras.txt", "sparse/0/images.txt"}, {CAMERAS, IMAGES}},
    {{"transforms_train.json", NULL}, {"{\"camera_angle_x\":1," FRAMES, NULL}},
    {{"transforms.json", NULL}, {"{\"camera_angle_x\":1," FRAMES, NULL}},
};
enum { LAYOUTS = sizeof(layouts) / sizeof(*layouts) };

static void put_layout(struct fixture *f, int i, const char *mark)
{
    char text[2048];
    for (int k = 0; k < 2 && layouts[i].files[k]; k++) {
        snprintf(text, sizeof(text), "%s%s", mark, layouts[i].texts[k]);
        put_text(f, layouts[i].files[k], text);
    }
}

static void remove_layout(struct fixture *f, int i)
{
    for (int k = 0; k < 2 && layouts[i].files[k]; k++)
        assert_int_equal(remove(at(f, layouts[i].files[k])), 0);
}

/* Missing photos are skipped with one warning. They are refused with `strict`, and if all are
 * missing. */
static void missing_photos(void **state)
{
    struct fixture *f = *state;
    for (int i = 0; i < LAYOUTS; i++) {
        put_layout(f, i, "");
        expect_failure(f, NULL, SG_ERR_INPUT, "0 of 3 photos", "a.png", NULL);
        put_png(f, "images/a.png", 20, 10, 3, 1);
        put_png(f, "images/c.png", 20, 10, 3, 2);
        expect_failure(f, sg_scene_params(.strict = true), SG_ERR_INPUT, "2 of 3 photos", "b.png",
                       NULL);
        f->warnings = 0;
        struct sg_scene *s = load(f, NULL);
        assert_int_equal(s->n_train, 2);
        assert_string_equal(s->train[1].name, "c");
        /* The three poses of Blender and nerfstudio are one place. */
        assert_int_equal(f->warnings, i == 0 ? 1 : 2);
        sg_scene_destroy(&s);
        put_png(f, "images/b.png", 20, 10, 3, 3);
        f->warnings = 0;
        s = load(f, sg_scene_params(.strict = true, .images = "images"));
        assert_int_equal(f->warnings, i == 0 ? 0 : 2); /* --images has no effect; one place */
        assert_true(i == 0 || strstr(f->said, "images: found \"images\", which has no effect"));
        assert_int_equal(s->n_train, 3);
        sg_scene_destroy(&s);
        for (const char *c = "abc"; *c; c++) {
            char name[16];
            snprintf(name, sizeof(name), "images/%c.png", *c);
            remove(at(f, name));
        }
        remove_layout(f, i);
    }
}

/* Photos that cannot be decoded are skipped likewise, with a warning that names the first, and so
 * are those whose masks cannot be; but not where every N-th photo is a test photo. */
static void broken_photos(void **state)
{
    struct fixture *f = *state;
    for (int i = 0; i < LAYOUTS; i++) {
        put_layout(f, i, "");
        put_png(f, "images/a.png", 20, 10, 3, 1);
        put_text(f, "images/b.png", "no image");
        put_text(f, "images/c.png", "");
        f->warnings = 0;
        struct sg_scene *s = load(f, NULL);
        assert_int_equal(s->n_train, 1);
        assert_string_equal(s->train[0].name, "a");
        assert_non_null(strstr(f->said, "2 of 3 photos"));
        assert_non_null(strstr(f->said, "b.png"));
        sg_scene_destroy(&s);
        expect_failure(f, sg_scene_params(.strict = true), SG_ERR_INPUT, "png", "found", NULL);
        if (i != 1) /* Blender's files say which are test photos */
            expect_failure(f, sg_scene_params(.eval = true), SG_ERR_INPUT, "png", "found",
                           "not skipped", NULL);
        put_text(f, "images/a.png", "no image either");
        expect_failure(f, NULL, SG_ERR_INPUT, "3 of 3 photos cannot be decoded", "a.png", NULL);

        put_png(f, "images/a.png", 20, 10, 3, 1);
        put_png(f, "images/b.png", 20, 10, 3, 2);
        put_png(f, "images/c.png", 20, 10, 3, 3);
        put_text(f, "masks/a.png", "no mask");
        put_png(f, "masks/b.png", 20, 10, 1, 255);
        put_png(f, "masks/c.png", 20, 10, 1, 255);
        f->warnings = 0;
        s = load(f, NULL);
        assert_int_equal(s->n_train, 2);
        assert_non_null(strstr(f->said, "masks/a.png"));
        sg_scene_destroy(&s);
        for (const char *c = "abc"; *c; c++) {
            char name[16];
            snprintf(name, sizeof(name), "images/%c.png", *c);
            remove(at(f, name));
            snprintf(name, sizeof(name), "masks/%c.png", *c);
            remove(at(f, name));
        }
        remove_layout(f, i);
    }
}

static void marks(void **state)
{
    struct fixture *f = *state;
    for (const char *c = "abc"; *c; c++) {
        char name[16];
        snprintf(name, sizeof(name), "images/%c.png", *c);
        put_png(f, name, 20, 10, 3, *c);
    }
    for (int i = 0; i < LAYOUTS; i++) {
        put_layout(f, i, "\xef\xbb\xbf");
        struct sg_scene *s = load(f, NULL);
        assert_int_equal(s->n_train, 3);
        sg_scene_destroy(&s);
        put_layout(f, i, "\xff\xfe");
        expect_failure(f, NULL, SG_ERR_INPUT, layouts[i].files[0], "UTF-16", NULL);
        remove_layout(f, i);
    }
    put_layout(f, 0, "");
    put_text(f, "sparse/0/points3D.txt", "\xef\xbb\xbf# points\n1 0 0 1 1 2 3 0.5 1 1\n");
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(s->n_points, 1);
    sg_scene_destroy(&s);
}

/* Tracks and observations are longer than any window; what a record needs is at its beginning. */
static void long_lines(void **state)
{
    struct fixture *f = *state;
    enum { ENTRIES = 200000 };
    char *text = malloc(8 * ENTRIES + 100);
    size_t n = (size_t) sprintf(text, "1 0 0 1 1 2 3 0.5");
    for (int i = 0; i < ENTRIES; i++)
        n += (size_t) sprintf(text + n, " 123 45");
    n += (size_t) sprintf(text + n, "\r\n2 5 0 1 1 2 3 0.5\r\n");
    put(f, "sparse/0/points3D.txt", text, n);
    n = (size_t) sprintf(text, "1 1 0 0 0 0 0 0 1 a.png\r\n");
    for (int i = 0; i < ENTRIES; i++)
        n += (size_t) sprintf(text + n, "1 2 -1 ");
    n += (size_t) sprintf(text + n, "\r\n2 1 0 0 0 1 0 0 1 b b.png\r\n\r\n");
    put(f, "sparse/0/images.txt", text, n);
    put_text(f, "sparse/0/cameras.txt", CAMERAS);
    put_png(f, "images/a.png", 20, 10, 3, 1);
    put_png(f, "images/b b.png", 20, 10, 3, 1);
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(s->n_train, 2);
    assert_int_equal(s->n_points, 2);
    assert_true(s->points[3] == 5);
    sg_scene_destroy(&s);
    n -= 6; /* the observations lose a number */
    memcpy(text + 26, "1   ", 4);
    put(f, "sparse/0/images.txt", text, n);
    text[28] = 0;
    expect_failure(f, NULL, SG_ERR_INPUT, "images.txt", NULL);
    put(f, "sparse/0/images.txt", text, n);
    expect_failure(f, NULL, SG_ERR_INPUT, "images.txt: line 2", "zero byte", NULL);
    free(text);
}

/* Of this process: other work on the machine takes none of it. */
static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double) t.tv_sec + 1e-9 * (double) t.tv_nsec;
}

/* A file of zeros that is larger than memory takes the place of each file. It is refused by name,
 * at once and with little memory; also with a sound header before the zeros. */
static void huge_sparse_files(void **state)
{
    struct fixture *f = *state;
    static const struct {
        const char *file, *head;
        size_t head_bytes;
        int layout; /* that it stands in; -1: a model */
    } cases[] = {
        {"m.ply", "", 0, -1},
        {"m.ply", "ply\n", 4, -1},
        {"m.ply",
         "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nend_header\n",
         80, -1},
        {"m.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n", 65,
         -1},
        {"sparse/0/cameras.txt", "", 0, 0},
        {"sparse/0/images.txt", "", 0, 0},
        {"sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n", 24, 0},
        {"sparse/0/points3D.txt", "", 0, 0},
        {"sparse/0/points3D.ply", "", 0, 0},
        {"sparse/0/cameras.bin", "", 0, 3},
        {"sparse/0/images.bin", "", 0, 3},
        {"sparse/0/points3D.bin", "", 0, 3},
        {"images/a.png", "", 0, 0},
        {"images/a.png", "\x89PNG\r\n\x1a\n", 8, 0},
        {"images/a.png", "\xff\xd8\xff\xe0", 4, 0},
        {"images/a.png", "RIFF\0\0\0\0WEBPVP8 ", 16, 0},
        {"masks/a.png", "", 0, 0},
        {"transforms_train.json", "", 0, 1},
        {"transforms.json", "{", 1, 2},
    };
    char name[16];
    for (const char *c = "abc"; *c; c++) {
        snprintf(name, sizeof(name), "images/%c.png", *c);
        put_png(f, name, 20, 10, 3, *c);
    }
    for (size_t i = 0; i < sizeof(cases) / sizeof(*cases); i++) {
        struct sg_scene *scene = NULL;
        struct sg_model *model = NULL;
        float *xyz = NULL;
        uint8_t *rgb = NULL;
        size_t n;
        if (cases[i].layout == 3) { /* a good binary model around the bad part */
            static const uint64_t camera[] = {1, 1 | UINT64_C(1) << 32, 20, 10};
            static const double pinhole[] = {30, 30, 10, 5};
            char bytes[64];
            memcpy(bytes, camera, 32);
            memcpy(bytes + 32, pinhole, 32);
            put(f, "sparse/0/cameras.bin", bytes, 64);
            char image[8 + 64 + 6 + 8] = {1, 0, 0, 0, 0, 0, 0, 0, 1};
            const double one = 1;
            memcpy(image + 12, &one, 8);
            image[8 + 60] = 1;
            strcpy(image + 72, "a.png");
            put(f, "sparse/0/images.bin", image, sizeof(image));
        } else if (cases[i].layout >= 0)
            put_layout(f, cases[i].layout, "");
        put(f, cases[i].file, cases[i].head, cases[i].head_bytes);
        if (truncate(at(f, cases[i].file), (off_t) 20 << 30)) { /* the file system cannot */
            skip();
            return;
        }
        const double begun = seconds();
        int code = cases[i].layout >= 0
                       ? sg_scene_load(f->ctx, f->dir, sg_scene_params(.strict = true), &scene)
                       : sg_model_read_ply(f->ctx, at(f, "m.ply"), UINT32_MAX, &model);
        const bool named = strstr(sg_last_error(f->ctx), cases[i].file);
        if (code != SG_ERR_INPUT || !named)
            fail_msg("case %zu (%s): code %d: %s", i, cases[i].file, code, sg_last_error(f->ctx));
        if (cases[i].layout < 0)
            assert_int_equal(sg_points_read_ply(f->ctx, at(f, "m.ply"), UINT32_MAX, &xyz, &rgb, &n),
                             SG_ERR_INPUT);
        const double took = seconds() - begun;
        if (took > 1)
            fail_msg("case %zu (%s): %.1f s", i, cases[i].file, took);
        remove(at(f, cases[i].file));
        if (!strncmp(cases[i].file, "images/", 7))
            put_png(f, "images/a.png", 20, 10, 3, 1);
        static const char *const all[] = {"sparse/0/cameras.txt",  "sparse/0/images.txt",
                                          "sparse/0/cameras.bin",  "sparse/0/images.bin",
                                          "transforms_train.json", "transforms.json"};
        for (size_t k = 0; k < sizeof(all) / sizeof(*all); k++)
            remove(at(f, all[k]));
    }
    assert_true(sg_mem_peak(f->ctx, SG_MEM_TAGS) < 8 << 20);
#ifndef SG_SANITIZE_ADDRESS
    struct rusage use;
    getrusage(RUSAGE_SELF, &use);
    assert_true(use.ru_maxrss < 50 << 10); /* kilobytes */
#endif
}

/* Nothing waits for the other end of a pipe, and a folder is not a file. */
static void files_that_are_none(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m;
    float *xyz;
    uint8_t *rgb;
    size_t n;
    struct sg_image image;
    const char *const names[] = {"pipe", "folder", "/dev/zero"};
    assert_int_equal(mkfifo(at(f, "pipe"), 0600), 0);
    assert_int_equal(mkdir(at(f, "folder"), 0700), 0);
    for (int i = 0; i < 3; i++) {
        const char *path = names[i][0] == '/' ? names[i] : at(f, names[i]);
        assert_int_equal(sg_model_read_ply(f->ctx, path, 9, &m), SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(f->ctx), "expected a file"));
        assert_int_equal(sg_points_read_ply(f->ctx, path, 9, &xyz, &rgb, &n), SG_ERR_INPUT);
        assert_int_equal(sg_image_read(f->ctx, path, 9, &image), SG_ERR_INPUT);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(huge_sparse_files), /* first: the peak is the process's */
        scene_test(missing_photos),    scene_test(broken_photos),       scene_test(marks),
        scene_test(long_lines),        scene_test(files_that_are_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
