/* SPDX-License-Identifier: Apache-2.0 */
/* Decoding, writing and resampling of images. */
#include "scene_files.h"

#include "splatguard/picture.h"

#include <spng.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <turbojpeg.h>
#include <webp/encode.h>

#define MAX_PIXELS (1u << 20)

/* Encodes raw samples as any kind of PNG, in memory. */
static void *encode_png(int width, int height, int color, int depth, const void *samples,
                        size_t size, struct spng_plte *palette, struct spng_trns *trns,
                        size_t *bytes)
{
    int error;
    struct spng_ihdr ihdr = {.width = (uint32_t) width,
                             .height = (uint32_t) height,
                             .bit_depth = (uint8_t) depth,
                             .color_type = (uint8_t) color};
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
    spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1);
    assert_int_equal(spng_set_ihdr(png, &ihdr), 0);
    if (palette)
        assert_int_equal(spng_set_plte(png, palette), 0);
    if (trns)
        assert_int_equal(spng_set_trns(png, trns), 0);
    assert_int_equal(spng_encode_image(png, samples, size, SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE), 0);
    void *data = spng_get_png_buffer(png, bytes, &error);
    spng_ctx_free(png);
    return data;
}

static void expect_pixels(struct fixture *f, void *data, size_t size, int channels,
                          const uint8_t *expected, size_t n)
{
    struct sg_image image;
    if (sg_image_decode(f->ctx, "x.png", data, size, MAX_PIXELS, &image))
        fail_msg("%s", sg_last_error(f->ctx));
    assert_int_equal(image.channels, channels);
    assert_int_equal((size_t) image.width * (size_t) image.height * (size_t) channels, n);
    assert_memory_equal(image.pixels, expected, n);
    sg_image_clear(&image);
    free(data);
}

static void every_kind_of_png(void **state)
{
    struct fixture *f = *state;
    size_t size;
    uint16_t deep[6] = {0x1234, 0xff00, 0x00ff, 0x8001, 0x7fff, 0xabcd};
    void *data =
        encode_png(2, 1, SPNG_COLOR_TYPE_TRUECOLOR, 16, deep, sizeof(deep), NULL, NULL, &size);
    expect_pixels(f, data, size, 3, (const uint8_t[]){0x12, 0xff, 0x00, 0x80, 0x7f, 0xab}, 6);
    data = encode_png(3, 2, SPNG_COLOR_TYPE_GRAYSCALE, 16, deep, sizeof(deep), NULL, NULL, &size);
    expect_pixels(f, data, size, 1, (const uint8_t[]){0x12, 0xff, 0x00, 0x80, 0x7f, 0xab}, 6);
    data = encode_png(8, 1, SPNG_COLOR_TYPE_GRAYSCALE, 1, "\xa5", 1, NULL, NULL, &size);
    expect_pixels(f, data, size, 1, (const uint8_t[]){255, 0, 255, 0, 0, 255, 0, 255}, 8);
    data = encode_png(2, 1, SPNG_COLOR_TYPE_GRAYSCALE_ALPHA, 8, "\x10\x20\x30\x40", 4, NULL, NULL,
                      &size);
    expect_pixels(f, data, size, 4,
                  (const uint8_t[]){0x10, 0x10, 0x10, 0x20, 0x30, 0x30, 0x30, 0x40}, 8);
    struct spng_plte palette = {.n_entries = 2, .entries = {{1, 2, 3, 0}, {200, 100, 50, 0}}};
    data = encode_png(2, 1, SPNG_COLOR_TYPE_INDEXED, 8, "\1\0", 2, &palette, NULL, &size);
    expect_pixels(f, data, size, 3, (const uint8_t[]){200, 100, 50, 1, 2, 3}, 6);
    struct spng_trns trns = {.n_type3_entries = 1, .type3_alpha = {9}};
    data = encode_png(2, 1, SPNG_COLOR_TYPE_INDEXED, 8, "\1\0", 2, &palette, &trns, &size);
    expect_pixels(f, data, size, 4, (const uint8_t[]){200, 100, 50, 255, 1, 2, 3, 9}, 8);
}

static void png_round_trip(void **state)
{
    struct fixture *f = *state;
    uint8_t pixels[5 * 3 * 4];
    for (size_t i = 0; i < sizeof(pixels); i++)
        pixels[i] = (uint8_t) (i * 37);
    for (int channels = 1; channels <= 4; channels++) {
        struct sg_image image;
        sg_clear_error(f->ctx);
        int code = sg_image_write_png(f->ctx, at(f, "a.png"), pixels, 5, 3, channels);
        if (channels == 2) {
            assert_int_equal(code, SG_ERR_USAGE);
            continue;
        }
        assert_int_equal(code, SG_OK);
        assert_int_equal(sg_image_read(f->ctx, at(f, "a.png"), MAX_PIXELS, &image), SG_OK);
        assert_int_equal(image.width, 5);
        assert_int_equal(image.height, 3);
        assert_int_equal(image.channels, channels);
        assert_memory_equal(image.pixels, pixels, (size_t) (15 * channels));
        sg_image_clear(&image);
    }
}

/* Zeros before the end marker are some cameras' padding; all else that is too much or missing is
 * damage. */
static void damaged_jpeg(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[3 * 32 * 24];
    for (size_t i = 0; i < sizeof(rgb); i++)
        rgb[i] = (uint8_t) (i * i / 7);
    tjhandle jpeg = tjInitCompress();
    struct sg_image plain, image;
    for (int progressive = 0; progressive < 2; progressive++) {
        unsigned char *data = NULL;
        unsigned long size = 0;
        uint8_t changed[16384];
        assert_int_equal(tjCompress2(jpeg, rgb, 32, 0, 24, TJPF_RGB, &data, &size, TJSAMP_444, 95,
                                     progressive ? TJFLAG_PROGRESSIVE : 0),
                         0);
        assert_true(size + 100 < sizeof(changed));
        assert_int_equal(sg_image_decode(f->ctx, "x", data, size, MAX_PIXELS, &plain), SG_OK);
        /* padded, and something behind the end */
        memcpy(changed, data, size - 2);
        memset(changed + size - 2, 0, 50);
        memcpy(changed + size + 48, "\xff\xd9more", 6);
        assert_int_equal(sg_image_decode(f->ctx, "x", changed, size + 54, MAX_PIXELS, &image),
                         SG_OK);
        assert_memory_equal(plain.pixels, image.pixels, sizeof(rgb));
        sg_image_clear(&image);
        sg_image_clear(&plain);
        /* stray bytes between header segments, which would hide that most of the picture is
         * missing */
        memcpy(changed, data, 20);
        memset(changed + 20, 0, 3);
        memcpy(changed + 23, data + 20, size - 20);
        assert_int_equal(sg_image_decode(f->ctx, "x", changed, size / 2, MAX_PIXELS, &image),
                         SG_ERR_INPUT);
        /* what the decoder holds of a progressive photo counts */
        sg_ctx *small;
        assert_int_equal(
            sg_ctx_create(&small, &(struct sg_ctx_params){.threads = 1, .max_memory = 6000}),
            SG_OK);
        assert_int_equal(sg_image_decode(small, "x", data, size, MAX_PIXELS, &image),
                         progressive ? SG_ERR_BUDGET : SG_OK);
        sg_image_clear(&image);
        sg_ctx_destroy(&small);
        tjFree(data);
    }
    tjDestroy(jpeg);
    /* Padding of pixels that end in a zero themselves, before another picture; cameras append
     * previews. */
    int zeros = 0;
    for (uint32_t draw = 1; zeros < 3 && draw < 100000; draw++) {
        unsigned char *data = NULL;
        unsigned long size = 0;
        uint8_t pixels[8 * 8], changed[4096];
        for (uint32_t i = 0; i < sizeof(pixels); i++)
            pixels[i] = (uint8_t) ((draw * 2654435761u + i * 40503u) * (i + 7) >> 13);
        jpeg = tjInitCompress();
        assert_int_equal(
            tjCompress2(jpeg, pixels, 8, 0, 8, TJPF_GRAY, &data, &size, TJSAMP_GRAY, 90, 0), 0);
        if (data[size - 3] == 0) {
            zeros++;
            assert_true(2 * size + 60 < sizeof(changed));
            memcpy(changed, data, size - 2);
            memset(changed + size - 2, 0, 48);
            memcpy(changed + size + 46, "\xff\xd9", 2);
            memcpy(changed + size + 48, data, size);
            assert_int_equal(
                sg_image_decode(f->ctx, "x", changed, 2 * size + 48, MAX_PIXELS, &image), SG_OK);
            sg_image_clear(&image);
        }
        tjFree(data);
        tjDestroy(jpeg);
    }
    assert_true(zeros > 0);
    assert_int_equal(sg_image_decode(f->ctx, "x", "\xff\xd8\xff\xd9", 4, MAX_PIXELS, &image),
                     SG_ERR_INPUT);
}

static size_t add_marker(uint8_t *out, size_t at, uint8_t marker, size_t length)
{
    const uint8_t bytes[] = {0xff, marker, (uint8_t) (length >> 8), (uint8_t) length};
    memcpy(out + at, bytes, sizeof(bytes));
    return at + 2 + length;
}

/* Markers without a length: whoever reads one behind them jumps into a comment, where a picture
 * pretends to need less memory than the one that the decoder finds. */
static void jpeg_markers_without_length(void **state)
{
    struct fixture *f = *state;
    static const uint8_t alone[] = {0x01, 0xd0, 0xd7};
    enum { COMMENTS = 65541 + 2 + 4000 };
    uint8_t grey[32 * 24] = {0}, *made = calloc(COMMENTS + 16384, 1);
    unsigned char *data = NULL;
    unsigned long size = 0;
    tjhandle jpeg = tjInitCompress();
    assert_int_equal(tjCompress2(jpeg, grey, 32, 0, 24, TJPF_GRAY, &data, &size, TJSAMP_GRAY, 90,
                                 TJFLAG_PROGRESSIVE),
                     0);
    assert_true(size < 16384);
    sg_ctx *small;
    assert_int_equal(
        sg_ctx_create(&small, &(struct sg_ctx_params){.threads = 1, .max_memory = 2000}), SG_OK);
    for (size_t k = 0; k < sizeof(alone); k++) {
        struct sg_image image;
        memcpy(made, (uint8_t[]){0xff, 0xd8, 0xff, alone[k]}, 4);
        const size_t second = add_marker(made, 4, 0xfe, 65535); /* its marker as a length: 65534 */
        assert_int_equal(second, 65541);
        memcpy(made + 4 + 65534, "\xff\xfe\x00", 3); /* with the next byte, 255 long */
        assert_int_equal(add_marker(made, second, 0xfe, 4000), COMMENTS);
        size_t forged = 65540 + 255;
        memcpy(made + forged + 4, "\x08\x00\x18\x00\x20\x01\x01\x11\x00", 9);
        forged = add_marker(made, forged, 0xc0, 11);
        memcpy(made + forged + 4, "\x01\x01\x00\x00\x3f\x00", 6);
        forged = add_marker(made, forged, 0xda, 8);
        memcpy(made + forged, "\xff\xd9", 2);
        memcpy(made + COMMENTS, data + 2, size - 2);
        assert_int_equal(sg_image_decode(small, "x", made, COMMENTS + size - 2, MAX_PIXELS, &image),
                         SG_ERR_BUDGET);
        sg_clear_error(small);
        assert_int_equal(
            sg_image_decode(f->ctx, "x", made, COMMENTS + size - 2, MAX_PIXELS, &image), SG_OK);
        assert_int_equal(image.width, 32);
        sg_image_clear(&image);
    }
    sg_ctx_destroy(&small);
    tjFree(data);
    tjDestroy(jpeg);
    free(made);
}

/* A small file must not take minutes. */
static void jpeg_of_many_scans(void **state)
{
    struct fixture *f = *state;
    uint8_t grey[64] = {0}, made[16384];
    unsigned char *data = NULL;
    unsigned long size = 0;
    struct sg_image image;
    tjhandle jpeg = tjInitCompress();
    assert_int_equal(tjCompress2(jpeg, grey, 8, 0, 8, TJPF_GRAY, &data, &size, TJSAMP_GRAY, 90,
                                 TJFLAG_PROGRESSIVE),
                     0);
    size_t scan = size;
    while (memcmp(data + scan - 2, "\xff\xda", 2))
        scan--;
    scan -= 2;
    const size_t length = size - 2 - scan;
    assert_true(size + 64 * length < sizeof(made));
    memcpy(made, data, size - 2);
    for (size_t i = 0; i < 64; i++)
        memcpy(made + size - 2 + i * length, data + scan, length);
    memcpy(made + size - 2 + 64 * length, "\xff\xd9", 2);
    assert_int_equal(sg_image_decode(f->ctx, "x", made, size + 64 * length, MAX_PIXELS, &image),
                     SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "found more than 64 scans"));
    tjFree(data);
    tjDestroy(jpeg);
}

static void jpeg_and_webp_by_content(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[32 * 24 * 3];
    for (size_t i = 0; i < sizeof(rgb); i++)
        rgb[i] = i % 3 == 0 ? 200 : i % 3 == 1 ? 100 : 50;
    tjhandle jpeg = tjInitCompress();
    unsigned char *jpeg_data = NULL;
    unsigned long jpeg_size = 0;
    assert_int_equal(
        tjCompress2(jpeg, rgb, 32, 0, 24, TJPF_RGB, &jpeg_data, &jpeg_size, TJSAMP_444, 95, 0), 0);
    struct sg_image image;
    put(f, "really-a-jpeg.png", jpeg_data, jpeg_size); /* the content decides */
    assert_int_equal(sg_image_read(f->ctx, at(f, "really-a-jpeg.png"), MAX_PIXELS, &image), SG_OK);
    assert_int_equal(image.width, 32);
    assert_int_equal(image.height, 24);
    for (int c = 0; c < 3; c++)
        assert_in_range(image.pixels[300 + c] + 2 - rgb[c], 0, 4);
    sg_image_clear(&image);
    /* cut anywhere: an error, never grey filling */
    for (unsigned long cut = 0; cut < jpeg_size - 2; cut += 7) {
        sg_clear_error(f->ctx);
        assert_int_equal(sg_image_decode(f->ctx, "x", jpeg_data, cut, MAX_PIXELS, &image),
                         SG_ERR_INPUT);
        assert_null(image.pixels);
    }
    tjFree(jpeg_data);
    tjDestroy(jpeg);
    uint8_t *webp = NULL;
    size_t webp_size = WebPEncodeLosslessRGB(rgb, 32, 24, 32 * 3, &webp);
    sg_clear_error(f->ctx);
    assert_int_equal(sg_image_decode(f->ctx, "x", webp, webp_size, MAX_PIXELS, &image), SG_OK);
    assert_int_equal(image.channels, 3);
    assert_memory_equal(image.pixels, rgb, sizeof(rgb));
    sg_image_clear(&image);
    for (size_t cut = 0; cut < webp_size - 1; cut++) {
        sg_clear_error(f->ctx);
        assert_int_equal(sg_image_decode(f->ctx, "x", webp, cut, MAX_PIXELS, &image), SG_ERR_INPUT);
    }
    WebPFree(webp);
}

static void damaged_png(void **state)
{
    struct fixture *f = *state;
    struct sg_image image;
    char *data;
    size_t size;
    put_png(f, "a.png", 40, 30, 3, 1);
    assert_int_equal(sg_file_read(f->ctx, at(f, "a.png"), MAX_PIXELS, &data, &size), SG_OK);
    for (size_t cut = 0; cut + 20 < size;
         cut++) { /* 12 bytes of IEND, 8 of checksums: the pixels are whole without */
        sg_clear_error(f->ctx);
        assert_int_equal(sg_image_decode(f->ctx, "a.png", data, cut, MAX_PIXELS, &image),
                         SG_ERR_INPUT);
        assert_null(image.pixels);
    }
    data[60] ^= 0x55;
    sg_clear_error(f->ctx);
    assert_int_equal(sg_image_decode(f->ctx, "a.png", data, size, MAX_PIXELS, &image),
                     SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "a.png"));
    sg_free(data);
}

static uint32_t crc(const char *data, size_t n)
{
    uint32_t sum = UINT32_MAX;
    for (size_t i = 0; i < n; i++) {
        sum ^= (uint8_t) data[i];
        for (int bit = 0; bit < 8; bit++)
            sum = sum >> 1 ^ (sum & 1 ? 0xedb88320u : 0);
    }
    return ~sum;
}

/* The file with a chunk of n bytes after its header. */
static char *insert_chunk(const char *png, size_t size, const char *name, uint32_t n, bool checked)
{
    const size_t header = 33;
    char *out = calloc(1, size + 12 + n);
    memcpy(out, png, header);
    char *chunk = out + header;
    for (int k = 0; k < 4; k++)
        chunk[k] = (char) (n >> (24 - 8 * k));
    memcpy(chunk + 4, name, 4);
    const uint32_t sum = crc(chunk + 4, n + 4) ^ !checked;
    for (int k = 0; k < 4; k++)
        chunk[8 + n + (uint32_t) k] = (char) (sum >> (24 - 8 * k));
    memcpy(chunk + 12 + n, png + header, size - header);
    return out;
}

/* Texts and profiles are not looked at, whatever is in them. Errors say what is wrong. */
static void png_chunks(void **state)
{
    struct fixture *f = *state;
    static const char *const passed_over[] = {"zTXt", "iTXt", "iCCP", "tEXt", "eXIf"};
    struct sg_image image, plain;
    char *data;
    size_t size;
    put_png(f, "a.png", 40, 30, 3, 1);
    assert_int_equal(sg_file_read(f->ctx, at(f, "a.png"), MAX_PIXELS, &data, &size), SG_OK);
    assert_int_equal(sg_image_decode(f->ctx, "a.png", data, size, MAX_PIXELS, &plain), SG_OK);
    for (int k = 0; k < 10; k++) {
        char *more = insert_chunk(data, size, passed_over[k / 2], 70000, k % 2);
        assert_int_equal(sg_image_decode(f->ctx, "a.png", more, size + 70012, MAX_PIXELS, &image),
                         SG_OK);
        assert_memory_equal(image.pixels, plain.pixels, 40 * 30 * 3);
        sg_image_clear(&image);
        more[33] = 0x7f; /* longer than the file */
        assert_int_equal(sg_image_decode(f->ctx, "a.png", more, size + 70012, MAX_PIXELS, &image),
                         SG_ERR_INPUT);
        sg_clear_error(f->ctx);
        free(more);
    }
    char *unknown = insert_chunk(data, size, "ABCD", 3, true); /* must be understood */
    assert_int_equal(sg_image_decode(f->ctx, "a.png", unknown, size + 15, MAX_PIXELS, &image),
                     SG_ERR_INPUT);
    sg_clear_error(f->ctx);
    free(unknown);
    for (int k = 0; k < 2; k++) { /* colours: 4 bytes are none, and a wrong checksum */
        char *more = insert_chunk(data, size, "PLTE", k ? 3 : 4, !k);
        const size_t bytes = size + 12 + (k ? 3 : 4);
        assert_int_equal(sg_image_decode(f->ctx, "a.png", more, bytes, MAX_PIXELS, &image),
                         SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(f->ctx), k ? "chunk checksum" : "chunk length"));
        sg_clear_error(f->ctx);
        free(more);
    }
    sg_image_clear(&plain);
    sg_free(data);
}

static void bomb_is_refused_before_allocation(void **state)
{
    struct fixture *f = *state;
    struct sg_image image;
    char *data;
    size_t size;
    put_png(f, "a.png", 100, 100, 1, 1);
    assert_int_equal(sg_file_read(f->ctx, at(f, "a.png"), MAX_PIXELS, &data, &size), SG_OK);
    uint64_t peak = sg_mem_peak(f->ctx, SG_MEM_IMAGES);
    sg_clear_error(f->ctx);
    assert_int_equal(sg_image_decode(f->ctx, "a.png", data, size, 9999, &image), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "100 x 100"));
    assert_int_equal(sg_mem_peak(f->ctx, SG_MEM_IMAGES), peak);
    sg_clear_error(f->ctx);
    assert_int_equal(sg_image_decode(f->ctx, "a.png", data, size, 10000, &image), SG_OK);
    sg_image_clear(&image);
    sg_free(data);
}

static void flatten_truncates(void **state)
{
    (void) state;
    uint8_t pixels[] = {255, 10, 100, 255, 200, 200, 0, 128, 77, 88, 99, 0}, rgb[9];
    struct sg_image image = {.width = 3, .height = 1, .channels = 4, .pixels = pixels};
    sg_image_flatten(&image, SG_ALPHA_ON_WHITE, rgb);
    /* 200 * 128/255 + 127 = 227.39; 0 + 127 */
    const uint8_t white[] = {255, 10, 100, 227, 227, 127, 255, 255, 255};
    assert_memory_equal(rgb, white, 9);
    sg_image_flatten(&image, SG_ALPHA_DROP, rgb);
    for (int i = 0; i < image.width * image.height; i++)
        assert_memory_equal(rgb + 3 * i, image.pixels + 4 * i, 3);
    sg_image_flatten(&image, SG_ALPHA_ON_BLACK, rgb);
    const uint8_t black[] = {255, 10, 100, 100, 100, 0, 0, 0, 0}; /* 100.39 */
    assert_memory_equal(rgb, black, 9);
    for (int v = 0; v < 256; v++) { /* opaque pixels pass unchanged */
        uint8_t one[4] = {(uint8_t) v, (uint8_t) v, (uint8_t) v, 255};
        sg_image_flatten(&(struct sg_image){.width = 1, .height = 1, .channels = 4, .pixels = one},
                         SG_ALPHA_ON_WHITE, rgb);
        assert_int_equal(rgb[0], v);
    }
}

/* Expected values: the definition evaluated in double precision by an independent script. */
static void resample_known_values(void **state)
{
    struct fixture *f = *state;
    static const struct {
        int w, h, W, H;
        uint8_t expected[64];
    } cases[] = {
        {7, 5, 3, 2, {90, 139, 126, 129, 125, 142}},
        {4, 3, 6, 5, {0,   7,   34,  59,  86,  102, 29,  53,  91,  118, 148, 168, 98, 122, 159,
                      193, 230, 254, 178, 117, 64,  112, 157, 186, 224, 106, 0,   49, 100, 130}},
        {13, 11, 13, 4, {88,  75,  130, 165, 116, 101, 157, 112, 168, 49,  83,  140, 189,
                         147, 145, 135, 91,  168, 129, 156, 87,  119, 161, 75,  108, 192,
                         147, 143, 132, 123, 122, 161, 99,  101, 174, 89,  211, 74,  194,
                         148, 109, 122, 163, 174, 131, 128, 115, 97,  168, 144, 42,  197}},
        {16, 16, 3, 3, {126, 123, 126, 135, 129, 129, 140, 126, 133}},
    };
    for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++) {
        int w = cases[k].w, h = cases[k].h, W = cases[k].W, H = cases[k].H;
        uint8_t src[256 * 3], dst[64 * 3];
        for (int channels = 1; channels <= 3; channels += 2) {
            for (int i = 0; i < w * h * channels; i++) {
                int x = i / channels % w, y = i / channels / w;
                src[i] = (uint8_t) (x * 37 + y * 101 + x * y * 13);
            }
            assert_int_equal(sg_resample(f->ctx, src, w, h, channels, dst, W, H), SG_OK);
            for (int i = 0; i < W * H * channels; i++)
                assert_int_equal(dst[i], cases[k].expected[i / channels]);
        }
    }
    uint8_t flat[50 * 40], small[7 * 5];
    memset(flat, 201, sizeof(flat));
    assert_int_equal(sg_resample(f->ctx, flat, 50, 40, 1, small, 7, 5), SG_OK);
    for (size_t i = 0; i < sizeof(small); i++)
        assert_int_equal(small[i], 201);
}

static void pictures_in_memory(void **state)
{
    struct fixture *f = *state;
    uint8_t rgb[32 * 24 * 3];
    for (size_t i = 0; i < sizeof(rgb); i++)
        rgb[i] = (uint8_t) (i / 3 % 32 * 4 + i % 3 * 40);
    const uint64_t held = sg_mem_current(f->ctx, SG_MEM_TAGS);
    for (int k = 0; k < 2; k++) {
        void *data;
        size_t size;
        struct sg_image image;
        assert_int_equal(
            sg_picture_encode(f->ctx, (enum sg_picture_format) k, rgb, 32, 24, &data, &size),
            SG_OK);
        assert_memory_equal(data, k == SG_PICTURE_PNG ? "\x89PNG" : "\xff\xd8\xff", 3);
        assert_true(sg_mem_current(f->ctx, SG_MEM_FRAME) >= size);
        assert_int_equal(sg_image_decode(f->ctx, "x", data, size, MAX_PIXELS, &image), SG_OK);
        for (size_t i = 0; i < sizeof(rgb); i++)
            assert_in_range(image.pixels[i] + 6 - rgb[i], k == SG_PICTURE_PNG ? 6 : 0,
                            k == SG_PICTURE_PNG ? 6 : 12);
        sg_image_clear(&image);
        sg_mem_free(data);
        assert_int_equal(
            sg_picture_encode(f->ctx, (enum sg_picture_format) k, rgb, 0, 24, &data, &size),
            SG_ERR_USAGE);
        assert_null(data);
        assert_int_equal(
            sg_picture_encode(f->ctx, (enum sg_picture_format)(2 + k), rgb, 32, 24, &data, &size),
            SG_ERR_USAGE);
        assert_null(data);
    }
    assert_int_equal(sg_mem_current(f->ctx, SG_MEM_TAGS), held);
}

/* A JPEG is smaller than other pictures at most. */
static void sides_of_encoded_pictures(void **state)
{
    struct fixture *f = *state;
    uint8_t *line = calloc(65535, 3);
    static const struct {
        enum sg_picture_format format;
        int side, code;
    } cases[] = {{SG_PICTURE_PNG, 65535, SG_OK},
                 {SG_PICTURE_PNG, 65536, SG_ERR_USAGE},
                 {SG_PICTURE_JPEG, 65500, SG_OK},
                 {SG_PICTURE_JPEG, 65501, SG_ERR_USAGE}};
    for (size_t k = 0; k < sizeof(cases) / sizeof(*cases); k++)
        for (int upright = 0; upright < 2; upright++) {
            void *data;
            size_t size;
            assert_int_equal(sg_picture_encode(f->ctx, cases[k].format, line,
                                               upright ? 1 : cases[k].side,
                                               upright ? cases[k].side : 1, &data, &size),
                             cases[k].code);
            assert_true(!data == (cases[k].code != SG_OK));
            sg_mem_free(data);
        }
    free(line);
}

/* Noise, which needs much memory as a file too, where the system gives hardly any more. */
static int encode_without_memory(enum sg_picture_format format)
{
    enum { SIDE = 1200 };
    uint8_t *rgb = malloc(3 * SIDE * SIDE);
    unsigned long pages;
    uint32_t random = 1;
    for (size_t i = 0; i < 3 * SIDE * SIDE; i++)
        rgb[i] = (uint8_t) ((random = random * 1664525 + 1013904223) >> 24);
    sg_ctx *ctx;
    void *data;
    size_t size;
    FILE *statm = fopen("/proc/self/statm", "r");
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1}) || !statm ||
        fscanf(statm, "%lu", &pages) != 1)
        return SG_ERR_INTERNAL;
    const rlim_t most = (pages + 300) * (rlim_t) sysconf(_SC_PAGESIZE);
    if (setrlimit(RLIMIT_AS, &(struct rlimit){most, most}))
        return SG_ERR_INTERNAL;
    return sg_picture_encode(ctx, format, rgb, SIDE, SIDE, &data, &size);
}

static void encoders_without_memory(void **state)
{
    (void) state;
#if defined(SG_SANITIZE_ADDRESS) || defined(SG_SANITIZE_THREAD)
    skip(); /* sanitizers need memory of their own */
#endif
    for (int format = SG_PICTURE_PNG; format <= SG_PICTURE_JPEG; format++) {
        int status;
        const pid_t child = fork();
        if (child == 0)
            _exit(-encode_without_memory((enum sg_picture_format) format));
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFEXITED(status));
        assert_int_equal(-WEXITSTATUS(status), SG_ERR_BUDGET);
    }
}

/* What the encoders hold counts against the limit, before they have it. */
static void encoders_in_the_ledger(void **state)
{
    struct fixture *f = *state;
    const int side = 700;
    uint8_t *rgb = calloc((size_t) side * side, 3);
    sg_ctx *small;
    void *data;
    size_t size;
    assert_int_equal(
        sg_ctx_create(&small, &(struct sg_ctx_params){.threads = 1, .max_memory = 1 << 20}), SG_OK);
    for (int format = SG_PICTURE_PNG; format <= SG_PICTURE_JPEG; format++) {
        assert_int_equal(sg_picture_encode(small, (enum sg_picture_format) format, rgb, side, side,
                                           &data, &size),
                         SG_ERR_BUDGET);
        assert_non_null(strstr(sg_last_error(small), "memory"));
        assert_int_equal(sg_picture_encode(f->ctx, (enum sg_picture_format) format, rgb, side, side,
                                           &data, &size),
                         SG_OK);
        sg_mem_free(data);
        assert_int_equal(sg_mem_current(small, SG_MEM_TAGS), 0);
    }
    for (int full = 0; full < 2; full++)
        assert_int_equal(sg_image_write_jpeg(small, at(f, "m.jpg"), rgb, side, side, 90, full),
                         SG_ERR_BUDGET);
    assert_false(sg_file_exists(f->path));
    sg_ctx_destroy(&small);
    free(rgb);
}

/* A float map has one or three planes, and is not begun for anything else. */
static void float_map_refusals(void **state)
{
    struct fixture *f = *state;
    const float planes[6] = {0};
    static const int wrong[][3] = {{2, 1, 2}, {0, 1, 1}, {1, -1, 3}, {65536, 1, 1}};
    for (int i = 0; i < 4; i++) {
        assert_int_equal(sg_picture_write_pfm(f->ctx, at(f, "m.pfm"), planes, wrong[i][0],
                                              wrong[i][1], wrong[i][2]),
                         SG_ERR_USAGE);
        assert_false(sg_file_exists(f->path));
    }
    assert_int_equal(sg_picture_write_pfm(f->ctx, at(f, "m.pfm"), planes, 2, 1, 3), SG_OK);
    unlink(at(f, "m.pfm"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(every_kind_of_png),
        scene_test(png_round_trip),
        scene_test(float_map_refusals),
        scene_test(encoders_in_the_ledger),
        scene_test(jpeg_markers_without_length),
        scene_test(jpeg_of_many_scans),
        scene_test(jpeg_and_webp_by_content),
        scene_test(damaged_jpeg),
        scene_test(damaged_png),
        scene_test(png_chunks),
        scene_test(bomb_is_refused_before_allocation),
        scene_test(flatten_truncates),
        scene_test(resample_known_values),
        scene_test(pictures_in_memory),
        scene_test(sides_of_encoded_pictures),
        cmocka_unit_test(encoders_without_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
