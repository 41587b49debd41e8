/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_COMMANDS_H
#define CLI_COMMANDS_H

#include "exit_status.h"
#include "options.h"
#include "splatguard/splatguard.h"

extern const struct command command_train, command_eval, command_render, command_synth,
    command_info, command_attack, command_compare, command_spectrum, command_audit;

/* What scenes and threads need, shared by the commands that load one. */
struct scene_options {
    struct sg_scene_params params;
    int format; /* index of SCENE_FORMATS, which are in the order of enum sg_scene_format */
};
#define ENGINES "cpu|ref"
#define SCENE_FORMATS "auto|blender|colmap|nerfstudio"
#define SCENE_OPTION_DEFAULTS .params = {SG_SCENE_DEFAULTS}

/* The scene rows of an option table; `scene_` is the `struct scene_options` member of `config`.
 * Those that every command with a scene has, and those that `attack` words otherwise. */
#define SCENE_PLACE_ROWS(config, scene_, transient_)                                               \
    CHOICE_ROW("format", offsetof(config, scene_.format), SCENE_FORMATS, "FORMAT",                 \
               "Layout of the scene folder.", .transient = transient_),                            \
        TEXT_ROW("images", offsetof(config, scene_.params.images), "DIR",                          \
                 "COLMAP: image folder below the scene, e.g. images_4.", .letter = 'i',            \
                 .transient = transient_),                                                         \
        NUMBER_ROW("resolution", OPT_INT, offsetof(config, scene_.params.resolution), -1, 16384,   \
                   "R",                                                                            \
                   "1, 2, 4, 8 divide the size; -1 limits the width to 1600; other numbers are "   \
                   "the target width.",                                                            \
                   .letter = 'r', .nonzero = true, .transient = transient_)
#define SCENE_LENS_ROWS(config, scene_, transient_)                                                \
    FLAG_ROW("centred-principal", offsetof(config, scene_.params.centred_principal),               \
             "Ignore cx and cy, as the reference does.", .transient = transient_),                 \
        TEXT_ROW(                                                                                  \
            "masks", offsetof(config, scene_.params.masks), "DIR",                                 \
            "Folder of masks inside the scene's, white = use; found by itself if called masks.",   \
            .transient = transient_),                                                              \
        FLAG_ROW("follow-links", offsetof(config, scene_.params.follow_links),                     \
                 "Follow symbolic links that lead out of the scene's folder.", .transient = true), \
        FLAG_ROW(                                                                                  \
            "strict", offsetof(config, scene_.params.strict),                                      \
            "Refuse a scene with missing photos, or photos at another scale than their camera.",   \
            .transient = true)
#define SCENE_OPTIONS(config, scene_, transient_)                                                  \
    GROUP_ROW("Scene"), SCENE_PLACE_ROWS(config, scene_, transient_),                              \
        NUMBER_ROW("downscale", OPT_DOUBLE, offsetof(config, scene_.params.downscale), 1, 64, "F", \
                   "Divides the image size further.", .transient = transient_),                    \
        FLAG_ROW("white-background", offsetof(config, scene_.params.white_background),             \
                 "White instead of black behind transparent images (not COLMAP's) and renders.",   \
                 .letter = 'w', .transient = transient_),                                          \
        NUMBER_ROW("test-every", OPT_INT, offsetof(config, scene_.params.test_every), 2, 1000000,  \
                   "N", "COLMAP, nerfstudio: every N-th view by name is a test view.",             \
                   .transient = transient_),                                                       \
        SCENE_LENS_ROWS(config, scene_, transient_)

/* Of every command that reads files which may come from a stranger. */
#define MEMORY_ROW(config, field)                                                                  \
    NUMBER_ROW("max-memory", OPT_BYTES, offsetof(config, field), 0, 9e15, "BYTES",                 \
               "Most memory of the process; 0 = no limit.", .transient = true)

/* Where the audit's verdict means little. */
void warn_small_photos(const struct sg_scene *scene);

/* The scene that a command line names by its place, unless another option names one too. Returns an
 * exit code. */
int take_scene(const struct command *c, const char *place, const char **source);

/* How to go on with what was interrupted, for a shell. */
void say_resume(const char *command, const char *folder);

/* Says that the command itself could not allocate something small; returns the exit code 3. */
int no_memory(void);

/* Prints and releases a value, on one line or indented. Returns an exit code. */
int json_print(json_t *value, int indent);
json_t *numbers_json(const double *values, int n);

/* The same file or folder under any name. */
bool is_same(const char *a, const char *b);

/* Prints the last error; returns its exit code. */
int report(const sg_ctx *ctx, int error);

/* The same for a check of parameters, whose error names a value as its option is named. */
int report_option(const sg_ctx *ctx, const char *command, int error);

/* A context that logs warnings to stderr (info too unless quiet). Returns an exit code. */
int open_context(sg_ctx **ctx, int threads, uint64_t max_memory, bool quiet);

/* --cpu, else SG_CPU, else NULL. */
const char *cpu_variant(const char *option);

/* MODEL.ply, or the point_cloud of an iteration (0 = the newest) of a run folder, as text the
 * caller frees. NULL after printing what is wrong. */
char *find_model(const char *path, int iteration);

#endif
