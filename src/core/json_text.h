/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_CORE_JSON_TEXT_H
#define SG_CORE_JSON_TEXT_H

#include <jansson.h>

#include "context.h"

/* Charges the ledger for the most memory that the parser needs for a text. *room: as of sg_reserve,
 * to be released after the values. */
int sg_json_reserve(sg_ctx *ctx, const char *data, size_t size, void **room);

/* A JSON string. File names need not be UTF-8, but JSON must be: in a name that is not, bytes that
 * are not ASCII become "?", and at most 4095 bytes are kept. NULL without memory. */
json_t *sg_text_to_json(const char *text);

/* The same without loss: text that is not UTF-8 becomes {"percent": "/tmp/caf%E9"}, where %XX
 * stands for a byte. NULL without memory. */
json_t *sg_bytes_to_json(const char *text);
/* Converts such members of an object back to strings of the original bytes, which must not be
 * written as JSON. */
void sg_bytes_from_json(json_t *object);

/* A value as messages quote it: the value itself if it is short, else its kind; NULL is "nothing".
 * Returns text. */
#define SG_JSON_SHOWN 64
const char *sg_json_show(const json_t *value, char text[SG_JSON_SHOWN]);

#endif
