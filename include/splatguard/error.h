/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_ERROR_H
#define SPLATGUARD_ERROR_H

/* A call that can fail returns SG_OK or one of these negative codes. sg_last_error() has a message
 * that names file, place, what was found and what was expected (sg_ctx_create has none). The arrows
 * show the exit status of the command line tool, which has more: see splatguard --help. */
enum sg_error {
    SG_OK = 0,
    SG_ERR_USAGE = -1,       /* an argument, parameter or option is not allowed         -> exit 1 */
    SG_ERR_INPUT = -2,       /* a file or folder is missing, malformed or unwritable    -> exit 2 */
    SG_ERR_BUDGET = -3,      /* a limit on memory or counts would be exceeded           -> exit 3 */
    SG_ERR_INTERNAL = -4,    /* a bug, or the system refused something basic            -> exit 4 */
    SG_ERR_INTERRUPTED = -5, /* a progress or step function cancelled                 -> exit 130 */
    SG_ERR_POISONED = -6,    /* the photos look poisoned, which the run refuses         -> exit 5 */
};

#endif
