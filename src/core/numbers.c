/* SPDX-License-Identifier: Apache-2.0 */
#include "numbers.h"

#include <pthread.h>
#include <stdlib.h>

static locale_t c_locale;

static void make(void)
{
    c_locale = newlocale(LC_ALL_MASK, "C", (locale_t) 0); /* cannot fail: it is compiled in */
}

locale_t sg_c_locale(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, make);
    return c_locale;
}

double sg_strtod(const char *text, char **end)
{
    return strtod_l(text, end, sg_c_locale());
}

float sg_strtof(const char *text, char **end)
{
    return strtof_l(text, end, sg_c_locale());
}
