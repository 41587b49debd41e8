/* SPDX-License-Identifier: Apache-2.0 */
#include "image.h"

#include <errno.h>
#include <spng.h>
#include <string.h>
#include <turbojpeg.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include "core/file.h"

#define WEBP_ENCODER_BYTES 48 /* of libwebp for a pixel, measured 37, and for any image */
#define WEBP_ENCODER_LEAST (14u << 20)
#define PNG_ENCODER_LEAST (1u << 19)
#define WEBP_TABLE_BYTES 20000 /* five Huffman codes with the largest colour cache */
/* Of a JPEG. Programs write about 10. Each passes over the whole picture, however few bytes it has.
 */
#define SCANS_MAX 64
#define JPEG_SIDE_MAX 65500 /* pixels; libjpeg's limit, below that of the format */
#define ZERO_CUTS 16        /* decodings that find where padding begins */

static int allocate(sg_ctx *ctx, const char *name, uint64_t width, uint64_t height, int channels,
                    uint64_t max_pixels, struct sg_image *out)
{
    if (width < 1 || height < 1 || width > SG_IMAGE_SIDE_MAX || height > SG_IMAGE_SIDE_MAX)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: image header: found %llu x %llu pixels, expected sides of 1..%d", name,
                       (unsigned long long) width, (unsigned long long) height, SG_IMAGE_SIDE_MAX);
    if (width * height > max_pixels)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: image header: found %llu x %llu pixels, the limit is %llu pixels", name,
                       (unsigned long long) width, (unsigned long long) height,
                       (unsigned long long) max_pixels);
    out->pixels = sg_alloc_raw(ctx, SG_MEM_IMAGES, (size_t) (width * height), (size_t) channels);
    if (!out->pixels)
        return SG_ERR_BUDGET;
    out->width = (int) width;
    out->height = (int) height;
    out->channels = channels;
    return SG_OK;
}

#define PNG_SIGNATURE 8
#define PNG_AROUND 12 /* of a chunk: length, name and checksum */

/* A PNG without the ancillary chunks that are of no use here, such as texts and profiles: the
 * library would unpack them, in memory that no limit knows of. */
struct png_chunks {
    const uint8_t *data;
    size_t size, at, end; /* end: of the chunk */
};

static void next_chunk(struct png_chunks *c)
{
    while (c->at == c->end && c->size - c->at >= PNG_AROUND) {
        const uint8_t *p = c->data + c->at;
        const size_t length = (size_t) p[0] << 24 | (size_t) p[1] << 16 | (size_t) p[2] << 8 | p[3],
                     left = c->size - c->at - PNG_AROUND;
        /* Names of critical chunks begin with a capital. */
        const bool wanted = !(p[4] & 0x20) || !memcmp(p + 4, "tRNS", 4);
        c->end += PNG_AROUND + (length < left ? length : left);
        c->at = wanted ? c->at : c->end;
    }
    if (c->at == c->end)
        c->end = c->size; /* less than a chunk: the library says so */
}

static int read_chunks(spng_ctx *png, void *from, void *to, size_t n)
{
    (void) png;
    struct png_chunks *c = from;
    for (size_t done = 0; done < n;) {
        if (c->at == c->end)
            next_chunk(c);
        const size_t here = c->end - c->at, most = n - done < here ? n - done : here;
        if (!most)
            return SPNG_IO_EOF;
        memcpy((uint8_t *) to + done, c->data + c->at, most);
        c->at += most, done += most;
    }
    return 0;
}

static int decode_png(sg_ctx *ctx, const char *name, const void *data, size_t size,
                      uint64_t max_pixels, struct sg_image *out)
{
    int code = SG_OK, failed;
    uint8_t *wide = NULL;
    struct png_chunks chunks = {data, size, 0, size < PNG_SIGNATURE ? size : PNG_SIGNATURE};
    spng_ctx *png = spng_ctx_new(0);
    if (!png)
        return sg_fail(ctx, SG_ERR_BUDGET, "%s: no memory for the PNG decoder", name);
    struct spng_ihdr ihdr;
    struct spng_trns trns;
    failed = spng_set_image_limits(png, SG_IMAGE_SIDE_MAX, SG_IMAGE_SIDE_MAX);
    if (!failed)
        failed = spng_set_png_stream(png, read_chunks, &chunks);
    if (!failed)
        failed = spng_get_ihdr(png, &ihdr);
    if (failed)
        goto bad;
    const int transparent = spng_get_trns(png, &trns);
    if (transparent && transparent != SPNG_ECHUNKAVAIL) {
        failed = transparent;
        goto bad;
    }
    bool grey = ihdr.color_type == SPNG_COLOR_TYPE_GRAYSCALE;
    bool alpha = ihdr.color_type == SPNG_COLOR_TYPE_GRAYSCALE_ALPHA ||
                 ihdr.color_type == SPNG_COLOR_TYPE_TRUECOLOR_ALPHA || !transparent;
    code = allocate(ctx, name, ihdr.width, ihdr.height, alpha ? 4 : grey ? 1 : 3, max_pixels, out);
    if (code)
        goto done;
    size_t pixels = (size_t) ihdr.width * ihdr.height;
    if (grey && !alpha &&
        ihdr.bit_depth == 16) { /* the library has no 16 to 8 bit path for grey alone */
        wide = sg_alloc_raw(ctx, SG_MEM_IMAGES, pixels, 2);
        if (!wide) {
            code = SG_ERR_BUDGET;
            goto done;
        }
        failed = spng_decode_image(png, wide, pixels * 2, SPNG_FMT_RAW, 0); /* big endian */
        for (size_t i = 0; i < pixels && !failed; i++)
            out->pixels[i] = wide[2 * i];
    } else {
        int format = alpha ? SPNG_FMT_RGBA8 : grey ? SPNG_FMT_G8 : SPNG_FMT_RGB8;
        failed = spng_decode_image(png, out->pixels, pixels * (size_t) out->channels, format,
                                   SPNG_DECODE_TRNS);
    }
    if (!failed)
        goto done;
bad:
    code = sg_fail(ctx, failed == SPNG_EMEM ? SG_ERR_BUDGET : SG_ERR_INPUT, "%s: PNG data: %s",
                   name, spng_strerror(failed));
done:
    sg_free(wide);
    spng_ctx_free(png);
    return code;
}

/* What the markers of a JPEG say. They are untrusted. */
struct outline {
    bool whole; /* decoded by way of all coefficients, 2 bytes each: progressive, or one scan a
                   colour */
    int scans;
    size_t end; /* of the end marker, 0 = none was found */
};

static bool is_restart(uint8_t marker)
{
    return (marker & 0xf8) == 0xd0;
}

static struct outline outline_of(const uint8_t *data, size_t size)
{
    struct outline o = {.whole = true}; /* the worst case where a marker is not understood */
    int colours = 0;
    for (size_t i = 2; i + 1 < size && data[i] == 0xff;) {
        const uint8_t marker = data[i + 1];
        if (marker == 0xff) { /* fill */
            i++;
            continue;
        }
        if (marker == 0x01 || is_restart(marker)) { /* the decoder skips them: nothing follows */
            i += 2;
            continue;
        }
        if (marker == 0xd9)
            o.end = i;
        /* At 0 and another begin of a picture the decoder ends too. */
        if (o.end || !marker || marker == 0xd8 || i + 4 >= size)
            break;
        const size_t begin = i + 2;
        i = begin + ((size_t) data[begin] << 8 | data[begin + 1]);
        if (marker == 0xda) { /* pixels follow; stuffed and restart markers are among them */
            o.whole = o.whole || data[begin + 2] < colours;
            o.scans += o.scans <= SCANS_MAX;
            while (i + 1 < size && !(data[i] == 0xff && data[i + 1] && data[i + 1] != 0xff &&
                                     !is_restart(data[i + 1])))
                i++;
        } else if (marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 &&
                   marker != 0xcc && begin + 7 < size) {
            o.whole = marker > 0xc1;
            colours = data[begin + 7];
        }
    }
    o.whole = o.whole || !o.end;
    return o;
}

/* Pixels of a side with those that the largest blocks add to it. */
static uint64_t in_blocks(int side)
{
    return ((uint64_t) side + 31) / 32 * 32;
}

/* Lack of memory has no code of its own: the first text is libjpeg's, the second TurboJPEG's. */
static int jpeg_failed(sg_ctx *ctx, const char *name, const char *what, tjhandle jpeg)
{
    const char *why = tjGetErrorStr2(jpeg);
    const bool no_memory =
        strstr(why, "Insufficient memory") || strstr(why, "Memory allocation failure");
    return sg_fail(ctx, no_memory ? SG_ERR_BUDGET : SG_ERR_INPUT, "%s: %s: %s", name, what, why);
}

/* Whether the header, as far as it was read, is that of a picture which can be decoded. */
static int check_jpeg_header(sg_ctx *ctx, const char *name, int width, int height, int space)
{
    if (space < 0 || width < 1 || height < 1) /* a file of tables only is also read as a header */
        return sg_fail(ctx, SG_ERR_INPUT, "%s: JPEG header: found no picture, expected one", name);
    if (space != TJCS_RGB && space != TJCS_YCbCr && space != TJCS_GRAY)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: JPEG header: found CMYK colours, expected RGB or grey", name);
    return SG_OK;
}

/* A warning of the decoder means damaged or missing pixels, with one exception: some cameras put
 * zeros before the end marker. None belongs to the pixels, mostly; otherwise bisection finds how
 * many. Scans of the whole picture are not decoded that often. */
static int decode_jpeg_data(sg_ctx *ctx, const char *name, tjhandle jpeg, const uint8_t *data,
                            size_t size, const struct outline *outline, struct sg_image *out)
{
    const int width = out->width, height = out->height;
    const int format = out->channels == 1 ? TJPF_GRAY : TJPF_RGB;
    const int flags = TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS | TJFLAG_STOPONWARNING;
    int failed = tjDecompress2(jpeg, data, size, out->pixels, width, 0, height, format, flags);
    size_t least = outline->end, most = outline->end;
    while (least && !data[least - 1])
        least--;
    uint8_t *stripped = NULL;
    if (failed && least < most && !(stripped = sg_alloc_raw(ctx, SG_MEM_MISC, most + 2, 1)))
        return SG_ERR_BUDGET;
    const int cuts = outline->whole ? 1 : ZERO_CUTS;
    for (int cut = 0; cut < cuts && failed && least < most && tjGetErrorCode(jpeg) == TJERR_WARNING;
         cut++) {
        const size_t end = cut ? least + (most - least) / 2 : least;
        memcpy(stripped, data, end);
        memcpy(stripped + end, (uint8_t[]){0xff, 0xd9}, 2);
        failed =
            tjDecompress2(jpeg, stripped, end + 2, out->pixels, width, 0, height, format, flags);
        if (failed && strstr(tjGetErrorStr2(jpeg), "extraneous"))
            most = end;
        else
            least = end + 1;
    }
    sg_free(stripped);
    return failed ? jpeg_failed(ctx, name, "JPEG data", jpeg) : SG_OK;
}

static int decode_jpeg(sg_ctx *ctx, const char *name, const void *data, size_t size,
                       uint64_t max_pixels, struct sg_image *out)
{
    int code = SG_OK, width = 0, height = 0, subsampling = -1, space = -1;
    void *room = NULL;
    tjhandle jpeg = tjInitDecompress();
    if (!jpeg)
        return sg_fail(ctx, SG_ERR_BUDGET, "%s: no memory for the JPEG decoder", name);
    if (tjDecompressHeader3(jpeg, data, size, &width, &height, &subsampling, &space) &&
        tjGetErrorCode(jpeg) == TJERR_FATAL)
        code = jpeg_failed(ctx, name, "JPEG header", jpeg);
    if (!code)
        code = check_jpeg_header(ctx, name, width, height, space);
    const struct outline outline = code ? (struct outline){0} : outline_of(data, size);
    if (outline.scans > SCANS_MAX) /* decoding could take minutes */
        code = sg_fail(ctx, SG_ERR_INPUT, "%s: JPEG: found more than %d scans, expected at most %d",
                       name, SCANS_MAX, SCANS_MAX);
    const int channels = space == TJCS_GRAY ? 1 : 3;
    if (!code)
        code = allocate(ctx, name, (uint64_t) width, (uint64_t) height, channels, max_pixels, out);
    if (!code && outline.whole)
        code = sg_reserve(ctx, SG_MEM_IMAGES,
                          in_blocks(width) * in_blocks(height) * 2 * (uint64_t) channels, &room);
    if (!code)
        code = decode_jpeg_data(ctx, name, jpeg, data, size, &outline, out);
    sg_free(room);
    tjDestroy(jpeg);
    return code;
}

static int decode_webp(sg_ctx *ctx, const char *name, const void *data, size_t size,
                       uint64_t max_pixels, struct sg_image *out)
{
    WebPBitstreamFeatures info;
    if (WebPGetFeatures(data, size, &info) != VP8_STATUS_OK)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: WebP header: found a damaged one, expected that of a picture", name);
    if (info.has_animation)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: WebP header: found an animation, expected one picture", name);
    int code = allocate(ctx, name, (uint64_t) info.width, (uint64_t) info.height,
                        info.has_alpha ? 4 : 3, max_pixels, out);
    if (code)
        return code;
    /* The decoder's own pixels. Of lossless parts (alpha is one) three small images too, each with
     * a pixel for 4 x 4, and tables: one set for 4 x 4 pixels, each of at least 20 bits in the
     * file. Alpha of a lossy picture is held twice. */
    const uint64_t pixels = (uint64_t) info.width * (uint64_t) info.height;
    const bool lossless = info.format == 2;
    const uint64_t held = lossless ? 5 : info.has_alpha ? 6 : 4;
    out->lossless = lossless;
    uint64_t tables = lossless || info.has_alpha ? (uint64_t) size * 8 / 20 : 0;
    tables = tables < pixels / 16 + 1 ? tables : pixels / 16 + 1;
    tables = tables < 65536 ? tables : 65536;
    void *room;
    if ((code = sg_reserve(ctx, SG_MEM_IMAGES, held * pixels + tables * WEBP_TABLE_BYTES, &room)))
        return code;
    WebPDecoderConfig config;
    if (!WebPInitDecoderConfig(&config)) {
        sg_free(room);
        return sg_fail(ctx, SG_ERR_USAGE, "libwebp: found another version than it was built for");
    }
    const int stride = out->width * out->channels;
    config.output.colorspace = info.has_alpha ? MODE_RGBA : MODE_RGB;
    config.output.is_external_memory = 1;
    config.output.u.RGBA = (WebPRGBABuffer){
        .rgba = out->pixels, .stride = stride, .size = (size_t) stride * (size_t) out->height};
    const VP8StatusCode status = WebPDecode(data, size, &config);
    WebPFreeDecBuffer(&config.output);
    sg_free(room);
    if (status == VP8_STATUS_OUT_OF_MEMORY)
        return sg_fail(ctx, SG_ERR_BUDGET, "%s: no memory for the WebP decoder", name);
    return status == VP8_STATUS_OK
               ? SG_OK
               : sg_fail(ctx, SG_ERR_INPUT,
                         "%s: WebP data: found damaged data, or too little, expected a picture",
                         name);
}

enum signature { UNKNOWN, PNG, JPEG, WEBP };
#define SIGNATURE_BYTES 12

static enum signature signature_of(const uint8_t *head, size_t size)
{
    static const uint8_t png[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    if (size >= 8 && !memcmp(head, png, 8))
        return PNG;
    if (size >= 3 && head[0] == 0xff && head[1] == 0xd8 && head[2] == 0xff)
        return JPEG;
    return size >= 12 && !memcmp(head, "RIFF", 4) && !memcmp(head + 8, "WEBP", 4) ? WEBP : UNKNOWN;
}

static int unknown(sg_ctx *ctx, const char *name, uint64_t size)
{
    if (!size)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found an empty file, expected an image", name);
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: first bytes: found no known signature, expected a PNG, JPEG or WebP image",
                   name);
}

int sg_image_decode(sg_ctx *ctx, const char *name, const void *data, size_t size,
                    uint64_t max_pixels, struct sg_image *out)
{
    int code;
    *out = (struct sg_image){0};
    switch (signature_of(data, size)) {
    case PNG:
        code = decode_png(ctx, name, data, size, max_pixels, out);
        out->lossless = true;
        break;
    case JPEG:
        code = decode_jpeg(ctx, name, data, size, max_pixels, out);
        break;
    case WEBP:
        code = decode_webp(ctx, name, data, size, max_pixels, out);
        break;
    default:
        return unknown(ctx, name, size);
    }
    if (code)
        sg_image_clear(out);
    return code;
}

bool sg_image_recognised(struct sg_source *in)
{
    const size_t n = sg_source_fill(in, SIGNATURE_BYTES);
    return signature_of((const uint8_t *) in->window, n) != UNKNOWN;
}

int sg_image_read_source(sg_ctx *ctx, struct sg_source *in, uint64_t max_pixels,
                         struct sg_image *out)
{
    char *data;
    size_t size;
    *out = (struct sg_image){0};
    /* An uncompressed 16-bit RGBA file is 8 bytes a pixel; the rest is for metadata. */
    uint64_t limit = max_pixels > UINT64_MAX / 16 ? UINT64_MAX : max_pixels * 8 + (64u << 20);
    if (!sg_image_recognised(in)) /* before the whole file is in memory */
        return unknown(ctx, in->path, in->size);
    if (in->size > limit)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %llu bytes, the limit is %llu", in->path,
                       (unsigned long long) in->size, (unsigned long long) limit);
    int code = sg_source_read(ctx, in, &data, &size);
    if (code)
        return code;
    code = sg_image_decode(ctx, in->path, data, size, max_pixels, out);
    sg_free(data);
    return code;
}

int sg_image_read(sg_ctx *ctx, const char *path, uint64_t max_pixels, struct sg_image *out)
{
    struct sg_source in;
    *out = (struct sg_image){0};
    int code = sg_source_open(ctx, &in, path, UINT64_MAX);
    if (!code)
        code = sg_image_read_source(ctx, &in, max_pixels, out);
    sg_source_close(&in);
    return code;
}

/* To a stream, or to memory of the C library where there is none. Returns spng's code. */
static int encode_png(FILE *stream, bool marked, void **data, size_t *size, const uint8_t *pixels,
                      int width, int height, int channels)
{
    char software[64];
    struct spng_text mark = {.keyword = "Software", .text = software, .type = SPNG_TEXT};
    snprintf(software, sizeof(software), "splatguard %s", sg_version());
    mark.length = strlen(software);
    struct spng_ihdr ihdr = {
        .width = (uint32_t) width, .height = (uint32_t) height, .bit_depth = 8};
    ihdr.color_type = channels == 1   ? SPNG_COLOR_TYPE_GRAYSCALE
                      : channels == 3 ? SPNG_COLOR_TYPE_TRUECOLOR
                                      : SPNG_COLOR_TYPE_TRUECOLOR_ALPHA;
    int failed = SPNG_EMEM;
    spng_ctx *png = spng_ctx_new(SPNG_CTX_ENCODER);
    if (png)
        failed = stream ? spng_set_png_file(png, stream)
                        : spng_set_option(png, SPNG_ENCODE_TO_BUFFER, 1);
    if (!failed)
        failed = spng_set_ihdr(png, &ihdr);
    if (!failed && marked)
        failed = spng_set_text(png, &mark, 1);
    if (!failed)
        failed =
            spng_encode_image(png, pixels, (size_t) width * (size_t) height * (size_t) channels,
                              SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE);
    if (!failed && !stream)
        *data = spng_get_png_buffer(png, size, &failed);
    spng_ctx_free(png);
    return failed;
}

static int png_possible(sg_ctx *ctx, const char *name, int width, int height, int channels)
{
    if (width >= 1 && height >= 1 && (channels == 1 || channels == 3 || channels == 4))
        return SG_OK;
    return sg_fail(ctx, SG_ERR_USAGE, "%s: cannot write a PNG of %d x %d pixels with %d channels",
                   name, width, height, channels);
}

static int write_png(sg_ctx *ctx, const char *path, bool marked, const uint8_t *pixels, int width,
                     int height, int channels)
{
    struct sg_file_writer w;
    int code = png_possible(ctx, path, width, height, channels);
    if (code || (code = sg_file_create(ctx, &w, path)))
        return code;
    const int failed = encode_png(w.stream, marked, NULL, NULL, pixels, width, height, channels);
    if (failed) {
        code = sg_fail(ctx, failed == SPNG_EMEM ? SG_ERR_BUDGET : SG_ERR_INPUT,
                       "%s: cannot write the PNG: %s", path,
                       ferror(w.stream) ? strerror(errno) : spng_strerror(failed));
        sg_file_abandon(&w);
        return code;
    }
    return sg_file_commit(ctx, &w);
}

int sg_image_write_png(sg_ctx *ctx, const char *path, const uint8_t *pixels, int width, int height,
                       int channels)
{
    return write_png(ctx, path, false, pixels, width, height, channels);
}

int sg_image_write_picture(sg_ctx *ctx, const char *path, const uint8_t *pixels, int width,
                           int height, int channels)
{
    return write_png(ctx, path, true, pixels, width, height, channels);
}

/* A codec's memory as the context's. */
static int take_copy(sg_ctx *ctx, const void *from, size_t n, void **data, size_t *size)
{
    *data = sg_alloc_raw(ctx, SG_MEM_FRAME, n, 1);
    *size = *data ? n : 0;
    if (*data)
        memcpy(*data, from, n);
    return *data ? SG_OK : SG_ERR_BUDGET;
}

int sg_image_encode_png(sg_ctx *ctx, const uint8_t *pixels, int width, int height, int channels,
                        void **data, size_t *size)
{
    void *png = NULL, *room;
    *data = NULL;
    int code = png_possible(ctx, "memory", width, height, channels);
    if (!code)
        code = sg_reserve(ctx, SG_MEM_MISC, /* the encoder doubles its buffer */
                          2 * (uint64_t) width * (uint64_t) height * (uint64_t) channels +
                              PNG_ENCODER_LEAST,
                          &room);
    if (code)
        return code;
    const int failed = encode_png(NULL, false, &png, size, pixels, width, height, channels);
    code = failed ? sg_fail(ctx, SG_ERR_BUDGET, "cannot encode a PNG: %s", spng_strerror(failed))
                  : take_copy(ctx, png, *size, data, size);
    free(png);
    sg_free(room);
    return code;
}

/* A compressed picture. */
struct jpeg {
    unsigned char *data; /* the codec's */
    unsigned long size;
    void *room; /* in the ledger, for it */
};

static void clear_jpeg(struct jpeg *j)
{
    tjFree(j->data);
    sg_free(j->room);
}

/* Compresses; clear *out, also after an error. name stands for the place in messages. */
static int make_jpeg(sg_ctx *ctx, const char *name, const uint8_t *rgb, int width, int height,
                     int quality, bool full_chroma, struct jpeg *out)
{
    const int chroma = full_chroma ? TJSAMP_444 : TJSAMP_420;
    *out = (struct jpeg){0};
    if (width < 1 || height < 1 || width > JPEG_SIDE_MAX || height > JPEG_SIDE_MAX)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "%s: found %d x %d pixels, expected sides of 1 to %d of a JPEG", name, width,
                       height, JPEG_SIDE_MAX);
    int code = sg_reserve(ctx, SG_MEM_MISC, tjBufSize(width, height, chroma), &out->room);
    if (code)
        return code;
    tjhandle jpeg = tjInitCompress();
    if (!jpeg)
        return sg_fail(ctx, SG_ERR_BUDGET, "%s: no memory for the JPEG encoder", name);
    if (tjCompress2(jpeg, rgb, width, 0, height, TJPF_RGB, &out->data, &out->size, chroma, quality,
                    TJFLAG_ACCURATEDCT))
        code = jpeg_failed(ctx, name, "cannot write the JPEG", jpeg);
    tjDestroy(jpeg);
    return code;
}

int sg_image_write_jpeg(sg_ctx *ctx, const char *path, const uint8_t *rgb, int width, int height,
                        int quality, bool full_chroma)
{
    struct jpeg j;
    int code = make_jpeg(ctx, path, rgb, width, height, quality, full_chroma, &j);
    if (!code)
        code = sg_file_write(ctx, path, j.data, j.size);
    clear_jpeg(&j);
    return code;
}

int sg_image_encode_jpeg(sg_ctx *ctx, const uint8_t *rgb, int width, int height, int quality,
                         bool full_chroma, void **data, size_t *size)
{
    struct jpeg j;
    *data = NULL;
    int code = make_jpeg(ctx, "memory", rgb, width, height, quality, full_chroma, &j);
    if (!code)
        code = take_copy(ctx, j.data, j.size, data, size);
    clear_jpeg(&j);
    return code;
}

int sg_image_encode_webp(sg_ctx *ctx, const uint8_t *rgba, int width, int height, void **data,
                         size_t *size)
{
    WebPConfig config;
    WebPPicture picture;
    WebPMemoryWriter writer;
    void *room;
    *data = NULL;
    if (!WebPConfigInit(&config) || !WebPPictureInit(&picture))
        return sg_fail(ctx, SG_ERR_USAGE, "cannot encode a WebP: another version of libwebp");
    int code = sg_reserve(
        ctx, SG_MEM_MISC,
        (uint64_t) width * (uint64_t) height * WEBP_ENCODER_BYTES + WEBP_ENCODER_LEAST, &room);
    if (code)
        return code;
    WebPMemoryWriterInit(&writer);
    config.lossless = config.exact = 1; /* exact: also where alpha is 0 */
    picture.use_argb = 1, picture.width = width, picture.height = height;
    picture.writer = WebPMemoryWrite, picture.custom_ptr = &writer;
    if (!WebPPictureImportRGBA(&picture, rgba, 4 * width) || !WebPEncode(&config, &picture))
        code = sg_fail(ctx, SG_ERR_BUDGET, "cannot encode a WebP of %d x %d pixels: error %d",
                       width, height, (int) picture.error_code);
    else
        code = take_copy(ctx, writer.mem, writer.size, data, size);
    WebPPictureFree(&picture);
    WebPMemoryWriterClear(&writer);
    sg_free(room);
    return code;
}

void sg_image_clear(struct sg_image *image)
{
    sg_free(image->pixels);
    *image = (struct sg_image){0};
}

void sg_image_flatten(const struct sg_image *image, enum sg_alpha alpha, uint8_t *rgb)
{
    size_t pixels = (size_t) image->width * (size_t) image->height;
    const uint8_t *p = image->pixels;
    if (image->channels == 3) {
        memcpy(rgb, p, pixels * 3);
        return;
    }
    if (image->channels == 1) {
        for (size_t i = 0; i < pixels; i++)
            rgb[3 * i] = rgb[3 * i + 1] = rgb[3 * i + 2] = p[i];
        return;
    }
    double background = alpha == SG_ALPHA_ON_WHITE ? 1 : 0;
    for (size_t i = 0; i < pixels; i++, p += 4) {
        double a = alpha == SG_ALPHA_DROP ? 1 : p[3] / 255.0;
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (size_t) c] = (uint8_t) (255.0 * (p[c] / 255.0 * a + background * (1 - a)));
    }
}
