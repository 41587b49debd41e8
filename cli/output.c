/* SPDX-License-Identifier: Apache-2.0 */
#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "core/file.h"
#include "run_folder.h"
#include "scene/reader.h"

#define MARK ".splatguard"
#define MARK_BYTES 512
#define TRIES 100   /* while others make and remove the same folder */
#define PATIENCE 50 /* times 10 ms, until an owner has written who it is */

/* The path without links and dots, or that of the nearest folder above that exists. NULL without
 * memory. */
static char *existing_place(const char *path)
{
    char *copy = strdup(path), *found = copy ? realpath(copy, NULL) : NULL;
    while (copy && !found) {
        char *slash = strrchr(copy, '/');
        if (slash == copy)
            slash[1] = 0;
        else if (slash)
            *slash = 0;
        found = realpath(slash ? copy : ".", NULL);
        if (!slash || slash == copy)
            break;
    }
    free(copy);
    return found;
}

static bool is_within(const char *path, const char *folder)
{
    const size_t n = strlen(folder);
    return !strncmp(path, folder, n) && (path[n] == '/' || !path[n] || n == 1);
}

/* path: of a new output. own: the output itself, which may be a scene that the tool made, or
 * NULL. */
static int refuse_scene_around(sg_ctx *ctx, const char *path, const char *own)
{
    char *place = existing_place(path);
    int code = place ? 0 : no_memory();
    for (char *end = place ? place + strlen(place) : NULL; end && !code;
         end = strrchr(place, '/')) {
        if (end != place)
            *end = 0;
        else
            end[1] = 0; /* the root */
        if ((!own || strcmp(place, own)) && sg_scene_recognised(ctx, place)) {
            say(stderr,
                "splatguard: %s: found the output in the scene %s, expected a place apart from "
                "every scene\n",
                path, place);
            code = 2;
        }
        if (end == place)
            break;
    }
    free(place);
    return code;
}

static int refuse_inputs_inside(const char *folder, const char *real, const char *const *inputs)
{
    for (; real && *inputs; inputs++) {
        char *input = realpath(*inputs, NULL);
        const bool inside = input && is_within(input, real);
        free(input);
        if (inside) {
            say(stderr,
                "splatguard: %s: found the output around the input %s, expected a folder apart "
                "from it\n",
                folder, *inputs);
            return 2;
        }
    }
    return 0;
}

static int check_place(sg_ctx *ctx, const char *folder, const struct output_rules *rules)
{
    char *real = realpath(folder, NULL);
    const bool own = real && rules->is_own && rules->is_own(folder);
    /* What was begun there goes on there, and a scene that the tool made is replaced as a whole. */
    int code = rules->resume && own
                   ? 0
                   : refuse_scene_around(ctx, folder, own && rules->makes_scenes ? real : NULL);
    if (!code && !rules->resume)
        code = refuse_inputs_inside(folder, real, rules->inputs);
    free(real);
    return code;
}

/* The mark as text; false where it is neither empty nor one of ours. */
static bool read_mark(int fd, char text[MARK_BYTES])
{
    const ssize_t n = pread(fd, text, MARK_BYTES - 1, 0);
    text[n > 0 ? n : 0] = 0;
    return n == 0 || (n > 0 && !strncmp(text, "splatguard ", 11));
}

static bool is_marked(const struct output *o)
{
    char text[MARK_BYTES], expected[64];
    const int fd = open(o->mark, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    snprintf(expected, sizeof(expected), "splatguard %s\n", o->command);
    const bool marked =
        fd >= 0 && read_mark(fd, text) && !strncmp(text, expected, strlen(expected));
    if (fd >= 0)
        close(fd);
    return marked;
}

/* Who else holds the lock. An owner that has just begun has not written that yet, and an earlier
 * one that was killed may have left its own name. */
static int say_owner(const struct output *o, int fd)
{
    char text[MARK_BYTES], host[256] = "", here[256] = "";
    long pid = 0;
    const struct timespec pause = {.tv_nsec = 10000000};
    gethostname(here, sizeof(here) - 1);
    const char *owner = NULL;
    for (int i = 0; i < PATIENCE && !owner; i++) {
        const bool ours = read_mark(fd, text);
        char *end = strchr(text, '\n');
        if (ours && end && sscanf(end + 1, "process %ld on %255s", &pid, host) == 2 &&
            strchr(end + 1, '\n') &&
            (strcmp(host, here) || !kill((pid_t) pid, 0) || errno == EPERM)) {
            *end = 0;
            owner = end + 1;
            end[1 + strcspn(owner, "\n")] = 0;
        } else
            nanosleep(&pause, NULL);
    }
    if (owner)
        say(stderr, "splatguard: %s: in use by %s, %s\n", o->folder, text, owner);
    else
        say(stderr, "splatguard: %s: in use by another process\n", o->folder);
    return 2;
}

static void write_mark(const struct output *o, bool owned)
{
    char text[MARK_BYTES], host[256] = "", when[32] = "";
    const time_t now = time(NULL);
    struct tm utc;
    gethostname(host, sizeof(host) - 1);
    strftime(when, sizeof(when), "%Y-%m-%d %H:%M:%S UTC", gmtime_r(&now, &utc));
    int n = snprintf(text, sizeof(text), "splatguard %s\n", o->command);
    if (owned)
        n += snprintf(text + n, sizeof(text) - (size_t) n, "process %ld on %s since %s\n",
                      (long) getpid(), host, when);
    /* On a full disk there is no text, but still a lock. */
    if (pwrite(o->lock, text, (size_t) n, 0) != n || ftruncate(o->lock, n))
        return;
}

/* One try. Returns an exit code, or -1 where somebody removed the folder or the mark in the
 * meantime. */
static int try_lock(struct output *o, sg_ctx *ctx)
{
    size_t made;
    char text[MARK_BYTES];
    struct stat st, named;
    sg_clear_error(ctx);
    const int error = sg_dir_make(ctx, o->folder, &made);
    if (error)
        return report(ctx, error);
    o->made = o->made ? o->made : made;
    const int fd = open(o->mark, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
    if (fd < 0)
        return errno == ENOENT ? -1 : run_cannot("write", o->mark);
    int code = 0;
    if (fstat(fd, &st) || !S_ISREG(st.st_mode) || st.st_nlink > 1) {
        say(stderr,
            "splatguard: %s: found a link, folder or device, expected the mark of an output "
            "folder\n",
            o->mark);
        code = 2;
    } else if (flock(fd, LOCK_EX | LOCK_NB)) {
        if (errno == EWOULDBLOCK)
            code = say_owner(o, fd);
        else
            say(stderr, "warning: %s: cannot lock it: %s; nothing keeps a second process out\n",
                o->folder, strerror(errno));
    }
    if (!code && (fstat(fd, &st) || stat(o->mark, &named) || st.st_ino != named.st_ino ||
                  st.st_dev != named.st_dev))
        code = -1;
    if (!code && !read_mark(fd, text)) {
        say(stderr,
            "splatguard: %s: found a file that splatguard did not make, expected its mark\n",
            o->mark);
        code = 2;
    }
    if (code)
        close(fd);
    else
        o->lock = fd;
    return code;
}

/* What is in the folder: other people's files are left alone, what the command made is for the
 * owner to judge. */
static int check_content(const struct output *o, const struct output_rules *rules)
{
    if (rules->resume || !run_has_other_files(o->folder))
        return 0;
    const bool own = is_marked(o) || (rules->is_own && rules->is_own(o->folder));
    if (own && (o->lock < 0 || rules->force || rules->adds ||
                (rules->is_lost && rules->is_lost(o->folder))))
        return 0;
    if (own && rules->earlier)
        say(stderr,
            "splatguard: %s: found an earlier %s; continue it with --resume or replace it with "
            "--force\n",
            o->folder, rules->earlier);
    else
        say(stderr,
            "splatguard: %s: found other files, which `splatguard %s` does not replace, expected a "
            "new or empty folder\n",
            o->folder, rules->command);
    return 2;
}

static int refuse_links(sg_ctx *ctx, const char *folder, const char *name)
{
    char *path;
    sg_clear_error(ctx);
    const int error = sg_path_below(ctx, folder, name, &path);
    sg_free(path);
    return error ? report(ctx, error) : 0;
}

int output_claim(struct output *o, sg_ctx *ctx, const char *folder,
                 const struct output_rules *rules)
{
    *o = (struct output) OUTPUT_NONE;
    o->command = rules->command;
    o->folder = strdup(folder);
    o->mark = run_path(folder, MARK);
    int code = o->folder && o->mark ? 0 : no_memory();
    if (!code && !rules->nested)
        code = check_place(ctx, folder, rules);
    if (!code)
        code = check_content(o, rules);
    int tried = -1;
    for (int i = 0; i < TRIES && !code && tried < 0; i++)
        tried = try_lock(o, ctx);
    if (!code && tried < 0) {
        say(stderr, "splatguard: %s: cannot write: others keep removing it\n", folder);
        code = 2;
    }
    code = code ? code : tried;
    if (!code)
        code = check_content(o, rules);
    if (!code && rules->within)
        code = refuse_links(ctx, folder, rules->within);
    if (!code)
        write_mark(o, true);
    if (code)
        output_release(o);
    return code;
}

/* Removes the folders that were made, as far as they are empty. */
static void remove_made(const struct output *o)
{
    for (size_t n = strlen(o->folder); o->made && n >= o->made; n--)
        if (!o->folder[n] || o->folder[n] == '/') {
            o->folder[n] = 0;
            if (rmdir(o->folder))
                break;
        }
}

void output_release(struct output *o)
{
    if (o->lock >= 0) {
        char text[MARK_BYTES];
        /* The mark is removed under the lock: whoever opened it before sees that it is gone, and
         * starts again. */
        if (!run_has_other_files(o->folder) || (read_mark(o->lock, text) && !*text))
            unlink(o->mark);
        else if (is_marked(o))
            write_mark(o, false);
        close(o->lock);
    }
    if (o->folder)
        remove_made(o);
    free(o->folder);
    free(o->mark);
    *o = (struct output) OUTPUT_NONE;
}

/* Whether the beginning of the file says that the tool made it: see sg_image_write_picture and
 * audit_report. */
static bool is_own_file(const char *path)
{
    static const char png[] = "tEXtSoftware\0splatguard",
                      page[] = "<meta name=generator content=\"splatguard ";
    char head[1024];
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    const ssize_t n = fd < 0 ? -1 : pread(fd, head, sizeof(head), 0);
    if (fd >= 0)
        close(fd);
    return n > 0 && (memmem(head, (size_t) n, png, sizeof(png) - 1) ||
                     memmem(head, (size_t) n, page, sizeof(page) - 1));
}

int output_check_replaced(const char *path)
{
    struct stat st;
    if (lstat(path, &st)) /* nothing there, or writing says what is wrong */
        return 0;
    if (!S_ISREG(st.st_mode))
        say(stderr,
            "splatguard: %s: cannot write: found a link, folder or device, expected a file\n",
            path);
    else if (!is_own_file(path))
        say(stderr,
            "splatguard: %s: found a file that splatguard did not make, expected a new name\n",
            path);
    else
        return 0;
    return 2;
}

int output_check_file(sg_ctx *ctx, const char *path)
{
    const char *slash = strrchr(path, '/');
    char *folder = slash == path ? strdup("/")
                   : slash       ? strndup(path, (size_t) (slash - path))
                                 : strdup(".");
    int code = folder ? output_check_replaced(path) : no_memory();
    if (!code)
        code = refuse_scene_around(ctx, folder, NULL);
    free(folder);
    return code;
}
