/* SPDX-License-Identifier: Apache-2.0 */
/* Numbers with decimal points in every locale. */
#ifndef SG_NUMBERS_H
#define SG_NUMBERS_H

#include <locale.h>

locale_t sg_c_locale(void); /* for uselocale around printf; never freed */
double sg_strtod(const char *text, char **end);
float sg_strtof(const char *text, char **end);

#endif
