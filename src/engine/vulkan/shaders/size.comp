/* SPDX-License-Identifier: Apache-2.0 */
/* How much later kernels have to do, in numbers that only the device knows. Where the instances
 * have no room the device stops: nothing that follows changes the model, until the host has made
 * room and does it again. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 1) in;
ARGUMENTS(size);

/* Workgroups of `each` items, folded as the host does. */
void put(uint item, uint items, uint room, uint each)
{
    const uint groups = room / each + (room % each > 0 ? 1 : 0);
    const uint rows = max((groups + VK_MOST_GROUPS - 1) / VK_MOST_GROUPS, 1);
    a.work.v[item * VK_WORK_WORDS] = (groups + rows - 1) / rows;
    a.work.v[item * VK_WORK_WORDS + 1] = rows;
    a.work.v[item * VK_WORK_WORDS + 2] = 1;
    a.work.v[item * VK_WORK_WORDS + VK_WORK_ITEMS] = items;
}

void put_sort(uint item, uint digits, uint items)
{
    const uint counters = (items + VK_SORT - 1) / VK_SORT * VK_DIGITS;
    put(item, items, items, VK_SORT);
    put(digits, counters, counters, VK_SCAN);
}

void main()
{
    const bool stopped = a.stop.v[0] != 0;
    const uint total = stopped ? 0 : a.total.v[0];
    if (a.what == VK_SIZE_DRAWN) {
        put(VK_WORK_MODEL, a.count, stopped ? 0 : a.count, VK_GROUP);
        put(VK_WORK_DRAWN, total, total, VK_GROUP);
        put(VK_WORK_DRAWN_SCAN, total, total, VK_SCAN);
        put_sort(VK_WORK_DRAWN_SORT, VK_WORK_DRAWN_DIGITS, total);
    } else if (a.what == VK_SIZE_INSTANCES) {
        const uint drawn = a.work.v[VK_WORK_DRAWN * VK_WORK_WORDS + VK_WORK_ITEMS];
        const bool fits = !stopped && total <= a.capacity &&
                          (a.whole == 0 || a.results.v[VK_RESULT_INSTANCES + 1] == 0);
        const uint instances = fits ? total : 0;
        if (!fits) {
            a.stop.v[0] = 1;
            put(VK_WORK_MODEL, a.count, 0, VK_GROUP);
        }
        put(VK_WORK_EMIT, fits ? drawn : 0, fits ? drawn : 0, VK_GROUP);
        put_sort(VK_WORK_SORT, VK_WORK_DIGITS, instances);
        put(VK_WORK_STARTS, instances, fits ? instances + 1 : 0, VK_GROUP);
        put(VK_WORK_TILES, a.tiles, fits ? a.tiles : 0, 1);
    } else if (a.what == VK_SIZE_UNITS)
        put(VK_WORK_UNITS, total, total, 1);
    else if (!stopped) {
        const uint low = a.results.v[VK_RESULT_INSTANCES],
                   high = a.results.v[VK_RESULT_INSTANCES + 1];
        if (high > a.most.v[1] || (high == a.most.v[1] && low > a.most.v[0])) {
            a.most.v[0] = low;
            a.most.v[1] = high;
        }
    }
}
