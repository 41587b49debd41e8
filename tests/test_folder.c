/* SPDX-License-Identifier: Apache-2.0 */
/* Symbolic links in a stranger's scene: followed inside its folder, refused where they lead out of
 * it. */
#include <pthread.h>
#include <stdatomic.h>
#include <sys/stat.h>

#include "colmap_files.h"
#include "core/folder.h"

#define SECRET "secret"
#define PUBLIC "public"

/* DIR/scene with a file, and a secret beside it. */
static void put_folders(struct fixture *f, const char *const *folders)
{
    for (; *folders; folders++)
        assert_int_equal(mkdir(at(f, *folders), 0777), 0);
}

static void link_to(struct fixture *f, const char *target, const char *name)
{
    unlink(at(f, name));
    assert_int_equal(symlink(target, at(f, name)), 0);
}

/* What is read of DIR/scene/NAME: its text, or NULL and the error is the folder's. */
static const char *read_of(struct fixture *f, bool follow_links, const char *name)
{
    static char text[64], path[600];
    char *data;
    size_t size;
    struct sg_folder folder;
    snprintf(path, sizeof(path), "%s", at(f, "scene"));
    assert_int_equal(sg_folder_open(f->ctx, path, follow_links, &folder), SG_OK);
    strcat(path, "/");
    strcat(path, name);
    sg_clear_error(f->ctx);
    const int code = sg_folder_read(f->ctx, &folder, path, 60, &data, &size);
    if (!code) {
        strcpy(text, data);
        sg_free(data);
    } else
        assert_int_equal(code, SG_ERR_INPUT);
    sg_folder_close(&folder);
    return code ? NULL : text;
}

static void refused(struct fixture *f, const char *name)
{
    assert_null(read_of(f, false, name));
    assert_non_null(strstr(sg_last_error(f->ctx), "leads out of"));
    assert_non_null(strstr(sg_last_error(f->ctx), name));
}

static void links(void **state)
{
    struct fixture *f = *state;
    char absolute[600];
    put_folders(f,
                (const char *const[]){"scene", "scene/a", "scene/a/b", "scene/c", "scene2", NULL});
    put_text(f, "scene/a/b/file", PUBLIC);
    put_text(f, SECRET, SECRET);
    put_text(f, "scene2/file", SECRET);
    assert_string_equal(read_of(f, false, "a/b/file"), PUBLIC);
    assert_string_equal(read_of(f, false, ".//a/./b//file"), PUBLIC);
    assert_string_equal(read_of(f, false, "c/../a/b/file"), PUBLIC);

    link_to(f, "../a/b/file", "scene/c/up"); /* inside */
    assert_string_equal(read_of(f, false, "c/up"), PUBLIC);
    link_to(f, "a/../a/b", "scene/folder");
    assert_string_equal(read_of(f, false, "folder/file"), PUBLIC);
    assert_string_equal(read_of(f, false, "folder/../b/file"),
                        PUBLIC); /* ".." of where the link leads */
    link_to(f, "../c/up", "scene/a/chain");
    assert_string_equal(read_of(f, false, "a/chain"), PUBLIC);
    snprintf(absolute, sizeof(absolute), "%s", at(f, "scene/a"));
    link_to(f, absolute, "scene/c/absolute");
    assert_string_equal(read_of(f, false, "c/absolute/b/file"), PUBLIC);

    link_to(f, "../" SECRET, "scene/out"); /* outside */
    refused(f, "out");
    assert_string_equal(read_of(f, true, "out"), SECRET);
    link_to(f, "../out", "scene/c/chain_out");
    refused(f, "c/chain_out");
    link_to(f, "a/../../scene/a/b/file", "scene/round"); /* out and in again */
    refused(f, "round");
    refused(f, "../" SECRET);
    link_to(f, "/etc/passwd", "scene/passwd");
    refused(f, "passwd");
    snprintf(absolute, sizeof(absolute), "%s", at(f, "scene2"));
    link_to(f, absolute, "scene/namesake"); /* "scene" is only the beginning of its name */
    refused(f, "namesake/file");
    link_to(f, "/proc/self/root/etc", "scene/magic");
    refused(f, "magic/passwd");

    link_to(f, "loop", "scene/loop");
    assert_null(read_of(f, false, "loop"));
    assert_non_null(strstr(sg_last_error(f->ctx), "cannot read"));
    link_to(f, "nowhere", "scene/dangling");
    assert_null(read_of(f, false, "dangling"));
    assert_null(read_of(f, false, "a"));
    assert_non_null(strstr(sg_last_error(f->ctx), "expected a file"));
    assert_null(read_of(f, false, "a/b/file/more"));

    struct sg_folder folder; /* the folder itself may be named by a link */
    link_to(f, "scene", "alias");
    assert_int_equal(sg_folder_open(f->ctx, at(f, "alias"), false, &folder), SG_OK);
    assert_true(sg_folder_has(&folder, at(f, "alias/c/absolute/b/file")));
    assert_true(sg_folder_has_folder(&folder, at(f, "alias/folder")));
    assert_false(sg_folder_has(&folder, at(f, "alias/folder")));
    assert_false(sg_folder_has(&folder, at(f, "alias/nowhere")));
    assert_false(sg_folder_leads_out(&folder, at(f, "alias/nowhere")));
    assert_true(sg_folder_leads_out(&folder, at(f, "alias/out")));
    sg_folder_close(&folder);
}

/* Another thread swaps a file and a folder for links and back, all the time. */
struct swapper {
    struct fixture f;
    atomic_bool stop;
};

static void *swap(void *arg)
{
    struct swapper *s = arg;
    while (!atomic_load(&s->stop)) {
        char name[600];
        snprintf(name, sizeof(name), "%s", at(&s->f, "scene/file"));
        rename(at(&s->f, "link"), name);
        assert_int_equal(symlink("../" SECRET, at(&s->f, "link")), 0);
        FILE *plain = fopen(at(&s->f, "plain"), "w");
        assert_true(plain && fputs(PUBLIC, plain) >= 0 && !fclose(plain));
        rename(at(&s->f, "plain"), name);
        snprintf(name, sizeof(name), "%s", at(&s->f, "scene/dir"));
        rename(name, at(&s->f, "scene/kept"));
        assert_int_equal(symlink("../secrets", name), 0);
        unlink(name);
        rename(at(&s->f, "scene/kept"), name);
    }
    return NULL;
}

static void swapped(void **state)
{
    struct fixture *f = *state;
    struct swapper s = {.f = *f};
    pthread_t thread;
    int read = 0;
    put_folders(f, (const char *const[]){"scene", "scene/dir", "secrets", NULL});
    put_text(f, SECRET, SECRET);
    put_text(f, "secrets/file", SECRET);
    put_text(f, "scene/file", PUBLIC);
    put_text(f, "scene/dir/file", PUBLIC);
    assert_int_equal(symlink("../" SECRET, at(f, "link")), 0);
    assert_int_equal(pthread_create(&thread, NULL, swap, &s), 0);
    for (int i = 0; i < 4000; i++) {
        const char *text = read_of(f, false, i % 2 ? "file" : "dir/file");
        read += text != NULL;
        if (text)
            assert_string_equal(text, PUBLIC);
    }
    atomic_store(&s.stop, true);
    pthread_join(thread, NULL);
    assert_true(read > 0);
}

/* Every kind of file that a scene names, moved out of the folder and replaced by a link. */
static void scene_files(void **state)
{
    struct fixture *f = *state;
    static const char *const colmap[] = {"sparse/0/cameras.txt",
                                         "sparse/0/images.txt",
                                         "sparse/0/points3D.txt",
                                         "images/a.png",
                                         "masks/a.png",
                                         "images",
                                         "masks",
                                         "sparse",
                                         NULL};
    put_folders(f, (const char *const[]){"masks", "images", "sparse", "sparse/0", NULL});
    put_text(f, "sparse/0/cameras.txt", "1 PINHOLE 20 10 20 20 10 5\n");
    put_text(f, "sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n\n");
    put_text(f, "sparse/0/points3D.txt", "1 0 0 1 1 2 3 0\n");
    put_png(f, "images/a.png", 20, 10, 3, 1);
    put_png(f, "masks/a.png", 20, 10, 1, 1);
    struct sg_scene *scene;
    char outside[600], name[600];
    snprintf(outside, sizeof(outside), "%s-outside", f->dir);
    for (int i = 0; colmap[i]; i++) {
        snprintf(name, sizeof(name), "%s", at(f, colmap[i]));
        assert_int_equal(rename(name, outside), 0);
        assert_int_equal(symlink(outside, name), 0);
        expect_failure(f, NULL, SG_ERR_INPUT, colmap[i], "leads out of", NULL);
        assert_int_equal(
            sg_scene_load(f->ctx, f->dir, sg_scene_params(.follow_links = true), &scene), SG_OK);
        assert_true(scene->follow_links && scene->n_points == 1 && scene->train[0].mask);
        sg_scene_destroy(&scene);
        assert_int_equal(unlink(name), 0);
        assert_int_equal(rename(outside, name), 0);
    }
    static const char *const json[] = {"transforms.json", "points.ply", "images/a.png",
                                       "masks/a.png", NULL};
    unlink(at(f, "sparse/0/cameras.txt"));
    put_text(f, "transforms.json",
             "{\"fl_x\":20,\"w\":20,\"h\":10,\"ply_file_path\":\"points.ply\",\"frames\":[{\"file_"
             "path\":"
             "\"images/a.png\",\"mask_path\":\"masks/a.png\","
             "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}");
    put_text(f, "points.ply",
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float "
             "y\nproperty float z\n"
             "end_header\n0 0 1\n");
    for (int i = 0; json[i]; i++) {
        snprintf(name, sizeof(name), "%s", at(f, json[i]));
        assert_int_equal(rename(name, outside), 0);
        assert_int_equal(symlink(outside, name), 0);
        expect_failure(f, NULL, SG_ERR_INPUT, json[i], "leads out of", NULL);
        assert_int_equal(
            sg_scene_load(f->ctx, f->dir, sg_scene_params(.follow_links = true), &scene), SG_OK);
        sg_scene_destroy(&scene);
        assert_int_equal(unlink(name), 0);
        assert_int_equal(rename(outside, name), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {scene_test(links), scene_test(swapped),
                                       scene_test(scene_files)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
