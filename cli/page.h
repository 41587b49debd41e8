/* SPDX-License-Identifier: Apache-2.0 */
/* What the pages of commands share. Names are untrusted: all text is escaped. */
#ifndef CLI_PAGE_H
#define CLI_PAGE_H

#include <stdbool.h>
#include <stdio.h>

#include "splatguard/splatguard.h"

/* Text for a page, and the same of a name that need not be UTF-8. */
void put_escaped(FILE *f, const char *text);
void put_name(FILE *f, const char *text);

/* For a data: address. Returns a text for free(), or NULL without memory. */
char *base64(const uint8_t *data, size_t n);

/* The beginning of a page, up to its heading, in the look of all pages. scripts: it has some. */
void put_page_head(FILE *f, const char *title, bool scripts);

/* The last cell of a row of a table of the class bars. share: 0..1 of its length. */
void put_bar(FILE *f, double share);

/* A file that appears whole or not at all. put returns an exit code. command: for messages. Returns
 * an exit code. */
int write_whole(const char *command, const char *path, const void *what,
                int (*put)(FILE *, const void *));

#endif
