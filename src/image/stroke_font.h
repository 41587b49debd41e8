/* SPDX-License-Identifier: Apache-2.0 */
/* A stroke font, for print on the solids of the synthetic scene and for labels of plots. */
#ifndef SG_STROKE_FONT_H
#define SG_STROKE_FONT_H

#include <stdbool.h>

/* Is the point (x, y) inked by the line of text? The text is centred on x = 0, and its baseline is
 * y = 0; `size` is the height of its capitals and `weight` the half width of a stroke, as a part of
 * size. Capitals, digits and . - / + only. */
bool sg_stroke_ink(const char *text, double x, double y, double size, double weight);

#endif
