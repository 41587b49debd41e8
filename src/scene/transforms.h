/* SPDX-License-Identifier: Apache-2.0 */
/* What the two JSON formats share: loading, numbers, poses, frames. */
#ifndef SG_SCENE_TRANSFORMS_H
#define SG_SCENE_TRANSFORMS_H

#include <jansson.h>

#include "scene/reader.h"

#define SG_JSON_BYTES (UINT64_C(1) << 28)

struct sg_transforms {
    json_t *root, *frames; /* an object and its array, not empty */
    void *room;            /* the parser's memory, in the ledger */
};

/* The whole text, which the caller owns. A file that does not begin like text is refused before it
 * is read. */
int sg_transforms_read(sg_ctx *ctx, const struct sg_folder *dir, const char *file, char **data,
                       size_t *size);
/* At most max_frames. A byte-order mark may come first. */
int sg_transforms_load(sg_ctx *ctx, const char *file, const char *data, size_t size,
                       uint64_t max_frames, struct sg_transforms *out);
void sg_transforms_clear(struct sg_transforms *transforms);
/* Leaves *out unchanged if the key is absent or null. */
int sg_json_text(sg_ctx *ctx, const json_t *object, const char *key, const char *where,
                 const char **out);
/* Intrinsics given in object replace those of *lens. */
int sg_json_lens(sg_ctx *ctx, const json_t *object, const char *where, struct sg_lens *lens);
/* One entry of "frames" as a shot with the given lens. */
int sg_transforms_frame(sg_ctx *ctx, const json_t *frame, const char *where,
                        const struct sg_lens *lens, uint64_t max_images, struct sg_shots *shots,
                        struct sg_shot **shot);
/* First of dir/file, dir/file.png, .jpg, .jpeg, .webp that exists, or a converted one, NULL if
 * none. */
int sg_find_photo(sg_ctx *ctx, const struct sg_folder *dir, const char *file, char **path);

/* nerfstudio.c: the split that the scene's own file gives. */
struct sg_split_lists {
    json_t *train, *test; /* objects whose keys are names as struct sg_shot has them; or NULL */
    const char *test_key; /* the name of the list test */
    void *room;           /* their memory, in the ledger */
};

/* The caller clears *out, also after a failure. */
int sg_nerfstudio_lists(sg_ctx *ctx, const struct sg_folder *dir, struct sg_split_lists *out);
void sg_split_lists_clear(struct sg_split_lists *lists);

#endif
