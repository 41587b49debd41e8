/* SPDX-License-Identifier: Apache-2.0 */
#include "codec.h"
#include "model/anchors.h"
#include "model/columns.h"

struct sg_model_selection sg_model_selection_default(void)
{
    return (struct sg_model_selection){SG_MODEL_SELECTION_DEFAULTS};
}

static int check(sg_ctx *ctx, const struct sg_model_selection *s)
{
    if (s->sh_degree < 0 || s->sh_degree > 3)
        return sg_fail(ctx, SG_ERR_USAGE, "sh_degree: found %d, expected 0 to 3", s->sh_degree);
    if (!(s->min_opacity >= 0 && s->min_opacity <= 1))
        return sg_fail(ctx, SG_ERR_USAGE, "min_opacity: found %g, expected 0 to 1", s->min_opacity);
    for (int k = 0; k < 3 && s->crop; k++)
        if (!(s->low[k] <= s->high[k]))
            return sg_fail(ctx, SG_ERR_USAGE, "crop: found %c from %g to %g, expected low to high",
                           'x' + k, s->low[k], s->high[k]);
    return SG_OK;
}

static bool is_selected(const struct sg_model *m, size_t i, const struct sg_model_selection *s)
{
    for (int k = 0; k < 3 && s->crop; k++) {
        const float at = *sg_model_at(m, i, SG_P_XYZ + k);
        if (!((double) at >= s->low[k] && (double) at <= s->high[k]))
            return false;
    }
    return s->min_opacity <= 0 ||
           (double) sg_logistic(*sg_model_at(m, i, SG_P_OPACITY)) >= s->min_opacity;
}

int sg_model_select(sg_ctx *ctx, const struct sg_model *m,
                    const struct sg_model_selection *selection, struct sg_model **out)
{
    sg_clear_error(ctx);
    *out = NULL;
    const struct sg_model_selection s = selection ? *selection : sg_model_selection_default();
    int code = check(ctx, &s);
    if (!code)
        code = sg_model_refuse_anchors(ctx, m);
    size_t count = 0;
    for (size_t i = 0; i < m->count && !code; i++)
        count += is_selected(m, i, &s);
    if (!code && !count)
        code = sg_fail(ctx, SG_ERR_INPUT, "model: found none of %zu Gaussians in the selection",
                       m->count);
    if (!code)
        code = sg_model_create_like(ctx, m, count, s.sh_degree, out);
    for (size_t i = 0, to = 0; i < m->count && !code; i++)
        if (is_selected(m, i, &s))
            sg_model_copy_row(m, i, *out, to++);
    return code;
}
