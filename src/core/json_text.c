/* SPDX-License-Identifier: Apache-2.0 */
#include "json_text.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Every value begins after one of these characters, or is inside a string. */
int sg_json_reserve(sg_ctx *ctx, const char *data, size_t size, void **room)
{
    uint64_t bytes = 2 * (uint64_t) size;
    for (size_t i = 0; i < size; i++)
        bytes += data[i] == '{' || data[i] == '[' ? 320 : data[i] == ',' || data[i] == ':' ? 96 : 0;
    return sg_reserve(ctx, SG_MEM_MISC, bytes, room);
}

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

json_t *sg_bytes_to_json(const char *text)
{
    json_t *value = json_string(text);
    char *coded = value ? NULL : malloc(3 * strlen(text) + 1), *to = coded;
    for (const unsigned char *c = (const unsigned char *) text; coded && *c; c++)
        if (*c > ' ' && *c < 0x7f && *c != '%')
            *to++ = (char) *c;
        else
            to += sprintf(to, "%%%02X", *c);
    if (coded) {
        *to = 0;
        value = json_pack("{s:s}", "percent", coded);
    }
    free(coded);
    return value;
}

/* NULL for what sg_bytes_to_json does not write. */
static json_t *decode(const char *coded)
{
    char *text = malloc(strlen(coded) + 1);
    size_t n = 0;
    bool good = text;
    for (const char *c = coded; good && *c; c++) {
        unsigned byte = (unsigned char) *c;
        if (*c == '%') {
            good = strspn(c + 1, "0123456789ABCDEFabcdef") >= 2 &&
                   sscanf(c + 1, "%2x", &byte) == 1 && byte;
            c += good ? 2 : 0;
        }
        text[n++] = (char) byte;
    }
    json_t *value = good ? json_stringn_nocheck(text, n) : NULL;
    free(text);
    return value;
}

void sg_bytes_from_json(json_t *object)
{
    const char *key;
    json_t *member;
    void *next;
    json_object_foreach_safe(object, next, key, member)
    {
        const char *coded = json_object_size(member) == 1
                                ? json_string_value(json_object_get(member, "percent"))
                                : NULL;
        json_t *text = coded ? decode(coded) : NULL;
        if (text)
            json_object_set_new(object, key, text);
    }
}

const char *sg_json_show(const json_t *value, char text[SG_JSON_SHOWN])
{
    const char *word = json_string_value(value);
    if (!value)
        snprintf(text, SG_JSON_SHOWN, "nothing");
    else if (word)
        snprintf(text, SG_JSON_SHOWN,
                 strlen(word) > 40 ? "the string \"%.40s...\"" : "the string \"%s\"", word);
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
