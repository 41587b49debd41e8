/* SPDX-License-Identifier: Apache-2.0 */
/* The audit's page. Apart from the audit's other tests, since it takes texts from the JSON library,
 * which the memory sanitizer does not follow. */
#include "photos.h"

#include <unistd.h>

#include "comma.h"
#include "whole_file.h"

/* Coordinates of its pictures have a decimal point in every program. */
static void test_any_locale(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_page_XXXXXX";
    sg_ctx *ctx = make_context(1);
    struct sg_audit *a;
    size_t size, found_size;
    paint(4, false, 1);
    struct sg_view view = {
        .name = (char *) "photo", .camera = {.width = W, .height = H}, .rgb = image};
    const struct sg_scene scene = {.path = (char *) "scene", .train = &view, .n_train = 1};
    assert_int_equal(sg_audit_scene(ctx, &scene, &a), SG_OK);
    close(mkstemp(path));
    unlink(path);
    assert_int_equal(sg_audit_write_page(ctx, &scene, a, path), SG_OK);
    char *expected = slurp(path, &size);
    const bool set = set_comma();
    if (set) {
        const int code = sg_audit_write_page(ctx, &scene, a, path);
        setlocale(LC_NUMERIC, "C");
        assert_int_equal(code, SG_OK);
        char *found = slurp(path, &found_size);
        assert_int_equal(found_size, size);
        assert_memory_equal(found, expected, size);
        free(found);
    }
    unlink(path);
    free(expected);
    sg_audit_destroy(&a);
    sg_ctx_destroy(&ctx);
    if (!set)
        skip();
}

/* Of a photo whose mask leaves nothing there is no number. */
static void test_unseen(void **state)
{
    (void) state;
    static uint8_t nothing[W * H];
    char path[] = "/tmp/sg_page_XXXXXX";
    sg_ctx *ctx = make_context(1);
    struct sg_view views[2];
    struct sg_audit *a;
    size_t size;
    paint(4, false, 1);
    for (int i = 0; i < 2; i++)
        views[i] = (struct sg_view){.name = (char *) (i ? "masked" : "photo"),
                                    .camera = {.width = W, .height = H},
                                    .rgb = image,
                                    .mask = i ? nothing : NULL};
    const struct sg_scene scene = {.path = (char *) "scene", .train = views, .n_train = 2};
    assert_int_equal(sg_audit_scene(ctx, &scene, &a), SG_OK);
    close(mkstemp(path));
    unlink(path);
    assert_int_equal(sg_audit_write_page(ctx, &scene, a, path), SG_OK);
    char *page = slurp(path, &size);
    assert_non_null(memmem(page, size, "<td>photo<td class=clean>clean<td>0.", 36));
    assert_non_null(
        memmem(page, size, "<td>masked<td class=unseen>unseen<td colspan=12>\n</table>", 57));
    unlink(path);
    free(page);
    sg_audit_destroy(&a);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_any_locale),
                                       cmocka_unit_test(test_unseen)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
