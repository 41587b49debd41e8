/* SPDX-License-Identifier: Apache-2.0 */
#include "folder.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define DEPTH_MAX 64 /* folders below each other */
#define LINKS_MAX 40 /* on the way to one file, as in the kernel */

/* The state of a walk: all folders from the root down, each opened, and the rest of the name. ".."
 * returns to a folder on this stack, not to wherever that folder may have been moved. */
struct walk {
    const struct sg_folder *root;
    int stack[DEPTH_MAX], depth, links;
    char rest[PATH_MAX];
};

static int here(const struct walk *w)
{
    return w->depth ? w->stack[w->depth - 1] : w->root->fd;
}

static void leave(struct walk *w)
{
    close(w->stack[--w->depth]);
}

/* The rest of an absolute target below the root, NULL if it leads elsewhere. */
static const char *below_root(const struct walk *w, const char *target)
{
    const size_t n = strlen(w->root->real);
    return !strncmp(target, w->root->real, n) && (target[n] == '/' || !target[n]) ? target + n
                                                                                  : NULL;
}

/* Puts the target of the link NAME before what is left. False: see errno. */
static bool expand_link(struct walk *w, const char *name, const char *left)
{
    char target[PATH_MAX], whole[PATH_MAX];
    const ssize_t n = readlinkat(here(w), name, target, sizeof(target) - 1);
    if (n < 0)
        return false;
    target[n] = 0;
    const char *from = target;
    if (*target == '/') {
        if (!(from = below_root(w, target))) {
            errno = EXDEV;
            return false;
        }
        while (w->depth)
            leave(w);
    }
    const int length = snprintf(whole, sizeof(whole), "%s/%s", from, left);
    if (++w->links > LINKS_MAX || length >= (int) sizeof(whole)) {
        errno = ELOOP;
        return false;
    }
    memcpy(w->rest, whole, (size_t) length + 1);
    return true;
}

/* Goes down into a folder that was opened. */
static bool enter(struct walk *w, int fd)
{
    if (w->depth == DEPTH_MAX) {
        close(fd);
        errno = ELOOP;
        return false;
    }
    w->stack[w->depth++] = fd;
    return true;
}

static bool is_link(int fd)
{
    struct stat st;
    return !fstat(fd, &st) && S_ISLNK(st.st_mode);
}

/* One part of the name. Returns the descriptor of the last one, else -1: errno is 0 where the walk
 * goes on. */
static int walk_part(struct walk *w, int flags)
{
    char name[PATH_MAX], left[PATH_MAX];
    const char *start = w->rest + strspn(w->rest, "/"), *end = start + strcspn(start, "/");
    const size_t n = (size_t) (end - start);
    memcpy(name, start, n);
    name[n] = 0;
    strcpy(left, end + strspn(end, "/")); /* w->rest changes */
    const bool up = !strcmp(name, ".."), last = !*left;
    if (up && !w->depth) {
        errno = EXDEV;
        return -1;
    }
    if (up)
        leave(w);
    if (up || !n || !strcmp(name, ".")) {
        strcpy(w->rest, left);
        errno = 0;
        return last ? openat(here(w), ".", flags | O_CLOEXEC) : -1;
    }
    const int fd =
        openat(here(w), name, (last ? flags : O_PATH | O_DIRECTORY) | O_NOFOLLOW | O_CLOEXEC);
    const int why = errno;
    if (fd >= 0 && last && !((flags & O_PATH) && is_link(fd))) /* O_PATH opens a link itself */
        return fd;
    if (fd >= 0 && !last) {
        strcpy(w->rest, left);
        if (enter(w, fd))
            errno = 0;
        return -1;
    }
    if (fd >= 0)
        close(fd);
    if (expand_link(w, name, left))
        errno = 0;
    else if (errno == EINVAL) /* it is no link */
        errno = why;
    return -1;
}

/* -1: see errno, EXDEV where the name leads out of the folder. */
static int open_beneath(const struct sg_folder *folder, const char *path, int flags)
{
    const size_t n = strlen(folder->path);
    const char *name =
        !strncmp(path, folder->path, n) && path[n] == '/' ? path + n + strspn(path + n, "/") : NULL;
    if (!name || strlen(name) >= PATH_MAX) {
        errno = name ? ENAMETOOLONG : EXDEV;
        return -1;
    }
    if (folder->follow_links)
        return openat(folder->fd, name, flags | O_CLOEXEC);
    struct walk w = {.root = folder};
    strcpy(w.rest, name);
    int fd;
    do
        fd = walk_part(&w, flags);
    while (fd < 0 && !errno);
    const int why = errno;
    while (w.depth)
        leave(&w);
    errno = why;
    return fd;
}

int sg_folder_open(sg_ctx *ctx, const char *path, bool follow_links, struct sg_folder *out)
{
    *out = (struct sg_folder){.fd = open(path, O_PATH | O_DIRECTORY | O_CLOEXEC),
                              .follow_links = follow_links};
    char *real = out->fd >= 0 ? realpath(path, NULL) : NULL;
    if (!real) {
        const int why = errno;
        sg_folder_close(out);
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no folder: %s", path, strerror(why));
    }
    out->real = sg_strdup(ctx, strcmp(real, "/") ? real : "");
    out->path = sg_strdup(ctx, path);
    free(real);
    if (out->real && out->path)
        return SG_OK;
    sg_folder_close(out);
    return SG_ERR_BUDGET;
}

void sg_folder_close(struct sg_folder *folder)
{
    if (folder->fd >= 0)
        close(folder->fd);
    sg_free(folder->real);
    sg_free(folder->path);
    *folder = (struct sg_folder){.fd = -1};
}

int sg_folder_file(sg_ctx *ctx, const struct sg_folder *folder, const char *path, FILE **out)
{
    const int fd = open_beneath(folder, path, O_RDONLY | O_NONBLOCK);
    *out = fd < 0 ? NULL : sg_regular_stream(fd);
    if (!*out && errno == EXDEV)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a link or \"..\" that leads out of %s, expected a file inside "
                       "it; follow-links allows it",
                       path, folder->path);
    return *out ? SG_OK : sg_open_failed(ctx, path);
}

int sg_folder_read(sg_ctx *ctx, const struct sg_folder *folder, const char *path,
                   uint64_t max_bytes, char **data, size_t *size)
{
    FILE *f;
    *data = NULL;
    int code = sg_folder_file(ctx, folder, path, &f);
    if (!code) {
        code = sg_stream_read(ctx, f, path, max_bytes, data, size);
        fclose(f);
    }
    return code;
}

bool sg_folder_leads_out(const struct sg_folder *folder, const char *path)
{
    const int fd = open_beneath(folder, path, O_PATH);
    if (fd >= 0)
        close(fd);
    return fd < 0 && errno == EXDEV;
}

static bool has(const struct sg_folder *folder, const char *path, mode_t kind)
{
    struct stat st;
    const int fd = open_beneath(folder, path, O_PATH);
    if (fd < 0)
        return errno == EXDEV;
    const bool found = !fstat(fd, &st) && (st.st_mode & S_IFMT) == kind;
    close(fd);
    return found;
}

bool sg_folder_has(const struct sg_folder *folder, const char *path)
{
    return has(folder, path, S_IFREG);
}

bool sg_folder_has_folder(const struct sg_folder *folder, const char *path)
{
    return has(folder, path, S_IFDIR);
}
