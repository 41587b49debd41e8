/* SPDX-License-Identifier: Apache-2.0 */
#include "run_log.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/file.h"
#include "run_folder.h"

#define LINE_BYTES 65536 /* ours have a few hundred */

/* The next line, or an empty one in the place of one that is too long: a log may come from a stranger. */
static char *next_line(FILE *in, char *line)
{
    if (!fgets(line, LINE_BYTES, in))
        return NULL;
    if (!strchr(line, '\n') && !feof(in)) {
        for (int c = 0; c != '\n' && c != EOF;)
            c = fgetc(in);
        *line = 0;
    }
    return line;
}

/* Lines to keep go to kept, if there is one. */
static int each_line(FILE *in, run_log_take take, void *arg, FILE *kept)
{
    char *line = malloc(LINE_BYTES);
    while (line && next_line(in, line)) {
        json_t *value = json_loads(line, 0, NULL);
        if (value && take(arg, value) && kept)
            fputs(line, kept); /* errors surface at the end */
        json_decref(value);
    }
    const int code = line ? 0 : 4;
    free(line);
    return code;
}

/* *in is NULL where there is no log. */
static int open_log(const char *path, FILE **in)
{
    *in = run_open(path, UINT64_MAX);
    return *in || errno == ENOENT ? 0 : run_cannot("read", path);
}

int run_log_read(const char *path, run_log_take take, void *arg)
{
    FILE *in;
    int code = open_log(path, &in);
    if (in) {
        code = each_line(in, take, arg, NULL);
        fclose(in);
    }
    return code;
}

/* What was killed may have logged beyond its checkpoint: those iterations will be done and logged again. */
static int trim(const char *path, run_log_take take, void *arg)
{
    FILE *in;
    char *temporary = NULL;
    int code = open_log(path, &in);
    if (!in)
        return code;
    FILE *out = asprintf(&temporary, "%s.tmp%ld", path, (long) getpid()) > 0 ? sg_temporary_open(temporary) : NULL;
    code = out ? each_line(in, take, arg, out) : run_cannot("write", path);
    fclose(in);
    if (out && !sg_temporary_finish(out, temporary, path)) {
        code = run_cannot("write", path);
        unlink(temporary);
    }
    free(temporary);
    return code;
}

/* Through no link, and a pipe without a reader does not hold it up. */
static FILE *open_to_write(const char *path, bool append)
{
    const int how = O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | (append ? O_APPEND : O_TRUNC);
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
