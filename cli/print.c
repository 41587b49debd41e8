/* SPDX-License-Identifier: Apache-2.0 */
/* The tool's output: text and JSON. */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"

void make_printable(char *text)
{
    char *to = text;
    for (const char *c = text; *c;)
        to += sg_take_printable(&c, to);
    *to = 0;
}

void say(FILE *to, const char *format, ...)
{
    char *text = NULL;
    va_list args;
    va_start(args, format);
    const int n = vasprintf(&text, format, args);
    va_end(args);
    for (char *line = text; n >= 0 && line;) {
        char *end = strchr(line, '\n');
        if (end)
            *end = 0;
        make_printable(line);
        if (end)
            *end++ = '\n';
        line = end;
    }
    if (n >= 0)
        fputs(text, to);
    free(text);
}

/* Nobody reads the other end of a pipe any more. */
static bool is_reader_gone(void)
{
    struct pollfd out = {.fd = STDOUT_FILENO, .events = POLLOUT};
    return poll(&out, 1, 0) == 1 && out.revents & POLLERR;
}

int flush_output(int code)
{
    static bool said;
    errno = 0;
    if (!fflush(stdout) && !ferror(stdout))
        return code;
    if (!said && !is_reader_gone())
        say(stderr, "splatguard: standard output: cannot write: %s\n",
            strerror(errno ? errno : EIO));
    said = true;
    return code ? code : STATUS_INPUT;
}

void put_word(FILE *to, const char *text)
{
    fputs(*text == '-' ? "'./" : "'", to);
    for (const char *c = text; *c; c++)
        fputs(*c == '\'' ? "'\\''" : (char[]){*c, 0}, to);
    fputs("'", to);
}

void put_csv_text(FILE *f, const char *text)
{
    const bool quoted = strpbrk(text, ",\"\n\r");
    fputs(quoted ? "\"" : "", f);
    fputs(*text && strchr("=+-@", *text) ? "'" : "", f);
    for (const char *c = text; *c;) {
        char shown[SG_CHARACTER];
        const size_t n = sg_take_printable(&c, shown);
        if (*shown == '"')
            fputc('"', f);
        fwrite(shown, 1, n, f);
    }
    fputs(quoted ? "\"" : "", f);
}

/* Whether a shell takes it as it is. */
static bool is_plain(const char *text)
{
    static const char plain[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=:,./@%";
    return *text && strspn(text, plain) == strlen(text);
}

void put_short_word(FILE *to, const char *text)
{
    if (is_plain(text))
        fputs(text, to);
    else
        put_word(to, text);
}

void say_resume(const char *command, const char *folder)
{
    char *word = NULL;
    size_t size;
    FILE *out = is_plain(folder) && *folder != '-' ? NULL : open_memstream(&word, &size);
    if (out) {
        put_word(out, folder);
        fclose(out);
    }
    say(stderr, "Continue with: splatguard %s --resume %s\n", command, word ? word : folder);
    free(word);
}

json_t *text_json(const char *text)
{
    json_t *value = json_string(text);
    char *copy = value ? NULL : strdup(text);
    for (char *c = copy; c && *c; c++)
        *c = (unsigned char) *c < 0x80 ? *c : '?';
    value = copy ? json_string(copy) : value;
    free(copy);
    return value;
}

json_t *numbers_json(const double *values, int n)
{
    json_t *list = json_array();
    for (int i = 0; i < n; i++)
        json_array_append_new(list, number_json(values[i]));
    return list;
}

int json_print(json_t *value, int indent)
{
    /* A terminal may take characters from 0x80 to 0x9f for commands, as those that JSON escapes. */
    char *text = json_dumps(value, JSON_INDENT((size_t) indent) | JSON_REAL_PRECISION(8) |
                                       JSON_ENSURE_ASCII);
    json_decref(value);
    if (!text)
        return no_memory();
    for (const char *c = text; *c; c++)
        if (*c == 127) /* only strings can have it */
            fputs("\\u007f", stdout);
        else
            putchar(*c);
    putchar('\n');
    free(text);
    return 0;
}
