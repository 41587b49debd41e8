/* SPDX-License-Identifier: Apache-2.0 */
/* Some planes of an array after an edit of the model: rows move, and nothing is computed. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = VK_GROUP) in;
ARGUMENTS(edit);

void main()
{
    const uint i = thread_index();
    if (i >= a.count)
        return;
    const uint source = a.moves.v[2 * i], word = a.moves.v[2 * i + 1];
    const uint kind = word & (1u << VK_KIND_BITS) - 1u;
    const uint fate = a.fates >> VK_FATE_BITS * kind & VK_FATE_MASK;
    for (uint plane = a.first; plane < a.end; plane++) {
        float v = 0.0;
        if (fate == VK_FATE_COPY)
            v = a.from.v[param_at(a.planes, source, plane)];
        else if (fate == VK_FATE_ROW)
            v = a.rows.v[param_at(a.planes, source, plane)];
        else if (fate == VK_FATE_CHILD)
            v = a.children.v[param_at(P_SH, word >> VK_KIND_BITS, plane)];
        a.to.v[param_at(a.planes, i, plane)] = v;
    }
}
