/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_INTERRUPT_H
#define CLI_INTERRUPT_H

#include <stdbool.h>

/* From here on the first SIGINT or SIGTERM only sets the flag; a second one ends the process. */
void interrupt_catch(void);
bool interrupted(void);

#endif
