/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_ERROR_H
#define SPLATGUARD_ERROR_H

/* Every fallible call returns SG_OK or one of these negative codes and leaves a message that names
 * file, place, what was found and what was expected (but for sg_ctx_create); read it with
 * sg_last_error(). The arrows say what the command line tool exits with; it has more statuses, see
 * splatguard --help. */
enum sg_error {
    SG_OK = 0,
    SG_ERR_USAGE = -1,       /* the caller asked for something that makes no sense      -> exit 1 */
    SG_ERR_INPUT = -2,       /* a file or folder is missing, malformed or unwritable    -> exit 2 */
    SG_ERR_BUDGET = -3,      /* a limit on memory or counts would be exceeded           -> exit 3 */
    SG_ERR_INTERNAL = -4,    /* a bug, or the system refused something basic            -> exit 4 */
    SG_ERR_INTERRUPTED = -5, /* a progress or step function cancelled                 -> exit 130 */
    SG_ERR_POISONED = -6,    /* the photos look poisoned, which the run refuses         -> exit 5 */
};

#endif
