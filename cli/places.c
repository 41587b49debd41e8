/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes and folders that a command line names. */
#include <sys/stat.h>

#include "commands.h"

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

bool is_folder(const char *path)
{
    struct stat st;
    return !stat(path, &st) && S_ISDIR(st.st_mode);
}

bool is_same(const char *a, const char *b)
{
    struct stat x, y;
    return !stat(a, &x) && !stat(b, &y) && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}
