/* SPDX-License-Identifier: Apache-2.0 */
#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define DEPTH_MAX 64 /* folders below each other */
#define LINKS_MAX 40 /* on the way to one file, as in the kernel */

bool sg_path_is_inside(const char *path)
{
    if (*path == '/')
        return false;
    for (const char *p = path; p; p = strchr(p, '/')) {
        p += *p == '/';
        if (p[0] == '.' && p[1] == '.' && (p[2] == '/' || !p[2]))
            return false;
    }
    return true;
}

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

/* The name of PATH/NAME. NULL: see errno. */
static const char *name_of(const struct sg_folder *folder, const char *path)
{
    const size_t n = strlen(folder->path);
    const char *name =
        !strncmp(path, folder->path, n) && path[n] == '/' ? path + n + strspn(path + n, "/") : NULL;
    if (name && strlen(name) < PATH_MAX)
        return name;
    errno = name ? ENAMETOOLONG : EXDEV;
    return NULL;
}

/* -1: see errno, EXDEV where the name leads out of the folder. */
static int open_beneath(const struct sg_folder *folder, const char *path, int flags)
{
    const char *name = name_of(folder, path);
    if (!name)
        return -1;
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

/* ---- archives ---- */

#define UNPACKED_LEAST ((uint64_t) 1 << 26) /* bytes that any archive may claim, */
#define UNPACKED_RATIO 100                  /* and for each of its own: photos hardly shrink */

/* What macOS adds to its archives. */
static bool is_extra(const char *name)
{
    return !strncmp(name, "__MACOSX/", 9);
}

/* The folder of all files, or "". */
static char *find_top(sg_ctx *ctx, const struct sg_zip *zip)
{
    const char *first = NULL;
    size_t n = 0;
    for (size_t i = 0; i < zip->count; i++) {
        const char *name = zip->entries[i].name;
        if (is_extra(name))
            continue;
        if (!first) {
            const char *slash = strchr(name, '/');
            first = name, n = slash ? (size_t) (slash - name) + 1 : 0;
        } else if (strncmp(name, first, n))
            n = 0;
    }
    return sg_strf(ctx, "%.*s", (int) n, first ? first : "");
}

/* fd: of a regular file; *out has its path. */
static int open_archive(sg_ctx *ctx, struct sg_folder *out, uint64_t size)
{
    uint64_t claimed = 0;
    if (!(out->zip = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*out->zip))))
        return SG_ERR_BUDGET;
    const int code = sg_zip_open(ctx, out->path, out->fd, size, out->zip);
    if (code)
        return code;
    for (size_t i = 0; i < out->zip->count; i++) {
        const struct sg_zip_entry *e = &out->zip->entries[i];
        if (!sg_path_is_inside(e->name) || strchr(e->name, '\\'))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: zip: found \"%s\", expected names inside the archive", out->path,
                           e->name);
        claimed += e->size;
    }
    if (claimed > UNPACKED_LEAST && claimed / UNPACKED_RATIO > size)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: zip: found files of %llu bytes in an archive of %llu, expected at most "
                       "%d times as many",
                       out->path, (unsigned long long) claimed, (unsigned long long) size,
                       UNPACKED_RATIO);
    out->top = find_top(ctx, out->zip);
    return out->top ? SG_OK : SG_ERR_BUDGET;
}

/* The name of an entry for PATH/NAME, without empty parts and "."; a folder's ends with a slash.
 * False: see errno. */
static bool entry_name(const struct sg_folder *folder, const char *path, bool of_folder,
                       char entry[2 * PATH_MAX])
{
    const char *name = name_of(folder, path);
    if (!name || !sg_path_is_inside(name) || strlen(folder->top) >= PATH_MAX - 1) {
        errno = name ? EXDEV : errno;
        return false;
    }
    char *to = stpcpy(entry, folder->top);
    while (*name) {
        const size_t n = strcspn(name, "/");
        if (n && !(n == 1 && *name == '.')) {
            memcpy(to, name, n);
            to += n;
            *to++ = '/';
        }
        name += n + (name[n] == '/');
    }
    if (!of_folder && to > entry)
        to--;
    *to = 0;
    return true;
}

/* The file at PATH/NAME. NULL: see errno. */
static const struct sg_zip_entry *find_entry(const struct sg_folder *folder, const char *path)
{
    char name[2 * PATH_MAX];
    if (!entry_name(folder, path, false, name))
        return NULL;
    errno = ENOENT;
    return sg_zip_find(folder->zip, name);
}

static bool has_archived_folder(const struct sg_folder *folder, const char *path)
{
    char name[2 * PATH_MAX];
    if (!entry_name(folder, path, true, name))
        return errno == EXDEV;
    const size_t at = sg_zip_from(folder->zip, name);
    return at < folder->zip->count && !strncmp(folder->zip->entries[at].name, name, strlen(name));
}

/* ---- both ---- */

/* Opens the folder or the archive. 0: see errno. */
static int open_place(const char *path, bool *is_archive, uint64_t *size)
{
    struct stat st;
    char mark[2];
    int fd = open(path, O_PATH | O_DIRECTORY | O_CLOEXEC);
    *is_archive = fd < 0 && errno == ENOTDIR;
    if (!*is_archive)
        return fd;
    fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0)
        return fd;
    const ssize_t got = !fstat(fd, &st) && S_ISREG(st.st_mode) ? pread(fd, mark, 2, 0) : 0;
    if (got == 2 && !memcmp(mark, "PK", 2)) {
        *size = (uint64_t) st.st_size;
        return fd;
    }
    const int why = got < 0 ? errno : ENOTDIR;
    close(fd);
    errno = why;
    return -1;
}

int sg_folder_open(sg_ctx *ctx, const char *path, bool follow_links, struct sg_folder *out)
{
    bool is_archive;
    uint64_t size = 0;
    *out = (struct sg_folder){.fd = open_place(path, &is_archive, &size),
                              .follow_links = follow_links};
    char *real = out->fd >= 0 ? realpath(path, NULL) : NULL;
    if (!real) {
        const int why = errno;
        sg_folder_close(out);
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no folder or zip archive: %s", path,
                       strerror(why));
    }
    out->real = sg_strdup(ctx, strcmp(real, "/") ? real : "");
    out->path = sg_strdup(ctx, path);
    free(real);
    int code = out->real && out->path ? SG_OK : SG_ERR_BUDGET;
    if (!code && is_archive)
        code = open_archive(ctx, out, size);
    if (code)
        sg_folder_close(out);
    return code;
}

void sg_folder_close(struct sg_folder *folder)
{
    if (folder->fd >= 0)
        close(folder->fd);
    if (folder->zip)
        sg_zip_close(folder->zip);
    sg_free(folder->zip);
    sg_free(folder->top);
    sg_free(folder->real);
    sg_free(folder->path);
    *folder = (struct sg_folder){.fd = -1};
}

static int failed(sg_ctx *ctx, const struct sg_folder *folder, const char *path)
{
    if (errno != EXDEV)
        return sg_open_failed(ctx, path);
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: found a link or \"..\" that leads out of %s, expected a file inside "
                   "it; follow-links allows it",
                   path, folder->path);
}

int sg_folder_source(sg_ctx *ctx, const struct sg_folder *folder, const char *path,
                     uint64_t max_bytes, struct sg_source *out)
{
    *out = (struct sg_source){.failed = true};
    if (folder->zip) {
        const struct sg_zip_entry *entry = find_entry(folder, path);
        return entry ? sg_zip_source(folder->zip, entry, path, max_bytes, out)
                     : failed(ctx, folder, path);
    }
    const int fd = open_beneath(folder, path, O_RDONLY | O_NONBLOCK);
    FILE *file = fd < 0 ? NULL : sg_regular_stream(fd);
    if (!file)
        return failed(ctx, folder, path);
    const int code = sg_source_of_file(ctx, out, file, path, max_bytes);
    out->owned = true;
    return code;
}

int sg_folder_read(sg_ctx *ctx, const struct sg_folder *folder, const char *path,
                   uint64_t max_bytes, char **data, size_t *size)
{
    struct sg_source in;
    *data = NULL;
    int code = sg_folder_source(ctx, folder, path, max_bytes, &in);
    if (!code)
        code = sg_source_read(ctx, &in, data, size);
    sg_source_close(&in);
    return code;
}

bool sg_folder_leads_out(const struct sg_folder *folder, const char *path)
{
    if (folder->zip)
        return !find_entry(folder, path) && errno == EXDEV;
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
    return folder->zip ? find_entry(folder, path) || errno == EXDEV : has(folder, path, S_IFREG);
}

bool sg_folder_has_folder(const struct sg_folder *folder, const char *path)
{
    return folder->zip ? has_archived_folder(folder, path) : has(folder, path, S_IFDIR);
}

/* Entries are sorted, so that those of one folder follow each other. */
static int each_archived(const struct sg_folder *folder, int (*entry)(void *arg, const char *name),
                         void *arg)
{
    const size_t top = strlen(folder->top);
    char name[PATH_MAX], last[PATH_MAX] = "";
    int code = SG_OK;
    for (size_t i = 0; i < folder->zip->count && !code; i++) {
        const char *whole = folder->zip->entries[i].name;
        const size_t n = is_extra(whole) ? 0 : strcspn(whole + top, "/");
        if (!n || n >= sizeof(name))
            continue;
        memcpy(name, whole + top, n);
        name[n] = 0;
        if (!strcmp(name, last))
            continue;
        strcpy(last, name);
        code = entry(arg, name);
    }
    return code;
}

int sg_folder_each(sg_ctx *ctx, const struct sg_folder *folder,
                   int (*entry)(void *arg, const char *name), void *arg)
{
    if (folder->zip)
        return each_archived(folder, entry, arg);
    const int fd = openat(folder->fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *d = fd < 0 ? NULL : fdopendir(fd);
    if (!d) {
        const int why = errno;
        if (fd >= 0)
            close(fd);
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found a folder that cannot be listed: %s",
                       folder->path, strerror(why));
    }
    int code = SG_OK;
    errno = 0;
    for (struct dirent *e; !code && (e = readdir(d)); errno = 0)
        if (strcmp(e->d_name, ".") && strcmp(e->d_name, ".."))
            code = entry(arg, e->d_name);
    if (!code && errno)
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: the folder cannot be read: %s", folder->path,
                       strerror(errno));
    closedir(d);
    return code;
}
