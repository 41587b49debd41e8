/* SPDX-License-Identifier: Apache-2.0 */
#include "exit_status.h"

#include "splatguard/error.h"

const struct exit_meaning exit_meanings[] = {
    {STATUS_DONE, "done"},
    {STATUS_USAGE, "wrong command line; the message names the option"},
    {STATUS_INPUT,
     "a file or folder is missing, malformed or not writable; the message names it "
     "and the place; or every Gaussian became transparent; or a job of bench has failed"},
    {STATUS_BUDGET, "out of memory, or --max-memory or --max-vram is too little"},
    {STATUS_INTERNAL,
     "internal error: please report it; or the GPU was lost: train --resume goes on"},
    {STATUS_POISONED, "the photos look poisoned (train --audit refuse, audit --exit-code)"},
    {STATUS_SUSPICIOUS, "the photos look suspicious (audit --exit-code)"},
    {STATUS_INTERRUPTED,
     "interrupted; train, attack and bench have saved everything, others leave nothing unfinished"},
    {0},
};

int exit_code(int error)
{
    switch (error) {
    case SG_OK:
        return STATUS_DONE;
    case SG_ERR_USAGE:
        return STATUS_USAGE;
    case SG_ERR_INPUT:
        return STATUS_INPUT;
    case SG_ERR_BUDGET:
        return STATUS_BUDGET;
    case SG_ERR_POISONED:
        return STATUS_POISONED;
    case SG_ERR_INTERRUPTED:
        return STATUS_INTERRUPTED;
    default:
        return STATUS_INTERNAL;
    }
}
