/* SPDX-License-Identifier: Apache-2.0 */
#include "file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "source.h"

const char *sg_base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

FILE *sg_regular_stream(int fd)
{
    struct stat st;
    FILE *f = NULL;
    if (!fstat(fd, &st)) {
        if (S_ISREG(st.st_mode))
            f = fdopen(fd, "rb");
        else
            errno = EINVAL;
    }
    if (!f) {
        const int why = errno;
        close(fd);
        errno = why;
    }
    return f;
}

/* Never waits for a pipe's writer. */
static FILE *open_regular(const char *path)
{
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    return fd < 0 ? NULL : sg_regular_stream(fd);
}

/* There is nothing or a regular file: renaming would replace /dev/null. */
static bool is_replaceable(const char *path)
{
    struct stat st;
    return stat(path, &st) || S_ISREG(st.st_mode);
}

/* Does not follow a link of that name. NULL: see errno. */
static FILE *open_temporary(const char *path)
{
    unlink(path); /* left by a process with the same number, or put there on purpose */
    return fopen(path, "wbxe");
}

/* 0, or the errno of the first write that failed. */
static int sync_stream(FILE *stream)
{
    const int before = errno; /* of the write that failed, if one did */
    const int why = fflush(stream) ? errno : ferror(stream) ? before ? before : EIO : 0;
    return fsync(fileno(stream)) && !why ? errno : why;
}

/* Syncs, closes and renames. False: see errno. */
static bool finish_temporary(FILE *stream, const char *temporary, const char *path)
{
    int why = sync_stream(stream);
    if (fclose(stream) && !why)
        why = errno;
    if (!why && rename(temporary, path))
        why = errno;
    errno = why; /* the first cause: what fails after it says less */
    return !why;
}

/* Bytes of a file's name that its temporary file has too: what is left of 255 is for the ending. */
#define TEMPORARY_NAME 230

int sg_file_create(sg_ctx *ctx, struct sg_file_writer *w, const char *path)
{
    *w = (struct sg_file_writer){0};
    if (!is_replaceable(path))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: cannot write: found a folder or device, expected a file", path);
    const char *name = sg_base_name(path);
    w->path = sg_strdup(ctx, path);
    /* Long names are cut, so that two of them could have one temporary file at the same time. */
    static atomic_uint_least32_t files;
    const uint64_t number = (uint64_t) atomic_fetch_add(&files, 1) << 24 | (uint64_t) getpid();
    w->temporary = sg_strf(ctx, "%.*s%.*s.tmp%llu", (int) (name - path), path, TEMPORARY_NAME, name,
                           (unsigned long long) number);
    if (!w->path || !w->temporary) {
        sg_file_abandon(w);
        return SG_ERR_BUDGET;
    }
    w->stream = open_temporary(w->temporary);
    if (!w->stream) {
        int code = sg_fail(ctx, SG_ERR_INPUT, "%s: cannot write: %s", path, strerror(errno));
        sg_free(w->temporary); /* nothing was made that would have to be removed */
        w->temporary = NULL;
        sg_file_abandon(w);
        return code;
    }
    return SG_OK;
}

void sg_remove_temporary(DIR *folder, bool (*is_own)(const char *name))
{
    for (struct dirent *e; (e = readdir(folder));) {
        char name[NAME_MAX + 1];
        const char *ending = strrchr(e->d_name, '.');
        const size_t digits =
            ending && !strncmp(ending, ".tmp", 4) ? strspn(ending + 4, "0123456789") : 0;
        if (!digits || ending[4 + digits])
            continue;
        snprintf(name, sizeof(name), "%.*s", (int) (ending - e->d_name), e->d_name);
        if (is_own(name))
            unlinkat(dirfd(folder), e->d_name, 0);
    }
}

int sg_file_sync(sg_ctx *ctx, const struct sg_file_writer *w)
{
    const int why = sync_stream(w->stream);
    return why ? sg_fail(ctx, SG_ERR_INPUT, "%s: cannot write: %s", w->path, strerror(why)) : SG_OK;
}

int sg_file_commit(sg_ctx *ctx, struct sg_file_writer *w)
{
    const bool done = finish_temporary(w->stream, w->temporary, w->path);
    w->stream = NULL;
    int code = SG_OK;
    if (!done)
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: cannot write: %s", w->path, strerror(errno));
    else {
        sg_free(w->temporary);
        w->temporary = NULL;
    }
    sg_file_abandon(w);
    return code;
}

void sg_file_abandon(struct sg_file_writer *w)
{
    if (w->stream)
        fclose(w->stream);
    if (w->temporary)
        unlink(w->temporary);
    sg_free(w->temporary);
    sg_free(w->path);
    *w = (struct sg_file_writer){0};
}

int sg_file_write(sg_ctx *ctx, const char *path, const void *data, size_t size)
{
    struct sg_file_writer w;
    int code = sg_file_create(ctx, &w, path);
    if (code)
        return code;
    fwrite(data, 1, size, w.stream);
    return sg_file_commit(ctx, &w);
}

void sg_put_int(FILE *to, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        putc((int) (value >> 8 * i & 255), to);
}

void sg_put_real(FILE *to, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof(bits));
    sg_put_int(to, bits, sizeof(bits));
}

int sg_open_failed(sg_ctx *ctx, const char *path)
{
    return errno == EINVAL
               ? sg_fail(ctx, SG_ERR_INPUT, "%s: found a folder or device, expected a file", path)
               : sg_fail(ctx, SG_ERR_INPUT, "%s: cannot read: %s", path, strerror(errno));
}

int sg_file_open(sg_ctx *ctx, const char *path, FILE **out)
{
    *out = open_regular(path);
    return *out ? SG_OK : sg_open_failed(ctx, path);
}

int sg_file_read(sg_ctx *ctx, const char *path, uint64_t max_bytes, char **data, size_t *size)
{
    struct sg_source in;
    *data = NULL;
    int code = sg_source_open(ctx, &in, path, max_bytes);
    if (!code)
        code = sg_source_read(ctx, &in, data, size);
    sg_source_close(&in);
    return code;
}

bool sg_file_exists(const char *path)
{
    struct stat st;
    return !stat(path, &st) && S_ISREG(st.st_mode);
}

bool sg_dir_exists(const char *path)
{
    struct stat st;
    return !stat(path, &st) && S_ISDIR(st.st_mode);
}

void sg_dir_unmake(char *path, size_t made)
{
    for (size_t n = strlen(path); made && n >= made; n--)
        if (!path[n] || path[n] == '/') {
            path[n] = 0;
            rmdir(path); /* where it is empty */
        }
}

#define MAKE_TRIES 100

int sg_dir_make(sg_ctx *ctx, const char *path, size_t *made)
{
    *made = 0;
    if (!*path)
        return sg_fail(ctx, SG_ERR_USAGE, "found an empty path, expected that of a folder");
    char *copy = sg_strdup(ctx, path);
    if (!copy)
        return SG_ERR_BUDGET;
    int code = SG_OK, tries = 0;
    for (char *p = copy + 1; !code;) {
        if (*p && *p != '/') {
            p++;
            continue;
        }
        const char kept = *p;
        *p = 0;
        if (!mkdir(copy, 0777))
            *made = *made ? *made : (size_t) (p - copy);
        else if (errno == ENOENT &&
                 tries++ < MAKE_TRIES) { /* it has been removed since the last look */
            *p = kept;
            p = copy + 1;
            continue;
        } else if (errno != EEXIST)
            code = sg_fail(ctx, SG_ERR_INPUT, "%s: cannot create the folder: %s", copy,
                           strerror(errno));
        else if (!sg_dir_exists(copy))
            code = sg_fail(ctx, SG_ERR_INPUT, "%s: found something else, expected a folder", copy);
        if (!kept || code)
            break;
        *p++ = kept;
    }
    char *slash = code ? strrchr(copy, '/') : NULL;
    if (slash) { /* the folders above it go again */
        *slash = 0;
        sg_dir_unmake(copy, *made);
    }
    *made = code ? 0 : *made;
    sg_free(copy);
    return code;
}

int sg_dir_create(sg_ctx *ctx, const char *path)
{
    size_t made;
    return sg_dir_make(ctx, path, &made);
}

int sg_path_below(sg_ctx *ctx, const char *folder, const char *name, char **out)
{
    char *path = *out = sg_strf(ctx, "%s/%s", folder, name);
    int code = path ? SG_OK : SG_ERR_BUDGET;
    for (char *slash = path ? strchr(path + strlen(folder) + 1, '/') : NULL; slash && !code;
         slash = strchr(slash + 1, '/')) {
        struct stat st;
        *slash = 0;
        if (!lstat(path, &st) && S_ISLNK(st.st_mode))
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: found a link, expected a folder of the output's own", path);
        *slash = '/';
    }
    return code;
}
