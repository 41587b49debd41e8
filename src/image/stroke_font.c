/* SPDX-License-Identifier: Apache-2.0 */
/* Every glyph is a few polylines on a grid of 5 x 7 points, written as pairs of digits (column, row
 * from below); a blank lifts the pen. */
#include "stroke_font.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define UNITS 6   /* height of a capital */
#define ADVANCE 6 /* from one glyph to the next: 4 of ink, 2 of air */

static const char *const letters[26] = {
    "0004264440 0242",             /* A */
    "0300063645443303 3342413000", /* B */
    "4536160501103041",            /* C */
    "00062644422000",              /* D */
    "46060040 0333",               /* E */
    "460600 0333",                 /* F */
    "45361605011030414323",        /* G */
    "0006 4046 0343",              /* H */
    "1030 2026 1636",              /* I */
    "4641301001",                  /* J */
    "0006 4602 1340",              /* K */
    "060040",                      /* L */
    "0006234640",                  /* M */
    "00064046",                    /* N */
    "011030414536160501",          /* O */
    "00063645443303",              /* P */
    "011030414536160501 2240",     /* Q */
    "00063645443303 2340",         /* R */
    "453616050413334241301001",    /* S */
    "0646 2620",                   /* T */
    "060110304146",                /* U */
    "062046",                      /* V */
    "0610233046",                  /* W */
    "0046 0640",                   /* X */
    "062346 2320",                 /* Y */
    "06460040",                    /* Z */
};

static const char *const digits[10] = {
    "011030414536160501 1135",  "152620 1030", "05163645440040",
    "064624344341301001",       "30360242",    "460603334241301001",
    "453616050110304142331302", "064610",      "13040516364544331302011030414233",
    "011030414536160504133344",
};

static const char *glyph(char c)
{
    if (c >= 'A' && c <= 'Z')
        return letters[c - 'A'];
    if (c >= '0' && c <= '9')
        return digits[c - '0'];
    return c == '.' ? "2020" : c == '-' ? "1333" : c == '/' ? "0046" : c == '+' ? "1333 2224" : "";
}

static double distance2(double x, double y, const char *from, const char *to)
{
    const double ax = from[0] - '0', ay = from[1] - '0', bx = to[0] - '0' - ax,
                 by = to[1] - '0' - ay;
    const double l2 = bx * bx + by * by, px = x - ax, py = y - ay;
    const double t = l2 > 0 ? fmin(fmax((px * bx + py * by) / l2, 0), 1) : 0;
    const double dx = px - t * bx, dy = py - t * by;
    return dx * dx + dy * dy;
}

bool sg_stroke_ink(const char *text, double x, double y, double size, double weight)
{
    const double unit = size / UNITS, half = weight * UNITS;
    const double n = (double) strlen(text), row = y / unit;
    const double column = x / unit + (n * ADVANCE - 2) / 2;
    const double cell = floor((column + 1) / ADVANCE), at = column - cell * ADVANCE;
    if (row < -half || row > UNITS + half || cell < 0 || cell >= n)
        return false;
    for (const char *p = glyph(text[(size_t) cell]); p[0]; p += 2) {
        if (p[0] == ' ')
            p++;
        if (p[2] && p[2] != ' ' && distance2(at, row, p, p + 2) < half * half)
            return true;
    }
    return false;
}
