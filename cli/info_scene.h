/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_INFO_SCENE_H
#define CLI_INFO_SCENE_H

#include "commands.h"

/* Loads the scene with its test views apart and prints what is in it. Returns an exit code. */
int info_scene(sg_ctx *ctx, const char *path, struct sg_scene_params params, bool json);

#endif
