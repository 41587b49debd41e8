/* SPDX-License-Identifier: Apache-2.0 */
/* A ray-traced scene in a temporary folder, for the tests that read one. */
#ifndef SG_TEST_SYNTH_SCENE_H
#define SG_TEST_SYNTH_SCENE_H

#include <sys/stat.h>
#include <unistd.h>

#include "models.h"

/* folder: a template of mkdtemp, of at most 48 bytes, that becomes the folder's name. The scene is
 * FOLDER/scene, in Blender and COLMAP layout. Returns 0, or -1 without a folder. */
static inline int make_synth_scene(char *folder, const struct sg_synth_params *params)
{
    char scene[64];
    if (!mkdtemp(folder))
        return -1;
    snprintf(scene, sizeof(scene), "%s/scene", folder);
    sg_ctx *ctx = make_context(2);
    assert_int_equal(sg_synth_write(ctx, scene, params), SG_OK);
    sg_ctx_destroy(&ctx);
    return 0;
}

static inline int remove_synth_scene(const char *folder)
{
    char command[64];
    snprintf(command, sizeof(command), "rm -rf %s", folder);
    return system(command);
}

#endif
