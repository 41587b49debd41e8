/* SPDX-License-Identifier: Apache-2.0 */
/* Small scenes on disk for the scene tests. */
#ifndef SG_TEST_SCENE_FILES_H
#define SG_TEST_SCENE_FILES_H

#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <setjmp.h>
#include <cmocka.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/file.h"
#include "image/image.h"
#include "splatguard/scene.h"
#include "params.h"

struct fixture {
    sg_ctx *ctx;
    char dir[64];
    int warnings;
    char said[4096]; /* all of them */
    char path[512];  /* last result of at() */
};

static inline void count_warnings(void *priv, enum sg_log_level level, const char *message)
{
    struct fixture *f = priv;
    if (level != SG_LOG_WARN)
        return;
    const size_t n = f->warnings++ ? strlen(f->said) : 0;
    snprintf(f->said + n, sizeof(f->said) - n, "%s\n", message);
}

static inline int set_up(void **state)
{
    struct fixture *f = calloc(1, sizeof(*f));
    strcpy(f->dir, "/tmp/sg-scene-XXXXXX");
    *state = f;
    struct sg_ctx_params params = {.threads = 2, .log = count_warnings, .log_priv = f};
    return !mkdtemp(f->dir) || sg_ctx_create(&f->ctx, &params);
}

static inline int remove_one(const char *path, const struct stat *st, int kind, struct FTW *ftw)
{
    (void) st, (void) kind, (void) ftw;
    return remove(path);
}

static inline int tear_down(void **state)
{
    struct fixture *f = *state;
    int leaked =
        sg_mem_current(f->ctx, SG_MEM_TAGS) != 0; /* every test must give back what it took */
    nftw(f->dir, remove_one, 8, FTW_DEPTH | FTW_PHYS);
    sg_ctx_destroy(&f->ctx);
    free(f);
    return leaked;
}

#define scene_test(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

static inline const char *at(struct fixture *f, const char *name)
{
    snprintf(f->path, sizeof(f->path), "%s/%s", f->dir, name);
    return f->path;
}

/* Writes dir/name, making its folder. */
static inline void put(struct fixture *f, const char *name, const void *data, size_t size)
{
    char *folder = strdup(at(f, name));
    *strrchr(folder, '/') = 0;
    assert_int_equal(sg_dir_create(f->ctx, folder), SG_OK);
    free(folder);
    assert_int_equal(sg_file_write(f->ctx, at(f, name), data, size), SG_OK);
}

static inline void put_text(struct fixture *f, const char *name, const char *text)
{
    put(f, name, text, strlen(text));
}

/* A PNG whose samples are a function of place, so that mixed-up views show. */
static inline void put_png(struct fixture *f, const char *name, int width, int height, int channels,
                           int seed)
{
    size_t n = (size_t) width * (size_t) height * (size_t) channels;
    uint8_t *p = malloc(n);
    for (size_t i = 0; i < n; i++)
        p[i] = (uint8_t) (i * 7 + (size_t) seed * 31);
    put(f, name, "", 0);
    assert_int_equal(sg_image_write_png(f->ctx, at(f, name), p, width, height, channels), SG_OK);
    free(p);
}

/* Loads dir and expects the code and every listed word in the message. End the words with NULL. */
static inline void expect_failure(struct fixture *f, const struct sg_scene_params *params, int code,
                                  ...)
{
    struct sg_scene *scene = (void *) f;
    va_list words;
    assert_int_equal(sg_scene_load(f->ctx, f->dir, params, &scene), code);
    assert_null(scene);
    va_start(words, code);
    for (const char *w; (w = va_arg(words, const char *));)
        if (!strstr(sg_last_error(f->ctx), w))
            fail_msg("\"%s\" is not in the message: %s", w, sg_last_error(f->ctx));
    va_end(words);
    assert_int_equal(sg_mem_current(f->ctx, SG_MEM_TAGS), 0);
}

static inline struct sg_scene *load(struct fixture *f, const struct sg_scene_params *params)
{
    struct sg_scene *scene;
    if (sg_scene_load(f->ctx, f->dir, params, &scene))
        fail_msg("%s", sg_last_error(f->ctx));
    return scene;
}

#endif
