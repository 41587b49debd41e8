/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes and folders that a command line names. */
#include <errno.h>
#include <limits.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "commands.h"

bool folder_of(const char *path, char *out, size_t size)
{
    const char *slash = strrchr(path, '/');
    return snprintf(out, size, "%.*s", slash ? (int) (slash - path) + 1 : 2, slash ? path : "./") <
           (int) size;
}

bool is_below(const char *path, const char *folder)
{
    const size_t n = strlen(folder);
    return !strncmp(path, folder, n) && (!path[n] || path[n] == '/' || folder[n - 1] == '/');
}

int take_scene(const struct command *c, const char *place, const char **source)
{
    if (*source) {
        say(stderr, "splatguard %s: found two scenes, %s and --source-path %s, expected one\n",
            c->name, place, *source);
        return STATUS_USAGE;
    }
    *source = place;
    return STATUS_DONE;
}

int refuse_second(const struct command *c, bool resume, const char *const *positional)
{
    if (resume)
        say(stderr,
            "splatguard %s: --resume: found \"%s\" and \"%s\", expected one folder; -s SCENE names "
            "the place of a scene that has moved\n",
            c->name, positional[0], positional[1]);
    else
        say(stderr, "splatguard %s: unexpected argument \"%s\"\n", c->name, positional[1]);
    return STATUS_USAGE;
}

void say_moved(const char *scene)
{
    if (scene && access(scene, F_OK))
        say(stderr, "this is where the scene was; if it has moved, name its place with -s "
                    "SCENE\n");
}

bool is_folder(const char *path)
{
    struct stat st;
    return !stat(path, &st) && S_ISDIR(st.st_mode);
}

bool is_run_folder(const char *path)
{
    static const char *const marks[] = {"config.json", "cfg_args", "point_cloud"};
    char mark[PATH_MAX];
    for (size_t i = 0; i < sizeof(marks) / sizeof(marks[0]); i++)
        if (snprintf(mark, sizeof(mark), "%s/%s", path, marks[i]) < (int) sizeof(mark) &&
            !access(mark, F_OK))
            return true;
    return false;
}

bool is_scene(const char *path)
{
    const size_t n = strlen(path);
    const bool archive = n > 4 && !strcasecmp(path + n - 4, ".zip");
    return archive || (is_folder(path) && !is_run_folder(path));
}

const struct sg_view *scene_view(const struct sg_scene *scene, size_t i)
{
    return i < scene->n_train ? &scene->train[i] : &scene->test[i - scene->n_train];
}

bool is_same(const char *a, const char *b)
{
    struct stat x, y;
    return !stat(a, &x) && !stat(b, &y) && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

int own_program(const struct command *c, char *path, size_t size)
{
    const ssize_t n = readlink("/proc/self/exe", path, size - 1);
    path[n > 0 ? n : 0] = 0;
    if (n > 0)
        return STATUS_DONE;
    say(stderr, "splatguard %s: cannot find this program: /proc/self/exe: %s\n", c->name,
        strerror(errno));
    return STATUS_INTERNAL;
}

int missing(const struct command *c, const char *what)
{
    say(stderr, "splatguard %s: missing %s; usage: splatguard %s %s\n", c->name, what, c->name,
        c->arguments);
    return STATUS_USAGE;
}

int check_iteration(const struct command *c, const char *model, int iteration)
{
    if (!iteration || is_folder(model))
        return STATUS_DONE;
    say(stderr, "splatguard %s: --iteration: found with the model %s, expected a run's folder\n",
        c->name, model);
    return STATUS_USAGE;
}

int choose_format(const struct command *c, const char *out, enum sg_model_format *format)
{
    if (*format == SG_MODEL_AUTO)
        *format = sg_model_format_of(out);
    if (*format == SG_MODEL_AUTO)
        say(stderr,
            "splatguard %s: %s: found no known ending, expected .ply, .compressed.ply, .splat, "
            ".spz, .sog or .glb%s\n",
            c->name, out, c == &command_convert ? ", or --format" : "");
    else if (*format == SG_MODEL_KSPLAT)
        say(stderr, "splatguard %s: %s: found format %s, which is only read\n", c->name, out,
            sg_model_format_name(*format));
    else
        return STATUS_DONE;
    return STATUS_USAGE;
}
