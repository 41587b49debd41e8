/* SPDX-License-Identifier: Apache-2.0 */
/* The words on the plaque, from a 5 x 7 dot font. */
#include <string.h>

#include "synth_scene.h"

static const char letters[] = "SPLATGURD0123456789.-";
static const char *const glyphs[] = {
    "01110100011000001110000011000101110", "11110100011000111110100001000010000", "10000100001000010000100001000011111",
    "01110100011000111111100011000110001", "11111001000010000100001000010000100", "01110100011000010111100011000101111",
    "10001100011000110001100011000101110", "11110100011000111110101001001010001", "11110100011000110001100011000111110",
    "01110100011001110101110011000101110", "00100011000010000100001000010001110", "01110100010000100110010001000011111",
    "11111000100010000010000011000101110", "00010001100101010010111110001000010", "11111100001111000001000011000101110",
    "00110010001000011110100011000101110", "11111000010001000100010000100001000", "01110100011000101110100011000101110",
    "01110100011000101111000010001001100", "00000000000000000000000000110001100", "00000000000000011111000000000000000",
};
/* A large line above a line of fine print. */
static const char *const lines[2] = {"SPLATGUARD", "3.14159-26535-89793-23846"};
static const double bottom[2] = {0.42, 0.12}, height[2] = {0.42, 0.13};

bool synth_text(double u, double v)
{
    for (int line = 0; line < 2; line++) {
        const double y = (v - bottom[line]) / height[line];
        if (y < 0 || y >= 1)
            continue;
        const int columns = 6 * (int) strlen(lines[line]) - 1;
        const double x = (u - 0.06) / 0.88 * columns;
        if (x < 0 || x >= columns)
            return false;
        const int column = (int) x % 6, row = (int) ((1 - y) * 6.9999);
        const char *at = strchr(letters, lines[line][(int) x / 6]);
        return at && column < 5 && glyphs[at - letters][5 * row + column] == '1';
    }
    return false;
}
