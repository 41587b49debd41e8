/* SPDX-License-Identifier: Apache-2.0 */
/* Pixels of photos: a word each, red in the lowest byte, the mask in the highest. */
float photo_value(uint word, uint channel)
{
    return float(word >> 8 * channel & 255) * (1.0 / 255.0);
}
bool photo_counts(uint word)
{
    return word >> 24 != 0;
}
