/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_COMMANDS_H
#define CLI_COMMANDS_H

#include "options.h"
#include "splatguard/splatguard.h"

extern const struct command command_train, command_eval, command_render, command_synth, command_info, command_attack,
    command_compare, command_spectrum, command_audit;

/* What scenes and threads need, shared by the commands that load one. */
struct scene_options {
    struct sg_scene_params params;
    int format; /* index of SCENE_FORMATS, which are in the order of enum sg_scene_format */
};
#define BACKENDS "cpu|ref"
#define SCENE_FORMATS "auto|blender|colmap|nerfstudio"
#define SCENE_OPTION_DEFAULTS .params = {SG_SCENE_DEFAULTS}

/* The scene rows of an option table; `scene_` is the `struct scene_options` member of `config`. */
#define SCENE_OPTIONS(config, scene_, transient_)                                                                      \
    {"Scene", 0, OPT_GROUP, 0, 0, 0, NULL, NULL, NULL, false}, {"format",                                              \
                                                                0,                                                     \
                                                                OPT_CHOICE,                                            \
                                                                offsetof(config, scene_.format),                       \
                                                                0,                                                     \
                                                                0,                                                     \
                                                                SCENE_FORMATS,                                         \
                                                                "FORMAT",                                              \
                                                                "Layout of the scene folder.",                         \
                                                                transient_},                                           \
        {"images",                                                                                                     \
         'i',                                                                                                          \
         OPT_STRING,                                                                                                   \
         offsetof(config, scene_.params.images),                                                                       \
         0,                                                                                                            \
         0,                                                                                                            \
         NULL,                                                                                                         \
         "DIR",                                                                                                        \
         "COLMAP: image folder below the scene, e.g. images_4.",                                                       \
         transient_},                                                                                                  \
        {"resolution",                                                                                                 \
         'r',                                                                                                          \
         OPT_INT,                                                                                                      \
         offsetof(config, scene_.params.resolution),                                                                   \
         -1,                                                                                                           \
         16384,                                                                                                        \
         NULL,                                                                                                         \
         "R",                                                                                                          \
         "1, 2, 4, 8 divide the size; -1 limits the width to 1600; other numbers are the target width.",               \
         transient_},                                                                                                  \
        {"downscale", 0,    OPT_DOUBLE, offsetof(config, scene_.params.downscale), 1,                                  \
         64,          NULL, "F",        "Divides the image size further.",         transient_},                        \
        {"white-background",                                                                                           \
         'w',                                                                                                          \
         OPT_FLAG,                                                                                                     \
         offsetof(config, scene_.params.white_background),                                                             \
         0,                                                                                                            \
         0,                                                                                                            \
         NULL,                                                                                                         \
         NULL,                                                                                                         \
         "White instead of black behind transparent images and renders.",                                              \
         transient_},                                                                                                  \
        {"test-every",                                                                                                 \
         0,                                                                                                            \
         OPT_INT,                                                                                                      \
         offsetof(config, scene_.params.test_every),                                                                   \
         2,                                                                                                            \
         1000000,                                                                                                      \
         NULL,                                                                                                         \
         "N",                                                                                                          \
         "COLMAP, nerfstudio: every N-th view by name is a test view.",                                                \
         transient_},                                                                                                  \
        {"centred-principal",                                                                                          \
         0,                                                                                                            \
         OPT_FLAG,                                                                                                     \
         offsetof(config, scene_.params.centred_principal),                                                            \
         0,                                                                                                            \
         0,                                                                                                            \
         NULL,                                                                                                         \
         NULL,                                                                                                         \
         "Ignore cx and cy, as the reference does.",                                                                   \
         transient_},                                                                                                  \
    {                                                                                                                  \
        "masks", 0, OPT_STRING, offsetof(config, scene_.params.masks), 0, 0, NULL, "DIR",                              \
            "Folder of masks inside the scene's, white = use; found by itself if called masks.", transient_            \
    }

/* Where the audit's verdict means little. */
void warn_small_photos(const struct sg_scene *scene);

/* How to go on with what was interrupted, for a shell. */
void say_resume(const char *command, const char *folder);

/* Exit code for a library error: 1 usage, 2 input, 3 budget, 4 internal, 130 interrupted. */
int exit_code(int error);

/* Says that the command itself could not allocate something small; returns the exit code 3. */
int no_memory(void);

/* Prints the last error; returns its exit code. */
int report(const sg_ctx *ctx, int error);

/* A context that logs warnings to stderr (info too unless quiet). Returns an exit code. */
int open_context(sg_ctx **ctx, int threads, uint64_t max_memory, bool quiet);

/* --cpu, else SG_CPU, else NULL. */
const char *cpu_variant(const char *option);

/* MODEL.ply, or the point_cloud of an iteration (0 = the newest) of a run folder, as text the caller frees. NULL after
 * printing what is wrong. */
char *find_model(const char *path, int iteration);

#endif
