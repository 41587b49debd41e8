/* SPDX-License-Identifier: Apache-2.0 */
/* .splat, as the viewer of Kevin Kwok (antimatter15/splat) reads it. 32 bytes a Gaussian: position
 * and scales as float32, red green blue opacity and quaternion w x y z as bytes. */
#include "codec.h"

#define ROW 32

int sg_splat_read(sg_ctx *ctx, struct sg_source *in, uint64_t max_gaussians, struct sg_model **out)
{
    const uint64_t bytes = sg_source_left(in), count = bytes / ROW;
    if (bytes % ROW)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %llu bytes, expected a multiple of %d",
                       in->path, (unsigned long long) bytes, ROW);
    struct sg_model *m;
    int code = sg_claimed_model(ctx, in, count, 0, max_gaussians, &m);
    for (size_t i = 0; i < count && !code; i++) {
        const char *row = sg_source_peek(in, ROW);
        if (!row) {
            code = sg_short_file(ctx, in);
            break;
        }
        for (int k = 0; k < 3; k++) {
            *sg_model_at(m, i, SG_P_XYZ + k) = sg_f32(row + 4 * k);
            *sg_model_at(m, i, SG_P_SCALE + k) = sg_log_scale(sg_f32(row + 12 + 4 * k));
            *sg_model_at(m, i, SG_P_SH + k) = sg_dc_of_byte((uint8_t) row[24 + k]);
        }
        *sg_model_at(m, i, SG_P_OPACITY) = sg_logit_of_byte((uint8_t) row[27]);
        for (int k = 0; k < 4; k++)
            *sg_model_at(m, i, SG_P_ROT + k) = ((float) (uint8_t) row[28 + k] - 128) / 128;
        sg_source_skip(in, ROW);
    }
    if (code)
        sg_model_destroy(&m);
    *out = m;
    return code;
}

int sg_splat_write(const struct sg_model *m, FILE *f)
{
    for (size_t i = 0; i < m->count; i++) {
        float values[6], q[4];
        uint8_t bytes[8];
        sg_unit_quaternion(m, i, q);
        for (int k = 0; k < 3; k++) {
            values[k] = *sg_model_at(m, i, SG_P_XYZ + k);
            values[3 + k] = sg_finite_scale(*sg_model_at(m, i, SG_P_SCALE + k));
            bytes[k] = sg_byte_of_dc(*sg_model_at(m, i, SG_P_SH + k));
        }
        bytes[3] = sg_byte(255 * sg_logistic(*sg_model_at(m, i, SG_P_OPACITY)));
        for (int k = 0; k < 4; k++)
            bytes[4 + k] = sg_byte(128 * q[k] + 128);
        fwrite(values, 4, 6, f); /* little endian hosts only, as the store itself */
        fwrite(bytes, 1, 8, f);
    }
    return SG_OK;
}
