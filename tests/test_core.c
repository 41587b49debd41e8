/* SPDX-License-Identifier: Apache-2.0 */
/* The ledger, files that appear whole, and random numbers. */
#include <dirent.h>
#include <errno.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/file.h"
#include "core/context.h"
#include "models.h"
#include "splatguard/engine.h"

static sg_ctx *limited(int threads, uint64_t bytes)
{
    sg_ctx *ctx;
    assert_int_equal(
        sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = threads, .max_memory = bytes}),
        SG_OK);
    return ctx;
}

static void test_ledger_counts(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    unsigned char *a = sg_alloc(ctx, SG_MEM_MODEL, 1000, 3),
                  *b = sg_alloc_raw(ctx, SG_MEM_FRAME, 5000, 1);
    assert_non_null(a);
    assert_non_null(b);
    assert_int_equal((uintptr_t) a % 64, 0);
    assert_int_equal((uintptr_t) b % 64, 0);
    for (int i = 0; i < 3000; i++)
        assert_int_equal(a[i], 0);
    const uint64_t model = sg_mem_current(ctx, SG_MEM_MODEL),
                   frame = sg_mem_current(ctx, SG_MEM_FRAME);
    assert_true(model >= 3000 && model < 3000 + 256);
    assert_true(frame >= 5000 && frame < 5000 + 256);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_MISC), 0);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), model + frame);
    sg_free(a);
    sg_free(NULL);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_MODEL), 0);
    assert_int_equal(sg_mem_peak(ctx, SG_MEM_MODEL), model);
    sg_free(b);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    assert_int_equal(sg_mem_peak(ctx, SG_MEM_TAGS), model + frame);
    sg_ctx_destroy(&ctx);
    assert_null(ctx);
}

/* Objects are destroyed without a context: each is credited to the ledger that was charged for
 * it. */
static void test_ledger_owns(void **state)
{
    (void) state;
    sg_ctx *a = limited(1, 1 << 20), *b = limited(1, 1 << 20);
    struct sg_model *of_a, *of_b;
    assert_int_equal(sg_model_create(a, 100, 0, &of_a), SG_OK);
    const uint64_t held = sg_mem_current(a, SG_MEM_MODEL), total = sg_mem_current(a, SG_MEM_TAGS);
    assert_int_equal(sg_model_create(b, 1000, 0, &of_b), SG_OK);
    sg_model_destroy(&of_b);
    assert_int_equal(sg_mem_current(a, SG_MEM_MODEL), held);
    assert_int_equal(sg_mem_current(a, SG_MEM_TAGS), total);
    for (int tag = 0; tag <= SG_MEM_TAGS; tag++)
        assert_int_equal(sg_mem_current(b, tag), 0);
    sg_model_destroy(&of_a);
    for (int tag = 0; tag <= SG_MEM_TAGS; tag++)
        assert_int_equal(sg_mem_current(a, tag), 0);
    sg_ctx_destroy(&a);
    sg_ctx_destroy(&b);
}

static void test_ledger_refuses(void **state)
{
    (void) state;
    sg_ctx *ctx = limited(1, 10000);
    void *kept = sg_alloc(ctx, SG_MEM_IMAGES, 6000, 1);
    assert_non_null(kept);
    const uint64_t held = sg_mem_current(ctx, SG_MEM_TAGS), peak = sg_mem_peak(ctx, SG_MEM_TAGS);
    assert_string_equal(sg_last_error(ctx), "");
    assert_null(sg_alloc(ctx, SG_MEM_SPLATS, 5000, 1));
    /* The message says how much, for what, and the limit. */
    assert_non_null(strstr(sg_last_error(ctx), "splats"));
    assert_non_null(strstr(sg_last_error(ctx), "limit 10000"));
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), held);
    assert_int_equal(sg_mem_peak(ctx, SG_MEM_TAGS), peak);
    void *small = sg_alloc(ctx, SG_MEM_SPLATS, 1000, 1);
    assert_non_null(small);
    sg_free(small);
    sg_free(kept);
    sg_ctx_destroy(&ctx);
}

static void test_ledger_overflow(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    const size_t cases[][2] = {
        {SIZE_MAX, 2}, {SIZE_MAX / 4 + 1, 4}, {SIZE_MAX, 1}, {SIZE_MAX / 2, 1}};
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        sg_clear_error(ctx);
        assert_null(sg_alloc(ctx, SG_MEM_MISC, cases[i][0], cases[i][1]));
        assert_true(sg_last_error(ctx)[0] != 0);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        assert_int_equal(sg_mem_peak(ctx, SG_MEM_TAGS), 0);
    }
    int *array = NULL;
    size_t capacity = 0;
    assert_int_equal(sg_grow(ctx, SG_MEM_MISC, &array, &capacity, SIZE_MAX / 2, 0, sizeof(int)),
                     SG_ERR_BUDGET);
    assert_null(array);
    assert_int_equal(capacity, 0);
    sg_ctx_destroy(&ctx);
}

static void test_grow(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    int *array = NULL;
    size_t capacity = 0, moves = 0;
    for (size_t n = 1; n <= 10000; n++) {
        const size_t before = capacity;
        assert_int_equal(sg_grow(ctx, SG_MEM_MISC, &array, &capacity, n, n - 1, sizeof(int)),
                         SG_OK);
        assert_true(capacity >= n);
        moves += capacity != before;
        array[n - 1] = (int) n;
    }
    assert_true(moves < 40); /* amortised */
    for (size_t n = 1; n <= 10000; n++)
        assert_int_equal(array[n - 1], n);
    /* Refused while keeping: the old array stays. */
    const size_t before = capacity;
    assert_int_equal(sg_grow(ctx, SG_MEM_MISC, &array, &capacity, SIZE_MAX / 8, 10000, sizeof(int)),
                     SG_ERR_BUDGET);
    assert_int_equal(capacity, before);
    assert_int_equal(array[9999], 10000);
    sg_free(array);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* ---- files ---- */

static char folder[] = "/tmp/sg_core_XXXXXX";

static int make_folder(void **state)
{
    (void) state;
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    (void) state;
    char command[64];
    snprintf(command, sizeof(command), "rm -rf %s", folder);
    return system(command);
}

static void assert_content(sg_ctx *ctx, const char *path, const char *expected)
{
    char *data;
    size_t size;
    assert_int_equal(sg_file_read(ctx, path, 1 << 20, &data, &size), SG_OK);
    assert_int_equal(size, strlen(expected));
    assert_string_equal(data, expected);
    sg_free(data);
}

static int count_files(const char *path)
{
    DIR *d = opendir(path);
    int n = 0;
    assert_non_null(d);
    for (const struct dirent *entry; (entry = readdir(d));)
        n += entry->d_name[0] != '.';
    closedir(d);
    return n;
}

static void test_file_appears_whole(void **state)
{
    (void) state;
    char path[64];
    snprintf(path, sizeof(path), "%s/whole", folder);
    sg_ctx *ctx = make_context(1);
    assert_int_equal(sg_file_write(ctx, path, "first", 5), SG_OK);
    struct sg_file_writer w;
    assert_int_equal(sg_file_create(ctx, &w, path), SG_OK);
    fputs("second, half of", w.stream);
    fflush(w.stream);
    assert_content(ctx, path, "first");
    sg_file_abandon(&w);
    sg_file_abandon(&w);
    assert_content(ctx, path, "first");
    assert_int_equal(sg_file_create(ctx, &w, path), SG_OK);
    fputs("third", w.stream);
    assert_int_equal(sg_file_commit(ctx, &w), SG_OK);
    sg_file_abandon(&w); /* safe after a commit */
    assert_content(ctx, path, "third");
    assert_int_equal(count_files(folder), 1); /* no temporary one */
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

static void test_file_with_a_long_name(void **state)
{
    (void) state;
    char path[512], name[256];
    memset(name, 'n', sizeof(name) - 1);
    name[sizeof(name) - 1] = 0;
    snprintf(path, sizeof(path), "%s/%s", folder, name);
    sg_ctx *ctx = make_context(1);
    assert_int_equal(sg_file_write(ctx, path, "content", 7), SG_OK);
    assert_content(ctx, path, "content");
    sg_ctx_destroy(&ctx);
}

/* A process that dies while writing leaves the old file. */
static void test_file_survives_a_kill(void **state)
{
    (void) state;
    char path[64];
    snprintf(path, sizeof(path), "%s/killed", folder);
    sg_ctx *ctx = make_context(1);
    assert_int_equal(sg_file_write(ctx, path, "old", 3), SG_OK);
    const pid_t child = fork();
    if (child == 0) {
        struct sg_file_writer w;
        if (!sg_file_create(ctx, &w, path)) {
            fputs("new", w.stream);
            fflush(w.stream);
        }
        raise(SIGKILL);
    }
    assert_true(child > 0);
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    assert_content(ctx, path, "old");
    sg_ctx_destroy(&ctx);
}

static void test_file_refusals(void **state)
{
    (void) state;
    char path[64], *data = NULL;
    size_t size;
    sg_ctx *ctx = make_context(1);
    snprintf(path, sizeof(path), "%s/absent", folder);
    assert_int_equal(sg_file_read(ctx, path, 100, &data, &size), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), path));
    assert_int_equal(sg_file_read(ctx, folder, 100, &data, &size), SG_ERR_INPUT);
    snprintf(path, sizeof(path), "%s/large", folder);
    assert_int_equal(sg_file_write(ctx, path, "0123456789", 10), SG_OK);
    assert_int_equal(sg_file_read(ctx, path, 9, &data, &size), SG_ERR_INPUT);
    assert_null(data);
    assert_int_equal(sg_file_read(ctx, path, 10, &data, &size), SG_OK);
    sg_free(data);
    snprintf(path, sizeof(path), "%s/none/file", folder);
    sg_clear_error(ctx);
    assert_int_equal(sg_file_write(ctx, path, "x", 1), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), path));
    snprintf(path, sizeof(path), "%s/pipe", folder); /* neither waited for nor replaced */
    assert_int_equal(mkfifo(path, 0600), 0);
    sg_clear_error(ctx);
    assert_int_equal(sg_file_read(ctx, path, 100, &data, &size), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(ctx), "expected a file"));
    assert_int_equal(sg_file_write(ctx, path, "x", 1), SG_ERR_INPUT);
    assert_false(sg_file_exists(path));
    if (!access("/dev/full", W_OK)) { /* a full disk is noticed at the commit */
        snprintf(path, sizeof(path), "%s/full", folder);
        struct sg_file_writer w;
        const int before = count_files(folder);
        assert_int_equal(sg_file_create(ctx, &w, path), SG_OK);
        FILE *full = freopen("/dev/full", "wb", w.stream);
        assert_ptr_equal(full, w.stream);
        fputs("does not fit", w.stream);
        sg_clear_error(ctx);
        assert_int_equal(sg_file_commit(ctx, &w), SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(ctx), strerror(ENOSPC)));
        assert_int_equal(count_files(folder), before);
    }
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

static void test_folders(void **state)
{
    (void) state;
    char path[96];
    sg_ctx *ctx = make_context(1);
    snprintf(path, sizeof(path), "%s/a/b//c", folder);
    assert_int_equal(sg_dir_create(ctx, path), SG_OK);
    assert_true(sg_dir_exists(path));
    assert_int_equal(sg_dir_create(ctx, path), SG_OK);
    snprintf(path, sizeof(path), "%s/f", folder);
    assert_int_equal(sg_file_write(ctx, path, "", 0), SG_OK);
    snprintf(path, sizeof(path), "%s/f/under", folder);
    assert_int_equal(sg_dir_create(ctx, path), SG_ERR_INPUT);
    sg_clear_error(ctx);
    assert_int_equal(sg_dir_create(ctx, ""), SG_ERR_USAGE);
    sg_ctx_destroy(&ctx);
}

/* ---- errors, parameters, random numbers ---- */

static void test_first_error_wins(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    assert_int_equal(sg_fail(ctx, SG_ERR_INPUT, "first %d", 1), SG_ERR_INPUT);
    assert_int_equal(sg_fail(ctx, SG_ERR_BUDGET, "second"), SG_ERR_INPUT); /* as the message */
    assert_string_equal(sg_last_error(ctx), "first 1");
    sg_clear_error(ctx);
    assert_string_equal(sg_last_error(ctx), "");
    char *text = malloc(5000);
    assert_non_null(text);
    memset(text, 'x', 4999);
    text[4999] = 0;
    sg_fail(ctx, SG_ERR_INPUT, "%s", text); /* cut, not overrun */
    assert_true(strlen(sg_last_error(ctx)) < 5000);
    free(text);
    /* Memory for a caller takes no call's message away. */
    sg_clear_error(ctx);
    sg_fail(ctx, SG_ERR_INPUT, "of a call");
    void *memory = sg_mem_alloc(ctx, SG_MEM_MISC, 1, 1);
    assert_non_null(memory);
    assert_string_equal(sg_last_error(ctx), "of a call");
    sg_mem_free(memory);
    sg_ctx_destroy(&ctx);
}

/* Commands of terminals: below a space, 127, and those from 0x80 on, as bytes and as UTF-8 has
 * them. Other UTF-8 stays, in all lengths; what is none does not. */
static void test_printable(void **state)
{
    (void) state;
    char text[] = "a\033[31m\n\177 \302\233 \303\251 \302";
    sg_make_printable(text);
    assert_string_equal(text, "a?[31m?? ? \303\251 ?");
    char bytes[] = "\23331mx \205\205 \300\257 \355\240\200 \364\220\200\200 \370\210\200\200\200";
    sg_make_printable(bytes);
    assert_string_equal(bytes, "?31mx ?? ?? ??? ???? ?????");
    char good[] = "\n\302\240\337\277\340\240\200\357\277\275\360\220\200\200\364\217\277\277";
    sg_make_printable(good);
    assert_string_equal(
        good, "?\302\240\337\277\340\240\200\357\277\275\360\220\200\200\364\217\277\277");
}

static void test_context_parameters(void **state)
{
    (void) state;
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = -1}), SG_ERR_USAGE);
    assert_null(ctx);
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 257}), SG_ERR_USAGE);
    assert_int_equal(sg_ctx_create(&ctx, NULL), SG_OK);
    assert_true(sg_ctx_threads(ctx) >= 1);
    sg_ctx_destroy(&ctx);
    sg_ctx_destroy(&ctx);
    for (int tag = 0; tag <= SG_MEM_TAGS; tag++)
        assert_true(strlen(sg_mem_tag_name((enum sg_mem_tag) tag)) > 0);
}

static void test_rng_moments(void **state)
{
    (void) state;
    const int n = 200000;
    double mean = 0, square = 0, normal[4] = {0}, lag = 0, previous = 0;
    for (int i = 0; i < n; i++) {
        const double u = (double) sg_rng_uniform(3, SG_RNG_INIT, 1, (uint64_t) i);
        const double g = (double) sg_rng_normal(3, SG_RNG_SPLIT, 1, (uint64_t) i);
        assert_true(u >= 0 && u < 1 && isfinite(g));
        mean += u, square += u * u;
        lag += g * previous, previous = g;
        for (int k = 0; k < 4; k++)
            normal[k] += pow(g, k + 1);
    }
    assert_float_equal(mean / n, 0.5, 0.004);
    assert_float_equal(square / n, 1.0 / 3, 0.004);
    assert_float_equal(normal[0] / n, 0, 0.01);
    assert_float_equal(normal[1] / n, 1, 0.02);
    assert_float_equal(normal[2] / n, 0, 0.05);
    assert_float_equal(normal[3] / n, 3, 0.1);
    assert_float_equal(lag / n, 0, 0.01);
}

static void test_machine_name(void **state)
{
    (void) state;
    char name[256], cut[6] = "#####", line[300], model[256] = "";
    sg_machine_name(name, sizeof(name));
    FILE *f = fopen("/proc/cpuinfo", "r");
    while (f && !*model && fgets(line, sizeof(line), f))
        sscanf(line, "model name : %255[^\n]", model);
    if (f)
        fclose(f);
    if (*model)
        assert_string_equal(name, model);
    assert_true(*name && !strchr(name, '\n'));
    sg_machine_name(cut, 4);
    assert_true(!strncmp(cut, name, 3) && !cut[3] && cut[4] == '#');
}

/* Streams, uses and seeds are different numbers; the values themselves are part of what makes runs
 * repeatable. */
static void test_rng_streams(void **state)
{
    (void) state;
    const uint64_t a = sg_rng_u64(42, SG_RNG_VIEWS, 0, 0);
    assert_true(a != sg_rng_u64(42, SG_RNG_VIEWS, 0, 1));
    assert_true(a != sg_rng_u64(42, SG_RNG_VIEWS, 1, 0));
    assert_true(a != sg_rng_u64(42, SG_RNG_SPLIT, 0, 0));
    assert_true(a != sg_rng_u64(43, SG_RNG_VIEWS, 0, 0));
    assert_true(sg_rng_mix(0) ==
                0xe220a8397b1dcdafu); /* the first output of splitmix64 seeded with 0 */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ledger_counts),
        cmocka_unit_test(test_ledger_owns),
        cmocka_unit_test(test_ledger_refuses),
        cmocka_unit_test(test_ledger_overflow),
        cmocka_unit_test(test_grow),
        cmocka_unit_test(test_file_appears_whole),
        cmocka_unit_test(test_file_with_a_long_name),
        cmocka_unit_test(test_file_survives_a_kill),
        cmocka_unit_test(test_file_refusals),
        cmocka_unit_test(test_folders),
        cmocka_unit_test(test_first_error_wins),
        cmocka_unit_test(test_printable),
        cmocka_unit_test(test_context_parameters),
        cmocka_unit_test(test_machine_name),
        cmocka_unit_test(test_rng_moments),
        cmocka_unit_test(test_rng_streams),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
