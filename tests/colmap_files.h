/* SPDX-License-Identifier: Apache-2.0 */
/* Builds COLMAP binary files byte by byte. */
#ifndef SG_TEST_COLMAP_FILES_H
#define SG_TEST_COLMAP_FILES_H

#include "scene_files.h"

struct bytes {
    uint8_t data[8192];
    size_t size;
};

static inline void add(struct bytes *b, uint64_t value, int n)
{
    for (int i = 0; i < n; i++)
        b->data[b->size++] = (uint8_t) (value >> 8 * i);
}

static inline void add_f64(struct bytes *b, double v)
{
    uint64_t bits;
    memcpy(&bits, &v, 8);
    add(b, bits, 8);
}

static inline void add_camera(struct bytes *b, int id, int model, int width, int height,
                              const double *params, int n)
{
    add(b, (uint64_t) id, 4);
    add(b, (uint64_t) model, 4);
    add(b, (uint64_t) width, 8);
    add(b, (uint64_t) height, 8);
    for (int i = 0; i < n; i++)
        add_f64(b, params[i]);
}

/* The camera looks along z from (x, 0, 0). Its observations are to be skipped. */
static inline void add_image(struct bytes *b, int id, int camera, const char *name, double x,
                             int observations)
{
    const double pose[7] = {1, 0, 0, 0, -x, 0, 0};
    add(b, (uint64_t) id, 4);
    for (int i = 0; i < 7; i++)
        add_f64(b, pose[i]);
    add(b, (uint64_t) camera, 4);
    for (const char *p = name;; p++) {
        add(b, (uint8_t) *p, 1);
        if (!*p)
            break;
    }
    add(b, (uint64_t) observations, 8);
    for (int i = 0; i < observations * 3; i++)
        add(b, 77, 8);
}

static inline void add_point(struct bytes *b, int id, double x, double y, double z, int red,
                             int track)
{
    add(b, (uint64_t) id, 8);
    add_f64(b, x);
    add_f64(b, y);
    add_f64(b, z);
    add(b, (uint64_t) red, 1);
    add(b, 20, 1);
    add(b, 30, 1);
    add_f64(b, 0.5);
    add(b, (uint64_t) track, 8);
    for (int i = 0; i < track; i++)
        add(b, 5, 8);
}

static inline void put_bytes(struct fixture *f, const char *name, const struct bytes *b)
{
    put(f, name, b->data, b->size);
}

#endif
