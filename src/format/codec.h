/* SPDX-License-Identifier: Apache-2.0 */
/* What the readers and writers of model files share. */
#ifndef SG_FORMAT_CODEC_H
#define SG_FORMAT_CODEC_H

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "math/constants.h"
#include "model/ply.h"
#include "splatguard/format.h"

/* Readers: the source is at the first byte of the file; *out is the caller's, NULL after an error.
 * Writers: to a stream that the caller commits, and of a model without NaN and infinities. */
int sg_splat_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out);
int sg_spz_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out);
int sg_ksplat_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                   struct sg_model **out);
int sg_sog_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out);
int sg_compressed_ply_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians,
                           struct sg_model **out);

int sg_splat_write(const struct sg_model *m, FILE *f);
int sg_spz_write(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path, int version);
int sg_compressed_ply_write(sg_ctx *ctx, const struct sg_model *m, FILE *f);
int sg_sog_write(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path);
int sg_glb_write(sg_ctx *ctx, const struct sg_model *m, FILE *f, const char *path);

/* Packed data may stand for any number of equal Gaussians. A .sog, or an .spz of version 4, that
 * claims more is refused before memory is taken for it, and is not written. */
#define SG_GAUSSIANS_A_BYTE 16

/* Which Gaussian is where along a space-filling curve (Morton 1966); equal places keep their order.
 * sg_free(*order), also after an error. */
int sg_model_order(sg_ctx *ctx, const struct sg_model *m, uint32_t **order);

/* sg_model_create for the count that a file claims, once it has been compared with the file's
 * size. */
int sg_claimed_model(sg_ctx *ctx, const struct sg_source *in, uint64_t count, int sh_degree,
                     uint64_t max_gaussians, struct sg_model **out);

int sg_short_file(sg_ctx *ctx, const struct sg_source *in);

#define SG_SH_REST_MAX 45 /* values beyond degree 0, at degree 3 */
static inline int sg_sh_rest(int sh_degree)
{
    return 3 * ((sh_degree + 1) * (sh_degree + 1) - 1);
}

/* Axes of a file: how it differs from those of our models (x right, y down, z forward) in signs. */
struct sg_axes {
    int x, y, z; /* 1 or -1; one or three of them are 1 */
};
/* Signs of the quaternion's w x y z, and of the 15 coefficients of degrees 1 to 3. */
void sg_axes_signs(struct sg_axes axes, int quaternion[4], int sh[15]);

/* A quaternion w x y z of length 1; one of length 0 becomes 1 0 0 0. */
void sg_unit_quaternion(const struct sg_model *m, size_t i, float q[4]);

/* A scale of its logarithm, finite as readers expect it. */
static inline float sg_finite_scale(float log_scale)
{
    return fminf(expf(log_scale), 3.4e38f);
}

static inline float sg_logistic(float x)
{
    return 1 / (1 + expf(-x));
}

/* To 0..255, nearest. */
static inline uint8_t sg_byte(float x)
{
    return (uint8_t) (x <= 0 ? 0 : x >= 255 ? 255 : x + 0.5f);
}

/* Bytes 0 and 255 have no finite logit: they stand for values a quarter of a step from the end. */
static inline float sg_logit_of_byte(uint8_t byte)
{
    const float a = byte == 0 ? 0.25f : byte == 255 ? 254.75f : (float) byte;
    return logf(a / (255 - a));
}

/* Degree 0 of the SH as a colour: 0..255 is black..white. */
static inline uint8_t sg_byte_of_dc(float dc)
{
    return sg_byte(255 * (0.5f + (float) SG_SH_C0 * dc));
}

static inline float sg_dc_of_byte(uint8_t byte)
{
    return ((float) byte / 255 - 0.5f) / (float) SG_SH_C0;
}

/* Natural logarithm of a scale. 0 would be -infinity, which is no model: 2e-9 is as invisible. */
#define SG_SMALLEST_LOG_SCALE (-20.0f)
static inline float sg_log_scale(float scale)
{
    return scale == 0 ? SG_SMALLEST_LOG_SCALE : logf(scale);
}

static inline uint32_t sg_u32(const char *bytes)
{
    const unsigned char *b = (const unsigned char *) bytes;
    return b[0] | (uint32_t) b[1] << 8 | (uint32_t) b[2] << 16 | (uint32_t) b[3] << 24;
}

static inline uint16_t sg_u16(const char *bytes)
{
    const unsigned char *b = (const unsigned char *) bytes;
    return (uint16_t) (b[0] | b[1] << 8);
}

static inline float sg_f32(const char *bytes)
{
    const uint32_t bits = sg_u32(bytes);
    float value;
    memcpy(&value, &bits, 4);
    return value;
}

#endif
