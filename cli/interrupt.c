/* SPDX-License-Identifier: Apache-2.0 */
#include "interrupt.h"

#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

/* When the first signal came, in nanoseconds; 0: none has. The kernel may run the handler of two
 * signals on two threads at once. */
static _Atomic int64_t first;
static bool by_steps;
static const int signals[] = {SIGINT, SIGTERM, SIGHUP};
#define SIGNALS (sizeof(signals) / sizeof(signals[0]))
static sigset_t before_hold;

static void on_signal(int signal_number)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    const int64_t now = (int64_t) time.tv_sec * 1000000000 + time.tv_nsec + 1; /* never 0 */
    int64_t before = 0;
    if (!atomic_compare_exchange_strong(&first, &before, now) && now - before >= 1000000000) {
        signal(signal_number, SIG_DFL);
        raise(signal_number); /* pending until the handler returns */
    }
}

void interrupt_catch(void)
{
    static bool done;
    struct sigaction action, before;
    if (done)
        return;
    done = true;
    memset(&action, 0, sizeof(action));
    action.sa_handler = on_signal;
    action.sa_flags = SA_RESTART;        /* what saves is not cut short */
    for (size_t i = 0; i < SIGNALS; i++) /* ignored: as nohup and a shell's & set it */
        if (!sigaction(signals[i], NULL, &before) && before.sa_handler != SIG_IGN)
            sigaction(signals[i], &action, NULL);
}

bool interrupted(void)
{
    return first != 0;
}

void interrupt_hold(void)
{
    sigset_t held;
    sigemptyset(&held);
    for (size_t i = 0; i < SIGNALS; i++)
        sigaddset(&held, signals[i]);
    pthread_sigmask(SIG_BLOCK, &held, &before_hold);
}

void interrupt_release(bool child)
{
    struct sigaction now;
    for (size_t i = 0; i < SIGNALS && child; i++)
        if (!sigaction(signals[i], NULL, &now) && now.sa_handler == on_signal)
            signal(signals[i], SIG_DFL);
    pthread_sigmask(SIG_SETMASK, &before_hold, NULL);
}

void interrupt_by_steps(void)
{
    by_steps = true;
}

bool interrupt_cancels(void)
{
    return first && !by_steps;
}
