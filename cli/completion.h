/* SPDX-License-Identifier: Apache-2.0 */
/* Completion scripts for shells, made from the option tables. */
#ifndef CLI_COMPLETION_H
#define CLI_COMPLETION_H

#include "options.h"

/* shell: "bash", "zsh" or "fish". Returns false for another one, and writes nothing. */
bool completion_write(const char *shell, const struct command *const *commands, size_t n,
                      FILE *out);

#endif
