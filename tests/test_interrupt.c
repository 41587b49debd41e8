/* SPDX-License-Identifier: Apache-2.0 */
/* Signals to the tool around a fork: none is lost. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <signal.h>
#include <stdint.h>
#include <cmocka.h>
#include <sys/wait.h>
#include <unistd.h>

#include "interrupt.h"

static int status_of(int child)
{
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    return status;
}

static void test_fork(void **state)
{
    (void) state;
    signal(SIGHUP, SIG_IGN);
    signal(SIGTERM, SIG_DFL);
    interrupt_catch();
    for (int ends = 0; ends < 2; ends++) {
        interrupt_hold();
        const pid_t child = fork();
        if (!child)
            raise(ends ? SIGTERM : SIGHUP); /* ignored here and in the child */
        interrupt_release(!child);
        if (!child)
            _exit(7);
        const int status = status_of(child);
        if (ends)
            assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM);
        else
            assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 7);
    }
    assert_false(interrupted());
    interrupt_hold();
    raise(SIGTERM);
    assert_false(interrupted());
    interrupt_release(false);
    assert_true(interrupted());
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_fork)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
