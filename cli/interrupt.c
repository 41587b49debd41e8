/* SPDX-License-Identifier: Apache-2.0 */
#include "interrupt.h"

#include <signal.h>
#include <string.h>

static volatile sig_atomic_t caught;
static bool by_steps;

static void on_signal(int signal_number)
{
    (void) signal_number;
    caught = 1;
}

void interrupt_catch(void)
{
    static bool done;
    struct sigaction action;
    if (done)
        return;
    done = true;
    memset(&action, 0, sizeof(action));
    action.sa_handler = on_signal;
    action.sa_flags = (int) SA_RESETHAND;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    struct sigaction before;
    if (!sigaction(SIGHUP, NULL, &before) && before.sa_handler != SIG_IGN) /* as nohup sets it */
        sigaction(SIGHUP, &action, NULL);
}

bool interrupted(void)
{
    return caught;
}

void interrupt_by_steps(void)
{
    by_steps = true;
}

bool interrupt_cancels(void)
{
    return caught && !by_steps;
}
