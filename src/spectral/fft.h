/* SPDX-License-Identifier: Apache-2.0 */
/* Fourier transforms of rows and columns of images, not normalised. Vector lanes are transforms:
 * SG_FFT_LANES columns, or twice as many real rows in pairs, are transformed at once. The kernels
 * (src/engine/cpu/kernels/fft.c) exist once per instruction set and give the same bytes on each,
 * because none of them fuses multiplications and additions. */
#ifndef SG_SPECTRAL_FFT_H
#define SG_SPECTRAL_FFT_H

#include "core/context.h"

#define SG_FFT_LANES 16
#define SG_FFT_ROWS (2 * SG_FFT_LANES) /* real rows at once */
/* floats of a point of 16 transforms: the real parts, the imaginary parts */
#define SG_FFT_POINT (2 * SG_FFT_LANES)

/* Columns of a half spectrum: horizontal frequencies 0 .. width / 2. */
#define SG_FFT_COLUMNS(width) ((size_t) (width) / 2 + 1)

/* Half spectra are stored in panels of 16 columns: all rows of the first panel, a point each, then
 * those of the next. */
#define SG_FFT_PANELS(columns) (((size_t) (columns) + SG_FFT_LANES - 1) / SG_FFT_LANES)

#define SG_FFT_STAGES 32 /* n < 2^31 */
/* larger prime factors take longer by definition than the whole length by Bluestein */
#define SG_FFT_PRIME_MAX 97

/* The length n = radix x rest is transformed as `radix` transforms of length rest, whose results
 * one pass joins. */
struct sg_fft_stage {
    int radix, rest;
    /* rest x (radix - 1): e^(-2 pi i k j / (radix rest)), k = 0.., j = 1.. */
    const float *twiddles;
    const float *roots; /* radix: e^(-2 pi i j / radix) */
};

/* What the transforms of one length share; read only. */
struct sg_fft {
    int n, stages;
    struct sg_fft_stage stage[SG_FFT_STAGES];
    /* Lengths with a large prime factor (larger than SG_FFT_PRIME_MAX; stages = 0) are convolutions
     * with a chirp, by Bluestein: */
    struct sg_fft *longer; /* of at least 2 n - 1 */
    const float *chirp;    /* n: e^(-pi i j^2 / n) */
    const float *filter;   /* longer->n: transform of the chirp's conjugate, over longer->n */
    float *tables;
    size_t floats; /* of tables */
};

/* Errors: SG_ERR_BUDGET. */
int sg_fft_create(sg_ctx *ctx, int n, struct sg_fft **out);
void sg_fft_destroy(struct sg_fft **fft);

/* The fastest kernels of this machine; which ones does not change results. */
const struct sg_fft_kernels *sg_fft_fastest(void);

/* Floats of scratch, aligned to 64 bytes, that a kernel needs; of `columns`, and of `rows` and
 * `rows_back`. */
size_t sg_fft_scratch(const struct sg_fft *fft);
size_t sg_fft_rows_scratch(const struct sg_fft *fft);

/* Rows of an image and the same rows of its half spectrum. */
struct sg_fft_rows {
    int count;     /* rows, at most SG_FFT_ROWS */
    int width;     /* values of a row, at most n: up to n the last one is repeated */
    int columns;   /* of the half spectrum that are stored, the first ones; panels are written
                    * whole */
    float *panels; /* the first of the rows in the first panel */
    size_t panel;  /* floats from a panel to the next */
};

/* Name, result and arguments of every kernel. They are written here only. */
#define SG_FFT_KERNELS(K)                                                                          \
    /* SG_FFT_LANES complex transforms of n points each. in and out do not overlap. */             \
    K(columns, void,                                                                               \
      (const struct sg_fft *, const float *in, float *out, bool backward, float *scratch))         \
    /* Row i begins at row[i]. */                                                                  \
    K(rows, void,                                                                                  \
      (const struct sg_fft *, const struct sg_fft_rows *, const float *const *row,                 \
       float *scratch))                                                                            \
    /* Adds scale times the real transforms back to the `width` values at each row[i] that is not  \
     * NULL. Columns beyond the stored ones are 0, the imaginary part of column 0 is not read, and \
     * the column of frequency n / 2 must not be stored. The last value gets what belongs to its   \
     * repetitions too. */                                                                         \
    K(rows_back, void,                                                                             \
      (const struct sg_fft *, const struct sg_fft_rows *, float *const *row, float scale,          \
       float *scratch))

struct sg_fft_kernels {
#define K(kernel, result, arguments) result(*kernel) arguments;
    SG_FFT_KERNELS(K)
#undef K
};

/* The same by scalar code in double precision; slow. */
extern const struct sg_fft_kernels sg_fft_oracle;

/* One transform of n complex numbers in double precision; out, room: as many. */
void sg_fft_exact(int n, const double *in, double *out, double *room);

#endif
