/* SPDX-License-Identifier: Apache-2.0 */
#include "run_log.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "run_folder.h"

#define LOG_BYTES (UINT64_C(1) << 30)
#define LINE_BYTES 65536 /* ours have a few hundred */

/* Lines to keep go to kept, if there is one. *found: whether there is a log. */
static int each_line(const char *path, run_log_take take, void *arg, FILE *kept, bool *found)
{
    FILE *in = run_open(path, LOG_BYTES);
    char *line = NULL;
    size_t room = 0;
    *found = in;
    if (!in)
        return errno == ENOENT ? 0 : run_cannot("read", path);
    for (ssize_t n; (n = getline(&line, &room, in)) > 0;) {
        json_t *value = n > LINE_BYTES ? NULL : json_loads(line, 0, NULL);
        if (value && take(arg, value) && kept)
            fputs(line, kept);
        json_decref(value);
    }
    fclose(in);
    free(line);
    return 0;
}

int run_log_read(const char *path, run_log_take take, void *arg)
{
    bool found;
    return each_line(path, take, arg, NULL, &found);
}

/* What was killed may have logged beyond its checkpoint: those iterations will be done and logged again. */
static int trim(const char *path, run_log_take take, void *arg)
{
    char *kept = NULL;
    size_t size = 0;
    bool found;
    FILE *out = open_memstream(&kept, &size);
    if (!out)
        return 4;
    int code = each_line(path, take, arg, out, &found);
    if (fclose(out))
        code = 4;
    if (!code && found)
        code = run_write_file(path, kept, size);
    free(kept);
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
