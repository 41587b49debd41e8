/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_INTERRUPT_H
#define CLI_INTERRUPT_H

#include <stdbool.h>

/* From here on SIGINT, SIGTERM and SIGHUP only set the flag, except those that were ignored, as
 * under nohup (a second call does nothing). One that comes a second or more after the first ends
 * the process. Before that it is the same wish: timeout(1) sends its signal to the process and to
 * its group. */
void interrupt_catch(void);
bool interrupted(void);

/* Before a fork, and after it in both processes: signals that come in between wait. One to the
 * child ends it then; the flag would be lost with the program that it becomes. */
void interrupt_hold(void);
void interrupt_release(bool child);

/* The flag cancels whatever the library does, until a command asks it itself between its steps:
 * then it saves first. */
void interrupt_by_steps(void);
bool interrupt_cancels(void);

#endif
