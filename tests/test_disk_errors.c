/* SPDX-License-Identifier: Apache-2.0 */
/* A disk that fails while a scene is loaded. No such scene loads, in part or with photos skipped,
 * and the message is the system's. */
#include "zip_files.h"

#include <errno.h>
#include <unistd.h>

#define ROOM (1 << 20)

/* The n-th read fails, and all after it; 0: none. */
static int failing, reads;

ssize_t __real_pread(int fd, void *to, size_t n, off_t from);
ssize_t __wrap_pread(int fd, void *to, size_t n, off_t from);
ssize_t __wrap_pread(int fd, void *to, size_t n, off_t from)
{
    if (!failing || ++reads < failing)
        return __real_pread(fd, to, n, from);
    errno = EIO;
    return -1;
}

#define POSE "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]"
static const char frames[] =
    "{\"camera_angle_x\":1,\"ply_file_path\":\"points.ply\",\"frames\":["
    "{\"file_path\":\"images/a.png\"," POSE "},{\"file_path\":\"images/b.png\"," POSE "}]}";
static const char points[] = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
                             "property float y\nproperty float z\nend_header\n1 2 3\n-1 -2 -3\n";

static void put_photos(struct fixture *f)
{
    put_png(f, "images/a.png", 400, 300, 3, 1);
    put_png(f, "images/b.png", 400, 300, 3, 2);
    put_png(f, "masks/b.png", 400, 300, 1, 3);
}

/* Loads with every read failing in turn. */
static void fail_every_read(const char *path, int least)
{
    struct sg_scene *scene;
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1}), SG_OK);
    int code = SG_ERR_INPUT;
    for (failing = 1; code; failing++) {
        reads = 0;
        code = sg_scene_load(ctx, path, NULL, &scene);
        if (code && !strstr(sg_last_error(ctx), strerror(EIO)))
            fail_msg("read %d: %s", failing, sg_last_error(ctx));
        assert_true(code == (reads >= failing ? SG_ERR_INPUT : SG_OK));
        if (!code)
            assert_int_equal(scene->n_train, 2);
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    }
    assert_in_range(failing, least, 1000);
    failing = 0;
    sg_ctx_destroy(&ctx);
}

static void test_folder(void **state)
{
    struct fixture *f = *state;
    put_photos(f);
    put_text(f, "transforms.json", frames);
    put_text(f, "points.ply", points);
    fail_every_read(f->dir, 6);
}

/* Texts of several windows, where the end of a window is the end of a line or not. */
static void test_colmap_text(void **state)
{
    struct fixture *f = *state;
    enum { POINTS = 20000 };
    char *text = malloc(POINTS * 32), *to = text;
    put_photos(f);
    put_text(f, "sparse/0/cameras.txt", "1 PINHOLE 400 300 300 300 200 150\n");
    to += sprintf(to, "1 1 0 0 0 0 0 4 1 a.png\n");
    for (int i = 0; i < POINTS; i++)
        to += sprintf(to, "%d %d -1 ", i % 400, i % 300);
    sprintf(to, "\n2 1 0 0 0 1 0 4 1 b.png\n\n");
    put_text(f, "sparse/0/images.txt", text);
    to = text;
    for (int i = 0; i < POINTS; i++)
        to += sprintf(to, "%05d %d %d 1 9 9 9 0.1 %s\n", i, i % 7, i % 5, i % 3 ? "" : "1 2");
    put_text(f, "sparse/0/points3D.txt", text);
    free(text);
    fail_every_read(f->dir, 8);
}

static void test_archive(void **state)
{
    struct fixture *f = *state;
    static const char *const names[] = {"transforms.json", "images/a.png", "images/b.png",
                                        "masks/b.png", "points.ply"};
    put_photos(f);
    put_text(f, "transforms.json", frames);
    put_text(f, "points.ply", points);
    for (int deflated = 0; deflated < 2; deflated++) {
        struct archive a = {.bytes = malloc(ROOM)};
        for (size_t i = 0; i < sizeof(names) / sizeof(*names); i++) {
            char *data;
            size_t size;
            assert_int_equal(sg_file_read(f->ctx, at(f, names[i]), ROOM, &data, &size), SG_OK);
            archive_add(&a, names[i], data, size, deflated);
            sg_free(data);
        }
        archive_finish(&a, "");
        put(f, "s.zip", a.bytes, a.size);
        free(a.bytes);
        fail_every_read(at(f, "s.zip"), 10);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_folder),
        scene_test(test_colmap_text),
        scene_test(test_archive),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
