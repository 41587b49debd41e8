/* SPDX-License-Identifier: Apache-2.0 */
/* The model in a copy of a COLMAP scene names the photos that the copy has. */
#include "attack/poisoned_scene.h"
#include "colmap_files.h"

#define W 24
#define H 16
#define CAMERA "1 PINHOLE 24 16 30 31 12.5 7.5\n"

static void put_photos(struct fixture *f, const char *const *names)
{
    for (int k = 0; names[k]; k++) {
        char path[100];
        snprintf(path, sizeof(path), "images/%s", names[k]);
        put_png(f, path, W, H, 3, k);
    }
}

/* A text model with these images, photos and no points. */
static void put_model(struct fixture *f, const char *images, const char *const *photos)
{
    put_text(f, "sparse/0/cameras.txt", CAMERA);
    put_text(f, "sparse/0/images.txt", images);
    put_photos(f, photos);
}

/* Writes a copy of the scene to "out" and returns what sg_poisoned_scene_finish does. */
static int try_copy(struct fixture *f, enum sg_poison_save save, const char *changed)
{
    struct sg_scene *clean = load(f, NULL);
    const struct sg_poison_files files = {save, 75, false};
    char folder[100];
    snprintf(folder, sizeof(folder), "%s/out", f->dir);
    f->warnings = 0;
    assert_int_equal(sg_poisoned_scene_begin(f->ctx, clean, &files, folder), SG_OK);
    for (size_t i = 0; i < clean->n_train; i++)
        assert_int_equal(sg_poisoned_scene_image(f->ctx, clean, &clean->train[i], &files, folder,
                                                 clean->train[i].rgb, NULL),
                         SG_OK);
    if (changed)
        put_text(f, "sparse/0/images.txt", changed);
    const int code = sg_poisoned_scene_finish(f->ctx, clean, &files, folder);
    sg_scene_destroy(&clean);
    return code;
}

static void copy(struct fixture *f, enum sg_poison_save save)
{
    if (try_copy(f, save, NULL))
        fail_msg("%s", sg_last_error(f->ctx));
}

static void same_bytes(struct fixture *f, const char *name, const void *expected, size_t size)
{
    char *data;
    size_t found;
    assert_int_equal(sg_file_read(f->ctx, at(f, name), 1 << 20, &data, &found), SG_OK);
    assert_int_equal(found, size);
    assert_memory_equal(data, expected, size);
    sg_free(data);
}

static void same_text(struct fixture *f, const char *name, const char *expected)
{
    same_bytes(f, name, expected, strlen(expected));
}

/* The copy loads with these names, in the order of views, and has a photo of each. */
static void has_photos(struct fixture *f, const char *const *names)
{
    struct sg_scene *scene;
    size_t n = 0;
    if (sg_scene_load(f->ctx, at(f, "out"), NULL, &scene))
        fail_msg("%s", sg_last_error(f->ctx));
    for (; names[n]; n++) {
        char path[200];
        assert_true(n < scene->n_train);
        assert_string_equal(scene->train[n].file, names[n]);
        snprintf(path, sizeof(path), "%s/out/images/%s", f->dir, names[n]);
        assert_string_equal(scene->train[n].path, path);
    }
    assert_int_equal(scene->n_train, n);
    sg_scene_destroy(&scene);
}

/* Of images with 2D observations, and of one that has no photo. */
static void put_binary(struct bytes *b, const char *const names[4])
{
    b->size = 0;
    add(b, 5, 8);
    for (int i = 0; i < 4; i++)
        add_image(b, 10 - i, 1, names[i], i, 3 * i % 4);
    add_image(b, 99, 1, "gone.png", 4, 2);
}

static void test_binary(void **state)
{
    struct fixture *f = *state;
    static const double pinhole[] = {30, 31, 12.5, 7.5};
    static const char *const photos[] = {"a.png", "sub/b.PNG", "c.Jpeg", "d.1", NULL};
    static const struct {
        enum sg_poison_save save;
        const char *names[5], *mask; /* of b.PNG */
    } cases[] = {
        {SG_POISON_AUTO, {"./a.jpg", "sub/b.jpg", "c.Jpeg", "d.1.jpg"}, "out/masks/sub/b.jpg.png"},
        {SG_POISON_PNG, {"./a.png", "sub/b.png", "c.png", "d.1.png"}, "out/masks/sub/b.png.png"},
    };
    struct bytes b = {.size = 0};
    put_photos(f, photos);
    add(&b, 1, 8);
    add_camera(&b, 1, 1, W, H, pinhole, 4);
    put_bytes(f, "sparse/0/cameras.bin", &b);
    put_binary(&b, (const char *const[]){"./a.png", "sub/b.PNG", "c.Jpeg", "d.1"});
    put_bytes(f, "sparse/0/images.bin", &b);
    put_png(f, "masks/sub/b.png", W, H, 1, 1);
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        copy(f, cases[k].save);
        put_binary(&b, cases[k].names);
        same_bytes(f, "out/sparse/0/images.bin", b.data, b.size);
        const char *const sorted[] = {cases[k].names[0], cases[k].names[1], cases[k].names[2],
                                      cases[k].names[3], NULL};
        has_photos(f, sorted);
        assert_true(sg_file_exists(at(f, cases[k].mask)));
        struct sg_scene *poisoned;
        assert_int_equal(sg_scene_load(f->ctx, at(f, "out"), NULL, &poisoned), SG_OK);
        assert_true(poisoned->train[1].mask && !poisoned->train[0].mask);
        sg_scene_destroy(&poisoned);
    }
}

/* Comments, blanks and ends of lines stay, and observations that are longer than what is read at a
 * time. */
static void test_text(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"a photo.jpg", "b.jpeg", "c.png", "d.JPG", NULL};
    enum { OBSERVATIONS = 60000 };
    char *observations = malloc(6 * OBSERVATIONS + 1), *texts[2] = {NULL, NULL};
    for (int i = 0; i < OBSERVATIONS; i++)
        memcpy(observations + (size_t) i * 6, "5 6 1 ", 6);
    observations[6 * OBSERVATIONS] = 0;
    for (int k = 0; k < 2; k++)
        assert_true(
            asprintf(&texts[k],
                     "\xef\xbb\xbf# a.jpg\r\n  1 1 0 0 0 1 2 3 1 \ta photo.%s \r\n%s\r\n"
                     "# between\n\n2 1 0 0 0 3 2 1 1 b.%s\n\n3 1 0 0 0 3 2 1 1 c.png\n1 1 -1\n"
                     "4 1.0 0 0 0 3 2 1 1 gone.jpg\n\n5 1 0 0 0 3 2 4 1 d.%s",
                     k ? "png" : "jpg", observations, k ? "png" : "jpeg", k ? "png" : "JPG") > 0);
    put_model(f, texts[0], photos);
    copy(f, SG_POISON_PNG);
    same_text(f, "out/sparse/0/images.txt", texts[1]);
    has_photos(f, (const char *const[]){"a photo.png", "b.png", "c.png", "d.png", NULL});
    free(texts[0]);
    free(texts[1]);
    free(observations);
}

/* The file of images that is not read would name photos that are not there. */
static void test_both_encodings(void **state)
{
    struct fixture *f = *state;
    static const double pinhole[] = {30, 31, 12.5, 7.5};
    static const char *const photos[] = {"a.png", NULL}, *const written[] = {"a.jpg", NULL};
    static const char text[] = "1 1 0 0 0 1 2 3 1 a.png\n\n";
    struct bytes b = {.size = 0};
    put_model(f, text, photos);
    put_text(f, "sparse/images.txt", text);
    add(&b, 1, 8);
    add_image(&b, 1, 1, "a.png", 0, 2);
    put_bytes(f, "sparse/0/images.bin", &b);

    copy(f, SG_POISON_JPEG); /* there is no cameras.bin */
    same_text(f, "out/sparse/0/images.txt", "1 1 0 0 0 1 2 3 1 a.jpg\n\n");
    assert_false(sg_file_exists(at(f, "out/sparse/0/images.bin")));
    assert_false(sg_file_exists(at(f, "out/sparse/images.txt")));
    assert_int_equal(f->warnings, 2);
    assert_non_null(strstr(f->said, "images.bin: not copied"));
    has_photos(f, written);

    b.size = 0;
    add(&b, 1, 8);
    add_camera(&b, 1, 1, W, H, pinhole, 4);
    put_bytes(f, "sparse/0/cameras.bin", &b);
    copy(f, SG_POISON_JPEG);
    b.size = 0;
    add(&b, 1, 8);
    add_image(&b, 1, 1, "a.jpg", 0, 2);
    same_bytes(f, "out/sparse/0/images.bin", b.data, b.size);
    assert_false(sg_file_exists(at(f, "out/sparse/0/images.txt")));
    has_photos(f, written);

    copy(f, SG_POISON_PNG); /* no name changes */
    same_text(f, "out/sparse/0/images.txt", text);
    same_text(f, "out/sparse/images.txt", text);
    assert_true(sg_file_exists(at(f, "out/sparse/0/images.bin")));
    assert_int_equal(f->warnings, 0);
    has_photos(f, photos);
}

/* Two images of one photo have one file in the copy; their names must agree about its ending. */
static void test_one_photo(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"a.png", NULL};
    static const char text[] = "1 1 0 0 0 1 2 3 1 ./a.%s\n\n2 1 0 0 0 1 2 4 1 a.%s\n\n";
    char images[100];
    snprintf(images, sizeof(images), text, "png", "webp");
    put_model(f, images, photos);
    copy(f, SG_POISON_JPEG);
    snprintf(images, sizeof(images), text, "jpg", "jpg");
    same_text(f, "out/sparse/0/images.txt", images);
    has_photos(f, (const char *const[]){"./a.jpg", "a.jpg", NULL});

    snprintf(images, sizeof(images), text, "png", "JPG");
    put_text(f, "sparse/0/images.txt", images);
    struct sg_scene *scene = load(f, NULL);
    struct sg_poison_files files = {SG_POISON_JPEG, 75, false};
    assert_int_equal(sg_poisoned_scene_check(f->ctx, scene, &files), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "differ only in their endings"));
    files.save = SG_POISON_PNG;
    assert_int_equal(sg_poisoned_scene_check(f->ctx, scene, &files), SG_OK);
    sg_scene_destroy(&scene);
}

/* A name that has no room for another ending stays. */
static void test_no_room(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"b.1", NULL};
    char line[4100], longer[4100];
    put_model(f, "", photos);
    for (int room = 3; room <= 4; room++) { /* the reader keeps 4095 bytes of a line */
        snprintf(line, sizeof(line), "1 1 0 0 0 1 2 3 1 %*s\n\n", 4095 - 18 - room, "b.1");
        snprintf(longer, sizeof(longer), "1 1 0 0 0 1 2 3 1 %*s\n\n", 4095 - 18, "b.1.png");
        put_text(f, "sparse/0/images.txt", line);
        copy(f, SG_POISON_PNG);
        same_text(f, "out/sparse/0/images.txt", room < 4 ? line : longer);
        struct sg_scene *scene;
        assert_int_equal(sg_scene_load(f->ctx, at(f, "out"), NULL, &scene), SG_OK);
        assert_int_equal(scene->n_train, 1);
        assert_non_null(strstr(scene->train[0].path, "out/images/b.1.png"));
        sg_scene_destroy(&scene);
    }
}

/* Photos of a rig, whose names are paths, have the same names in a copy, in the same order. Names
 * that would be one in the copy are one in the scene. */
static void test_rig(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"l/1.tif", "r/1.tif", "l/1-2.tif", "b.1", NULL};
    struct sg_scene *clean, *scene;
    put_model(f,
              "1 1 0 0 0 1 2 3 1 l/1.tif\n\n2 1 0 0 0 1 2 4 1 r/1.tif\n\n"
              "3 1 0 0 0 1 2 5 1 l/1-2.tif\n\n",
              photos);
    copy(f, SG_POISON_JPEG);
    clean = load(f, NULL);
    assert_int_equal(sg_scene_load(f->ctx, at(f, "out"), NULL, &scene), SG_OK);
    assert_int_equal(scene->n_train, 3);
    for (int i = 0; i < 3; i++)
        assert_string_equal(scene->train[i].name, clean->train[i].name);
    sg_scene_destroy(&scene);
    sg_scene_destroy(&clean);

    put_text(f, "sparse/0/images.txt", "1 1 0 0 0 1 2 3 1 b.1\n\n2 1 0 0 0 1 2 4 1 b.1.png\n\n");
    assert_int_equal(sg_scene_load(f->ctx, f->dir, NULL, &scene), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "found the same name \"b.1\" twice"));
}

/* The file of images may have become another one. What cannot be finished is no scene. */
static void test_changed(void **state)
{
    struct fixture *f = *state;
    static const char *const photos[] = {"a.png", NULL};
    static const char images[] = "1 1 0 0 0 1 2 3 1 a.png\n\n",
                      others[] = "1 1 0 0 0 1 2 3 1 c.png\n\n";
    struct sg_scene *scene;
    put_model(f, images, photos);
    assert_int_equal(try_copy(f, SG_POISON_JPEG, others), SG_OK);
    same_text(f, "out/sparse/0/images.txt", others);
    put_text(f, "sparse/0/images.txt", images);
    assert_int_equal(try_copy(f, SG_POISON_JPEG, "no image"), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "no image"));
    assert_false(sg_file_exists(at(f, "out/sparse/0/images.txt")));
    assert_int_equal(sg_scene_load(f->ctx, at(f, "out"), NULL, &scene), SG_ERR_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {scene_test(test_binary),         scene_test(test_text),
                                       scene_test(test_both_encodings), scene_test(test_one_photo),
                                       scene_test(test_no_room),        scene_test(test_rig),
                                       scene_test(test_changed)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
