/* SPDX-License-Identifier: Apache-2.0 */
#include "codec.h"

#include "model/columns.h"

int sg_short_file(sg_ctx *ctx, const struct sg_source *in)
{
    return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %llu: found the end of the file, expected more",
                   in->path, (unsigned long long) in->size);
}

int sg_claimed_model(sg_ctx *ctx, const struct sg_source *in, uint64_t count, int sh_degree,
                     uint64_t max_gaussians, struct sg_model **out)
{
    *out = NULL;
    if (!count)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found 0 Gaussians, expected at least one", in->path);
    if (count > max_gaussians)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %llu Gaussians, the limit is %llu", in->path,
                       (unsigned long long) count, (unsigned long long) max_gaussians);
    const int code = sg_model_create(ctx, (size_t) count, sh_degree, out);
    return sg_model_refused(ctx, code, in->path, count,
                            (size_t) sg_param_count(sh_degree) * sizeof(float));
}

void sg_axes_signs(struct sg_axes a, int quaternion[4], int sh[15])
{
    /* A turn about an axis is reversed by mirroring one of the other two. */
    const int q[4] = {1, a.y * a.z, a.x * a.z, a.x * a.y};
    /* Which of x y z are factors of odd power: y z x; xy yz 1 xz 1; y xyz y z x z x. */
    const int s[15] = {a.y, a.z, a.x, a.x * a.y, a.y * a.z, 1, a.x * a.z, 1, a.y, a.x * a.y * a.z,
                       a.y, a.z, a.x, a.z,       a.x};
    memcpy(quaternion, q, sizeof(q));
    memcpy(sh, s, sizeof(s));
}

void sg_unit_quaternion(const struct sg_model *m, size_t i, float q[4])
{
    float largest = 0, length = 0;
    for (int k = 0; k < 4; k++) {
        q[k] = *sg_model_at(m, i, SG_P_ROT + k);
        largest = fmaxf(largest, fabsf(q[k]));
    }
    for (int k = 0; k < 4 && largest > 0; k++) {
        q[k] /= largest; /* whose square might not be finite */
        length += q[k] * q[k];
    }
    length = sqrtf(length);
    for (int k = 0; k < 4; k++)
        q[k] = largest > 0 ? q[k] / length : k == 0;
}
