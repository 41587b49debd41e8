/* SPDX-License-Identifier: Apache-2.0 */
/* Well-formed scenes, by every reader. */
#include "colmap_files.h"

#include <math.h>

#include "splatguard/train.h"

#define POSE(x) "\"transform_matrix\":[[1,0,0," #x "],[0,0.8,-0.6,2],[0,0.6,0.8,3],[0,0,0,1]]"

static void close_to(double a, double b)
{
    if (!(fabs(a - b) < 1e-9))
        fail_msg("%.12g is not %.12g", a, b);
}

static void put_blender(struct fixture *f)
{
    put_text(f, "transforms_train.json",
             "{\"camera_angle_x\":1.0,\"frames\":[{\"file_path\":\"./train/b\"," POSE(
                 5) "},"
                    "{\"file_path\":\"train/a.png\"," POSE(-5) "},{\"file_path\":\"train/c\"," POSE(
                        0) "}]}");
    put_text(f, "transforms_test.json",
             "{\"camera_angle_x\":1.0,\"frames\":[{\"file_path\":\"test/b\"," POSE(7) "}]}");
    put_png(f, "train/a.png", 20, 10, 4, 1);
    put_png(f, "train/b.png", 20, 10, 4, 2);
    put_png(f, "train/c.png", 20, 10, 3, 3);
    put_png(f, "test/b.png", 20, 10, 4, 4);
}

static void blender(void **state)
{
    struct fixture *f = *state;
    put_blender(f);
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(s->format, SG_FORMAT_BLENDER);
    assert_string_equal(sg_scene_format_name(s->format), "blender");
    assert_int_equal(s->n_train, 3);
    assert_int_equal(s->n_test, 0);
    assert_int_equal(s->n_points, 0);
    assert_string_equal(s->train[0].name, "b"); /* file order */
    assert_string_equal(s->train[1].name, "a");
    const struct sg_camera *c = &s->train[0].camera;
    assert_int_equal(c->width, 20);
    assert_int_equal(c->height, 10);
    close_to(c->fx, 20 / (2 * tan(0.5)));
    close_to(c->fy, c->fx);
    close_to(c->cx, 10);
    close_to(c->cy, 5);
    /* camera-to-world with columns y and z turned round, then inverted */
    const double R[9] = {1, 0, 0, 0, -0.8, -0.6, 0, 0.6, -0.8};
    for (int i = 0; i < 9; i++)
        close_to(c->R[i], R[i]);
    close_to(c->t[0], -5);
    close_to(c->t[1], 0.8 * 2 + 0.6 * 3);
    close_to(c->t[2], -0.6 * 2 + 0.8 * 3);
    close_to(s->center[0], 0);
    close_to(s->center[1], 2);
    close_to(s->extent, 1.1 * 5);
    /* black background, truncated: pixel 0 of seed 2 is 62, 69, 76 at alpha 83 */
    assert_int_equal(s->train[0].rgb[0], 62 * 83 / 255);
    assert_int_equal(s->train[0].rgb[2], 76 * 83 / 255);
    sg_scene_destroy(&s);
    assert_null(s);

    s = load(f, sg_scene_params(.eval = true, .white_background = true, .downscale = 2));
    assert_int_equal(s->n_test, 1);
    assert_string_equal(s->test[0].name, "b");
    assert_int_equal(s->test[0].camera.width, 10);
    assert_int_equal(s->test[0].camera.height, 5);
    assert_int_equal(s->test[0].file_width, 20);
    close_to(s->test[0].camera.fx, 10 / (2 * tan(0.5)));
    close_to(s->test[0].camera.cx, 5);
    sg_scene_destroy(&s);
}

/* Nine images 0..8, out of order, two cameras, each encoding. */
static void put_colmap(struct fixture *f, bool text)
{
    const double pinhole[] = {30, 40, 11, 6}, simple[] = {50, 10, 5};
    struct bytes b = {.size = 0};
    if (text) {
        put_text(f, "sparse/0/cameras.txt",
                 "# comment\n7 PINHOLE 20 10 30 40 11 6\n3 SIMPLE_RADIAL 20 10 50 10 5 0\n");
    } else {
        add(&b, 2, 8);
        add_camera(&b, 7, 1, 20, 10, pinhole, 4);
        add_camera(&b, 3, 0, 20, 10, simple, 3);
        put_bytes(f, "sparse/0/cameras.bin", &b);
    }
    b.size = 0;
    add(&b, 9, 8);
    char lines[4096] = "# comment\n";
    for (int k = 0; k < 9; k++) {
        int i = (k * 5 + 3) % 9;
        char name[32];
        snprintf(name, sizeof(name), "im %d.x.png", i);
        add_image(&b, 100 + i, i == 4 ? 3 : 7, name, i, k % 3);
        snprintf(lines + strlen(lines), 200, "%d 1 0 0 0 %d 0 0 %d %s\n%s\n", 100 + i, -i,
                 i == 4 ? 3 : 7, name, k % 3 ? "1.5 2.5 -1 3.5 4.5 6" : "");
        char path[64];
        snprintf(path, sizeof(path), "images/im %d.x.png", i);
        put_png(f, path, 20, 10, 3, i);
    }
    if (text)
        put_text(f, "sparse/0/images.txt", lines);
    else
        put_bytes(f, "sparse/0/images.bin", &b);
    b.size = 0;
    add(&b, 2, 8);
    add_point(&b, 1, 1, -2, 3.5, 10, 2);
    add_point(&b, 9, 4, 5, 6, 255, 0);
    if (text)
        put_text(f, "sparse/0/points3D.txt",
                 "1 1 -2 3.5 10 20 30 0.5 1 2 3 4\r\n9 4 5 6 255 20 30 0.5");
    else
        put_bytes(f, "sparse/0/points3D.bin", &b);
}

static void check_colmap(struct fixture *f)
{
    struct sg_scene *s = load(f, sg_scene_params(.eval = true, .test_every = 4));
    assert_int_equal(s->format, SG_FORMAT_COLMAP);
    assert_int_equal(s->n_train, 6);
    assert_int_equal(s->n_test, 3);
    assert_string_equal(s->test[0].name, "im 0"); /* up to the first dot */
    assert_string_equal(s->test[1].name, "im 4");
    assert_string_equal(s->test[2].name, "im 8");
    assert_string_equal(s->train[0].name, "im 1");
    const struct sg_camera *c = &s->train[1].camera;
    close_to(c->fx, 30);
    close_to(c->fy, 40);
    close_to(c->cx, 11);
    close_to(c->cy, 6);
    close_to(c->R[0], 1);
    close_to(c->t[0], -2);
    assert_int_equal(s->train[1].rgb[5], (uint8_t) (5 * 7 + 2 * 31));
    close_to(s->test[1].camera.fy, 50); /* the other camera */
    close_to(s->test[1].camera.cx, 10);
    assert_null(s->train[0].mask);
    assert_int_equal(s->n_points, 2);
    assert_true(s->points[1] == -2 && s->points[2] == 3.5f && s->points[3] == 4);
    assert_int_equal(s->point_colors[0], 10);
    assert_int_equal(s->point_colors[3], 255);
    assert_int_equal(s->point_colors[5], 30);
    sg_scene_destroy(&s);
    s = load(f, sg_scene_params(.centred_principal = true));
    assert_int_equal(s->n_train, 9);
    assert_int_equal(s->n_test, 0);
    close_to(s->train[0].camera.cx, 10);
    close_to(s->extent, 1.1 * 4);
    sg_scene_destroy(&s);
}

static void colmap_binary(void **state)
{
    put_colmap(*state, false);
    check_colmap(*state);
}

static void colmap_text(void **state)
{
    put_colmap(*state, true);
    check_colmap(*state);
}

/* The photo may have another size than the camera says: the field of view stays. */
static void colmap_other_size_and_folder(void **state)
{
    struct fixture *f = *state;
    put_text(f, "sparse/cameras.txt", "1 PINHOLE 40 20 60 80 22 12\n");
    put_text(f, "sparse/images.txt", "1 1 0 0 0 0 0 0 1 deep/a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n");
    put_png(f, "images_2/a.png", 20, 10, 1, 0); /* base name only */
    put_png(f, "images_2/b.png", 20, 10, 3, 0);
    struct sg_scene *s = load(f, sg_scene_params(.images = "images_2"));
    close_to(s->train[0].camera.fx, 30);
    close_to(s->train[0].camera.fy, 40);
    close_to(s->train[0].camera.cx, 11);
    close_to(s->train[0].camera.cy, 6);
    assert_int_equal(s->train[0].rgb[3], 7); /* grey is repeated */
    assert_int_equal(s->train[0].rgb[5], 7);
    sg_scene_destroy(&s);
}

/* COLMAP makes several models of photos that it cannot connect. */
static void colmap_other_model(void **state)
{
    struct fixture *f = *state;
    put_colmap(f, false);
    put_text(f, "transforms_train.json", "{}");
    put_text(f, "sparse/1/cameras.txt", "1 PINHOLE 20 10 60 80 10 5\n");
    put_text(f, "sparse/1/images.txt",
             "1 1 0 0 0 0 0 0 1 im 3.x.png\n\n2 1 0 0 0 5 0 0 1 im 5.x.png\n\n");
    put_text(f, "sparse/1/points3D.txt", "1 7 8 9 10 20 30 0.5\n");
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(s->n_train, 9);
    assert_int_equal(f->warnings, 1);
    assert_non_null(strstr(f->said, "sparse/1: found another COLMAP model"));
    sg_scene_destroy(&s);
    s = load(f, sg_scene_params(.colmap = "sparse/1"));
    assert_int_equal(f->warnings, 1);
    assert_int_equal(s->n_train, 2);
    assert_string_equal(s->train[0].name, "im 3");
    close_to(s->train[0].camera.fx, 60);
    assert_int_equal(s->n_points, 1);
    assert_true(s->points[2] == 9);
    sg_scene_destroy(&s);
    expect_failure(f, sg_scene_params(.colmap = "sparse/2"), SG_ERR_INPUT, f->dir,
                   "found no COLMAP model", "in sparse/2", NULL);
    expect_failure(f, sg_scene_params(.colmap = "../sparse/1"), SG_ERR_INPUT, f->dir,
                   "that leads out of", NULL);
    put_text(f, "transforms.json",
             "{\"fl_x\":30,\"frames\":[{\"file_path\":\"images/im 3.x.png\"," POSE(1) "}]}");
    s = load(f, sg_scene_params(.colmap = "sparse/1", .format = SG_FORMAT_NERFSTUDIO));
    assert_non_null(strstr(f->said, "colmap: found \"sparse/1\", which has no effect"));
    sg_scene_destroy(&s);
}

static void nerfstudio_masks(void **state)
{
    struct fixture *f = *state;
    const char *frame =
        "{\"fl_x\":30,\"frames\":[{\"file_path\":\"a.png\",\"mask_path\":\"%s\"," POSE(1) "}]}";
    char text[1024];
    const uint8_t mask[4] = {0, 255, 255, 0};
    snprintf(text, sizeof(text), frame, "m/a.png");
    put_text(f, "transforms.json", text);
    put_png(f, "a.png", 2, 2, 3, 1);
    expect_failure(f, NULL, SG_ERR_INPUT, "transforms.json", "found no mask", "m/a.png", NULL);
    put(f, "m/a.png", "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "m/a.png"), mask, 2, 2, 1), SG_OK);
    struct sg_scene *s = load(f, NULL);
    assert_memory_equal(s->train[0].mask, mask, 4);
    sg_scene_destroy(&s);
    /* As its writer reads it, all but 0 is used, so 0 and 1 do too. */
    const uint8_t ones[4] = {0, 1, 1, 0}, none[4] = {0};
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "m/a.png"), ones, 2, 2, 1), SG_OK);
    s = load(f, NULL);
    assert_memory_equal(s->train[0].mask, mask, 4);
    assert_null(strstr(f->said, "no used pixel"));
    sg_scene_destroy(&s);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "m/a.png"), none, 2, 2, 1), SG_OK);
    s = load(f, NULL);
    assert_non_null(strstr(f->said, "1 of 1 photos have no used pixel"));
    assert_non_null(strstr(f->said, "/a.png, with the mask "));
    sg_scene_destroy(&s);
    snprintf(text, sizeof(text), frame, "../m/a.png");
    put_text(f, "transforms.json", text);
    expect_failure(f, NULL, SG_ERR_INPUT, "frame 0", "mask_path", NULL);
}

/* Without the lines of 2D points every other image would go unnoticed. */
static void colmap_text_without_points(void **state)
{
    struct fixture *f = *state;
    put_text(f, "sparse/cameras.txt", "1 PINHOLE 2 1 2 2 1 0.5\n");
    put_text(f, "sparse/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 1 0 0 1 b.png\n");
    put_png(f, "images/a.png", 2, 1, 3, 0);
    expect_failure(f, NULL, SG_ERR_INPUT, "images.txt: line 2", "2D points", NULL);
    /* Names of three words make lines of a multiple of three words. */
    put_text(f, "sparse/images.txt",
             "1 1 0 0 0 0 0 0 1 my new a.png\n2 1 0 0 0 1 0 0 1 my new b.png\n");
    put_png(f, "images/my new a.png", 2, 1, 3, 0);
    expect_failure(f, NULL, SG_ERR_INPUT, "images.txt: line 2", "2D points", NULL);
}

/* Blanks behind a name are none of it; points may be in no track. */
static void colmap_text_blanks(void **state)
{
    struct fixture *f = *state;
    put_text(f, "sparse/cameras.txt", "1 PINHOLE 2 1 2 2 1 0.5\n");
    put_text(f, "sparse/images.txt",
             "1 1 0 0 0 0 0 0 1 a.png \t\r\n0.5 0.5 -1 1.5 0.5 7 \n2 1 0 0 0 1 0 0 1 b.png\n\n");
    put_png(f, "images/a.png", 2, 1, 3, 0);
    put_png(f, "images/b.png", 2, 1, 3, 0);
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(s->n_train, 2);
    assert_int_equal(f->warnings, 0);
    sg_scene_destroy(&s);
}

/* A photo that was moved out of its folder can be that of one image only. */
static void colmap_one_photo_for_two(void **state)
{
    struct fixture *f = *state;
    put_text(f, "sparse/cameras.txt", "1 PINHOLE 2 1 2 2 1 0.5\n");
    put_text(f, "sparse/images.txt",
             "1 1 0 0 0 0 0 0 1 left/1.png\n\n2 1 0 0 0 1 0 0 1 right/1.png\n\n"
             "3 1 0 0 0 2 0 0 1 right/2.png\n\n");
    put_png(f, "images/1.png", 2, 1, 3, 0);
    put_png(f, "images/2.png", 2, 1, 3, 0);
    expect_failure(f, NULL, SG_ERR_INPUT, "images.txt: found the photo", "images/1.png alone",
                   "\"left/1.png\" and \"right/1.png\"", NULL);
    put_png(f, "images/left/1.png", 2, 1, 3, 0);
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(s->n_train, 3);
    sg_scene_destroy(&s);
    /* An image has a photo at its own place, the other's is missing. */
    put_text(f, "sparse/images.txt",
             "1 1 0 0 0 0 0 0 1 gone/2.png\n\n2 1 0 0 0 1 0 0 1 2.png\n0 0 +7 1 1 -1.0e+00\n");
    s = load(f, NULL);
    assert_int_equal(s->n_train, 1);
    assert_string_equal(s->train[0].file, "2.png");
    assert_non_null(
        strstr(f->said, "1 of 2 photos are missing and are skipped, the first is gone/"));
    sg_scene_destroy(&s);
}

/* Lenses of COLMAP without a row of struct sg_lens are named in the text and numbered in the
 * binary. */
static void colmap_models(void **state)
{
    struct fixture *f = *state;
    const uint8_t division[8 + 24 + 3 * 8] = {1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 13, 0, 0, 0, 2};
    put_text(f, "sparse/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n");
    put_png(f, "images/a.png", 20, 10, 3, 0);
    put_text(f, "sparse/cameras.txt", "1 EUCM 20 10 20 20 10 5 0.5 1\n");
    expect_failure(f, NULL, SG_ERR_INPUT, "cameras.txt: line 1", "found camera model EUCM",
                   "SIMPLE_PINHOLE, PINHOLE", "THIN_PRISM_FISHEYE, SIMPLE_FISHEYE, FISHEYE;", NULL);
    put_text(f, "sparse/cameras.txt", "1 FISHEYE 20 10 20 19 10 5\n");
    struct sg_scene *s = load(f, NULL);
    assert_true(s->train[0].undistorted);
    close_to(s->train[0].camera.fy, 19);
    sg_scene_destroy(&s);
    put(f, "sparse/cameras.bin", division, sizeof(division));
    put(f, "sparse/images.bin", "", 0);
    expect_failure(f, NULL, SG_ERR_INPUT, "cameras.bin", "found camera model number 13", NULL);
}

/* Photos without cameras: what training from COLMAP would see of them, whatever their names are and
 * their alpha hides; and nothing to train on. */
static void photos_alone(void **state)
{
    struct fixture *f = *state;
    const struct sg_scene_params *alone = sg_scene_params(.photos_alone = true),
                                 *masked = sg_scene_params(.photos_alone = true, .masks = "m");
    const uint8_t faint[8] = {10, 20, 30, 0, 40, 50, 60, 1};
    put(f, "b.png", "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "b.png"), faint, 2, 1, 4), SG_OK);
    put_png(f, "a.dat", 3200, 4, 3, 0);
    put_text(f, "notes", "none");
    expect_failure(f, NULL, SG_ERR_INPUT, "found no scene", NULL);
    struct sg_scene *s = load(f, alone);
    assert_true(s->format == SG_FORMAT_PHOTOS && s->n_train == 2 && !f->warnings);
    assert_string_equal(s->train[0].name, "a.dat");
    assert_int_equal(s->train[0].camera.width, 1600);
    assert_int_equal(s->train[0].camera.height, 2);
    const uint8_t *rgb;
    assert_null(s->train[1].rgb); /* few are in memory at once */
    assert_int_equal(sg_view_pixels(f->ctx, &s->train[1], &rgb), SG_OK);
    assert_memory_equal(rgb, ((uint8_t[]){10, 20, 30, 40, 50, 60}), 6);
    sg_view_release(&s->train[1]);
    sg_trainer *t;
    assert_int_equal(sg_trainer_create(f->ctx, s, NULL, NULL, &t), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "found photos without cameras"));
    sg_scene_destroy(&s);

    put_png(f, "m/b.png", 2, 1, 1, 5); /* 155, 162: all is used */
    put_png(f, ".c", 2, 1, 3, 0);
    s = load(f, alone);
    assert_true(s->n_train == 2 && !s->train[1].mask && f->warnings == 1);
    assert_non_null(
        strstr(f->said, "2 of its entries are not looked at; the first is .c, a hidden"));
    sg_scene_destroy(&s);
    s = load(f, masked);
    assert_non_null(s->train[1].mask);
    assert_non_null(strstr(f->said, "1 of its entries is not looked at; the first is .c"));
    sg_scene_destroy(&s);
    expect_failure(f, sg_scene_params(.photos_alone = true, .strict = true), SG_ERR_INPUT,
                   "/.c: found a hidden photo, expected photos alone", NULL);
}

/* A rig's photos have the same names in other folders; alpha is dropped, as the reference does for
 * photos. */
static void colmap_rig(void **state)
{
    struct fixture *f = *state;
    const uint8_t faint[8] = {10, 20, 30, 0, 40, 50, 60, 128};
    put_text(f, "sparse/cameras.txt", "1 PINHOLE 2 1 2 2 1 0.5\n");
    put_text(f, "sparse/images.txt",
             "1 1 0 0 0 0 0 0 1 left/001.png\n\n2 1 0 0 0 1 0 0 1 right/001.png\n\n");
    put(f, "images/left/001.png", "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "images/left/001.png"), faint, 2, 1, 4),
                     SG_OK);
    put_png(f, "images/right/001.png", 2, 1, 3, 0);
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(s->n_train, 2);
    assert_string_equal(s->train[0].name, "left_001");
    assert_string_equal(s->train[1].name, "right_001");
    assert_memory_equal(s->train[0].rgb, ((uint8_t[]){10, 20, 30, 40, 50, 60}), 6);
    sg_scene_destroy(&s);

    /* Masks lie in folders of the same names, and have any of three. */
    static const char *const names[] = {"masks/left/001.png", "masks/left/001.png.png"};
    const uint8_t half[2] = {0, 255};
    for (int i = 0; i < 2; i++) {
        put(f, names[i], "", 0);
        assert_int_equal(sg_image_write_png(f->ctx, at(f, names[i]), half, 2, 1, 1), SG_OK);
        s = load(f, NULL);
        assert_memory_equal(s->train[0].mask, half, 2);
        assert_null(s->train[1].mask);
        sg_scene_destroy(&s);
        remove(at(f, names[i]));
    }
    put_text(f, "sparse/images.txt",
             "1 1 0 0 0 0 0 0 1 left/001.JPG\n\n2 1 0 0 0 1 0 0 1 right/001.png\n\n");
    remove(at(f, "images/left/001.png"));
    put_png(f, "images/left/001.JPG", 2, 1, 3, 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, names[0]), half, 2, 1, 1), SG_OK);
    s = load(f, NULL);
    assert_memory_equal(s->train[0].mask, half, 2);
    sg_scene_destroy(&s);

    /* One in no folder would be that of both photos. */
    remove(at(f, names[0]));
    put_png(f, "masks/001.png", 2, 1, 1, 0);
    expect_failure(f, NULL, SG_ERR_INPUT, "masks/001.png", "one mask", "left/001.JPG",
                   "masks/right/001.png.png", NULL);
    put_text(f, "sparse/images.txt",
             "1 1 0 0 0 0 0 0 1 left/001.JPG\n\n2 1 0 0 0 1 0 0 1 right/002.png\n\n");
    put_png(f, "images/right/002.png", 2, 1, 3, 0);
    s = load(f, NULL);
    assert_non_null(s->train[0].mask);
    assert_null(s->train[1].mask);
    sg_scene_destroy(&s);
}

static void resolution_rule(void **state)
{
    static const struct {
        int width, height, resolution;
        double downscale;
        int w, h;
    } cases[] = {
        {21, 11, 2, 1, 10, 6}, /* 10.5 and 5.5: half to even */
        {1601, 801, -1, 1, 1599, 800},
        /* 1601 / (1601 / 1600.) truncated, as the reference */ {1600, 7, -1, 1, 1600, 7},
        {90, 47, 30, 1, 30, 15},
        {90, 47, 1, 3, 30, 16},
        {3200, 10, -1, 4, 400, 1},
        {10, 3, 8, 1, 1, 1},
    };
    for (size_t i = 0; i < sizeof(cases) / sizeof(*cases); i++) {
        struct fixture *f = *state;
        put_text(f, "transforms_train.json",
                 "{\"camera_angle_x\":1.0,\"frames\":[{\"file_path\":\"a\"," POSE(5) "}]}");
        put_png(f, "a.png", cases[i].width, cases[i].height, 3, 1);
        struct sg_scene *s = load(
            f, sg_scene_params(.resolution = cases[i].resolution, .downscale = cases[i].downscale));
        assert_int_equal(s->train[0].camera.width, cases[i].w);
        assert_int_equal(s->train[0].camera.height, cases[i].h);
        close_to(s->train[0].camera.fx, cases[i].w / (2 * tan(0.5)));
        assert_int_equal(s->train[0].file_width, cases[i].width);
        sg_scene_destroy(&s);
    }
}

#define FRAME(name, x) "{\"file_path\":\"" name "\"," POSE(x) "}"

static void nerfstudio(void **state)
{
    struct fixture *f = *state;
    put_text(f, "transforms.json",
             "{\"w\":20.0,\"h\":10,\"fl_x\":30,\"fl_y\":40,\"cx\":11,\"cy\":6,\"k1\":0,\"camera_"
             "model\":\"OPENCV\","
             "\"applied_transform\":[[1,0,0,0],[0,0,1,0],[0,-1,0,0]],"
             "\"frames\":[" FRAME("images/d.png", 4) "," FRAME("./images/c.png", 3) "," FRAME(
                 "images/gone.png",
                 9) ","
                    "{\"file_path\":\"images/b.png\",\"fl_x\":35,\"cx\":10,\"cy\":5," POSE(
                        2) "}," FRAME("images/gone2.png", 9) "," FRAME("images/a.png", 1) "]}");
    for (char c = 'a'; c <= 'd'; c++)
        put_png(f, (char[]){'i', 'm', 'a', 'g', 'e', 's', '/', c, '.', 'p', 'n', 'g', 0}, 20, 10, 3,
                c);
    struct sg_scene *s = load(f, sg_scene_params(.eval = true, .test_every = 3));
    assert_int_equal(f->warnings, 1); /* missing photos */
    assert_int_equal(s->format, SG_FORMAT_NERFSTUDIO);
    assert_int_equal(s->n_train, 2);
    assert_int_equal(s->n_test, 2);
    assert_string_equal(s->test[0].name, "a");
    assert_string_equal(s->test[1].name, "d");
    assert_string_equal(s->train[0].name, "b");
    close_to(s->train[0].camera.fx, 35);
    close_to(s->train[0].camera.fy, 40);
    close_to(s->train[0].camera.cx, 10);
    close_to(s->train[1].camera.fx, 30);
    close_to(s->train[1].camera.cy, 6);
    close_to(s->train[1].camera.t[0], -3);
    close_to(s->train[1].camera.R[4], -0.8);
    sg_scene_destroy(&s);
}

/* A camera of which one side is known: the photo is as much smaller in both. */
static void nerfstudio_one_side(void **state)
{
    struct fixture *f = *state;
    static const char *const sides[] = {"\"w\":40,", "\"h\":20,", "\"w\":40,\"h\":20,"};
    char text[400];
    put_png(f, "a.png", 20, 10, 3, 'a');
    for (int k = 0; k < 6; k++) {
        snprintf(text, sizeof(text), "{%s%s\"frames\":[" FRAME("a.png", 1) "]}", sides[k / 2],
                 k % 2 ? "\"camera_angle_x\":1.2,\"camera_angle_y\":0.7," : "\"fl_x\":60,");
        put_text(f, "transforms.json", text);
        struct sg_scene *s = load(f, sg_scene_params());
        close_to(s->train[0].camera.fx, k % 2 ? 10 / tan(0.6) : 30);
        close_to(s->train[0].camera.fy, k % 2 ? 5 / tan(0.35) : 30);
        close_to(s->train[0].camera.cy, 5);
        sg_scene_destroy(&s);
    }
}

static void nerfstudio_own_split(void **state)
{
    struct fixture *f = *state;
    put_text(
        f, "transforms.json",
        "{\"camera_angle_x\":1,\"train_filenames\":[\"images/b.png\",\"images/a.png\"],"
        "\"test_filenames\":[\"./images/c.png\"],\"frames\":[" FRAME("images/a.png", 4) "," FRAME(
            "images/b.png", 3) "," FRAME("images/c.png", 9) "," FRAME("images/d.png", 9) "]}");
    for (char c = 'a'; c <= 'd'; c++)
        put_png(f, (char[]){'i', 'm', 'a', 'g', 'e', 's', '/', c, '.', 'p', 'n', 'g', 0}, 20, 10, 3,
                c);
    struct sg_scene *s = load(f, sg_scene_params(.eval = true));
    assert_int_equal(s->n_train, 2);
    assert_int_equal(s->n_test, 1);
    assert_string_equal(s->test[0].name, "c");
    close_to(s->train[0].camera.fy, 20 / (2 * tan(0.5)));
    sg_scene_destroy(&s);
    s = load(f, NULL);
    assert_int_equal(s->n_train, 4);
    sg_scene_destroy(&s);
    /* A name that is no frame's, here by its ending: c would be learned. */
    put_text(f, "transforms.json",
             "{\"camera_angle_x\":1,\"test_filenames\":[\"images/b.png\",\"images/c.jpg\"],"
             "\"frames\":[" FRAME("images/a.png", 4) "," FRAME("images/b.png", 3) "," FRAME(
                 "images/c.png", 9) "]}");
    expect_failure(f, sg_scene_params(.eval = true), SG_ERR_INPUT, "transforms.json",
                   "\"test_filenames\": found \"images/c.jpg\", expected the \"file_path\"", NULL);
}

/* The sets of names of a split count in the memory, and are gone after loading. */
static void nerfstudio_split_memory(void **state)
{
    struct fixture *f = *state;
    enum { NAMES = 20000 };
    uint64_t peak[2];
    put_png(f, "images/a.png", 20, 10, 3, 1);
    put_png(f, "images/b.png", 20, 10, 3, 2);
    for (int used = 0; used < 2; used++) {
        char *text = malloc(NAMES * 12 + 1000), *to = text;
        to += sprintf(to, "{\"camera_angle_x\":1,\"%s_filenames\":[\"images/a.png\"",
                      used ? "train" : "other");
        for (int i = 0; i < NAMES; i++)
            to += sprintf(to, ",\"%d\"", i);
        sprintf(to, "],\"frames\":[" FRAME("images/a.png", 4) "," FRAME("images/b.png", 3) "]}");
        put_text(f, "transforms.json", text);
        free(text);
        sg_ctx *ctx;
        struct sg_scene *s;
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 1u << 30}),
            SG_OK);
        assert_int_equal(
            sg_scene_load(ctx, f->dir, sg_scene_params(.eval = true, .test_every = 2), &s), SG_OK);
        peak[used] = sg_mem_peak(ctx, SG_MEM_MISC);
        sg_scene_destroy(&s);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    assert_true(peak[1] >= peak[0] + 100 * NAMES);
}

/* Each test photo is there twice: its left half to train on, its right half to measure. */
static void test_halves(void **state)
{
    struct fixture *f = *state;
    put_colmap(f, true);
    const struct sg_scene_params *params =
        sg_scene_params(.eval = true, .test_every = 4, .test_halves = true, .downscale = 20.0 / 7);
    struct sg_scene *s = load(f, params);
    assert_int_equal(s->n_train, 9);
    assert_int_equal(s->n_test, 3);
    for (size_t i = 0; i < 9; i++) {
        assert_int_equal(s->train[i].name[3], '0' + (char) i); /* in order of names */
        assert_true(!s->train[i].mask == (i % 4 != 0));
        assert_int_equal(sg_scene_photo(s, &s->train[i]), i);
    }
    for (size_t i = 0; i < 3; i++) {
        const struct sg_view *right = &s->test[i], *left = &s->train[4 * i];
        assert_string_equal(left->name, right->name);
        assert_int_equal(sg_scene_photo(s, right), 4 * i);
        assert_int_equal(right->camera.width, 7);
        for (int k = 0; k < 7 * right->camera.height; k++) {
            assert_int_equal(left->mask[k], k % 7 < 3 ? 255 : 0);
            assert_int_equal(right->mask[k], k % 7 < 3 ? 0 : 255);
        }
        assert_memory_equal(left->rgb, right->rgb, (size_t) (7 * 3 * right->camera.height));
    }
    sg_scene_destroy(&s);

    expect_failure(f, sg_scene_params(.test_halves = true), SG_ERR_USAGE, "test_halves", "eval",
                   NULL);

    uint8_t grey[20 * 10];
    for (int i = 0; i < 20 * 10; i++)
        grey[i] = i % 20 < 15 && i % 20 > 4 ? 255 : 0;
    put(f, "masks/x", "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "masks/im 4.x.png"), grey, 20, 10, 1), SG_OK);
    s = load(f, sg_scene_params(.eval = true, .test_every = 4, .test_halves = true));
    for (int k = 0; k < 20 * 10; k++) { /* the photo's own mask counts too */
        assert_int_equal(s->train[4].mask[k], k % 20 > 4 && k % 20 < 10 ? 255 : 0);
        assert_int_equal(s->test[1].mask[k], k % 20 >= 10 && k % 20 < 15 ? 255 : 0);
    }
    sg_scene_destroy(&s);

    /* What is measured does not reach what is trained, not by a filter of the photos either. */
    struct sg_scene *other[2];
    for (int i = 0; i < 2; i++) {
        uint8_t photo[20 * 10 * 3];
        for (int k = 0; k < 20 * 10 * 3; k++)
            photo[k] = i && k / 3 % 20 >= 10 ? 255 : (uint8_t) (k * 7);
        assert_int_equal(sg_image_write_png(f->ctx, at(f, "images/im 0.x.png"), photo, 20, 10, 3),
                         SG_OK);
        other[i] = load(f, sg_scene_params(.eval = true, .test_every = 4, .test_halves = true,
                                           .smooth = SG_SMOOTH_GAUSSIAN));
    }
    for (int k = 0; k < 20 * 10; k++)
        if (k % 20 < 10)
            assert_memory_equal(other[0]->train[0].rgb + 3 * k, other[1]->train[0].rgb + 3 * k, 3);
    assert_true(memcmp(other[0]->test[0].rgb, other[1]->test[0].rgb, 600) != 0);
    for (int i = 0; i < 2; i++)
        sg_scene_destroy(&other[i]);

    expect_failure(
        f, sg_scene_params(.eval = true, .test_every = 4, .test_halves = true, .max_images = 11),
        SG_ERR_INPUT, "9 images and 3 left halves", NULL);
}

/* Photos of NeRF-Synthetic's layout have the same name in both splits. */
static void test_halves_need_names(void **state)
{
    struct fixture *f = *state;
    put_blender(f);
    expect_failure(f, sg_scene_params(.eval = true, .test_halves = true), SG_ERR_INPUT,
                   "test halves", "same names", NULL);
    struct sg_scene *s = load(f, sg_scene_params(.eval = true));
    assert_true(sg_scene_photo(s, &s->test[0]) == SIZE_MAX); /* although there is a name "b" */
    sg_scene_destroy(&s);
}

static void masks(void **state)
{
    struct fixture *f = *state;
    put_colmap(f, true);
    uint8_t grey[40 * 20];
    for (int i = 0; i < 40 * 20; i++)
        grey[i] = i % 40 < 20 ? 127 : 128;
    put(f, "masks/x", "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "masks/im 1.x.png"), grey, 40, 20, 1), SG_OK);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, "masks/im 2.x.png.png"), grey, 40, 20, 1),
                     SG_OK);
    struct sg_scene *s = load(f, NULL);
    assert_int_equal(f->warnings, 1); /* seven views without */
    assert_null(s->train[0].mask);
    for (int k = 1; k <= 2; k++) {
        assert_non_null(s->train[k].mask);
        for (int i = 0; i < 200; i++)
            assert_int_equal(s->train[k].mask[i], i % 20 < 10 ? 0 : 255);
    }
    sg_scene_destroy(&s);
    expect_failure(f, sg_scene_params(.masks = "nowhere"), SG_ERR_INPUT, "nowhere", "folder", NULL);
}

static void threads_do_not_matter(void **state)
{
    struct fixture *f = *state;
    sg_ctx *seven;
    struct sg_scene *a, *b;
    put_colmap(f, false);
    assert_int_equal(sg_ctx_create(&seven, &(struct sg_ctx_params){.threads = 7}), SG_OK);
    a = load(f, sg_scene_params(.downscale = 1.5));
    assert_int_equal(sg_scene_load(seven, f->dir, sg_scene_params(.downscale = 1.5), &b), SG_OK);
    for (size_t i = 0; i < a->n_train; i++) {
        size_t n = (size_t) (a->train[i].camera.width * a->train[i].camera.height) * 3;
        assert_string_equal(a->train[i].name, b->train[i].name);
        assert_memory_equal(a->train[i].rgb, b->train[i].rgb, n);
        assert_memory_equal(&a->train[i].camera, &b->train[i].camera, sizeof(struct sg_camera));
    }
    sg_scene_destroy(&a);
    sg_scene_destroy(&b);
    sg_ctx_destroy(&seven);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(blender),
        scene_test(colmap_binary),
        scene_test(colmap_text),
        scene_test(colmap_other_size_and_folder),
        scene_test(colmap_other_model),
        scene_test(nerfstudio_masks),
        scene_test(colmap_text_without_points),
        scene_test(colmap_text_blanks),
        scene_test(colmap_one_photo_for_two),
        scene_test(colmap_models),
        scene_test(colmap_rig),
        scene_test(resolution_rule),
        scene_test(nerfstudio),
        scene_test(nerfstudio_one_side),
        scene_test(nerfstudio_own_split),
        scene_test(nerfstudio_split_memory),
        scene_test(masks),
        scene_test(photos_alone),
        scene_test(test_halves),
        scene_test(test_halves_need_names),
        scene_test(threads_do_not_matter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
