/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_INTERRUPT_H
#define CLI_INTERRUPT_H

#include <stdbool.h>

/* From here on SIGINT, SIGTERM and SIGHUP (unless ignored, as under nohup) only set the flag, each
 * once (a second call does nothing): a second one of its kind ends the process. */
void interrupt_catch(void);
bool interrupted(void);

/* The flag cancels whatever the library does, until a command asks it itself between its steps:
 * then it saves first. */
void interrupt_by_steps(void);
bool interrupt_cancels(void);

#endif
