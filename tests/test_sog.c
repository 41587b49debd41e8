/* SPDX-License-Identifier: Apache-2.0 */
/* .sog files that are made here, value by value, and damaged ones. */
#include "scene_files.h"

#include <math.h>
#include <webp/encode.h>

#include "core/rng.h"
#include "format/codec.h"
#include "zip_files.h"

#define SIDE 5
#define COUNT 23 /* of the 25 pixels of an image */
#define PALETTE 70
#define COEFFICIENTS 8 /* of SH degree 2 */

/* ---- a model ---- */

static uint8_t value(int image, size_t i, int channel)
{
    return (uint8_t) sg_rng_u64(7, SG_RNG_SYNTH, (uint64_t) image, 4 * i + (uint64_t) channel);
}

enum { LOW, HIGH, QUATS, SCALES, SH0, CENTROIDS, LABELS, IMAGES };
static const char *const names[IMAGES] = {"means_l.webp",   "means_u.webp", "quats.webp",
                                          "scales.webp",    "sh0.webp",     "shN_centroids.webp",
                                          "shN_labels.webp"};

static uint8_t byte_of(int image, size_t i, int channel)
{
    if (image == QUATS && channel == 3)
        return (uint8_t) (252 + i % 4);
    if (image == QUATS) /* the three are smaller than the one left out */
        return (uint8_t) (64 + value(image, i, channel) / 2);
    if (image == LABELS)
        return channel == 0 ? (uint8_t) (i * 3 % PALETTE) : 0;
    return value(image, i, channel);
}

static float table(int which, int i)
{
    return (float) (which == 0 ? -9 + i * 0.04 : which == 1 ? -2 + i * 0.015 : sin(i + which));
}

static void add_image(struct archive *a, int image, bool deflated)
{
    const int w = image == CENTROIDS ? 64 * COEFFICIENTS : SIDE, h = image == CENTROIDS ? 2 : SIDE;
    const size_t n = (size_t) (w * h);
    uint8_t *rgba = malloc(4 * n), *webp = NULL;
    WebPConfig config;
    WebPPicture picture;
    WebPMemoryWriter writer;
    for (size_t i = 0; i < n; i++)
        for (int c = 0; c < 4; c++)
            rgba[4 * i + (size_t) c] =
                c == 3 && image != QUATS && image != SH0 ? 255 : byte_of(image, i, c);
    WebPConfigInit(&config);
    WebPPictureInit(&picture);
    WebPMemoryWriterInit(&writer);
    config.lossless = config.exact = 1;
    picture.use_argb = 1, picture.width = w, picture.height = h;
    picture.writer = WebPMemoryWrite, picture.custom_ptr = &writer;
    assert_true(WebPPictureImportRGBA(&picture, rgba, 4 * w) && WebPEncode(&config, &picture));
    webp = writer.mem;
    archive_add(a, names[image], webp, writer.size, deflated);
    WebPPictureFree(&picture);
    WebPMemoryWriterClear(&writer);
    free(rgba);
}

static const char *put_table(char *to, int which)
{
    char *at = to;
    for (int i = 0; i < 256; i++)
        at += sprintf(at, "%s%.9g", i ? "," : "[", (double) table(which, i));
    strcpy(at, "]");
    return to;
}

static char *make_meta(const char *count, const char *rest)
{
    static char text[65536], tables[3][8192];
    snprintf(
        text, sizeof(text),
        "{\"version\":2,\"count\":%s,\"means\":{\"mins\":[-2,-1,0],\"maxs\":[2,3,1],\"files\":["
        "\"means_l.webp\",\"means_u.webp\"]},\"quats\":{\"files\":[\"quats.webp\"]},\"scales\":{"
        "\"codebook\":%s,\"files\":[\"scales.webp\"]},\"sh0\":{\"codebook\":%s,\"files\":["
        "\"sh0.webp\"]},\"shN\":{%s,\"codebook\":%s,\"files\":[\"shN_centroids.webp\","
        "\"shN_labels.webp\"]}}",
        count, put_table(tables[0], 0), put_table(tables[1], 1), rest, put_table(tables[2], 2));
    return text;
}

static struct archive make_archive(const char *meta, bool deflated)
{
    struct archive a = {.bytes = malloc(1 << 20)};
    for (int image = 0; image < IMAGES; image++)
        add_image(&a, image, deflated);
    archive_add(&a, "meta.json", meta, strlen(meta), deflated);
    archive_finish(&a, deflated ? "a comment" : "");
    return a;
}

static void test_values(void **state)
{
    struct fixture *f = *state;
    for (int deflated = 0; deflated < 2; deflated++) {
        struct archive a = make_archive(make_meta("23", "\"count\":70,\"bands\":2"), deflated);
        struct sg_model *m;
        put(f, "m.sog", a.bytes, a.size);
        if (sg_model_read(f->ctx, at(f, "m.sog"), 100, &m))
            fail_msg("%s", sg_last_error(f->ctx));
        assert_int_equal(m->count, COUNT);
        assert_int_equal(m->sh_degree, 2);
        assert_int_equal(m->active_sh_degree, 2);
        for (size_t i = 0; i < COUNT; i++) {
            static const double least[] = {-2, -1, 0}, most[] = {2, 3, 1};
            double square = 0;
            for (int k = 0; k < 3; k++) {
                const double t = (byte_of(LOW, i, k) + 256 * byte_of(HIGH, i, k)) / 65535.0,
                             v = least[k] + t * (most[k] - least[k]);
                assert_float_equal(*sg_model_at(m, i, SG_P_XYZ + k), copysign(exp(fabs(v)) - 1, v),
                                   1e-5);
                assert_float_equal(*sg_model_at(m, i, SG_P_SCALE + k),
                                   table(0, byte_of(SCALES, i, k)), 1e-6);
                assert_float_equal(*sg_model_at(m, i, SG_P_SH + k), table(1, byte_of(SH0, i, k)),
                                   1e-6);
            }
            assert_float_equal(sg_logistic(*sg_model_at(m, i, SG_P_OPACITY)),
                               byte_of(SH0, i, 3) / 255.0, 1.1e-3);
            for (int k = 0, from = 0; k < 4; k++) {
                const float q = *sg_model_at(m, i, SG_P_ROT + k);
                square += (double) q * q;
                if (k != (int) (i % 4))
                    assert_float_equal(q, (byte_of(QUATS, i, from++) / 255.0 - 0.5) * sqrt(2),
                                       1e-6);
                else
                    assert_true(q > 0.1);
            }
            assert_float_equal(square, 1, 1e-5);
            const size_t label = byte_of(LABELS, i, 0),
                         first = label / 64 * 64 * COEFFICIENTS + label % 64 * COEFFICIENTS;
            for (size_t k = 0; k < COEFFICIENTS; k++)
                for (int c = 0; c < 3; c++)
                    assert_float_equal(*sg_model_at(m, i, SG_P_SH + 3 * (int) (k + 1) + c),
                                       table(2, byte_of(CENTROIDS, first + k, c)), 1e-6);
        }
        sg_model_destroy(&m);
        free(a.bytes);
    }
}

static void refused(struct fixture *f, const char *meta, const char *why)
{
    struct archive a = make_archive(meta, true);
    struct sg_model *m;
    put(f, "m.sog", a.bytes, a.size);
    assert_int_equal(sg_model_read(f->ctx, at(f, "m.sog"), 1 << 30, &m), SG_ERR_INPUT);
    assert_null(m);
    if (!strstr(sg_last_error(f->ctx), "m.sog") || !strstr(sg_last_error(f->ctx), why))
        fail_msg("found \"%s\", expected \"%s\"", sg_last_error(f->ctx), why);
    free(a.bytes);
}

static void test_refused(void **state)
{
    struct fixture *f = *state;
    refused(f, "{", "meta.json: line 1");
    refused(f, "[]", "version: found nothing, expected 2");
    refused(f, "{\"version\":1}", "version: found the number 1");
    refused(f, make_meta("26", "\"count\":70,\"bands\":2"), "5 x 5 pixels");
    refused(f, make_meta("0", "\"count\":70,\"bands\":2"), "found 0 Gaussians");
    refused(f, make_meta("-1", "\"count\":70,\"bands\":2"), "count: found the number -1");
    refused(f, make_meta("900000000", "\"count\":70,\"bands\":2"), "900000000 Gaussians in a file");
    refused(f, make_meta("23", "\"count\":70,\"bands\":4"), "shN.bands: found the number 4");
    refused(f, make_meta("23", "\"count\":70,\"bands\":4294967298"), "found the number 4294967298");
    refused(f, make_meta("23", "\"count\":60,\"bands\":2"), "of a palette of 60");
    refused(f, make_meta("23", "\"count\":70,\"bands\":3"), "expected colour for 1920");
    refused(f, make_meta("23", "\"count\":60,\"bands\":1"), "512 pixels wide, expected 192");
    refused(f, make_meta("23", "\"count\":70000,\"bands\":2"), "shN.count: found the number 70000");
    char *meta = make_meta("23", "\"count\":70,\"bands\":2");
    memcpy(strstr(meta, "[-2,"), "[\"\",", 4);
    refused(f, meta, "means.mins: found");
    meta = make_meta("23", "\"count\":70,\"bands\":2");
    memcpy(strstr(meta, "\"quats.webp"), "\"other.webp", 11);
    refused(f, meta, "found no other.webp");
    meta = make_meta("23", "\"count\":70,\"bands\":2");
    memcpy(strstr(meta, "\"quats.webp"), "\"sh0.webp\"  ", 12);
    refused(f, meta, "expected 252 to 255");
    meta = make_meta("23", "\"count\":70,\"bands\":2");
    memcpy(strstr(meta, "\"quats.webp"), "\"meta.json\" ", 12);
    refused(f, meta, "m.sog/meta.json: "); /* which is no image */
}

/* A random change or end is read or refused, but harms nothing; the memory is bounded. */
static void test_damage(void **state)
{
    struct fixture *f = *state;
    for (int deflated = 0; deflated < 2; deflated++) {
        struct archive a = make_archive(make_meta("23", "\"count\":70,\"bands\":2"), deflated);
        int bad = 0;
        for (uint64_t k = 0; k < 600; k++) {
            const uint64_t random = sg_rng_u64(9, SG_RNG_SYNTH, (uint64_t) deflated, k);
            struct sg_model *m;
            put_damaged(f, "m.sog", &a, random, k);
            const int code = sg_model_read(f->ctx, at(f, "m.sog"), 1000, &m);
            assert_true(code == SG_OK || code == SG_ERR_INPUT);
            assert_true((code == SG_OK) == (m != NULL));
            assert_true(code == SG_OK || strstr(sg_last_error(f->ctx), "m.sog"));
            bad += code != SG_OK;
            sg_model_destroy(&m);
        }
        assert_true(bad > 150); /* those that were cut */
        free(a.bytes);
    }
    assert_true(sg_mem_peak(f->ctx, SG_MEM_TAGS) < 64 << 20);
}

/* A file with more bytes than an archive can have, most of them a hole. */
static void test_too_large(void **state)
{
    struct fixture *f = *state;
    struct sg_model *m;
    const uint64_t held = sg_mem_peak(f->ctx, SG_MEM_TAGS);
    put(f, "m.sog", "PK\3\4", 4);
    assert_int_equal(truncate(at(f, "m.sog"), (off_t) 6 << 30), 0);
    assert_int_equal(sg_model_read(f->ctx, at(f, "m.sog"), 1000, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "m.sog: found 6442450944 bytes"));
    assert_true(sg_mem_peak(f->ctx, SG_MEM_TAGS) < held + (1 << 20));
}

/* What the parser of meta.json needs is within the limit on memory. */
static void test_deep_meta(void **state)
{
    struct fixture *f = *state;
    struct archive a = {.bytes = malloc(1 << 20)};
    struct sg_model *m;
    sg_ctx *ctx;
    char *meta = malloc(250002);
    for (int i = 0; i < 250000; i += 5)
        memcpy(meta + i, i ? ",[[]]" : "[[[]]", 5);
    strcpy(meta + 250000, "]");
    archive_add(&a, "meta.json", meta, strlen(meta), true);
    archive_finish(&a, "");
    put(f, "m.sog", a.bytes, a.size);
    assert_int_equal(sg_model_read(f->ctx, at(f, "m.sog"), 1000, &m), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "version: found nothing"));
    assert_int_equal(sg_ctx_create(&ctx, &(struct sg_ctx_params){.max_memory = 8 << 20}), SG_OK);
    assert_int_equal(sg_model_read(ctx, at(f, "m.sog"), 1000, &m), SG_ERR_BUDGET);
    assert_null(m);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
    free(meta);
    free(a.bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(test_values),    scene_test(test_refused),   scene_test(test_damage),
        scene_test(test_too_large), scene_test(test_deep_meta),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
