/* SPDX-License-Identifier: Apache-2.0 */
/* Names of files in JSON, which need not be UTF-8. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "core/json_text.h"

#include <stdlib.h>
#include <string.h>

static void every_byte_returns(void **state)
{
    (void) state;
    char all[256];
    for (int i = 0; i < 255; i++)
        all[i] = (char) (i + 1);
    all[255] = 0;
    static const char *const names[] = {"plain", "caf\xc3\xa9", "caf\xe9",       "\xff",
                                        "100%",  "%41\xfe",     "a b\n\xc0\x80", ""};
    const size_t n = sizeof(names) / sizeof(*names);
    for (size_t i = 0; i <= n; i++) {
        const char *name = i < n ? names[i] : all;
        json_t *root = json_object();
        json_object_set_new(root, "place", sg_bytes_to_json(name));
        char *text = json_dumps(root, 0); /* it is JSON */
        assert_non_null(text);
        json_t *back = json_loads(text, 0, NULL);
        sg_bytes_from_json(back);
        assert_string_equal(json_string_value(json_object_get(back, "place")), name);
        free(text);
        json_decref(root);
        json_decref(back);
    }
}

static void others_stay(void **state)
{
    (void) state;
    json_t *root = json_loads(
        "{\"a\":{\"percent\":\"%00\"},\"b\":{\"percent\":\"%4\"},\"c\":{\"percent\":\"x%\"},"
        "\"d\":{\"percent\":3},\"e\":{\"percent\":\"%41\",\"f\":1},\"g\":\"%41\",\"h\":null,"
        "\"i\":{\"percent\":\"% 4\"}}",
        0, NULL);
    json_t *before = json_deep_copy(root);
    sg_bytes_from_json(root);
    assert_true(json_equal(root, before));
    sg_bytes_from_json(NULL);
    json_decref(root);
    json_decref(before);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_byte_returns),
                                       cmocka_unit_test(others_stay)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
