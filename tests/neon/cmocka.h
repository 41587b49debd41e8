/* SPDX-License-Identifier: Apache-2.0 */
/* As much of cmocka as the kernel tests use, in a header: cross compilers come without the library.
 * A failure exits. */
#ifndef TESTS_NEON_CMOCKA_H
#define TESTS_NEON_CMOCKA_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define fail_msg(...)                                                                              \
    do {                                                                                           \
        fprintf(stderr, "%s:%d: ", __FILE__, __LINE__);                                            \
        fprintf(stderr, __VA_ARGS__);                                                              \
        fputc('\n', stderr);                                                                       \
        exit(1);                                                                                   \
    } while (0)
#define assert_true(c)                                                                             \
    do {                                                                                           \
        if (!(c))                                                                                  \
            fail_msg("%s is false", #c);                                                           \
    } while (0)
#define assert_false(c) assert_true(!(c))
#define assert_null(p) assert_true((p) == NULL)
#define assert_non_null(p) assert_true((p) != NULL)
#define assert_int_equal(a, b) assert_true((unsigned long long) (a) == (unsigned long long) (b))
#define assert_string_equal(a, b) assert_true(!strcmp((a), (b)))
#define assert_memory_equal(a, b, n) assert_true(!memcmp((a), (b), (n)))
#define assert_memory_not_equal(a, b, n) assert_true(memcmp((a), (b), (n)))
#define assert_float_equal(a, b, epsilon)                                                          \
    do {                                                                                           \
        const double a_ = (double) (a), b_ = (double) (b);                                         \
        if (!(a_ - b_ <= (double) (epsilon) && b_ - a_ <= (double) (epsilon)))                     \
            fail_msg("%s: found %.9g, expected %.9g", #a, a_, b_);                                 \
    } while (0)

struct CMUnitTest {
    const char *name;
    void (*test_func)(void **state);
    void *initial_state;
};
#define cmocka_unit_test(f)                                                                        \
    {                                                                                              \
        .name = #f, .test_func = f                                                                 \
    }

static inline int _cmocka_run_group_tests(const char *group, const struct CMUnitTest *tests,
                                          size_t n, int (*setup)(void **), int (*teardown)(void **))
{
    void *shared = NULL;
    if (setup && setup(&shared))
        return 1;
    for (size_t i = 0; i < n; i++) {
        void *state = tests[i].initial_state ? tests[i].initial_state : shared;
        tests[i].test_func(&state);
        printf("%s: %s\n", group, tests[i].name);
    }
    return teardown ? teardown(&shared) : 0;
}
#define cmocka_run_group_tests(tests, setup, teardown)                                             \
    _cmocka_run_group_tests("tests", (tests), sizeof(tests) / sizeof((tests)[0]), (setup),         \
                            (teardown))

#endif
