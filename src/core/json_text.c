/* SPDX-License-Identifier: Apache-2.0 */
#include "json_text.h"

json_t *sg_text_to_json(const char *text)
{
    json_t *value = json_string(text);
    if (value)
        return value;
    char copy[4096];
    size_t n = 0;
    for (; text[n] && n < sizeof(copy) - 1; n++)
        copy[n] = (unsigned char) text[n] < 0x80 ? text[n] : '?';
    copy[n] = 0;
    return json_string(copy);
}
