/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_CORE_JSON_TEXT_H
#define SG_CORE_JSON_TEXT_H

#include <jansson.h>

/* A JSON string. Names of files need not be UTF-8, JSON must be: of those that are not, what is not
 * ASCII becomes "?", and 4095 bytes stay. NULL without memory. */
json_t *sg_text_to_json(const char *text);

/* The same without loss: text that is no UTF-8 becomes {"percent": "/tmp/caf%E9"}, of which %XX is
 * a byte. NULL without memory. */
json_t *sg_bytes_to_json(const char *text);
/* Turns such members of an object back: from then on they are strings of their bytes, not to be
 * written as JSON. */
void sg_bytes_from_json(json_t *object);

/* A value as messages quote it: as it is where that is short, else its kind. NULL is "nothing".
 * Returns text. */
#define SG_JSON_SHOWN 64
const char *sg_json_show(const json_t *value, char text[SG_JSON_SHOWN]);

#endif
