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
    static const int signals[] = {SIGINT, SIGTERM, SIGHUP};
    static bool done;
    struct sigaction action, before;
    if (done)
        return;
    done = true;
    memset(&action, 0, sizeof(action));
    action.sa_handler = on_signal;
    action.sa_flags = SA_RESTART; /* what saves is not cut short */
    for (int i = 0; i < 3; i++)   /* ignored: as nohup and a shell's & set it */
        if (!sigaction(signals[i], NULL, &before) && before.sa_handler != SIG_IGN)
            sigaction(signals[i], &action, NULL);
}

bool interrupted(void)
{
    return first != 0;
}

void interrupt_by_steps(void)
{
    by_steps = true;
}

bool interrupt_cancels(void)
{
    return first && !by_steps;
}
