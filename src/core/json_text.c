/* SPDX-License-Identifier: Apache-2.0 */
#include "json_text.h"

#include <stdio.h>
#include <string.h>

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

const char *sg_json_show(const json_t *value, char text[SG_JSON_SHOWN])
{
    const char *word = json_string_value(value);
    if (!value)
        snprintf(text, SG_JSON_SHOWN, "nothing");
    else if (word)
        snprintf(text, SG_JSON_SHOWN, strlen(word) > 40 ? "the string \"%.40s...\"" : "the string \"%s\"", word);
    else if (json_is_integer(value))
        snprintf(text, SG_JSON_SHOWN, "the number %lld", (long long) json_integer_value(value));
    else if (json_is_real(value))
        snprintf(text, SG_JSON_SHOWN, "the number %g", json_real_value(value));
    else if (json_is_array(value))
        snprintf(text, SG_JSON_SHOWN, "an array of %zu", json_array_size(value));
    else
        snprintf(text, SG_JSON_SHOWN, "%s",
                 json_is_object(value) ? "an object"
                 : json_is_true(value) ? "true"
                 : json_is_null(value) ? "null"
                                       : "false");
    return text;
}
