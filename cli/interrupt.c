/* SPDX-License-Identifier: Apache-2.0 */
#include "interrupt.h"

#include <signal.h>
#include <string.h>
#include <time.h>

static volatile sig_atomic_t caught;
static struct timespec first; /* when; only the handler uses it */
static bool by_steps;

static void on_signal(int signal_number)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (!caught) {
        first = now;
        caught = 1;
    } else if ((double) (now.tv_sec - first.tv_sec) +
                   1e-9 * (double) (now.tv_nsec - first.tv_nsec) >=
               1) {
        signal(signal_number, SIG_DFL);
        raise(signal_number); /* pending until the handler returns */
    }
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
    sigaddset(&action.sa_mask, SIGINT); /* the handler is not interrupted by itself */
    sigaddset(&action.sa_mask, SIGTERM);
    sigaddset(&action.sa_mask, SIGHUP);
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
