/* SPDX-License-Identifier: Apache-2.0 */
/* cameras.json: what is written is read back, and what is wrong is named. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "scene_files.h"
#include "splatguard/model.h"

#define POSE "\"position\":[1,2,3],\"rotation\":[[1,0,0],[0,1,0],[0,0,1]]"
#define SIZE "\"width\":40,\"height\":20"
#define TEN "abcdefghij"
#define LONG TEN TEN TEN TEN TEN TEN TEN TEN TEN TEN
#define CAMERA(name) "{\"img_name\":\"" name "\"," SIZE ",\"fx\":30,\"fy\":31," POSE "}"

static void written_and_read(void **state)
{
    struct fixture *f = *state;
    struct sg_view views[3] = {{.name = (char *) "b", .file_width = 100, .file_height = 60},
                               {.name = (char *) "a", .file_width = 100, .file_height = 60},
                               {.name = (char *) "c", .file_width = 100, .file_height = 60}},
                   *back;
    for (int i = 0; i < 3; i++)
        views[i].camera = (struct sg_camera){.width = 50,
                                             .height = 30,
                                             .fx = 40 + i,
                                             .fy = 41,
                                             .cx = i ? 25 : 27,
                                             .cy = 15,
                                             .R = {0.6, 0.8, 0, -0.8, 0.6, 0, 0, 0, 1},
                                             .t = {i, 2, -3}};
    const struct sg_scene scene = {.test = views, .n_test = 1, .train = views + 1, .n_train = 2};
    size_t n;
    assert_int_equal(sg_cameras_write_json(f->ctx, &scene, at(f, "cameras.json")), SG_OK);
    assert_int_equal(sg_cameras_read_json(f->ctx, at(f, "cameras.json"),
                                          sg_scene_params(.resolution = 2), &back, &n),
                     SG_OK);
    assert_int_equal(n, 3);
    for (int i = 0; i < 3; i++) {
        const struct sg_view *whole = &views[i == 0 ? 1 : i == 1 ? 0 : 2]; /* by name */
        const struct sg_camera *c = &back[i].camera, *d = &whole->camera;
        assert_string_equal(back[i].name, whole->name);
        assert_null(back[i].rgb);
        assert_true(c->width == 50 && c->height == 30 && back[i].file_width == 100);
        const double pairs[][2] = {{c->fx, d->fx}, {c->fy, d->fy}, {c->cx, d->cx}, {c->cy, d->cy}};
        for (int k = 0; k < 4; k++)
            assert_float_equal(pairs[k][0], pairs[k][1], 1e-9);
        for (int k = 0; k < 12; k++)
            assert_float_equal(k < 9 ? c->R[k] : c->t[k - 9], k < 9 ? d->R[k] : d->t[k - 9], 1e-9);
    }
    sg_cameras_destroy(&back, &n);
    assert_true(!back && !n);
    assert_int_equal(sg_cameras_read_json(f->ctx, at(f, "cameras.json"),
                                          sg_scene_params(.resolution = 1, .downscale = 4,
                                                          .centred_principal = true),
                                          &back, &n),
                     SG_OK);
    assert_true(back[1].camera.width == 25 && back[1].camera.cx == 12.5);
    sg_cameras_destroy(&back, &n);
}

/* As those of NeRF-Synthetic: test photos come first, and have the names of training photos. */
static void same_names(void **state)
{
    struct fixture *f = *state;
    static const char *const names[] = {"b", "c_0", "c_2", "c_3"};
    struct sg_view *views;
    size_t n;
    put_text(f, "cameras.json",
             "[" CAMERA("c") "," CAMERA("b") "," CAMERA("c") "," CAMERA("c") "]");
    assert_int_equal(sg_cameras_read_json(f->ctx, at(f, "cameras.json"), NULL, &views, &n), SG_OK);
    assert_int_equal(n, 4);
    for (size_t i = 0; i < n; i++)
        assert_string_equal(views[i].name, names[i]);
    sg_cameras_destroy(&views, &n);
}

static void refused(void **state)
{
    struct fixture *f = *state;
    const struct {
        const char *text, *says;
    } files[] = {
        {"", "expected a list of cameras"},
        {"{}", "found 0 cameras"},
        {"[]", "found 0 cameras"},
        {"[1]", "camera 0: camera: found the number 1, expected an object"},
        {"[" CAMERA("a") "," CAMERA("a_2") "," CAMERA("a") "]", "found two cameras of \"a_2\""},
        {"[" CAMERA("a") "," CAMERA("../b") "]", "camera 1: img_name: found the string \"../b\""},
        {"[" CAMERA("") "]", "img_name: found the string \"\", expected a name of a file"},
        {"[" CAMERA(".a") "]", "img_name: found the string \".a\", expected a name of a file"},
        {"[" CAMERA("..") "]", "img_name: found the string \"..\", expected a name of a file"},
        {"[" CAMERA(LONG LONG "a") "]", "img_name: found a name of 201 bytes"},
        {"[{" SIZE ",\"fx\":30,\"fy\":31," POSE "}]", "img_name: found nothing"},
        {"[{\"img_name\":\"a\",\"width\":0,\"height\":20,\"fx\":30,\"fy\":31," POSE "}]",
         "width: found the number 0"},
        {"[{\"img_name\":\"a\",\"width\":1e9,\"height\":20,\"fx\":30,\"fy\":31," POSE "}]",
         "width: found the number 1e+09, expected 1 to 65535 pixels"},
        {"[{\"img_name\":\"a\",\"width\":60000,\"height\":60000,\"fx\":30,\"fy\":31," POSE "}]",
         "expected sides up to 16384"},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":0,\"fy\":31," POSE "}]",
         "fx: found the number 0, expected a number of pixels above 0"},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":1e300,\"fy\":31," POSE "}]",
         "camera 0: found focal lengths 1e+300, 31 pixels"},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":30,\"fy\":\"31\"," POSE "}]",
         "fy: found the string \"31\""},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":30,\"fy\":31,\"cx\":true," POSE "}]",
         "cx: found true"},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":30,\"fy\":31,\"cx\":20," POSE "}]",
         "cy: found nothing"},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":30,\"fy\":31,\"position\":[1,2],"
         "\"rotation\":[[1,0,0],[0,1,0],[0,0,1]]}]",
         "position"},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":30,\"fy\":31,\"position\":[1,2,3],"
         "\"rotation\":[[1,0,0],[0,1,0]]}]",
         "rotation"},
        {"[{\"img_name\":\"a\"," SIZE ",\"fx\":30,\"fy\":31,\"position\":[1,2,3],"
         "\"rotation\":[[1,0,0],[0,1,0],[0,0,0]]}]",
         "expected a rotation"},
    };
    struct sg_view *views;
    size_t n;
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
        put_text(f, "cameras.json", files[i].text);
        const int code = sg_cameras_read_json(f->ctx, at(f, "cameras.json"),
                                              sg_scene_params(.resolution = 1), &views, &n);
        if (code != SG_ERR_INPUT || !strstr(sg_last_error(f->ctx), files[i].says))
            fail_msg("%s: code %d, \"%s\", expected \"%s\"", files[i].text, code,
                     sg_last_error(f->ctx), files[i].says);
        assert_true(!views && !n);
    }
    put_text(f, "cameras.json", "[" CAMERA("a") "," CAMERA("b") "]");
    assert_int_equal(sg_cameras_read_json(f->ctx, at(f, "cameras.json"),
                                          sg_scene_params(.max_images = 1), &views, &n),
                     SG_ERR_INPUT);
    static const double downscales[] = {0, -2, 65, NAN};
    for (size_t i = 0; i < sizeof(downscales) / sizeof(downscales[0]); i++) {
        assert_int_equal(sg_cameras_read_json(f->ctx, at(f, "cameras.json"),
                                              sg_scene_params(.downscale = downscales[i]), &views,
                                              &n),
                         SG_ERR_USAGE);
        assert_true(!views && !n);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {scene_test(written_and_read), scene_test(same_names),
                                       scene_test(refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
