/* SPDX-License-Identifier: Apache-2.0 */
/* Detects poisoned photos before training, from the pixels alone: poisons that make training
 * expensive leave fine oscillation. An attacker can limit it to parts of photos or to some photos;
 * docs/audit.md has the limits. */
#ifndef SPLATGUARD_AUDIT_H
#define SPLATGUARD_AUDIT_H

#include "scene.h"
#include "spectrum.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SG_AUDIT_TEXTURE 162

enum sg_audit_verdict {
    SG_AUDIT_CLEAN,
    SG_AUDIT_SUSPICIOUS,
    SG_AUDIT_POISONED,
    SG_AUDIT_UNSEEN, /* photos only: the mask leaves no pixel to examine */
    SG_AUDIT_VERDICTS
};

/* Measurements of one image. Differences are between the luma of neighbouring pixels, in grey
 * levels. Neighbours are the nearest used pixels of a row or column: masked pixels are skipped. */
struct sg_audit_features {
    double tv_down, tv_across; /* mean absolute difference to the next row, to the next column */
    /* Mean oscillation: at local extremes the lesser of both differences, else 0. */
    double osc_down, osc_across;
    /* Share of local extremes in all variation plus two grey levels per pixel. */
    double osc_share;
    /* Oscillation of the quiet parts: the 25th percentile over the blocks of 16 x 16 pixels with
     * more than one luma value, weighted by their used pixels. */
    double osc_quiet;
    /* Oscillation of red - green and of blue - green, in both directions. */
    double osc_chroma;
    /* Share of pixels in such blocks that oscillate by more than 2.5 grey levels and where extremes
     * make up more than 0.45 of the variation. */
    double noisy;
    /* At half the size (means of four pixels): oscillation of the quietest tenth and of the median
     * of the blocks, which cover the same parts of the photo, and the share of local extremes. */
    double half_quiet, half_osc, half_share;
    /* At a quarter of the size: oscillation of the median block, share of local extremes. */
    double quarter_osc, quarter_share;
    /* Used pixels in blocks with more than one luma value; all used pixels if ragged > 0.25. */
    double content;
    /* Share of used pixels that have an unused one above, below, left or right. */
    double ragged;
    /* ln of the spectrum's mean energy at 0.7..0.95 of the Nyquist frequency over that at
     * 0.35..0.55. This and anisotropy use all pixels. */
    double slope;
    double anisotropy;                /* of the spectrum, see spectrum.h */
    double tiles;                     /* of 32 x 32 pixels in which luma varies */
    double texture[SG_AUDIT_TEXTURE]; /* statistics of these tiles: docs/audit.md */
    double evidence; /* logit of the score of the most suspicious area: photo, half or quarter */
    double amplitude, amplitude_error; /* tau of that area, if it is poisoned */
};

struct sg_audit_image {
    const char *name; /* owned by the scene */
    struct sg_audit_features features;
    double score; /* 0..1; 0 if unseen */
    /* Amplitude of the poison: an estimate of the attack's bound in grey levels, and its standard
     * error. Both are 0 if the verdict is clean or unseen. */
    double tau, tau_error;
    enum sg_audit_verdict verdict;
};

#define SG_AUDIT_REASONS_MAX 8

struct sg_audit {
    size_t count;
    struct sg_audit_image *images; /* one per training view, in their order */
    double score;                  /* of the set */
    /* Median over the photos that are not clean, and its standard error; 0 if the set is clean. */
    double tau, tau_error;
    enum sg_audit_verdict verdict;
    size_t verdicts[SG_AUDIT_VERDICTS]; /* number of images with each verdict */
    size_t count_reasons;
    char *reasons[SG_AUDIT_REASONS_MAX]; /* sentences: the evidence for a poison */
};

/* Audits the training views. The caller owns *out. Errors: SG_ERR_INPUT if no training view has a
 * used pixel; SG_ERR_BUDGET. Thread safety: as the context. */
SG_API int sg_audit_scene(sg_ctx *ctx, const struct sg_scene *scene, struct sg_audit **out);
SG_API void sg_audit_destroy(struct sg_audit **audit);

/* "clean", "suspicious", ...: static. */
SG_API const char *sg_audit_verdict_name(enum sg_audit_verdict verdict);

/* Measures one image. rgb: height x width x 3. mask: height x width, 0 = ignored, or NULL. map:
 * NULL, or (height + 15) / 16 x (width + 15) / 16 floats that receive the oscillation of each block
 * in grey levels. Errors: SG_ERR_USAGE for a side outside 1..SG_SIDE_MAX, SG_ERR_BUDGET. Several
 * threads may measure at once in one context. */
SG_API int sg_audit_measure(sg_ctx *ctx, const uint8_t *rgb, const uint8_t *mask, int width,
                            int height, struct sg_audit_features *out, float *map);

/* Writes a page (HTML, without any other file) with the reasons, spectra and heat maps of the most
 * and the least suspicious photos, and a table of all. Errors: SG_ERR_INPUT where it cannot be
 * written or another's file is there, SG_ERR_BUDGET. */
SG_API int sg_audit_write_page(sg_ctx *ctx, const struct sg_scene *scene,
                               const struct sg_audit *audit, const char *path);

#ifdef __cplusplus
}
#endif

#endif
