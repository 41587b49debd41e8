/* SPDX-License-Identifier: Apache-2.0 */
#include "page.h"

#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"

extern const char page_css[];

void put_escaped(FILE *f, const char *text)
{
    for (const char *c = text; *c;) {
        char shown[SG_CHARACTER];
        const size_t n = sg_take_printable(&c, shown);
        if (strchr("<>&\"'", *shown))
            fprintf(f, "&#%d;", *shown);
        else
            fwrite(shown, 1, n, f);
    }
}

void put_name(FILE *f, const char *text)
{
    json_t *valid = text_json(text);
    put_escaped(f, valid ? json_string_value(valid) : "");
    json_decref(valid);
}

char *base64(const uint8_t *data, size_t n)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char *out = malloc((n + 2) / 3 * 4 + 1), *o = out;
    for (size_t i = 0; i < n && out; i += 3) {
        const unsigned word = (unsigned) data[i] << 16 | (i + 1 < n ? data[i + 1] : 0u) << 8 |
                              (i + 2 < n ? data[i + 2] : 0u);
        for (size_t k = 0; k < 4; k++)
            *o++ = i + k > n ? '=' : digits[word >> (18 - 6 * k) & 63];
    }
    if (out)
        *o = 0;
    return out;
}

void put_page_head(FILE *f, const char *title, bool scripts)
{
    fprintf(f,
            "<!doctype html>\n<html lang=en><head><meta charset=utf-8><meta name=viewport "
            "content=\"width=device-width\">\n<meta http-equiv=Content-Security-Policy "
            "content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:%s\">\n"
            "<meta name=generator content=\"splatguard %s\">\n<title>splatguard: ",
            scripts ? "; script-src 'unsafe-inline'" : "", sg_version());
    put_name(f, title);
    fprintf(f, "</title>\n<style>\n%s</style></head><body>\n<h1>", page_css);
    put_name(f, title);
    fprintf(f, "</h1>\n");
}

void put_bar(FILE *f, double share)
{
    fprintf(f,
            "<td><svg width=200 height=14 viewBox=\"0 0 200 14\" preserveAspectRatio=none "
            "aria-hidden=true><rect width=%.1f height=14 /></svg>\n",
            200 * share);
}

int write_whole(const char *command, const char *path, const void *what,
                int (*put)(FILE *, const void *))
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    char *temporary; /* its name is cut: names have 255 bytes at most */
    if (asprintf(&temporary, "%.*s%.230s.tmp%ld", (int) (name - path), path, name,
                 (long) getpid()) < 0)
        return no_memory();
    unlink(temporary); /* left by a process with the same number, or put there on purpose */
    FILE *f = fopen(temporary, "wxe");
    errno = f ? 0 : errno;
    const int code = f ? put(f, what) : STATUS_DONE;
    const bool whole =
        f && !code && !fflush(f) && !ferror(f) && !fsync(fileno(f)) && !rename(temporary, path);
    const int error = errno;
    if (f)
        fclose(f);
    if (!whole && !code)
        say(stderr, "splatguard %s: %s: cannot write: %s\n", command, path,
            strerror(error ? error : EIO));
    if (!whole)
        unlink(temporary);
    free(temporary);
    return whole ? STATUS_DONE : code ? code : STATUS_INPUT;
}
