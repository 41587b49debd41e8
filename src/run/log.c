/* SPDX-License-Identifier: Apache-2.0 */
#include "files.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/file.h"

#define LOG_BYTES (UINT64_C(1) << 32)
#define LINE_BYTES 65536 /* the library's lines have a few hundred bytes */

/* The bytes of the next line, or as many as there is room for; -1 at the end. A log is untrusted.
 */
static long next_line(FILE *in, char *line)
{
    long n = 0;
    int c;
    while ((c = getc_unlocked(in)) != EOF) {
        if (n < LINE_BYTES)
            line[n++] = (char) c;
        if (c == '\n')
            return n;
    }
    return n ? n : -1;
}

/* Writes the lines to keep to `kept`, if it is not NULL. */
static int each_line(sg_ctx *ctx, FILE *in, const char *path, sg_run_log_take take, void *arg,
                     FILE *kept)
{
    char *line = sg_alloc_raw(ctx, SG_MEM_MISC, LINE_BYTES, 1);
    for (long n; line && (n = next_line(in, line)) >= 0;) {
        json_t *value = json_loadb(line, (size_t) n, 0, NULL);
        if (value && take(arg, value) && kept) { /* errors are reported at the end */
            fwrite(line, 1, (size_t) n, kept);
            if (line[n - 1] != '\n') /* the last one of a file that was cut off there */
                fputc('\n', kept);
        }
        json_decref(value);
    }
    sg_free(line);
    if (line && ferror(in))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: cannot read: %s", path, strerror(errno));
    return line ? SG_OK : SG_ERR_BUDGET;
}

/* *in is NULL where there is no log. */
static int open_log(sg_ctx *ctx, const char *path, FILE **in)
{
    struct stat st;
    *in = NULL;
    if (access(path, F_OK) && errno == ENOENT)
        return SG_OK;
    int code = sg_file_open(ctx, path, in);
    if (!code && (fstat(fileno(*in), &st) || (uint64_t) st.st_size > LOG_BYTES)) {
        fclose(*in);
        *in = NULL;
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: cannot read: %s", path, strerror(EFBIG));
    }
    return code;
}

int sg_run_log_read(sg_ctx *ctx, const char *path, sg_run_log_take take, void *arg)
{
    FILE *in;
    int code = open_log(ctx, path, &in);
    if (in) {
        code = each_line(ctx, in, path, take, arg, NULL);
        fclose(in);
    }
    return code;
}

/* A killed process may have logged iterations after its checkpoint. They will be done and logged
 * again. */
static int trim(sg_ctx *ctx, const char *path, sg_run_log_take take, void *arg)
{
    FILE *in;
    struct sg_file_writer out;
    int code = open_log(ctx, path, &in);
    if (!in)
        return code;
    code = sg_file_create(ctx, &out, path);
    if (!code)
        code = each_line(ctx, in, path, take, arg, out.stream);
    if (!code)
        code = sg_file_commit(ctx, &out);
    sg_file_abandon(&out);
    fclose(in);
    return code;
}

/* Follows no link, and does not wait for the reader of a pipe. */
static FILE *open_to_write(const char *path, bool append)
{
    const int how =
        O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | (append ? O_APPEND : O_TRUNC);
    const int fd = open(path, how, 0666);
    struct stat st;
    FILE *f = NULL;
    if (fd >= 0 && !fstat(fd, &st) && !S_ISREG(st.st_mode))
        errno = EINVAL;
    else if (fd >= 0)
        f = fdopen(fd, append ? "ab" : "wb");
    if (fd >= 0 && !f)
        close(fd);
    return f;
}

int sg_run_log_open(sg_ctx *ctx, const char *run, const char *name, sg_run_log_take take,
                    sg_run_log_fill fill, void *arg, struct sg_run_log *log)
{
    *log = (struct sg_run_log){
        .ctx = ctx, .path = sg_strf(ctx, "%s/%s", run, name), .fill = fill, .arg = arg};
    int code = !log->path ? SG_ERR_BUDGET : take ? sg_run_check_inside(ctx, run, name) : SG_OK;
    if (!code && take)
        code = trim(ctx, log->path, take, arg);
    if (!code && !(log->stream = open_to_write(log->path, take)))
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: cannot write: %s", log->path, strerror(errno));
    return code;
}

static int write_line(struct sg_run_log *log, json_t *line)
{
    char *text = line ? json_dumps(line, JSON_COMPACT | JSON_REAL_PRECISION(8)) : NULL;
    errno = 0;
    const bool bad = !text || fprintf(log->stream, "%s\n", text) < 0 || fflush(log->stream);
    const int why = errno ? errno : EIO;
    free(text);
    json_decref(line);
    return bad ? sg_fail(log->ctx, SG_ERR_INPUT, "%s: cannot write: %s", log->path, strerror(why))
               : SG_OK;
}

int sg_run_log_set(const struct sg_run_log *log, json_t *line, json_t *values)
{
    const bool bad = !values || json_object_update(line, values);
    json_decref(values);
    return bad ? sg_fail(log->ctx, SG_ERR_BUDGET, "%s: no memory for a line", log->path) : SG_OK;
}

int sg_run_log_settle(struct sg_run_log *log, bool wait)
{
    int code = SG_OK, n = 0;
    for (bool known = true; n < log->late_count && known && !code;) {
        const struct sg_run_late *late = &log->late[n];
        code = log->fill(log->arg, late->line, late->view, wait, &known);
        if (!code && !known && wait)
            code =
                sg_fail(log->ctx, SG_ERR_INTERNAL, "%s: the values of a line are lost", log->path);
        if (!code && known) {
            code = write_line(log, late->line);
            n++;
        }
    }
    for (int k = n; k < log->late_count && code; k++)
        json_decref(log->late[k].line);
    log->late_count = code ? 0 : log->late_count - n;
    memmove(log->late, log->late + n, (size_t) log->late_count * sizeof(log->late[0]));
    return code;
}

int sg_run_log_line(struct sg_run_log *log, json_t *line)
{
    const int code = sg_run_log_settle(log, true);
    if (code)
        json_decref(line);
    return code ? code : write_line(log, line);
}

int sg_run_log_later(struct sg_run_log *log, json_t *line, uint64_t view)
{
    int code = line ? SG_OK : write_line(log, line); /* no memory, which that reports */
    if (!code)
        code = sg_run_log_settle(log, log->late_count == SG_RUN_LATE);
    if (code) {
        json_decref(line);
        return code;
    }
    log->late[log->late_count++] = (struct sg_run_late){line, view};
    return SG_OK;
}

int sg_run_log_close(struct sg_run_log *log)
{
    int code = SG_OK;
    for (int k = 0; k < log->late_count; k++) /* of a run that failed */
        json_decref(log->late[k].line);
    errno = 0;
    const bool failed = log->stream && ferror(log->stream);
    if (log->stream && (fclose(log->stream) || failed))
        code = sg_fail(log->ctx, SG_ERR_INPUT, "%s: cannot write: %s", log->path,
                       errno ? strerror(errno) : "lines are missing");
    sg_free(log->path);
    *log = (struct sg_run_log){0};
    return code;
}
