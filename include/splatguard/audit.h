/* SPDX-License-Identifier: Apache-2.0 */
/* Tells poisoned photos from clean ones before training, from the pixels alone: an attack that
 * makes training dear has to fill the photos with fine oscillation, everywhere, and in every
 * photo. */
#ifndef SPLATGUARD_AUDIT_H
#define SPLATGUARD_AUDIT_H

#include "scene.h"
#include "spectrum.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SG_AUDIT_TEXTURE 146

enum sg_audit_verdict {
    SG_AUDIT_CLEAN,
    SG_AUDIT_SUSPICIOUS,
    SG_AUDIT_POISONED,
    SG_AUDIT_UNSEEN, /* of a photo, never of a set: its mask leaves no pixel, so nothing was looked
                        at */
    SG_AUDIT_VERDICTS
};

/* What is measured of one image. Differences are between neighbouring pixels' luma, in grey levels;
 * neighbours are the nearest pixels of a row or column that the mask does not leave out. */
struct sg_audit_features {
    double tv_down, tv_across;   /* mean absolute difference to the next row, to the next column */
    double osc_down, osc_across; /* mean oscillation: at local extremes, the lesser of both
                                    differences, else 0 */
    double osc_share; /* the share that local extremes carry of all variation plus two grey levels a
                         pixel */
    double osc_quiet; /* oscillation of the quiet parts: the 25th percentile over the blocks of 16 x
                         16 pixels that are not of one colour, each counting as much as it has used
                         pixels */
    double osc_chroma; /* oscillation of red - green and of blue - green, both directions */
    double noisy; /* the share of pixels in such blocks that oscillate by more than 2.5 grey levels,
                     with more than 0.45 of their variation in it */
    double half_quiet, half_osc,
        half_share; /* at half the size (means of four pixels): oscillation of the quietest
                       tenth and of the middle of the blocks, which cover the same parts of the
                       photo; what local extremes carry */
    double quarter_osc,
        quarter_share; /* at a quarter of the size: of the middle; what they carry */
    double content;    /* used pixels in blocks that are not of one colour (of luma); all used ones
                          where ragged > 0.25 */
    /* the share of used pixels that have an unused one above, below, left or right */
    double ragged;
    double slope; /* ln of the spectrum's mean energy at 0.7..0.95 of the Nyquist frequency over
                     that at 0.35..0.55; of all pixels, as the next */
    double anisotropy;                /* of the spectrum, see spectrum.h */
    double tiles;                     /* of 32 x 32 pixels in which luma varies */
    double texture[SG_AUDIT_TEXTURE]; /* statistics of these tiles: docs/audit.md */
    double evidence; /* logit of the score, of the photo or of a half or quarter of it */
    double amplitude, amplitude_error; /* of the same area, if it is poisoned: tau */
};

struct sg_audit_image {
    const char *name; /* the view's: lives as long as the scene */
    struct sg_audit_features features;
    double score; /* 0..1; 0 where unseen */
    /* Amplitude of the poison: an estimate of the attack's bound in grey levels, and its standard
     * error. Both are 0 where the verdict is clean or unseen. */
    double tau, tau_error;
    enum sg_audit_verdict verdict;
};

#define SG_AUDIT_REASONS_MAX 8

struct sg_audit {
    size_t count;
    struct sg_audit_image *images; /* of the training views, in their order */
    double score;                  /* of the set */
    double tau,
        tau_error; /* of the photos that are not clean: the median, and its standard error; or 0 */
    enum sg_audit_verdict verdict;
    size_t verdicts[SG_AUDIT_VERDICTS]; /* images of each */
    size_t count_reasons;
    char *reasons[SG_AUDIT_REASONS_MAX]; /* sentences: what speaks for a poison */
};

/* The caller owns *out. Errors: SG_ERR_INPUT: no training view has a used pixel, so there is
 * nothing to judge; SG_ERR_BUDGET. Thread safety: as the context. */
SG_API int sg_audit_scene(sg_ctx *ctx, const struct sg_scene *scene, struct sg_audit **out);
SG_API void sg_audit_destroy(struct sg_audit **audit);

SG_API const char *sg_audit_verdict_name(enum sg_audit_verdict verdict);

/* One image, rgb: height x width x 3. mask: height x width, 0 = left out, or NULL. map: NULL, or
 * (height + 15) / 16 x (width + 15) / 16 floats for the blocks' oscillation in grey levels. Errors:
 * SG_ERR_BUDGET. Several threads may measure at once in one context. */
SG_API int sg_audit_measure(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width,
                            int height, struct sg_audit_features *out, float *map);

#ifdef __cplusplus
}
#endif

#endif
