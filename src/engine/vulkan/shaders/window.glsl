/* SPDX-License-Identifier: Apache-2.0 */
/* The window of SSIM on 16 x 16 pixels of a channel, from shared memory with a border. */
#include "math/photometric.h"

#define SIDE 16
#define WIDE (SIDE + 2 * SG_SSIM_RADIUS)

layout(local_size_x = SIDE * SIDE) in;

/* Tiles of a channel, one a workgroup; channels one after the other. */
struct place {
    uint channel, x0, y0;
};
place place_of(uint width, uint height)
{
    const uint across = (width + SIDE - 1) / SIDE, tiles = across * ((height + SIDE - 1) / SIDE);
    const uint group = group_index(), tile = group % tiles;
    return place(group / tiles, tile % across * SIDE, tile / across * SIDE);
}

/* Place of pixel k of the bordered tile, or -1 outside of the image. */
int bordered(place p, uint k, uint width, uint height)
{
    const int x = int(p.x0 + k % WIDE) - SG_SSIM_RADIUS, y = int(p.y0 + k / WIDE) - SG_SSIM_RADIUS;
    return x >= 0 && y >= 0 && x < int(width) && y < int(height)
               ? int((p.channel * height + uint(y)) * width) + x
               : -1;
}
