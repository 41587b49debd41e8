/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes in zip archives: the same views as from a folder, and archives that are hostile. */
#include "core/folder.h"
#include "core/context.h"
#include "core/rng.h"
#include "core/zip.h"
#include "scene/photo.h"
#include "zip_files.h"

#define ROOM (1 << 20)

/* A scene of instant-ngp's layout: photos, a mask and points. */
static const char *const files[] = {"transforms.json", "images/a.png", "images/b.png",
                                    "masks/a.png", "points.ply"};
enum { FILES = sizeof(files) / sizeof(*files), SIDE = 40 };

static void put_scene(struct fixture *f)
{
    put_text(f, "scene/transforms.json",
             "{\"fl_x\":30,\"w\":40,\"h\":40,\"ply_file_path\":\"./points.ply\",\"frames\":["
             "{\"file_path\":\"images/a.png\",\"transform_matrix\":"
             "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},"
             "{\"file_path\":\"./images//b\",\"transform_matrix\":"
             "[[0,0,1,4],[0,1,0,0],[-1,0,0,0],[0,0,0,1]]}]}");
    put_png(f, "scene/images/a.png", SIDE, SIDE, 3, 1);
    put_png(f, "scene/images/b.png", SIDE, SIDE, 3, 2);
    put_png(f, "scene/masks/a.png", SIDE, SIDE, 1, 3);
    put_text(f, "scene/points.ply",
             "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
             "property float z\nend_header\n1 2 3\n-1 -2 -3\n");
}

static void archive_file(struct fixture *f, struct archive *a, const char *from, const char *name,
                         bool deflated)
{
    char path[128], *data;
    size_t size;
    snprintf(path, sizeof(path), "scene/%s", from);
    assert_int_equal(sg_file_read(f->ctx, at(f, path), ROOM, &data, &size), SG_OK);
    archive_add(a, name, data, size, deflated);
    sg_free(data);
}

/* The scene below a folder of the archive, or with "" at its top. */
static struct archive archive_scene(struct fixture *f, const char *top, bool deflated)
{
    struct archive a = {.bytes = malloc(ROOM)};
    char name[128];
    if (*top)
        archive_add(&a, top, "", 0, false);
    for (int i = 0; i < FILES; i++) {
        snprintf(name, sizeof(name), "%s%s", top, files[i]);
        archive_file(f, &a, files[i], name, deflated);
    }
    return a;
}

static void put_archive(struct fixture *f, struct archive *a)
{
    archive_finish(a, "");
    put(f, "s.zip", a->bytes, a->size);
    free(a->bytes);
}

static void compare(const struct sg_scene *a, const struct sg_scene *b)
{
    assert_int_equal(a->n_train, 2);
    assert_int_equal(b->n_train, 2);
    assert_int_equal(a->n_points, 2);
    assert_int_equal(b->n_points, 2);
    assert_memory_equal(a->points, b->points, 6 * sizeof(*a->points));
    for (size_t i = 0; i < 2; i++) {
        const struct sg_view *x = &a->train[i], *y = &b->train[i];
        assert_string_equal(x->name, y->name);
        assert_memory_equal(&x->camera, &y->camera, sizeof(x->camera));
        assert_true(x->hash == y->hash && !x->mask == !y->mask);
        assert_memory_equal(x->rgb, y->rgb, 3 * SIDE * SIDE);
    }
}

static void test_same_scene(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *folder, *scene;
    put_scene(f);
    assert_int_equal(sg_scene_load(f->ctx, at(f, "scene"), NULL, &folder), SG_OK);
    assert_non_null(folder->train[0].mask);
    for (int k = 0; k < 6; k++) {
        static const char *const tops[] = {"", "lego/", "a b/"};
        struct archive a = archive_scene(f, tops[k % 3], k < 3);
        if (k % 3 == 1)
            archive_add(&a, "__MACOSX/lego/._transforms.json", "x", 1, false);
        put_archive(f, &a);
        if (sg_scene_load(f->ctx, at(f, "s.zip"), NULL, &scene))
            fail_msg("%s", sg_last_error(f->ctx));
        compare(folder, scene);
        sg_scene_destroy(&scene);
    }
    sg_scene_destroy(&folder);
}

/* Under a limit on memory photos are dropped and unpacked again, for the same pixels. */
static void test_limits(void **state)
{
    struct fixture *f = *state;
    enum { PHOTOS = 12, W = 160, H = 120 };
    struct archive a = {.bytes = malloc(PHOTOS * 4 * W * H)};
    char text[4096], name[64];
    struct sg_scene *whole, *scene;
    bool dropped = false, all = false;
    int n = snprintf(text, sizeof(text), "{\"fl_x\":90,\"frames\":[");
    for (int k = 0; k < PHOTOS; k++) {
        snprintf(name, sizeof(name), "scene/%02d.png", k);
        put_png(f, name, W, H, 3, k);
        archive_file(f, &a, name + 6, name, k % 2);
        n += snprintf(text + n, sizeof(text) - (size_t) n,
                      "%s{\"file_path\":\"%02d.png\",\"transform_matrix\":"
                      "[[1,0,0,%d],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}",
                      k ? "," : "", k, k);
    }
    strcpy(text + n, "]}");
    archive_add(&a, "scene/transforms.json", text, strlen(text), true);
    put_archive(f, &a);
    assert_int_equal(sg_scene_load(f->ctx, at(f, "s.zip"), NULL, &whole), SG_OK);
    for (uint64_t limit = 4 << 20;; limit -= limit / 16) {
        sg_ctx *ctx;
        const struct sg_ctx_params params = {.threads = 2, .max_memory = limit};
        assert_int_equal(sg_ctx_create(&ctx, &params), SG_OK);
        int code = sg_scene_load(ctx, at(f, "s.zip"), NULL, &scene);
        for (int k = 0; k < 2 * PHOTOS && !code; k++) {
            const struct sg_view *view = &scene->train[k * 5 % PHOTOS];
            const uint8_t *rgb;
            if (!(code = sg_view_pixels(ctx, view, &rgb))) {
                assert_memory_equal(rgb, whole->train[k * 5 % PHOTOS].rgb, 3 * W * H);
                sg_view_release(view);
            }
        }
        if (!code && scene->lazy)
            *(sg_lazy_photos_bytes(scene->lazy).dropped ? &dropped : &all) = true;
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
        if (code) {
            assert_int_equal(code, SG_ERR_BUDGET);
            break;
        }
    }
    assert_true(dropped && all);
    sg_scene_destroy(&whole);
}

/* Each allocation of a load fails once: an error that says so, and nothing is leaked. */
static void test_no_memory(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *scene;
    sg_ctx *ctx;
    put_scene(f);
    struct archive a = archive_scene(f, "lego/", true);
    put_archive(f, &a);
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1}), SG_OK);
    int failures = 0;
    for (uint64_t nth = 1;; nth++) {
        sg_fail_allocation(ctx, nth);
        const int code = sg_scene_load(ctx, at(f, "s.zip"), NULL, &scene);
        const bool failed = sg_fail_allocation(ctx, 0);
        failures += code != SG_OK; /* a photo that found no memory is read once more */
        assert_true(!code == (scene != NULL) && (failed || !code));
        if (code && code != SG_ERR_BUDGET)
            fail_msg("allocation %d: %s", (int) nth, sg_last_error(ctx));
        sg_scene_destroy(&scene);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        if (!failed)
            break;
    }
    assert_in_range(failures, 40, 1000);
    sg_ctx_destroy(&ctx);
}

static void refused(struct fixture *f, struct archive *a, const char *why)
{
    struct sg_scene *scene;
    if (a)
        put_archive(f, a);
    const uint64_t held = sg_mem_current(f->ctx, SG_MEM_TAGS);
    assert_int_equal(sg_scene_load(f->ctx, at(f, "s.zip"), sg_scene_params(.strict = true), &scene),
                     SG_ERR_INPUT);
    assert_null(scene);
    if (!strstr(sg_last_error(f->ctx), "s.zip") || !strstr(sg_last_error(f->ctx), why))
        fail_msg("found \"%s\", expected \"%s\"", sg_last_error(f->ctx), why);
    assert_int_equal(sg_mem_current(f->ctx, SG_MEM_TAGS), held);
}

static void test_names(void **state)
{
    struct fixture *f = *state;
    static const char *const names[] = {"/etc/passwd", "../outside", "images/../../x", "..",
                                        "images\\a.png"};
    put_scene(f);
    for (size_t k = 0; k < sizeof(names) / sizeof(*names); k++) {
        struct archive a = archive_scene(f, "", true);
        archive_add(&a, names[k], "x", 1, false);
        refused(f, &a, "expected names inside the archive");
    }
    struct archive a = archive_scene(f, "", true);
    archive_add(&a, "images/a.png", "x", 1, false);
    refused(f, &a, "found images/a.png twice");
    a = archive_scene(f, "", true);
    archive_add(&a, "zero", "x", 1, false);
    a.directory[a.directory_size - 2] = 0;
    refused(f, &a, "a name with a zero byte");
    a = (struct archive){.bytes = malloc(ROOM)};
    archive_add(&a, "readme", "x", 1, false);
    refused(f, &a, "found no scene");
    put_text(f, "s.zip", "text");
    refused(f, NULL, "found no folder or zip archive");
    put_text(f, "s.zip", "PK\3\4 and no more");
    refused(f, NULL, "no directory at its end");
}

/* The file of the scene that the n-th entry is, with a byte of its directory changed. */
static void changed(struct fixture *f, int entry, int at_byte, uint8_t value, const char *why)
{
    struct archive a = archive_scene(f, "", true);
    uint8_t *e = a.directory;
    for (int i = 0; i < entry; i++)
        e += 46 + e[28];
    e[at_byte] = value;
    refused(f, &a, why);
}

static void test_entries(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    changed(f, 1, 8, 1, "images/a.png: zip: found encryption");
    changed(f, 1, 10, 12, "images/a.png: zip: found method 12");
    changed(f, 1, 16, 0x55, "images/a.png: zip: found damaged data");
    changed(f, 0, 16, 0x55, "transforms.json: zip: found damaged data");
    changed(f, 4, 16, 0x55, "points.ply: zip: found damaged data");
    changed(f, 1, 24, 1, "images/a.png: zip: found damaged data");
    changed(f, 1, 20, 1, "images/a.png: zip: found damaged data");
    changed(f, 1, 22, 99, "an entry beyond the file");
    changed(f, 1, 44, 99, "an entry that is not where");
    changed(f, 1, 0, 0, "a torn directory");
    changed(f, 0, 26, 15, "transforms.json: zip: found 98"); /* more than deflate can hold */
    changed(f, 1, 27, 0xff, "an archive of");                /* 4 GB in all */
    struct archive a = archive_scene(f, "", true);
    archive_finish(&a, "");
    memset(a.bytes + a.size - 12, 0xff, 8); /* size and place of the directory */
    put(f, "s.zip", a.bytes, a.size);
    refused(f, NULL, "zip64");
    free(a.bytes);
}

/* Entries that cannot be unpacked are photos that cannot be decoded. */
static void test_skipped_entries(void **state)
{
    struct fixture *f = *state;
    static const struct {
        int at_byte;
        uint8_t value;
        const char *why;
    } bad[] = {{8, 1, "found encryption"},
               {10, 12, "found method 12"},
               {16, 0x55, "found damaged data"},
               {44, 99, "an entry that is not where"}};
    put_scene(f);
    for (size_t k = 0; k < sizeof(bad) / sizeof(*bad); k++)
        for (int entry = 1; entry <= 3; entry += 2) { /* a photo, and its mask */
            struct archive a = archive_scene(f, "", true);
            struct sg_scene *scene;
            uint8_t *e = a.directory;
            for (int i = 0; i < entry; i++)
                e += 46 + e[28];
            e[bad[k].at_byte] = bad[k].value;
            put_archive(f, &a);
            f->warnings = 0;
            if (sg_scene_load(f->ctx, at(f, "s.zip"), NULL, &scene))
                fail_msg("%s", sg_last_error(f->ctx));
            assert_int_equal(scene->n_train, 1);
            assert_string_equal(scene->train[0].name, "b");
            assert_non_null(strstr(f->said, "1 of 2 photos cannot be decoded"));
            assert_non_null(strstr(f->said, bad[k].why));
            sg_scene_destroy(&scene);
        }
}

/* Sizes that an archive claims are checked before memory is taken. */
static void test_bomb(void **state)
{
    struct fixture *f = *state;
    struct archive a = {.bytes = malloc(ROOM)};
    struct sg_zip zip;
    struct sg_source in;
    static const uint8_t zeros[5000];
    char *data;
    size_t size;
    archive_add(&a, "zeros", zeros, sizeof(zeros), true);
    archive_add(&a, "empty", zeros, 0, true);
    archive_add(&a, "stored", zeros, 0, false);
    archive_finish(&a, "a comment");
    const uint64_t held = sg_mem_current(f->ctx, SG_MEM_TAGS);
    for (unsigned n = 0; n < 4; n++) {
        static const uint32_t claims[] = {5000, 4999, 5001, 4000000000u};
        uint8_t *to = a.bytes + a.size - 31 - a.directory_size + 24;
        put_le(&to, claims[n], 4);
        put(f, "a.zip", a.bytes, a.size);
        FILE *file = fopen(at(f, "a.zip"), "rb");
        assert_int_equal(sg_zip_open(f->ctx, "a.zip", fileno(file), a.size, &zip), SG_OK);
        assert_int_equal(zip.count, 3);
        const struct sg_zip_entry *zeros_entry = sg_zip_find(&zip, "zeros");
        int code = sg_zip_source(&zip, zeros_entry, "a.zip/zeros", n ? SIZE_MAX : 5000, &in);
        if (!code)
            code = sg_source_read(f->ctx, &in, &data, &size);
        assert_int_equal(code, n ? SG_ERR_INPUT : SG_OK);
        assert_true(n < 3 || strstr(sg_last_error(f->ctx), "expected at most 1032 times as many"));
        if (!code) {
            assert_int_equal(size, 5000);
            assert_memory_equal(data, zeros, 5000);
            sg_free(data);
        }
        sg_source_close(&in);
        for (int k = 0; k < 2; k++) {
            const struct sg_zip_entry *e = sg_zip_find(&zip, k ? "stored" : "empty");
            sg_clear_error(f->ctx);
            assert_int_equal(sg_zip_source(&zip, e, "e", 0, &in), SG_OK);
            assert_int_equal(sg_source_fill(&in, 1), 0);
            sg_source_close(&in);
        }
        sg_clear_error(f->ctx);
        assert_int_equal(sg_zip_source(&zip, zeros_entry, "a.zip/zeros", 100, &in), SG_ERR_INPUT);
        sg_source_close(&in);
        assert_null(sg_zip_find(&zip, "zero"));
        sg_zip_close(&zip);
        fclose(file);
        sg_clear_error(f->ctx);
    }
    assert_true(sg_mem_peak(f->ctx, SG_MEM_TAGS) < held + (1 << 20));
    free(a.bytes);
}

/* What is passed over is unpacked and thrown away. */
static void test_skipping(void **state)
{
    struct fixture *f = *state;
    enum { N = 700000 };
    uint8_t *bytes = malloc(N);
    for (size_t i = 0; i < N; i++)
        bytes[i] = (uint8_t) (i / 16 * 2654435761u >> 24);
    for (int deflated = 0; deflated < 2; deflated++) {
        struct archive a = {.bytes = malloc(2 * N)};
        struct sg_folder folder;
        struct sg_source in;
        archive_add(&a, "x/data", bytes, N, deflated);
        put_archive(f, &a);
        assert_int_equal(sg_folder_open(f->ctx, at(f, "s.zip"), false, &folder), SG_OK);
        assert_false(sg_folder_has(&folder, at(f, "s.zip/x/data"))); /* x stands for the archive */
        assert_true(sg_folder_has(&folder, at(f, "s.zip/./data")));
        assert_false(sg_folder_has_folder(&folder, at(f, "s.zip/data")));
        assert_true(sg_folder_leads_out(&folder, at(f, "s.zip/../data")));
        assert_int_equal(sg_folder_source(f->ctx, &folder, at(f, "s.zip/data"), N, &in), SG_OK);
        for (size_t place = 0, k = 0; place + 50 < N; k++) {
            const char *found = sg_source_peek(&in, 50);
            assert_non_null(found);
            assert_memory_equal(found, bytes + place, 50);
            const size_t step = k % 3 ? 60000 * k : 40;
            sg_source_skip(&in, step);
            place += step;
        }
        sg_source_close(&in);
        sg_folder_close(&folder);
    }
    free(bytes);
}

/* A random change or end is read or refused, but harms nothing. */
static void test_damage(void **state)
{
    struct fixture *f = *state;
    put_scene(f);
    for (int deflated = 0; deflated < 2; deflated++) {
        struct archive a = archive_scene(f, "top/", deflated);
        archive_finish(&a, "");
        int bad = 0;
        for (uint64_t k = 0; k < 300; k++) {
            const uint64_t random = sg_rng_u64(4, SG_RNG_SYNTH, (uint64_t) deflated, k);
            struct sg_scene *scene;
            put_damaged(f, "s.zip", &a, random, k);
            const int code = sg_scene_load(f->ctx, at(f, "s.zip"), NULL, &scene);
            assert_true(code == SG_OK || code == SG_ERR_INPUT);
            assert_true((code == SG_OK) == (scene != NULL));
            bad += code != SG_OK;
            sg_scene_destroy(&scene);
        }
        assert_in_range(bad, 100, 299);
        free(a.bytes);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_same_scene), scene_test(test_limits),  scene_test(test_no_memory),
        scene_test(test_names),      scene_test(test_entries), scene_test(test_bomb),
        scene_test(test_skipping),   scene_test(test_damage),  scene_test(test_skipped_entries),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
