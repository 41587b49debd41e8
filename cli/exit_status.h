/* SPDX-License-Identifier: Apache-2.0 */
/* The tool's exit statuses. Scripts depend on them: a number never gets another meaning. */
#ifndef CLI_EXIT_STATUS_H
#define CLI_EXIT_STATUS_H

#include <stdio.h>

enum exit_status {
    STATUS_DONE = 0,
    STATUS_USAGE = 1,
    STATUS_INPUT = 2,
    STATUS_BUDGET = 3,
    STATUS_INTERNAL = 4,
    STATUS_POISONED = 5,
    STATUS_SUSPICIOUS = 6,
    STATUS_INTERRUPTED = 130
};

struct exit_meaning {
    enum exit_status status;
    const char *meaning;
};

/* What --help, the man page and docs/options.md say. Ends with a NULL meaning. */
extern const struct exit_meaning exit_meanings[];

/* The status of a library error. */
int exit_code(int error);

#endif
