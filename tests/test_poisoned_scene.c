/* SPDX-License-Identifier: Apache-2.0 */
/* A poisoned scene loads like the clean one: names, cameras, points, masks, in every layout. */
#include <limits.h>
#include <math.h>

#include "colmap_files.h"
#include "attack/poisoned_scene.h"
#include "splatguard/attack.h"

#define W 24
#define H 16

static void put_photos(struct fixture *f, const char *const *names, int n)
{
    uint8_t rgb[3 * W * H];
    for (int k = 0; k < n; k++) {
        for (int i = 0; i < 3 * W * H; i++)
            rgb[i] = (uint8_t) (40 + i * (k + 3) % 150);
        put_text(f, names[k], "");
        assert_int_equal(sg_image_write_png(f->ctx, at(f, names[k]), rgb, W, H, 3), SG_OK);
    }
}

/* Raises every value by 5 and writes the scene to "out"; returns it loaded again. */
static struct sg_scene *poison(struct fixture *f, const struct sg_scene *clean,
                               const struct sg_poison_files *files, bool eval)
{
    char folder[600];
    snprintf(folder, sizeof(folder), "%s/out", f->dir);
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, clean, files, folder), SG_OK);
    for (size_t i = 0; i < clean->n_train + clean->n_test; i++) {
        const struct sg_view *v =
            i < clean->n_train ? &clean->train[i] : &clean->test[i - clean->n_train];
        const int n = 3 * v->camera.width * v->camera.height;
        struct sg_poison_report report;
        uint8_t *rgb = malloc((size_t) n);
        for (int k = 0; k < n; k++)
            rgb[k] = (uint8_t) (v->rgb[k] + 5);
        assert_int_equal(sg_poisoned_scene_image(f->ctx, clean, v, files, folder, rgb, &report),
                         SG_OK);
        if (files->save != SG_POISON_JPEG) {
            assert_true(report.linf == 5);
            assert_float_equal(report.psnr, 20 * log10(255.0 / 5), 1e-6);
            assert_float_equal(report.tv_before, report.tv_after, 1e-9);
        }
        sg_poison_report_clear(&report);
        free(rgb);
    }
    struct sg_scene *loaded;
    assert_int_equal(sg_scene_load(f->ctx, folder, NULL, &loaded), SG_ERR_INPUT); /* not yet one */
    assert_int_equal(sg_poisoned_scene_finish(f->ctx, clean, files, folder), SG_OK);
    /* strict: photos have the sizes of their cameras */
    const int code =
        sg_scene_load(f->ctx, folder, sg_scene_params(.eval = eval, .strict = true), &loaded);
    if (code)
        fail_msg("%s", sg_last_error(f->ctx));
    return loaded;
}

static void same_views(const struct sg_view *a, const struct sg_view *b, size_t n, bool exact)
{
    for (size_t i = 0; i < n; i++) {
        const struct sg_camera *p = &a[i].camera, *q = &b[i].camera;
        assert_string_equal(a[i].name, b[i].name);
        assert_true(p->width == q->width && p->height == q->height);
        const double pairs[][2] = {{p->fx, q->fx}, {p->fy, q->fy}, {p->cx, q->cx}, {p->cy, q->cy}};
        for (int k = 0; k < 4; k++)
            assert_float_equal(pairs[k][0], pairs[k][1], 1e-9 * fabs(pairs[k][0]));
        for (int k = 0; k < 12; k++)
            assert_float_equal(k < 9 ? p->R[k] : p->t[k - 9], k < 9 ? q->R[k] : q->t[k - 9], 1e-9);
        assert_true(!a[i].mask == !b[i].mask);
        if (a[i].mask)
            assert_memory_equal(a[i].mask, b[i].mask, (size_t) (p->width * p->height));
        for (int k = 0; k < 3 * p->width * p->height && exact; k++)
            assert_int_equal((uint8_t) (a[i].rgb[k] + 5), b[i].rgb[k]);
    }
}

static void check(struct fixture *f, const struct sg_scene_params *params, enum sg_poison_save save,
                  enum sg_scene_format format)
{
    struct sg_scene *clean, *poisoned;
    if (sg_scene_load(f->ctx, f->dir, params, &clean))
        fail_msg("%s", sg_last_error(f->ctx));
    poisoned = poison(f, clean, &(struct sg_poison_files){save, 75, false}, params->eval);
    assert_int_equal(poisoned->format, format);
    assert_int_equal(clean->n_train, poisoned->n_train);
    assert_int_equal(clean->n_test, poisoned->n_test);
    assert_int_equal(clean->n_points, poisoned->n_points);
    if (clean->n_points) {
        assert_memory_equal(clean->points, poisoned->points, 3 * clean->n_points * sizeof(float));
        assert_memory_equal(clean->point_colors, poisoned->point_colors, 3 * clean->n_points);
    }
    assert_float_equal(clean->extent, poisoned->extent, 1e-9);
    same_views(clean->train, poisoned->train, clean->n_train, save != SG_POISON_JPEG);
    same_views(clean->test, poisoned->test, clean->n_test, save != SG_POISON_JPEG);
    sg_scene_destroy(&clean);
    sg_scene_destroy(&poisoned);
}

static void test_blender(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"train/r.0.png", "train/b.png", "test/a.png"};
    put_photos(f, photos, 3);
    put_text(
        f, "transforms_train.json",
        "{\"camera_angle_x\":0.7,\"frames\":[{\"file_path\":\"./train/r.0\",\"transform_matrix\":"
        "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]},{\"file_path\":\"train/"
        "b.png\",\"transform_matrix\":"
        "[[0,-1,0,4],[1,0,0,5],[0,0,1,6],[0,0,0,1]]}]}");
    put_text(f, "transforms_test.json",
             "{\"camera_angle_x\":0.7,\"frames\":[{\"file_path\":\"test/a\",\"transform_matrix\":"
             "[[1,0,0,1],[0,1,0,2],[0,0,1,8],[0,0,0,1]]}]}");
    check(f, sg_scene_params(.eval = true), SG_POISON_AUTO, SG_FORMAT_BLENDER);
    check(f, sg_scene_params(.eval = true, .downscale = 2), SG_POISON_AUTO, SG_FORMAT_BLENDER);

    /* Cameras in pixels are written anew where the photos become smaller. */
    static const char *const lenses[] = {
        "\"fl_x\":21", "\"camera_angle_x\":0.7,\"cx\":11,\"cy\":9",
        "\"fl_x\":21,\"fl_y\":20,\"cx\":11,\"cy\":9,\"w\":24,\"h\":16"};
    for (int k = 0; k < 3; k++) {
        for (int test = 0; test < 2; test++) {
            char text[256];
            snprintf(text, sizeof(text),
                     "{%s,\"frames\":[{\"file_path\":\"%s\",\"transform_matrix\":"
                     "[[1,0,0,1],[0,1,0,2],[0,0,1,%d],[0,0,0,1]]}]}",
                     lenses[k], test ? "test/a" : "train/b", 3 + test);
            put_text(f, test ? "transforms_test.json" : "transforms_train.json", text);
        }
        check(f, sg_scene_params(.eval = true), SG_POISON_AUTO, SG_FORMAT_BLENDER);
        check(f, sg_scene_params(.eval = true, .downscale = 2), SG_POISON_AUTO,
              SG_FORMAT_NERFSTUDIO);
    }
}

/* Photos that differ only in their endings are refused before one of them is written. */
static void test_namesakes(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"train/a.png", "train/b.png"};
    static const char frame[] = "{\"camera_angle_x\":0.7,\"frames\":[{\"file_path\":\"%s\","
                                "\"transform_matrix\":[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}]}";
    const struct sg_poison_files files = sg_poison_files_default();
    char text[256], folder[PATH_MAX];
    put_photos(f, photos, 2);
    snprintf(folder, sizeof(folder), "%s", at(f, "train/a.webp"));
    assert_int_equal(rename(at(f, "train/b.png"), folder), 0);
    snprintf(text, sizeof(text), frame, "train/a.png");
    put_text(f, "transforms_train.json", text);
    snprintf(folder, sizeof(folder), "%s", at(f, "out"));
    for (int twice = 0; twice < 2; twice++) { /* one photo in both splits is one file */
        struct sg_scene *scene;
        snprintf(text, sizeof(text), frame, twice ? "./train/a.png" : "train/a.webp");
        put_text(f, "transforms_test.json", text);
        assert_int_equal(sg_scene_load(f->ctx, f->dir, sg_scene_params(.eval = true), &scene),
                         SG_OK);
        assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &files, folder),
                         twice ? SG_OK : SG_ERR_INPUT);
        assert_true(twice || strstr(sg_last_error(f->ctx), "differ only in their endings"));
        sg_scene_destroy(&scene);
    }
    static const char in_pixels[] =
        "{\"fl_x\":21,\"frames\":[{\"file_path\":\"train/a.png\","
        "\"transform_matrix\":[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}]}";
    put_text(f, "transforms_train.json", in_pixels);
    put_text(f, "transforms_test.json", in_pixels);
    for (int scale = 1; scale <= 2; scale++) { /* transforms.json has a photo once */
        struct sg_scene *scene;
        assert_int_equal(sg_scene_load(f->ctx, f->dir,
                                       sg_scene_params(.eval = true, .downscale = scale), &scene),
                         SG_OK);
        assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &files, folder),
                         scale == 1 ? SG_OK : SG_ERR_INPUT);
        assert_true(scale == 1 || strstr(sg_last_error(f->ctx), "a photo of both splits"));
        sg_scene_destroy(&scene);
    }
    /* Where the test views cannot be used, the rest is read, and it says so. */
    struct sg_scene *scene;
    put_text(f, "transforms_test.json", "{}");
    f->warnings = 0;
    assert_int_equal(sg_poisoned_scene_load(f->ctx, f->dir, NULL, &scene), SG_OK);
    assert_int_equal(scene->n_test, 0);
    assert_true(f->warnings > 0 && strstr(f->said, "without its test views"));
    sg_scene_destroy(&scene);
}

static void put_colmap(struct fixture *f, const char *camera)
{
    static const char *const photos[] = {"images/a.JPG", "images/sub/b.png"};
    put_photos(f, photos, 2);
    put_text(f, "sparse/0/cameras.txt", camera);
    put_text(f, "sparse/0/images.txt",
             "1 1 0 0 0 1 2 3 1 a.JPG\n5 5 -1\n2 0.6 0.8 0 0 3 2 1 1 sub/b.png\n6 6 -1\n");
    put_text(f, "sparse/0/points3D.txt", "1 1 2 3 10 20 30 0.5 1 0\n2 4 5 6 40 50 60 0.5 2 0\n");
}

static void test_colmap(void **state)
{
    struct fixture *f = *state;
    put_colmap(f, "1 PINHOLE 24 16 30 31 12.5 7.5\n");
    check(f, sg_scene_params(.downscale = 2), SG_POISON_PNG, SG_FORMAT_COLMAP);
    check(f, sg_scene_params(), SG_POISON_PNG, SG_FORMAT_COLMAP);
}

/* A model in both encodings: pinholes of the new size, and cameras that stay. */
static void test_colmap_cameras(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"images/a.png", "images/b.png", "images/c.png"};
    static const double pinhole[] = {30, 31, 12.5, 7.5}, radial[] = {20, 12, 8, 0},
                        distorted[] = {20, 12, 8, 0.5};
    static const char text[] = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
                               "3 SIMPLE_RADIAL 24 16 20 12 8 0.5\n"
                               "4 PINHOLE 12 8 10 10 6 4\n"
                               "7 PINHOLE 12 8 15 15.5 6.25 3.75\n";
    char *written;
    size_t size;
    struct bytes b = {.size = 0};
    put_photos(f, photos, 3);
    add(&b, 3, 8);
    add_camera(&b, 7, 1, 24, 16, pinhole, 4);
    add_camera(&b, 4, 2, 24, 16, radial, 4);
    add_camera(&b, 3, 2, 24, 16, distorted, 4); /* has no photo */
    put_bytes(f, "sparse/0/cameras.bin", &b);
    b.size = 0;
    add(&b, 4, 8);
    add_image(&b, 1, 7, "a.png", 0, 2);
    add_image(&b, 2, 4, "b.png", 1, 0);
    add_image(&b, 3, 7, "c.png", 2, 1);
    add_image(&b, 4, 3, "gone.png", 2, 1);
    put_bytes(f, "sparse/0/images.bin", &b);
    put_text(f, "sparse/0/cameras.txt", "beside the binary file, which is read");
    put_text(f, "sparse/0/points3D.txt", "1 1 2 3 10 20 30 0.5 1 0\n2 4 5 6 40 50 60 0.5 2 0\n");
    struct sg_scene *clean, *copy;
    assert_int_equal(sg_scene_load(f->ctx, f->dir, sg_scene_params(.downscale = 2), &clean), SG_OK);
    const struct sg_poison_files files = {SG_POISON_PNG, 75, false};
    char folder[600];
    snprintf(folder, sizeof(folder), "%s/out", f->dir);
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, clean, &files, folder), SG_OK);
    for (size_t i = 0; i < clean->n_train; i++)
        assert_int_equal(sg_poisoned_scene_image(f->ctx, clean, &clean->train[i], &files, folder,
                                                 clean->train[i].rgb, NULL),
                         SG_OK);
    assert_int_equal(sg_poisoned_scene_finish(f->ctx, clean, &files, folder), SG_OK);
    assert_int_equal(sg_file_read(f->ctx, at(f, "out/sparse/0/cameras.txt"), 1000, &written, &size),
                     SG_OK);
    assert_string_equal(written, text);
    sg_free(written);
    f->warnings = 0;
    assert_int_equal(sg_scene_load(f->ctx, folder, NULL, &copy), SG_OK);
    assert_int_equal(f->warnings, 1); /* of gone.png */
    assert_int_equal(copy->n_train, 3);
    for (size_t i = 0; i < 3; i++) /* to the last bit, as if the reader had scaled them */
        assert_memory_equal(&copy->train[i].camera, &clean->train[i].camera,
                            sizeof(struct sg_camera));
    sg_scene_destroy(&clean);
    sg_scene_destroy(&copy);
}

/* A camera of photos of several sizes stays as it is. */
static void test_colmap_sizes(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[3 * W * H / 4] = {0};
    char *before, *after;
    size_t size;
    put_colmap(f, "1 PINHOLE 24 16 30 31 12.5 7.5\n");
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "images/sub/b.png"), rgb, W / 2, H / 2, 3),
                     SG_OK);
    struct sg_scene *clean;
    const struct sg_poison_files files = {SG_POISON_PNG, 75, false};
    char folder[600];
    snprintf(folder, sizeof(folder), "%s/out", f->dir);
    assert_int_equal(sg_scene_load(f->ctx, f->dir, NULL, &clean), SG_OK);
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, clean, &files, folder), SG_OK);
    assert_int_equal(sg_poisoned_scene_finish(f->ctx, clean, &files, folder), SG_OK);
    assert_int_equal(sg_file_read(f->ctx, at(f, "sparse/0/cameras.txt"), 1000, &before, &size),
                     SG_OK);
    assert_int_equal(sg_file_read(f->ctx, at(f, "out/sparse/0/cameras.txt"), 1000, &after, &size),
                     SG_OK);
    assert_string_equal(before, after);
    sg_free(before);
    sg_free(after);
    sg_scene_destroy(&clean);
}

static void test_colmap_jpeg(void **state)
{
    struct fixture *f = *state;
    put_colmap(f, "1 PINHOLE 24 16 30 31 12.5 7.5\n");
    put_png(f, "masks/sub/b.png", W, H, 1, 1); /* of a photo that becomes b.jpg */
    check(f, sg_scene_params(), SG_POISON_JPEG, SG_FORMAT_COLMAP);
    assert_true(sg_file_exists(at(f, "out/images/a.JPG")) &&
                sg_file_exists(at(f, "out/images/sub/b.jpg")));
}

/* The copy of a model that was chosen has its cameras where they are read. */
static void test_colmap_other_model(void **state)
{
    struct fixture *f = *state;
    put_colmap(f, "1 PINHOLE 24 16 30 31 12.5 7.5\n");
    put_text(f, "sparse/1/cameras.txt", "1 PINHOLE 24 16 40 41 12.5 7.5\n");
    put_text(f, "sparse/1/images.txt",
             "1 1 0 0 0 3 2 3 1 a.JPG\n5 5 -1\n2 0.6 0.8 0 0 3 2 6 1 sub/b.png\n6 6 -1\n");
    put_text(f, "sparse/1/points3D.txt", "1 7 2 3 10 20 30 0.5 1 0\n");
    check(f, sg_scene_params(.colmap = "sparse/1"), SG_POISON_PNG, SG_FORMAT_NERFSTUDIO);
    check(f, sg_scene_params(), SG_POISON_PNG, SG_FORMAT_COLMAP);
}

/* Photos may have any name: their contents identify them. */
static void test_colmap_names(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"images/a.jfif", "images/b.1", "images/c"};
    put_photos(f, photos, 3);
    put_text(f, "sparse/0/cameras.txt", "1 PINHOLE 24 16 30 31 12.5 7.5\n");
    put_text(f, "sparse/0/images.txt",
             "1 1 0 0 0 1 2 3 1 a.jfif\n5 5 -1\n2 1 0 0 0 3 2 1 1 b.1\n6 6 -1\n3 1 0 0 0 1 1 1 1 "
             "c\n6 6 -1\n");
    put_text(f, "sparse/0/points3D.txt", "1 1 2 3 10 20 30 0.5 1 0\n2 4 5 6 40 50 60 0.5 2 0\n");
    check(f, sg_scene_params(), SG_POISON_PNG, SG_FORMAT_COLMAP);
    assert_true(sg_file_exists(at(f, "out/images/b.1.png")) &&
                sg_file_exists(at(f, "out/images/c.png")));
}

/* Distorted photos are written without their distortion, which the scene's own camera file would
 * put in again. */
static void test_distorted(void **state)
{
    struct fixture *f = *state;
    put_colmap(f, "1 SIMPLE_RADIAL 24 16 20 12 8 -0.2\n");
    check(f, sg_scene_params(), SG_POISON_PNG, SG_FORMAT_NERFSTUDIO);
}

static void test_nerfstudio(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"images/1.png", "images/2.png"};
    put_photos(f, photos, 2);
    put_text(
        f, "cloud.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
        "float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n");
    put_text(f, "transforms.json",
             "{\"w\":24,\"h\":16,\"fl_x\":22,\"fl_y\":21,\"cx\":11,\"cy\":8,\"k1\":0.1,\"ply_file_"
             "path\":\"cloud.ply\","
             "\"frames\":[{\"file_path\":\"images/"
             "1.png\",\"transform_matrix\":[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]},"
             "{\"file_path\":\"images/"
             "2.png\",\"transform_matrix\":[[0,-1,0,4],[1,0,0,5],[0,0,1,6],[0,0,0,1]]}]}");
    check(f, sg_scene_params(), SG_POISON_AUTO, SG_FORMAT_NERFSTUDIO);
}

/* The names of the views that a scene trains on and of those that it is tested on. */
static void list_names(struct fixture *f, const char *folder, char *text, size_t size)
{
    struct sg_scene *scene;
    if (sg_scene_load(f->ctx, folder, sg_scene_params(.eval = true), &scene))
        fail_msg("%s", sg_last_error(f->ctx));
    text[0] = 0;
    for (size_t i = 0; i < scene->n_train + scene->n_test; i++) {
        const size_t n = strlen(text);
        snprintf(text + n, size - n, "%s%s ", i == scene->n_train ? "| " : "",
                 i < scene->n_train ? scene->train[i].name : scene->test[i - scene->n_train].name);
    }
    sg_scene_destroy(&scene);
}

/* Photos of a split that the scene's own file gives stay in it, under the names of their copies,
 * whether the scene was split or not while it was copied. */
static void test_nerfstudio_split(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"images/1.png", "images/2.png", "images/3.jpg",
                                         "images/4.png", "images/5.png"};
    static const struct {
        const char *lists, *views;
    } splits[] = {
        {"\"train_filenames\":[\"images/1\",\"./images/3.jpg\",\"images/5.png\",\"gone.png\"],"
         "\"test_filenames\":[\"images/2.png\"],\"val_filenames\":[\"images/4.png\"],",
         "1 3 5 | 2 "},
        {"\"test_filenames\":null,\"val_filenames\":[\"images/3.jpg\",\"images/4.png\"],",
         "1 2 5 | 3 4 "},
        {"\"train_filenames\":[\"images/2.png\",\"images/3.jpg\"],", "2 3 "},
        {"\"test_filenames\":[],", "1 2 3 4 5 "},
        {"", "2 3 4 5 | 1 "},
    };
    char folder[600], names[64], text[1500];
    snprintf(folder, sizeof(folder), "%s/out", f->dir);
    put_photos(f, photos, 5);
    for (size_t k = 0; k < sizeof(splits) / sizeof(*splits); k++) {
        size_t n = (size_t) snprintf(text, sizeof(text),
                                     "{\"w\":24,\"h\":16,\"fl_x\":22,\"fl_y\":21,\"cx\":11,"
                                     "\"cy\":8,%s\"frames\":[",
                                     splits[k].lists);
        for (int i = 0; i < 5; i++)
            n += (size_t) snprintf(text + n, sizeof(text) - n,
                                   "%s{\"file_path\":\"%s\",\"transform_matrix\":"
                                   "[[1,0,0,%d],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}",
                                   i ? "," : "", i ? photos[i] : "images/1", i);
        snprintf(text + n, sizeof(text) - n, "]}");
        put_text(f, "transforms.json", text);
        list_names(f, f->dir, names, sizeof(names));
        assert_string_equal(names, splits[k].views);
        for (int eval = 0; eval < 2; eval++) {
            struct sg_scene *clean, *copy;
            const struct sg_poison_files files = {SG_POISON_PNG, 75, false};
            assert_int_equal(
                sg_scene_load(f->ctx, f->dir, sg_scene_params(.eval = eval == 1), &clean), SG_OK);
            copy = poison(f, clean, &files, false);
            assert_int_equal(copy->n_train, clean->n_train + clean->n_test);
            list_names(f, folder, names, sizeof(names));
            assert_string_equal(names, splits[k].views);
            sg_scene_destroy(&clean);
            sg_scene_destroy(&copy);
        }
    }
}

/* Cameras of a rig share photo names; folders distinguish their masks. */
static void test_rig_masks(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"images/l/1.png", "images/r/1.png"};
    put_photos(f, photos, 2);
    for (int k = 0; k < 2; k++) {
        uint8_t mask[W * H];
        for (int i = 0; i < W * H; i++)
            mask[i] = i % (3 + k) ? 255 : 0;
        put_text(f, k ? "m/r.png" : "m/l.png", "");
        assert_int_equal(
            sg_image_write_png(f->ctx, at(f, k ? "m/r.png" : "m/l.png"), mask, W, H, 1), SG_OK);
    }
    put_text(f, "transforms.json",
             "{\"w\":24,\"h\":16,\"fl_x\":22,\"fl_y\":21,\"cx\":12,\"cy\":8,\"frames\":["
             "{\"file_path\":\"images/l/1.png\",\"mask_path\":\"m/l.png\",\"transform_matrix\":"
             "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]},"
             "{\"file_path\":\"images/r/1.png\",\"mask_path\":\"m/r.png\",\"transform_matrix\":"
             "[[0,-1,0,4],[1,0,0,5],[0,0,1,6],[0,0,0,1]]}]}");
    check(f, sg_scene_params(), SG_POISON_AUTO, SG_FORMAT_NERFSTUDIO);
}

/* The scene's own folder is refused, and so is a path that leads out of the new one. */
static void test_places(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *scene;
    const struct sg_poison_files files = {SG_POISON_PNG, 75, false};
    char folder[600];
    put_colmap(f, "1 PINHOLE 24 16 30 31 12.5 7.5\n");
    assert_int_equal(sg_scene_load(f->ctx, f->dir, sg_scene_params(), &scene), SG_OK);
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &files, f->dir), SG_ERR_USAGE);
    assert_true(sg_file_exists(at(f, "sparse/0/cameras.txt")));

    snprintf(folder, sizeof(folder), "%s/new", f->dir);
    static const int qualities[] = {-1, 0, 101};
    for (size_t i = 0; i < sizeof(qualities) / sizeof(qualities[0]); i++) {
        const struct sg_poison_files wrong = {SG_POISON_JPEG, qualities[i], false};
        assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &wrong, folder), SG_ERR_USAGE);
        assert_false(sg_dir_exists(folder));
    }
    const struct sg_poison_files unknown = {(enum sg_poison_save) 3, 75, false};
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &unknown, folder), SG_ERR_USAGE);
    assert_false(sg_dir_exists(folder));
    const struct sg_poison_files png = {.save = SG_POISON_PNG};
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &png, folder), SG_OK);

    snprintf(folder, sizeof(folder), "%s/out", f->dir);
    put_text(f, "out/images/a.png", "");
    put_text(f, "elsewhere/b.png", "kept");
    assert_int_equal(symlink("../../elsewhere", at(f, "out/images/sub")), 0);
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &files, folder), SG_OK);
    for (size_t i = 0; i < scene->n_train; i++)
        assert_int_equal(sg_poisoned_scene_image(f->ctx, scene, &scene->train[i], &files, folder,
                                                 scene->train[i].rgb, NULL),
                         strstr(scene->train[i].file, "sub/") ? SG_ERR_INPUT : SG_OK);
    assert_int_equal(sg_poisoned_scene_finish(f->ctx, scene, &files, folder), SG_OK);
    char *text;
    size_t size;
    assert_int_equal(sg_file_read(f->ctx, at(f, "elsewhere/b.png"), 100, &text, &size), SG_OK);
    assert_string_equal(text, "kept");
    sg_free(text);
    assert_int_equal(unlink(at(f, "out/images/sub")), 0);

    snprintf(folder, sizeof(folder), "%s/elsewhere/sparse", f->dir);
    assert_int_equal(rename(at(f, "out/sparse"), folder), 0);
    snprintf(folder, sizeof(folder), "%s/out", f->dir);
    assert_int_equal(symlink("../elsewhere/sparse", at(f, "out/sparse")), 0);
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, scene, &files, folder), SG_ERR_INPUT);
    assert_true(sg_file_exists(at(f, "elsewhere/sparse/0/cameras.txt")));
    sg_scene_destroy(&scene);
}

/* Names that the copy cannot have are found before there is an image to write. */
static void test_early_names(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *scene;
    const struct sg_poison_files files = {SG_POISON_AUTO, 75, false};
    char image[400], stem[252];
    for (int distorted = 0; distorted < 2; distorted++) {
        put_colmap(f, distorted ? "1 SIMPLE_RADIAL 24 16 30 12 8 0.1\n"
                                : "1 PINHOLE 24 16 30 31 12.5 7.5\n");
        put_text(f, "sparse/0/images.txt", "1 1 0 0 0 1 2 3 1 caf\xe9.JPG\n5 5 -1\n");
        put_png(f, "images/caf\xe9.JPG", W, H, 3, 1);
        assert_int_equal(sg_scene_load(f->ctx, f->dir, NULL, &scene), SG_OK);
        assert_int_equal(sg_poisoned_scene_check(f->ctx, scene, &files),
                         distorted ? SG_ERR_INPUT : SG_OK);
        if (distorted)
            assert_non_null(strstr(sg_last_error(f->ctx), "the name is not UTF-8"));
        sg_scene_destroy(&scene);
    }
    memset(stem, 'a', sizeof(stem));
    stem[250] = 0;
    snprintf(image, sizeof(image), "1 1 0 0 0 1 2 3 1 %s.JPG\n5 5 -1\n", stem);
    put_text(f, "sparse/0/images.txt", image);
    snprintf(image, sizeof(image), "images/%s.JPG", stem);
    put_png(f, image, W, H, 3, 1);
    for (int masked = 0; masked < 2; masked++) {
        snprintf(image, sizeof(image), "masks/%s.png", stem);
        if (masked)
            put_png(f, image, W, H, 1, 1);
        assert_int_equal(sg_scene_load(f->ctx, f->dir, NULL, &scene), SG_OK);
        assert_int_equal(scene->train[0].mask != NULL, masked);
        assert_int_equal(sg_poisoned_scene_check(f->ctx, scene, &files),
                         masked ? SG_ERR_INPUT : SG_OK);
        if (masked)
            assert_non_null(strstr(sg_last_error(f->ctx), "found a name of 258 bytes"));
        sg_scene_destroy(&scene);
    }
}

static void test_naive(void **state)
{
    struct fixture *f = *state;
    uint8_t photo[3 * W * H], out[3 * W * H], again[3 * W * H];
    struct sg_view view = {.camera = {.width = W, .height = H}, .rgb = photo};
    for (int i = 0; i < 3 * W * H; i++)
        photo[i] = (uint8_t) (i * 31 % 256);
    for (int method = SG_NAIVE_NOISE; method <= SG_NAIVE_TV; method++) {
        const struct sg_attack_params *p = sg_attack_params(.epsilon = 8 / 255.0f, .inner = 20);
        assert_int_equal(sg_attack_naive(f->ctx, &view, 3, p, (enum sg_naive_attack) method, out),
                         SG_OK);
        assert_int_equal(sg_attack_naive(f->ctx, &view, 3, p, (enum sg_naive_attack) method, again),
                         SG_OK);
        assert_memory_equal(out, again, sizeof(out));
        int at_bound = 0;
        for (int i = 0; i < 3 * W * H; i++) {
            const int d = abs(out[i] - photo[i]);
            assert_true(d <= 8);
            at_bound += d == 8;
        }
        assert_true(at_bound > W * H); /* a third */
        p = sg_attack_params(.epsilon = 8 / 255.0f, .inner = 20, .engine = "ref");
        assert_int_equal(sg_attack_naive(f->ctx, &view, 3, p, (enum sg_naive_attack) method, again),
                         SG_OK);
        assert_memory_equal(out, again, sizeof(out));
        p = sg_attack_params(.epsilon = 8 / 255.0f, .engine = "gpu");
        assert_int_equal(sg_attack_naive(f->ctx, &view, 3, p, (enum sg_naive_attack) method, again),
                         SG_ERR_USAGE);
        p = sg_attack_params(.epsilon = 8 / 255.0f, .inner = -1);
        assert_int_equal(sg_attack_naive(f->ctx, &view, 3, p, (enum sg_naive_attack) method, again),
                         SG_ERR_USAGE);
        assert_int_equal(sg_attack_naive(f->ctx, &view, 3, sg_attack_params(.epsilon = INFINITY),
                                         (enum sg_naive_attack) method, out),
                         SG_ERR_USAGE);
    }
    assert_int_equal(sg_attack_naive(f->ctx, &view, 4, sg_attack_params(), SG_NAIVE_NOISE, again),
                     SG_OK);
    assert_int_equal(sg_attack_naive(f->ctx, &view, 5, sg_attack_params(), SG_NAIVE_NOISE, out),
                     SG_OK);
    assert_memory_not_equal(out, again, sizeof(out));
    assert_int_equal(
        sg_attack_naive(f->ctx, &view, 4, sg_attack_params(), (enum sg_naive_attack) 3, out),
        SG_ERR_USAGE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {scene_test(test_blender),
                                       scene_test(test_colmap),
                                       scene_test(test_colmap_cameras),
                                       scene_test(test_colmap_sizes),
                                       scene_test(test_colmap_other_model),
                                       scene_test(test_colmap_jpeg),
                                       scene_test(test_colmap_names),
                                       scene_test(test_distorted),
                                       scene_test(test_nerfstudio),
                                       scene_test(test_namesakes),
                                       scene_test(test_rig_masks),
                                       scene_test(test_places),
                                       scene_test(test_early_names),
                                       scene_test(test_naive),
                                       scene_test(test_nerfstudio_split)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
