/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes that are broken, lying or malicious: each is refused with a message that names the file
 * and the place. */
#include "colmap_files.h"

#include <math.h>

static const char pose[] = "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";

/* transforms_train.json with one frame; angle and matrix as given. */
static void put_blender(struct fixture *f, const char *angle, const char *matrix)
{
    char text[1024];
    snprintf(text, sizeof(text), "{\"camera_angle_x\":%s,\"frames\":[{\"file_path\":\"a\",%s}]}",
             angle, matrix);
    put_text(f, "transforms_train.json", text);
    put_png(f, "a.png", 20, 10, 3, 1);
}

static void folders(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *scene;
    expect_failure(f, NULL, SG_ERR_INPUT, f->dir, "sparse/0/images.bin", "transforms_train.json",
                   "transforms.json", NULL);
    assert_int_equal(sg_scene_load(f->ctx, "/nowhere/at/all", NULL, &scene), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "/nowhere/at/all"));
    expect_failure(f, sg_scene_params(.format = SG_FORMAT_COLMAP), SG_ERR_INPUT, "COLMAP", "sparse",
                   NULL);
    expect_failure(f, sg_scene_params(.format = SG_FORMAT_BLENDER), SG_ERR_INPUT,
                   "transforms_train.json", NULL);
    expect_failure(f, sg_scene_params(.format = SG_FORMAT_NERFSTUDIO), SG_ERR_INPUT,
                   "transforms.json", NULL);
}

static void parameters(void **state)
{
    struct fixture *f = *state;
    expect_failure(f, sg_scene_params(.resolution = 0), SG_ERR_USAGE, "resolution", NULL);
    expect_failure(f, sg_scene_params(.downscale = 0.5), SG_ERR_USAGE, "downscale", NULL);
    expect_failure(f, sg_scene_params(.test_every = 0), SG_ERR_USAGE, "test_every", NULL);
    expect_failure(f, sg_scene_params(.format = (enum sg_scene_format) 9), SG_ERR_USAGE, "format",
                   NULL);
}

static void json_poses(void **state)
{
    static const char *const bad[] = {
        "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,0,0],[0,0,0,1]]",   /* singular */
        "\"transform_matrix\":[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]",   /* all zero */
        "\"transform_matrix\":[[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",  /* mirrored */
        "\"transform_matrix\":[[1,0.5,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", /* sheared */
        "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,0]]",   /* projective */
        "\"transform_matrix\":[[1,0,0,1e200],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
        "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0]]",
        "\"transform_matrix\":[[1,0,0,0],[0,1,0,0]]",
        "\"transform_matrix\":[[1,0,0,\"0\"],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
        "\"transform_matrix\":7",
        "\"other\":7",
    };
    struct fixture *f = *state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(*bad); i++) {
        put_blender(f, "1", bad[i]);
        expect_failure(f, NULL, SG_ERR_INPUT, "transforms_train.json", "frame 0", NULL);
    }
    put_blender(f, "1", "\"transform_matrix\":[[1,0,0,1e200],[0,1,0,0],[0,0,1,0],[0,0,0,1]]");
    expect_failure(f, NULL, SG_ERR_INPUT, "found 1e+200 in the pose", "of at most 1e+12", NULL);
    put_blender(f, "1", "\"transform_matrix\":[[NaN,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]");
    expect_failure(f, NULL, SG_ERR_INPUT, "transforms_train.json", "line 1", NULL);
    put_blender(f, "1", "\"transform_matrix\":[[1e999,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]");
    expect_failure(f, NULL, SG_ERR_INPUT, "transforms_train.json", "line 1", NULL);
    /* a uniform scale is harmless */
    put_blender(f, "1", "\"transform_matrix\":[[2,0,0,6],[0,2,0,0],[0,0,2,0],[0,0,0,1]]");
    struct sg_scene *s = load(f, NULL);
    assert_true(s->train[0].camera.R[0] == 1 && s->train[0].camera.t[0] == -6);
    sg_scene_destroy(&s);
}

static void json_values(void **state)
{
    struct fixture *f = *state;
    static const char *const angles[] = {"0", "-1", "4", "\"1\"", "null"};
    for (size_t i = 0; i < sizeof(angles) / sizeof(*angles); i++) {
        put_blender(f, angles[i], pose);
        expect_failure(f, NULL, SG_ERR_INPUT, "transforms_train.json", NULL);
    }
    put_text(f, "transforms_train.json", "{\"camera_angle_x\":1,\"frames\":[]}");
    expect_failure(f, NULL, SG_ERR_INPUT, "frames", NULL);
    put_text(f, "transforms_train.json", "[1,2]");
    expect_failure(f, NULL, SG_ERR_INPUT, "frames", NULL);
    put_text(f, "transforms_train.json", "{\"camera_angle_x\":1,\"frames\":[{\"file_path\":");
    expect_failure(f, NULL, SG_ERR_INPUT, "line 1", NULL);
    put_text(f, "transforms_train.json", "");
    expect_failure(f, NULL, SG_ERR_INPUT, "transforms_train.json", NULL);
    char *deep = malloc(100001);
    memset(deep, '[', 100000);
    deep[100000] = 0;
    put_text(f, "transforms_train.json", deep);
    expect_failure(f, NULL, SG_ERR_INPUT, "transforms_train.json", NULL);
    free(deep);
}

static void json_files(void **state)
{
    struct fixture *f = *state;
    char text[1024];
    put_blender(f, "1", pose);
    remove(at(f, "a.png"));
    expect_failure(f, NULL, SG_ERR_INPUT, "0 of 1 photos", "is a, also", NULL);
    put_png(f, "a.png", 20, 10, 3, 1);
    expect_failure(f, sg_scene_params(.eval = true), SG_ERR_INPUT, "transforms_test.json", NULL);
    expect_failure(f, sg_scene_params(.max_pixels = 199), SG_ERR_INPUT, "a.png", "20 x 10", NULL);
    static const char *const outside[] = {"/etc/passwd", "../a", "x/../../a", "..", "b/.."};
    for (size_t i = 0; i < sizeof(outside) / sizeof(*outside); i++) {
        snprintf(text, sizeof(text),
                 "{\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"%s\",%s}]}", outside[i], pose);
        put_text(f, "transforms_train.json", text);
        expect_failure(f, NULL, SG_ERR_INPUT, "frame 0", outside[i], NULL);
    }
    snprintf(text, sizeof(text),
             "{\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"a\",%s},{\"file_path\":\"./"
             "a.png\",%s}]}",
             pose, pose);
    put_text(f, "transforms_train.json", text);
    expect_failure(f, NULL, SG_ERR_INPUT, "transforms_train.json", "same name", "a.png", NULL);
    expect_failure(f, sg_scene_params(.max_images = 1), SG_ERR_INPUT, "frames", "limit is 1", NULL);
    put_blender(f, "1", pose);
    put_text(f, "a.png", "this is no image");
    expect_failure(f, NULL, SG_ERR_INPUT, "a.png", "signature", NULL);
    put_text(f, "a.png", "");
    expect_failure(f, NULL, SG_ERR_INPUT, "a.png", NULL);
}

static void nerfstudio(void **state)
{
    struct fixture *f = *state;
    char text[1024];
    put_png(f, "a.png", 20, 10, 3, 1);
    static const struct {
        const char *extra, *word;
    } cases[] = {
        {"\"camera_model\":\"EQUIRECTANGULAR\"", "EQUIRECTANGULAR"},
        {"\"camera_model\":\"OPENCV_FISHEYE\"", "fl_x"},
        {"\"is_fisheye\":true", "fl_x"},
        {"\"camera_model\":\"OPENCV_FISHEYE\",\"fl_x\":10,\"p1\":0.1", "p1 = 0.1"},
        {"\"k4\":0.1", "k4 = 0.1"},
        {"\"k6\":0.1", "k6 = 0.1"},
        {"\"camera_model\":\"FULL_OPENCV\",\"fl_x\":10,\"k4\":-1e300", "distortion"},
        {"\"w\":20,\"h\":90", "a.png: found 20 x 10 pixels"},
        {"\"w\":-5", "\"w\""},
        {"\"h\":10.5", "\"h\""},
        {"\"w\":1e30", "\"w\""},
        {"\"cx\":1", "cx"},
        {"\"fl_x\":-3", "focal"},
        {"\"fl_x\":1e300", "expected ones above 0, of at most 1e+07 pixels"},
        {"\"cx\":1e8,\"cy\":5", "principal point (1e+08, 5), expected pixels of at most 1e+07"},
        {"\"ply_file_path\":\"../../x.ply\"", "ply_file_path"},
        {"\"ply_file_path\":3", "ply_file_path"},
    };
    for (size_t i = 0; i < sizeof(cases) / sizeof(*cases); i++) {
        snprintf(text, sizeof(text),
                 "{%s\"camera_angle_y\":1,%s,\"frames\":[{\"file_path\":\"a.png\",%s}]}",
                 strstr(cases[i].extra, "fl_x") ? "" : "\"camera_angle_x\":1,", cases[i].extra,
                 pose);
        put_text(f, "transforms.json", text);
        expect_failure(f, NULL, SG_ERR_INPUT, "transforms.json", cases[i].word, NULL);
    }
    snprintf(text, sizeof(text),
             "{\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"gone.png\",%s}]}", pose);
    put_text(f, "transforms.json", text);
    expect_failure(f, NULL, SG_ERR_INPUT, "transforms.json", "gone.png", "0 of 1 photos", NULL);
    snprintf(text, sizeof(text), "{\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"a.png\",%s}]}",
             pose);
    put_text(f, "transforms.json", text);
    expect_failure(f, sg_scene_params(.eval = true), SG_ERR_INPUT, "no view to train on", NULL);
    f->warnings = 0;
    struct sg_scene *s = load(f, sg_scene_params(.eval = true, .untrained = true));
    assert_int_equal(s->n_train, 0);
    assert_int_equal(s->n_test, 1);
    assert_int_equal(f->warnings, 0);
    sg_scene_destroy(&s);
}

static const double pinhole[12] = {30, 40, 10, 5};

/* A small good COLMAP scene, in memory too. */
static void make_colmap(struct fixture *f, struct bytes *cameras, struct bytes *images,
                        struct bytes *points)
{
    cameras->size = images->size = points->size = 0;
    add(cameras, 1, 8);
    add_camera(cameras, 7, 1, 20, 10, pinhole, 4);
    add(images, 2, 8);
    add_image(images, 1, 7, "a.png", 0, 1);
    add_image(images, 2, 7, "b.png", 1, 0);
    add(points, 2, 8);
    add_point(points, 1, 1, 2, 3, 4, 1);
    add_point(points, 2, 1, 2, 3, 4, 0);
    put_png(f, "images/a.png", 20, 10, 3, 1);
    put_png(f, "images/b.png", 20, 10, 3, 2);
    put_bytes(f, "sparse/0/cameras.bin", cameras);
    put_bytes(f, "sparse/0/images.bin", images);
    put_bytes(f, "sparse/0/points3D.bin", points);
}

static void colmap_every_cut_and_excess(void **state)
{
    struct fixture *f = *state;
    static struct bytes part[3];
    static const char *const names[] = {"sparse/0/cameras.bin", "sparse/0/images.bin",
                                        "sparse/0/points3D.bin"};
    make_colmap(f, &part[0], &part[1], &part[2]);
    for (int k = 0; k < 3; k++) {
        for (size_t cut = 0; cut < part[k].size; cut++) {
            put(f, names[k], part[k].data, cut);
            expect_failure(f, NULL, SG_ERR_INPUT, names[k], NULL);
        }
        put(f, names[k], part[k].data, part[k].size + 1);
        expect_failure(f, NULL, SG_ERR_INPUT, names[k], "after the last", NULL);
        put_bytes(f, names[k], &part[k]);
    }
    struct sg_scene *s = load(f, NULL);
    sg_scene_destroy(&s);
}

static void colmap_counts(void **state)
{
    struct fixture *f = *state;
    static struct bytes c, i, p;
    make_colmap(f, &c, &i, &p);
    static const uint64_t counts[] = {3, 1u << 16, UINT64_MAX, UINT64_MAX / 64 + 1};
    for (size_t k = 0; k < sizeof(counts) / sizeof(*counts); k++) {
        struct bytes *files[] = {&c, &i, &p};
        static const char *const names[] = {"sparse/0/cameras.bin", "sparse/0/images.bin",
                                            "sparse/0/points3D.bin"};
        for (int n = 0; n < 3; n++) {
            struct bytes b = *files[n];
            memcpy(b.data, &counts[k], 8); /* the tests run on little-endian machines */
            put_bytes(f, names[n], &b);
            struct sg_scene *scene;
            int code = sg_scene_load(f->ctx, f->dir, NULL, &scene);
            assert_int_equal(code, SG_ERR_INPUT);
            assert_non_null(strstr(sg_last_error(f->ctx), names[n]));
            put_bytes(f, names[n], files[n]);
        }
    }
    /* inner counts: observations of the first image, track of the first point */
    struct bytes b = i;
    memset(b.data + 8 + 64 + 6, 0xff, 8);
    put_bytes(f, "sparse/0/images.bin", &b);
    expect_failure(f, NULL, SG_ERR_INPUT, "images.bin", "image id 1", "observations", NULL);
    put_bytes(f, "sparse/0/images.bin", &i);
    b = p;
    memset(b.data + 8 + 43, 0x11, 8);
    put_bytes(f, "sparse/0/points3D.bin", &b);
    expect_failure(f, NULL, SG_ERR_INPUT, "points3D.bin", "point id 1", "track", NULL);
    put_bytes(f, "sparse/0/points3D.bin", &p);
    expect_failure(f, sg_scene_params(.max_points = 1), SG_ERR_INPUT, "points3D.bin", "limit is 1",
                   NULL);
    expect_failure(f, sg_scene_params(.max_images = 1), SG_ERR_INPUT, "images.bin", "limit is 1",
                   NULL);
}

static void colmap_cameras(void **state)
{
    struct fixture *f = *state;
    static struct bytes c, i, p;
    static const struct {
        int model, width, height, n;
        double params[12];
        const char *word;
    } cases[] = {
        {5, 20, 10, 8, {30, 30, 10, 5, 0, 0, 0, NAN}, "distortion"},
        {6, 20, 10, 12, {30, 30, 10, 5, 0, 0, 0, 0, 0, 0, 0, INFINITY}, "distortion"},
        {7, 20, 10, 5, {30, 30, 10, 5, 4}, "omega"},
        {7, 20, 10, 5, {30, 30, 10, 5, -1}, "omega"},
        {10, 20, 10, 12, {0, 30, 10, 5}, "focal"},
        {11, 20, 10, 4, {30, 30, 10, 5}, "model number 11"},
        {-1, 20, 10, 4, {30, 30, 10, 5}, "model number"},
        {1, 0, 10, 4, {30, 30, 10, 5}, "0 x 10"},
        {1, 20, -1, 4, {30, 30, 10, 5}, "sides"},
        {1, 20, 10, 4, {0, 30, 10, 5}, "focal"},
        {1, 20, 10, 4, {30, -1, 10, 5}, "focal"},
        {1, 20, 10, 4, {30, 0.0 / 1.0, 10, 5}, "focal"},
        {1, 20, 10, 4, {1e308, 30, 10, 5}, "focal"},
        {0, 20, 10, 3, {30, 1e308, 5}, "principal"},
    };
    for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++) {
        make_colmap(f, &c, &i, &p);
        c.size = 8;
        add_camera(&c, 7, cases[k].model, cases[k].width, cases[k].height, cases[k].params,
                   cases[k].n);
        put_bytes(f, "sparse/0/cameras.bin", &c);
        expect_failure(f, NULL, SG_ERR_INPUT, "cameras.bin", "camera id 7", cases[k].word, NULL);
    }
    c.size = 0;
    add(&c, 0, 8);
    put_bytes(f, "sparse/0/cameras.bin", &c);
    expect_failure(f, NULL, SG_ERR_INPUT, "cameras.bin", "no camera", NULL);
    c.size = 0;
    add(&c, 2, 8);
    add_camera(&c, 7, 1, 20, 10, pinhole, 4);
    add_camera(&c, 7, 1, 20, 10, pinhole, 4);
    put_bytes(f, "sparse/0/cameras.bin", &c);
    expect_failure(f, NULL, SG_ERR_INPUT, "cameras.bin", "id 7 twice", NULL);
    c.size = 0;
    add(&c, 1, 8);
    add_camera(&c, 8, 1, 20, 10, pinhole, 4);
    put_bytes(f, "sparse/0/cameras.bin", &c);
    expect_failure(f, NULL, SG_ERR_INPUT, "images.bin", "a.png", "camera id 7", NULL);
}

static void colmap_images(void **state)
{
    struct fixture *f = *state;
    static struct bytes c, i, p;
    static const struct {
        const char *name, *word;
    } cases[] = {
        {"a.png", "same name"},
        {"c.png", "missing is c.png"},
        {"x/c.png", "missing is x/c.png"},
        {"/etc/passwd", "inside"},
        {"../a.png", "inside"},
        {"", "name of a file"},
        {"images/", "name of a file"},
        {"a.jpg", "same name"},
    };
    for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++) {
        make_colmap(f, &c, &i, &p);
        i.size = 0;
        add(&i, 2, 8);
        add_image(&i, 1, 7, "a.png", 0, 0);
        add_image(&i, 2, 7, cases[k].name, 0, 1);
        put_bytes(f, "sparse/0/images.bin", &i);
        expect_failure(f, sg_scene_params(.strict = true), SG_ERR_INPUT, "images.bin",
                       cases[k].word, NULL);
    }
    for (size_t place = 12; place < 12 + 56;
         place += 8) { /* NaN in each number of the first pose */
        make_colmap(f, &c, &i, &p);
        memset(i.data + place, 0xff, 8);
        put_bytes(f, "sparse/0/images.bin", &i);
        expect_failure(f, NULL, SG_ERR_INPUT, "images.bin", "image id 1", NULL);
    }
    make_colmap(f, &c, &i, &p);
    memset(i.data + 12, 0, 32);
    put_bytes(f, "sparse/0/images.bin", &i);
    expect_failure(f, NULL, SG_ERR_INPUT, "images.bin", "quaternion", NULL);
    i.size = 0;
    add(&i, 0, 8);
    put_bytes(f, "sparse/0/images.bin", &i);
    expect_failure(f, NULL, SG_ERR_INPUT, "no images", NULL);
    make_colmap(f, &c, &i, &p);
    memset(p.data + 16, 0xff, 8);
    put_bytes(f, "sparse/0/points3D.bin", &p);
    expect_failure(f, NULL, SG_ERR_INPUT, "points3D.bin", "point id 1", "coordinate", NULL);
}

static void colmap_text(void **state)
{
    struct fixture *f = *state;
    static const char good_camera[] = "1 PINHOLE 20 10 30 30 10 5\n",
                      good_image[] = "1 1 0 0 0 0 0 0 1 a.png\n\n";
    static const struct {
        const char *cameras, *images, *points, *word;
    } cases[] = {
        {"1 PINHOLE 20 10 30 30 10\n", good_image, "",
         "cameras.txt: line 1: found \"1 PINHOLE 20 10 30 30 10\", expected ID PINHOLE WIDTH "
         "HEIGHT and 4 numbers"},
        {"1 PINHOLE 20 10 30 30 10 5 6\n", good_image, "", "cameras.txt: line 1"},
        {"# x\n1 PINHOLE 20 10 30 30 10 nan\n", good_image, "", "cameras.txt: line 2"},
        {"1 MAGIC 20 10 30 30 10 5\n", good_image, "", "MAGIC"},
        {"1 FOV 20 10 30 30 10 5 9\n", good_image, "", "omega"},
        {"-1 PINHOLE 20 10 30 30 10 5\n", good_image, "", "cameras.txt: line 1"},
        {"1 PINHOLE 99999999999999999999 10 30 30 10 5\n", good_image, "", "cameras.txt: line 1"},
        {"1 PINHOLE 2 1 9e6 9e6 1 0.5\n", good_image, "", "a.png: camera.fx: found 9e+07"},
        {"", good_image, "", "no camera"},
        {good_camera, "1 1 0 0 0 0 0 0 1\n\n", "",
         "images.txt: line 1: found \"1 1 0 0 0 0 0 0 1\", expected ID QW"},
        {good_camera, "1 1 0 0 0 0 0 inf 1 a.png\n\n", "", "images.txt: line 1"},
        {good_camera, "1 0 0 0 0 0 0 0 1 a.png\n\n", "", "quaternion"},
        {good_camera, "1 1 0 0 0 0 0 0 2 a.png\n\n", "", "camera id 2"},
        {good_camera, "", "", "no images"},
        {good_camera, good_image, "1 0 0 0 256 0 0 0\n",
         "points3D.txt: line 1: found \"1 0 0 0 256 0 0 0\", expected ID X"},
        {good_camera, good_image, "1 0 0 0 1 2 3 0\n2 0 nan 0 1 2 3 0\n", "points3D.txt: line 2"},
    };
    put_png(f, "images/a.png", 20, 10, 3, 1);
    for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++) {
        put_text(f, "sparse/cameras.txt", cases[k].cameras);
        put_text(f, "sparse/images.txt", cases[k].images);
        put_text(f, "sparse/points3D.txt", cases[k].points);
        expect_failure(f, NULL, SG_ERR_INPUT, cases[k].word, NULL);
    }
}

static void memory_limit_is_an_error(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *scene;
    put_blender(f, "1", pose);
    for (uint64_t limit = 64; limit < 20000; limit += 64) {
        sg_ctx *small;
        assert_int_equal(
            sg_ctx_create(&small, &(struct sg_ctx_params){.threads = 1, .max_memory = limit}),
            SG_OK);
        int code = sg_scene_load(small, f->dir, sg_scene_params(.downscale = 2), &scene);
        assert_true(code == SG_OK || code == SG_ERR_BUDGET || (code == SG_ERR_INPUT && !scene));
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(small, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&small);
        if (!code)
            return;
    }
    fail_msg("20 kB are not enough for a photo of 600 bytes");
}

/* Photos are decoded at full size: all threads at once need more than one does, which decides. */
static void threads_share_the_limit(void **state)
{
    struct fixture *f = *state;
    enum { PHOTOS = 12, SIDE = 256 };
    char json[4096];
    size_t n = (size_t) sprintf(json, "{\"camera_angle_x\":1,\"frames\":[");
    for (int i = 0; i < PHOTOS; i++) {
        char name[20];
        sprintf(name, "%d.png", i);
        put_png(f, name, SIDE, SIDE, 3, i);
        n += (size_t) sprintf(json + n, "%s{\"file_path\":\"%s\",\"transform_matrix\":%s}",
                              i ? "," : "", name, "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]");
    }
    sprintf(json + n, "]}");
    put_text(f, "transforms.json", json);
    int code = SG_ERR_BUDGET;
    bool estimated = false;
    for (uint64_t limit = 3 * SIDE * SIDE; code; limit += 16384)
        for (int threads = 1; threads <= 8; threads += 7) {
            sg_ctx *ctx;
            struct sg_scene *scene;
            const struct sg_ctx_params p = {.threads = threads, .max_memory = limit};
            assert_int_equal(sg_ctx_create(&ctx, &p), SG_OK);
            const int found = sg_scene_load(ctx, f->dir, sg_scene_params(.downscale = 2), &scene);
            assert_true(found == SG_OK || found == SG_ERR_BUDGET);
            assert_true(threads == 1 || found == code);
            code = found;
            estimated |= strstr(sg_last_error(ctx), "to read this photo") != NULL;
            sg_scene_destroy(&scene);
            sg_ctx_destroy(&ctx);
        }
    assert_true(estimated);
}

/* A parser's nodes are many times the text they come from. */
static void json_counts_as_memory(void **state)
{
    struct fixture *f = *state;
    enum { NODES = 100000 };
    struct sg_scene *scene;
    char *text = malloc(3 * NODES + 300);
    sg_ctx *small;
    put_png(f, "a.png", 4, 4, 3, 1);
    size_t n = (size_t) sprintf(text, "{\"x\":[");
    for (int i = 0; i < NODES; i++)
        n += (size_t) sprintf(text + n, "%s{}", i ? "," : "");
    sprintf(text + n,
            "],\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":"
            "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}]}");
    put_text(f, "transforms.json", text);
    free(text);
    assert_int_equal(
        sg_ctx_create(&small, &(struct sg_ctx_params){.threads = 1, .max_memory = 20 << 20}),
        SG_OK);
    assert_int_equal(sg_scene_load(small, f->dir, NULL, &scene), SG_ERR_BUDGET);
    sg_ctx_destroy(&small);
    sg_scene_destroy(&(struct sg_scene *){load(f, NULL)});
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(folders),
        scene_test(parameters),
        scene_test(threads_share_the_limit),
        scene_test(json_poses),
        scene_test(json_values),
        scene_test(json_files),
        scene_test(nerfstudio),
        scene_test(colmap_every_cut_and_excess),
        scene_test(colmap_counts),
        scene_test(colmap_cameras),
        scene_test(colmap_images),
        scene_test(colmap_text),
        scene_test(memory_limit_is_an_error),
        scene_test(json_counts_as_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
