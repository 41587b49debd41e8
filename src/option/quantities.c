/* SPDX-License-Identifier: Apache-2.0 */
#include "quantities.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "core/numbers.h"

/* Bytes of a unit, 0 = there is none of this name. */
static uint64_t unit_bytes(const char *name)
{
    static const char letters[] = "kmgt";
    if (!name[0] || !strcasecmp(name, "B"))
        return 1;
    const char *letter = strchr(letters, name[0] | 32); /* in lower case */
    if (!letter)
        return 0;
    const bool binary = !name[1] || !strcasecmp(name + 1, "iB");
    if (!binary && strcasecmp(name + 1, "B"))
        return 0;
    uint64_t bytes = 1;
    for (size_t i = 0; i <= (size_t) (letter - letters); i++)
        bytes *= binary ? 1024 : 1000;
    return bytes;
}

bool sg_quantity_bytes(const char *text, uint64_t *bytes)
{
    static const char digits[] = "0123456789";
    const size_t whole = strspn(text, digits);
    const bool point = text[whole] == '.';
    const size_t part = point ? strspn(text + whole + 1, digits) : 0;
    const uint64_t unit = unit_bytes(text + whole + point + part);
    errno = 0;
    const unsigned long long n = strtoull(text, NULL, 10);
    if (!whole || (point && (!part || unit == 1)) || !unit || errno ||
        n > (UINT64_MAX - unit) / unit)
        return false;
    const double fraction = point ? sg_strtod(text + whole, NULL) : 0;
    *bytes = n * unit + (uint64_t) (fraction * (double) unit);
    return true;
}

bool sg_quantity_seconds(const char *text, double *seconds)
{
    static const char units[] = "dhms";
    static const double of[] = {86400, 3600, 60, 1};
    char *end;
    double sum = sg_strtod(text, &end);
    size_t next = 0; /* the first unit that may still come */
    if (end == text)
        return false;
    if (*end) {
        double number = sum;
        sum = 0;
        for (;;) {
            const char *unit = *end ? strchr(units + next, *end) : NULL;
            if (!unit)
                return false;
            sum += number * of[unit - units];
            next = (size_t) (unit - units) + 1;
            const char *more = end + 1;
            if (!*more)
                break;
            if (!strchr(".0123456789", *more))
                return false;
            number = sg_strtod(more, &end);
            if (end == more)
                return false;
        }
    }
    *seconds = sum;
    return true;
}
