/* SPDX-License-Identifier: Apache-2.0 */
/* Zip archives that tests make, good ones and bad ones. */
#ifndef TESTS_ZIP_FILES_H
#define TESTS_ZIP_FILES_H

#include <zlib.h>

#include "scene_files.h"

struct archive {
    uint8_t *bytes;
    size_t size, directory_size;
    uint8_t directory[4096];
    unsigned entries;
};

static inline void put_le(uint8_t **at, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        *(*at)++ = (uint8_t) (i < 8 ? value >> 8 * i : 0);
}

static inline void archive_add(struct archive *a, const char *name, const void *data, size_t size,
                               bool deflated)
{
    uint8_t *packed = malloc(size + 64), *at = a->bytes + a->size;
    size_t n = size;
    memcpy(packed, data, size);
    if (deflated) {
        z_stream z = {.next_in = (uint8_t *) (uintptr_t) data,
                      .avail_in = (unsigned) size,
                      .next_out = packed,
                      .avail_out = (unsigned) size + 64};
        assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, -MAX_WBITS, 8, 0), Z_OK);
        assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
        n = z.total_out;
        deflateEnd(&z);
    }
    const uint64_t crc = crc32(0, data, (unsigned) size), names = strlen(name);
    uint8_t *to = a->directory + a->directory_size;
    memcpy(at, "PK\3\4", 4), memcpy(to, "PK\1\2", 4);
    at += 4, to += 4;
    put_le(&to, 20, 2);
    for (int k = 0; k < 2; k++) {
        uint8_t **both = k ? &to : &at;
        put_le(both, 20, 4); /* version, no flags */
        put_le(both, deflated ? 8 : 0, 2);
        put_le(both, 0, 4);
        put_le(both, crc, 4);
        put_le(both, n, 4);
        put_le(both, size, 4);
        put_le(both, names, 2);
        put_le(both, 0, 2);
    }
    put_le(&to, 0, 10);
    put_le(&to, a->size, 4);
    memcpy(at, name, names), memcpy(to, name, names);
    memcpy(at + names, packed, n);
    a->size += 30 + names + n, a->directory_size += 46 + names;
    a->entries++;
    free(packed);
}

static inline void archive_finish(struct archive *a, const char *comment)
{
    uint8_t *at = a->bytes + a->size;
    memcpy(at, a->directory, a->directory_size);
    at += a->directory_size;
    memcpy(at, "PK\5\6", 4);
    at += 4;
    put_le(&at, 0, 4);
    put_le(&at, a->entries, 2);
    put_le(&at, a->entries, 2);
    put_le(&at, a->directory_size, 4);
    put_le(&at, a->size, 4);
    put_le(&at, strlen(comment), 2);
    memcpy(at, comment, strlen(comment));
    a->size += a->directory_size + 22 + strlen(comment);
}

/* A finished archive with a random byte changed, and for every fourth k cut there. The directory
 * and the first header are where most can go wrong. */
static inline void put_damaged(struct fixture *f, const char *name, struct archive *a,
                               uint64_t random, uint64_t k)
{
    const size_t place = (random & 1) ? a->size - 1 - (size_t) (random >> 8) % 400
                                      : (size_t) (random >> 8) % a->size;
    const uint8_t kept = a->bytes[place];
    a->bytes[place] = (uint8_t) (random >> 40);
    put(f, name, a->bytes, k % 4 ? a->size : place);
    a->bytes[place] = kept;
}

#endif
