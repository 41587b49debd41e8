/* SPDX-License-Identifier: Apache-2.0 */
#include "run_log.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/file.h"
#include "run_folder.h"

#define LOG_BYTES (UINT64_C(1) << 32)
#define LINE_BYTES 65536 /* ours have a few hundred */

/* The bytes of the next line, or as many as there is room for; -1 at the end. A log may come from a
 * stranger. */
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

/* Lines to keep go to kept, if there is one. */
static int each_line(FILE *in, const char *path, run_log_take take, void *arg, FILE *kept)
{
    char *line = malloc(LINE_BYTES);
    for (long n; line && (n = next_line(in, line)) >= 0;) {
        json_t *value = json_loadb(line, (size_t) n, 0, NULL);
        if (value && take(arg, value) && kept)
            fwrite(line, 1, (size_t) n, kept); /* errors surface at the end */
        json_decref(value);
    }
    free(line);
    return !line ? no_memory() : ferror(in) ? run_cannot("read", path) : 0;
}

/* *in is NULL where there is no log. */
static int open_log(const char *path, FILE **in)
{
    *in = run_open(path, LOG_BYTES);
    return *in || errno == ENOENT ? 0 : run_cannot("read", path);
}

int run_log_read(const char *path, run_log_take take, void *arg)
{
    FILE *in;
    int code = open_log(path, &in);
    if (in) {
        code = each_line(in, path, take, arg, NULL);
        fclose(in);
    }
    return code;
}

/* What was killed may have logged beyond its checkpoint: those iterations will be done and logged
 * again. */
static int trim(const char *path, run_log_take take, void *arg)
{
    FILE *in;
    char *temporary = NULL;
    int code = open_log(path, &in);
    if (!in)
        return code;
    FILE *out = asprintf(&temporary, "%s.tmp%ld", path, (long) getpid()) > 0
                    ? sg_temporary_open(temporary)
                    : NULL;
    code = out ? each_line(in, path, take, arg, out) : run_cannot("write", path);
    fclose(in);
    if (out && code) {
        fclose(out);
        unlink(temporary);
    } else if (out && !sg_temporary_finish(out, temporary, path)) {
        code = run_cannot("write", path);
        unlink(temporary);
    }
    free(temporary);
    return code;
}

/* Through no link, and a pipe without a reader does not hold it up. */
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

int run_log_open(const char *path, run_log_take take, void *arg, FILE **log)
{
    const int code = take ? trim(path, take, arg) : 0;
    if (!code && !(*log = open_to_write(path, take)))
        return run_cannot("write", path);
    return code;
}

int run_log_line(FILE *log, const char *path, json_t *line)
{
    char *text = json_dumps(line, JSON_COMPACT | JSON_REAL_PRECISION(8));
    errno = 0;
    const bool bad = !text || fprintf(log, "%s\n", text) < 0 || fflush(log);
    free(text);
    json_decref(line);
    return bad ? run_cannot("write", path) : 0;
}
