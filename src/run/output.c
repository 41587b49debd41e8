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
#include "files.h"
#include "scene/reader.h"

struct sg_output {
    sg_ctx *ctx;
    char *folder, *mark;
    const char *maker;
    int lock;    /* descriptor; -1 = not owned */
    size_t made; /* length of the first folder that was made on the way, 0 = none */
};

#define MARK_BYTES 512
#define TRIES 100   /* while others make and remove the same folder */
#define PATIENCE 50 /* waits of 10 ms for an owner to write its name */

/* The path without links and dots, or that of the nearest folder above that exists. NULL: see
 * errno. */
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

/* Whether the place is the output itself, and holds a scene that its maker made. */
static bool is_own_scene(sg_ctx *ctx, const char *place, const char *output,
                         const struct sg_output_rules *rules)
{
    char *real = rules && rules->makes_scenes ? realpath(output, NULL) : NULL;
    const bool own = real && !strcmp(place, real) && rules->is_own(ctx, output);
    free(real);
    return own;
}

/* Whether ".." follows a folder that is not there: where that leads is not known yet. */
static bool leads_back(const char *path)
{
    char *copy = strdup(path);
    bool missing = false, back = !copy;
    for (char *name = copy; name && *name && !back;) {
        char *end = name + strcspn(name, "/");
        const char after = *end;
        *end = 0;
        back = missing && !strcmp(name, "..");
        missing |= *name && access(copy, F_OK);
        *end = after;
        name = end + (after != 0);
    }
    free(copy);
    return back;
}

/* path: of a new output. rules: of the output, or NULL where it is a file. */
static int refuse_scene_around(sg_ctx *ctx, const char *path, const struct sg_output_rules *rules)
{
    char *place = existing_place(path);
    int code = place ? SG_OK
               : errno == ENOMEM
                   ? sg_no_memory(ctx)
                   : sg_fail(ctx, SG_ERR_INPUT, "%s: cannot find the folder it is in: %s", path,
                             strerror(errno));
    if (!code && leads_back(path))
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found \"..\" after a folder that does not exist, expected the place "
                       "itself",
                       path);
    bool itself = rules && !access(path, F_OK);
    for (char *end = place ? place + strlen(place) : NULL; end && !code;
         end = strrchr(place, '/')) {
        if (end != place)
            *end = 0;
        else
            end[1] = 0; /* the root */
        /* In this order: another process that makes the scene says first whose it is. */
        if (sg_scene_recognised(ctx, place) && !is_own_scene(ctx, place, path, rules))
            code = itself ? sg_fail(ctx, SG_ERR_INPUT, "%s: found a scene, expected a new folder",
                                    path)
                          : sg_fail(ctx, SG_ERR_INPUT,
                                    "%s: found the output in the scene %s, expected a place apart "
                                    "from every scene",
                                    path, place);
        itself = false;
        if (end == place)
            break;
    }
    free(place);
    return code;
}

static int refuse_inputs_inside(sg_ctx *ctx, const char *folder, const char *real,
                                const char *const *inputs)
{
    for (; real && *inputs; inputs++) {
        char *input = realpath(*inputs, NULL);
        const bool inside = input && is_within(input, real);
        free(input);
        if (inside)
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found the output around the input %s, expected a folder apart from "
                           "it",
                           folder, *inputs);
    }
    return 0;
}

static int check_place(sg_ctx *ctx, const char *folder, const struct sg_output_rules *rules)
{
    /* A run continues in its folder. */
    if (rules->resume && rules->is_own && rules->is_own(ctx, folder))
        return 0;
    int code = refuse_scene_around(ctx, folder, rules);
    if (!code && !rules->resume) {
        char *real = realpath(folder, NULL);
        code = refuse_inputs_inside(ctx, folder, real, rules->inputs);
        free(real);
    }
    return code;
}

/* The mark as text; false if it is neither empty nor written by this library. */
static bool read_mark(int fd, char text[MARK_BYTES])
{
    const ssize_t n = pread(fd, text, MARK_BYTES - 1, 0);
    text[n > 0 ? n : 0] = 0;
    return n == 0 || (n > 0 && !strncmp(text, "splatguard ", 11));
}

static bool is_marked(const sg_output *o)
{
    char text[MARK_BYTES], expected[64];
    const int fd = open(o->mark, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    snprintf(expected, sizeof(expected), "splatguard %s\n", o->maker);
    const bool marked =
        fd >= 0 && read_mark(fd, text) && !strncmp(text, expected, strlen(expected));
    if (fd >= 0)
        close(fd);
    return marked;
}

/* The name of the other owner of the lock. A new owner may not have written its name yet, and a
 * killed one may have left its own. */
static int owner_error(const sg_output *o, int fd)
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
        return sg_fail(o->ctx, SG_ERR_INPUT, "%s: in use by %s, %s", o->folder, text, owner);
    return sg_fail(o->ctx, SG_ERR_INPUT, "%s: in use by another process", o->folder);
}

static void write_mark(const sg_output *o, bool owned)
{
    char text[MARK_BYTES], host[256] = "", when[32] = "";
    const time_t now = time(NULL);
    struct tm utc;
    gethostname(host, sizeof(host) - 1);
    strftime(when, sizeof(when), "%Y-%m-%d %H:%M:%S UTC", gmtime_r(&now, &utc));
    int n = snprintf(text, sizeof(text), "splatguard %s\n", o->maker);
    if (owned)
        n += snprintf(text + n, sizeof(text) - (size_t) n, "process %ld on %s since %s\n",
                      (long) getpid(), host, when);
    /* On a full disk there is no text, but still a lock. */
    if (pwrite(o->lock, text, (size_t) n, 0) != n || ftruncate(o->lock, n))
        return;
}

#define RETRY 1

/* One try. RETRY where somebody removed the folder or the mark in the meantime. */
static int try_lock(sg_output *o)
{
    size_t made;
    char text[MARK_BYTES];
    struct stat st, named;
    int code = sg_dir_make(o->ctx, o->folder, &made);
    if (code)
        return code;
    o->made = o->made ? o->made : made;
    const int fd = open(o->mark, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
    if (fd < 0 && errno == ENOENT)
        return RETRY;
    if (fd < 0)
        return sg_fail(o->ctx, SG_ERR_INPUT, "%s: cannot write: %s", o->mark, strerror(errno));
    if (fstat(fd, &st) || !S_ISREG(st.st_mode) || st.st_nlink > 1)
        code = sg_fail(o->ctx, SG_ERR_INPUT,
                       "%s: found a link, folder or device, expected the mark of an output folder",
                       o->mark);
    else if (flock(fd, LOCK_EX | LOCK_NB)) {
        if (errno == EWOULDBLOCK)
            code = owner_error(o, fd);
        else
            sg_log(o->ctx, SG_LOG_WARN,
                   "%s: cannot lock it: %s; nothing keeps a second process out", o->folder,
                   strerror(errno));
    }
    if (!code && (fstat(fd, &st) || stat(o->mark, &named) || st.st_ino != named.st_ino ||
                  st.st_dev != named.st_dev))
        code = RETRY;
    if (!code && !read_mark(fd, text))
        code = sg_fail(o->ctx, SG_ERR_INPUT,
                       "%s: found a file that splatguard did not make, expected its mark", o->mark);
    if (code)
        close(fd);
    else
        o->lock = fd;
    return code;
}

/* Checks the contents of the folder. Files of others are never touched; the caller decides about
 * files that the command made. */
static int check_content(const sg_output *o, const struct sg_output_rules *rules)
{
    if (rules->resume || !sg_run_has_files(o->folder))
        return 0;
    const bool own = is_marked(o) || (rules->is_own && rules->is_own(o->ctx, o->folder));
    if (own && (o->lock < 0 || rules->replace || rules->adds ||
                (rules->is_lost && rules->is_lost(o->ctx, o->folder))))
        return 0;
    if (own && rules->earlier)
        return sg_fail(o->ctx, SG_ERR_INPUT,
                       "%s: found an earlier %s, expected a new folder, or to continue or replace "
                       "what is there",
                       o->folder, rules->earlier);
    return sg_fail(o->ctx, SG_ERR_INPUT,
                   "%s: found other files, which `%s` does not replace, expected a new or empty "
                   "folder",
                   o->folder, rules->maker);
}

static int refuse_links(sg_ctx *ctx, const char *folder, const char *name)
{
    char *path;
    const int code = sg_path_below(ctx, folder, name, &path);
    sg_free(path);
    return code;
}

int sg_output_claim_by(sg_ctx *ctx, const char *folder, const struct sg_output_rules *rules,
                       sg_output **out)
{
    sg_clear_error(ctx);
    sg_output *o = *out = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*o));
    if (!o)
        return SG_ERR_BUDGET;
    *o = (sg_output){.ctx = ctx,
                     .lock = -1,
                     .maker = rules->maker,
                     .folder = sg_strdup(ctx, folder),
                     .mark = sg_strf(ctx, "%s/" SG_OUTPUT_MARK, folder)};
    int code = o->folder && o->mark ? SG_OK : SG_ERR_BUDGET, tried = RETRY;
    if (!code && !rules->nested)
        code = check_place(ctx, folder, rules);
    if (!code)
        code = check_content(o, rules);
    for (int i = 0; i < TRIES && !code && tried == RETRY; i++)
        tried = try_lock(o);
    if (!code && tried == RETRY)
        tried = sg_fail(ctx, SG_ERR_INPUT, "%s: cannot write: others keep removing it", folder);
    code = code ? code : tried;
    if (!code)
        code = check_content(o, rules);
    if (!code && rules->within)
        code = refuse_links(ctx, folder, rules->within);
    if (!code)
        write_mark(o, true);
    else
        sg_output_release(out);
    return code;
}

int sg_output_claim(sg_ctx *ctx, const char *folder, const char *maker, bool adds,
                    const char *const *inputs, sg_output **out)
{
    struct sg_output_rules rules = {.maker = maker, .adds = adds};
    for (int i = 0; i < 2 && inputs && inputs[i]; i++)
        rules.inputs[i] = inputs[i];
    return sg_output_claim_by(ctx, folder, &rules, out);
}

void sg_output_release(sg_output **output)
{
    sg_output *o = output ? *output : NULL;
    if (!o)
        return;
    if (o->lock >= 0) {
        char text[MARK_BYTES];
        /* The mark is removed under the lock: whoever opened it before sees that it is gone, and
         * starts again. */
        if (!sg_run_has_files(o->folder) || (read_mark(o->lock, text) && !*text))
            unlink(o->mark);
        else if (is_marked(o))
            write_mark(o, false);
        close(o->lock);
    }
    if (o->folder)
        sg_dir_unmake(o->folder, o->made);
    sg_free(o->folder);
    sg_free(o->mark);
    sg_free(o);
    *output = NULL;
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

int sg_output_check_replaced(sg_ctx *ctx, const char *path)
{
    struct stat st;
    sg_clear_error(ctx);
    if (lstat(path, &st)) /* there is no file, or writing will report the error */
        return SG_OK;
    if (!S_ISREG(st.st_mode))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: cannot write: found a link, folder or device, expected a file", path);
    if (!is_own_file(path))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found an existing file, expected a new name: only pictures and pages "
                       "that splatguard made are replaced",
                       path);
    return SG_OK;
}

int sg_output_check_file(sg_ctx *ctx, const char *path)
{
    if (!*path)
        return sg_fail(ctx, SG_ERR_INPUT, "output: found an empty name, expected that of a file");
    const char *slash = strrchr(path, '/');
    char *folder = slash == path ? sg_strdup(ctx, "/")
                   : slash       ? sg_strf(ctx, "%.*s", (int) (slash - path), path)
                                 : sg_strdup(ctx, ".");
    int code = folder ? sg_output_check_replaced(ctx, path) : SG_ERR_BUDGET;
    if (!code && access(folder, W_OK | X_OK))
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: cannot write to the folder %s: %s", path, folder,
                       strerror(errno));
    if (!code)
        code = refuse_scene_around(ctx, folder, NULL);
    sg_free(folder);
    return code;
}
