/* SPDX-License-Identifier: Apache-2.0 */
/* A locale with a decimal comma, for tests of what must not follow it. */
#ifndef TESTS_COMMA_H
#define TESTS_COMMA_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <locale.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

/* Sets it for numbers. False where it cannot be made: no localedef here, or no sources for it. */
static inline bool set_comma(void)
{
    char folder[] = "/tmp/sg_locale_XXXXXX", command[128], half[8];
    assert_non_null(mkdtemp(folder));
    snprintf(command, sizeof(command), "localedef -i de_DE -f UTF-8 %s/comma 2>&1", folder);
    const int made = system(command);
    assert_int_equal(setenv("LOCPATH", folder, 1), 0);
    const bool set = !made && setlocale(LC_NUMERIC, "comma");
    unsetenv("LOCPATH");
    snprintf(command, sizeof(command), "rm -r %s", folder);
    assert_int_equal(system(command), 0);
    if (set) {
        snprintf(half, sizeof(half), "%.1f", 0.5);
        assert_string_equal(half, "0,5");
    }
    return set;
}

#endif
