/* SPDX-License-Identifier: Apache-2.0 */
/* What the kernels of a tile share. A tile is VK_BLOCKS blocks of 8 x 4 pixels, and each block
 * walks only the instances whose ellipse reaches it. A block belongs to LANES neighbouring
 * invocations with PIXELS pixels each; LANES is the device's subgroup size, at most 32, and no
 * result depends on it: no kernel uses subgroup operations. */
#include "math/pair.h"
#include "splat.glsl"

layout(local_size_x_id = 0) in; /* VK_BLOCKS x LANES */
layout(constant_id = 1) const uint LANES = 32;
const uint PIXELS = VK_BLOCK_SIZE / LANES;
#define MOST_PIXELS 8 /* LANES is at least 4; loops over PIXELS are unrolled */
const uint INVOCATIONS = VK_BLOCKS * LANES;

/* A batch of instances. */
shared vec4 batch_shape[VK_BATCH];  /* x, y, across, shear */
shared vec4 batch_light[VK_BATCH];  /* down, peak; one stride for all three */
shared vec4 batch_colour[VK_BATCH]; /* and depth */
shared uint batch_rows[VK_BLOCKS];  /* a bit an instance that reaches the block */

/* Place of the lists of a batch: `at` instances after the first one of unit `first`. */
uint unit_at(uint first, uint at)
{
    return (first + at / VK_CHUNK) * VK_UNIT + at % VK_CHUNK / VK_BATCH * VK_BLOCKS;
}

uint block_of()
{
    return gl_LocalInvocationID.x / LANES;
}

/* Offset of pixel p of this invocation from the tile's corner. */
uvec2 pixel_of(uint p)
{
    const uint block = block_of(), q = gl_LocalInvocationID.x % LANES + p * LANES;
    return uvec2(block % 2 * 8 + q % 8, block / 2 * 4 + q / 8);
}

/* A batch is staged in parts, so that most of the workgroup works: an instance has an invocation for
 * each row of two blocks. */
#define STAGES (VK_BLOCKS / 2)
const uint STAGE_PASSES = (VK_BATCH * STAGES + INVOCATIONS - 1) / INVOCATIONS;

/* Stages a part of splat i as number k of the batch; the last part is none. */
void batch_stage(Floats splats, uint i, uint k, uint part)
{
    const uint at = i * SPLAT;
    if (part == 0)
        batch_shape[k] = vec4(splats.v[at + S_X], splats.v[at + S_Y], splats.v[at + S_ACROSS],
                              splats.v[at + S_SHEAR]);
    else if (part == 1)
        batch_light[k] = vec4(splats.v[at + S_DOWN], splats.v[at + S_PEAK], 0.0, 0.0);
    else if (part == 2)
        batch_colour[k] =
            vec4(splats.v[at + S_R], splats.v[at + S_G], splats.v[at + S_B], splats.v[at + S_Z]);
}

/* Marks splat i, number k of the batch, in the lists of the blocks that it can touch: those of one
 * of the STAGES rows of two blocks. x0, y0: the tile's first pixel. */
void batch_mark(Floats splats, uint i, uint k, uint row, uint x0, uint y0)
{
    const ellipse e = ellipse_load(splats, i);
    const float x = splats.v[i * SPLAT + S_X] - float(x0), y = splats.v[i * SPLAT + S_Y];
    const float top = float(y0 + row * 4) - y;
    const row_span span = ellipse_row_span(e, top, top + 3.0);
    const cell_range cells = row_span_cells(span, x, 8.0, 0.0, 2.0);
    const uint c0 = uint(cells.first), c1 = uint(cells.end);
    if (!span.hit || !(span.x0 <= span.x1))
        return;
    if (c0 == 0 && c1 > 0)
        atomicOr(batch_rows[2 * row], 1u << k);
    if (c0 <= 1 && c1 > 1)
        atomicOr(batch_rows[2 * row + 1], 1u << k);
}

/* Stages and marks a batch: n instances from number `at` on. The lists are empty before. */
void batch_read(Floats splats, Uints instances, uint at, uint n, uint x0, uint y0)
{
    [[unroll]] for (uint p = 0; p < STAGE_PASSES; p++) {
        const uint item = gl_LocalInvocationID.x + p * INVOCATIONS;
        const uint k = item / STAGES, part = item % STAGES;
        if (k < n) {
            const uint i = instances.v[2 * (at + k)];
            batch_stage(splats, i, k, part);
            batch_mark(splats, i, k, part, x0, y0);
        }
    }
}

/* Opacity of a pair before its bound, and the alpha that is drawn. */
struct pair {
    float raw, alpha;
};
pair pair_of(uint k, float px, float py)
{
    const vec4 shape = batch_shape[k];
    precise const float dx = px - shape.x, dy = py - shape.y;
    precise const float below = pair_below(dy, batch_light[k].x, batch_light[k].y);
    precise const float power = pair_power(pair_along(dx, dy, shape.z, shape.w), below);
    precise const float raw = exp2(power);
    return pair(raw, pair_alpha(pair_drawn(power), raw));
}
