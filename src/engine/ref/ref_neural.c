/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle of Scaffold-GS over blocks, for the engine "ref". */
#include "math/real_f32.h"

#include "engine/scaffold/neural.h"
#include "ref_neural.h"

_Static_assert(sizeof(struct ref_weights) == sizeof(struct sg_weights), "weights in float");

static struct ref_anchor anchor_of(const struct sg_anchor_block *b, int lane)
{
    struct ref_anchor a;
    for (int k = 0; k < 3; k++)
        a.position[k] = b->position[k][lane], a.reach[k] = b->reach[k][lane];
    for (int p = 0; p < SG_A_PLANES; p++)
        a.anchor[p] = b->anchor[p][lane];
    return a;
}

static struct ref_view view_of(const struct sg_neural_args *args)
{
    /* What an appearance makes is among the biases. */
    return (struct ref_view){{args->centre[0], args->centre[1], args->centre[2]},
                             args->parts & ~(unsigned) SG_PART_APPEARANCE,
                             {0}};
}

void sg_ref_neural(const struct sg_neural_args *args, const struct sg_anchor_block *block,
                   float (*drawn)[SG_DRAWN_PLANES][SG_LANES])
{
    struct ref_weights w;
    const struct ref_view view = view_of(args);
    memcpy(&w, args->weights, sizeof(w));
    for (int lane = 0; lane < SG_LANES; lane++) {
        const struct ref_anchor a = anchor_of(block, lane);
        real planes[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
        bool exists[SG_ANCHOR_GAUSSIANS];
        ref_neural_forward(&w, &a, &view, planes, exists);
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
            for (int p = 0; p < SG_DRAWN_PLANES; p++)
                drawn[k][p][lane] = p == SG_P_OPACITY && !exists[k] ? -INFINITY : planes[k][p];
    }
}

void sg_ref_neural_backward(const struct sg_neural_args *args, const struct sg_anchor_block *block,
                            float (*gradient)[SG_DRAWN_PLANES][SG_LANES],
                            struct sg_anchor_gradient *out, struct sg_weight_sums *sums)
{
    struct ref_weights w, sum;
    const struct ref_view view = view_of(args);
    memcpy(&w, args->weights, sizeof(w));
    for (int lane = 0; lane < SG_LANES; lane++) {
        const struct ref_anchor a = anchor_of(block, lane);
        struct ref_anchor d;
        real g[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
        memset(&sum, 0, sizeof(sum));
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
            for (int p = 0; p < SG_DRAWN_PLANES; p++)
                g[k][p] = gradient[k][p][lane];
        ref_neural_backward(&w, &a, &view, g, args->volume, &d, &sum, NULL);
        for (int k = 0; k < 3; k++)
            out->reach[k][lane] = d.reach[k];
        for (int p = 0; p < SG_A_PLANES; p++)
            out->anchor[p][lane] = d.anchor[p];
        for (int i = 0; i <= SG_NETWORK_INPUTS; i++)
            for (int h = 0; h < SG_HIDDEN; h++)
                sums->input[i][h] += sum.input[i][h];
        for (int o = 0; o < SG_OUTPUTS; o++) {
            sums->bias[o][lane] += sum.bias[o];
            for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
                sums->output[o][h] += sum.output[o][h];
        }
        for (int h = 0; h < SG_HIDDEN; h++)
            sums->distance[h] += sum.distance[h];
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++) {
            for (int i = 0; i <= SG_BANK_INPUTS; i++)
                sums->bank_input[i][h] += sum.bank_input[i][h];
            for (int j = 0; j < SG_BANK_OUTPUTS; j++)
                sums->bank_output[j][h] += sum.bank_output[j][h];
        }
        for (int j = 0; j < SG_BANK_OUTPUTS; j++)
            sums->bank_bias[j][lane] += sum.bank_bias[j];
    }
}

void sg_ref_pick(const float *column, int planes, int first, int count, const uint32_t *item,
                 float (*out)[SG_LANES])
{
    for (int lane = 0; lane < SG_LANES; lane++)
        for (int p = 0; p < count; p++)
            out[p][lane] = item[lane] == SG_NOWHERE
                               ? 0
                               : column[sg_param_index(planes, item[lane], first + p)];
}
