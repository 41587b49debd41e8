/* SPDX-License-Identifier: Apache-2.0 */
/* Rows are transformed a few at a time from a small buffer, columns a cache line's worth at a time and only those that
 * reach into the band; what is done with their coefficients is done while they are in the cache. */
#include "anisotropy.h"

#include <complex.h>
#include <fftw3.h>
#include <math.h>
#include <string.h>

#include "fft.h"

#define OUTSIDE 255  /* of the band; directions are fewer */
#define ROWS 16      /* a piece of work */
#define COLUMNS 16   /* a piece of work: two cache lines */
#define APART 4      /* sums of a bin */
#define EXACT_TO 256 /* sides this short are never continued */

struct sg_anisotropy {
    sg_ctx *ctx;
    struct sg_anisotropy_params params;
    int width, height;                                       /* of the image */
    int w, h;                                                /* of what is transformed */
    int planes;                                              /* transformed */
    int columns;                                             /* that reach into the band, the first ones */
    size_t row, stride;                                      /* floats of a row buffer, coefficients of a row */
    fftwf_plan rows[2], rows_back[2], cols[2], cols_back[2]; /* of a whole piece; of the last one */
    uint8_t *direction;                                      /* h x columns: bin of each coefficient */
    float *buffers;                                          /* a thread: ROWS rows */
    float complex *f;                                        /* planes half spectra */
    float *beyond;                                           /* gradient of the rows that continue the image */
    double *energy;                                          /* a piece of columns: bins */
    float factor[SG_SPECTRUM_BINS_MAX + 2];                  /* of each bin's coefficients in the gradient */
    /* of a call */
    const float *image;
    float *gradient;
    float weight;
};

/* The next quick multiple of `step`. */
static int quick(int n, int step, bool exact)
{
    if (exact || n < EXACT_TO)
        return n;
    for (n += n % step;; n += step) {
        int rest = n;
        for (int p = 2; p <= 7; p++)
            while (rest % p == 0)
                rest /= p;
        if (rest == 1 || rest == 11 || rest == 13)
            return n;
    }
}

int sg_anisotropy_width(int width, bool exact)
{
    return quick(width, 2, exact);
}

int sg_anisotropy_height(int height, bool exact)
{
    return quick(height, 1, exact);
}

static int fill_directions(struct sg_anisotropy *a)
{
    const struct sg_spectrum_params *band = &a->params.band;
    for (int v = 0; v < (int) SG_FFT_COLUMNS(a->w); v++)
        for (int u = 0; u < a->h && a->columns <= v; u++)
            if (sg_spectrum_bin(u, v, a->w, a->h, band, OUTSIDE) != OUTSIDE)
                a->columns = v + 1;
    a->columns = a->columns ? a->columns : 1;
    a->direction = sg_alloc_raw(a->ctx, SG_MEM_FRAME, (size_t) a->h * (size_t) a->columns, 1);
    if (!a->direction)
        return SG_ERR_BUDGET;
    for (int u = 0; u < a->h; u++)
        for (int v = 0; v < a->columns; v++)
            a->direction[u * a->columns + v] = (uint8_t) sg_spectrum_bin(u, v, a->w, a->h, band, OUTSIDE);
    return SG_OK;
}

static size_t row_pieces(const struct sg_anisotropy *a)
{
    return ((size_t) a->h + ROWS - 1) / ROWS;
}

static size_t column_pieces(const struct sg_anisotropy *a)
{
    return ((size_t) a->columns + COLUMNS - 1) / COLUMNS;
}

/* [0]: of a whole piece, [1]: of what is left at the end. */
static int make_plans(struct sg_anisotropy *a)
{
    for (int last = 0; last < 2; last++) {
        const int rows = last ? a->h % ROWS : ROWS, columns = last ? a->columns % COLUMNS : COLUMNS;
        if (rows && sg_fft_plan_rows(a->ctx, a->w, rows, (int) a->row, (int) a->stride, a->buffers, a->f,
                                     &a->rows[last], &a->rows_back[last]))
            return SG_ERR_BUDGET;
        if (columns &&
            sg_fft_plan_columns(a->ctx, a->h, columns, (int) a->stride, a->f, &a->cols[last], &a->cols_back[last]))
            return SG_ERR_BUDGET;
    }
    return SG_OK;
}

struct sg_anisotropy_params sg_anisotropy_params_default(void)
{
    return (struct sg_anisotropy_params){SG_ANISOTROPY_DEFAULTS};
}

int sg_anisotropy_create(sg_ctx *ctx, int width, int height, const struct sg_anisotropy_params *params,
                         struct sg_anisotropy **out)
{
    *out = NULL;
    struct sg_anisotropy *a = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*a));
    if (!a)
        return SG_ERR_BUDGET;
    *a = (struct sg_anisotropy){
        .ctx = ctx, .params = params ? *params : sg_anisotropy_params_default(), .width = width, .height = height};
    a->w = sg_anisotropy_width(width, a->params.exact_size);
    a->h = sg_anisotropy_height(height, a->params.exact_size);
    a->planes = a->params.channels == SG_CHANNELS_LUMA ? 1 : 3;
    a->row = ((size_t) a->w + 15) / 16 * 16, a->stride = (SG_FFT_COLUMNS(a->w) + 7) / 8 * 8;
    int code = fill_directions(a);
    const size_t planes = (size_t) a->planes, threads = (size_t) sg_ctx_threads(ctx);
    if (!code) {
        a->buffers = sg_alloc(ctx, SG_MEM_FRAME, threads * ROWS * a->row, sizeof(float));
        a->f = sg_alloc(ctx, SG_MEM_FRAME, planes * (size_t) a->h * a->stride, sizeof(float complex));
        a->beyond = sg_alloc(ctx, SG_MEM_FRAME, planes * (size_t) (a->h - height) + 1, (size_t) width * sizeof(float));
        a->energy =
            sg_alloc(ctx, SG_MEM_FRAME, planes * column_pieces(a) * (size_t) a->params.band.bins, sizeof(double));
        code = a->buffers && a->f && a->beyond && a->energy ? make_plans(a) : SG_ERR_BUDGET;
    }
    if (code) {
        sg_anisotropy_destroy(&a);
        return code;
    }
    *out = a;
    return SG_OK;
}

void sg_anisotropy_destroy(struct sg_anisotropy **p)
{
    struct sg_anisotropy *a = *p;
    if (!a)
        return;
    for (int i = 0; i < 2; i++) {
        sg_fft_forget(a->rows[i]);
        sg_fft_forget(a->rows_back[i]);
        sg_fft_forget(a->cols[i]);
        sg_fft_forget(a->cols_back[i]);
    }
    sg_free(a->direction);
    sg_free(a->buffers);
    sg_free(a->f);
    sg_free(a->beyond);
    sg_free(a->energy);
    sg_free(a);
    *p = NULL;
}

static const float luma[3] = {0.299f, 0.587f, 0.114f};

static float complex *spectrum_of(const struct sg_anisotropy *a, size_t plane)
{
    return a->f + plane * (size_t) a->h * a->stride;
}

static float pixel(const struct sg_anisotropy *a, size_t plane, int y, int x)
{
    const size_t pixels = (size_t) a->width * (size_t) a->height;
    const float *p = a->image + (size_t) y * (size_t) a->width + (size_t) x;
    return a->planes == 3 ? p[plane * pixels] : luma[0] * p[0] + luma[1] * p[pixels] + luma[2] * p[2 * pixels];
}

/* Row y of what is transformed: the image, whose last column and row are repeated. The jump to the first ones, which an
 * exact transform has too, is kept: a ramp there would change the energy along the axes, most of a smooth image's. */
static void load_row(const struct sg_anisotropy *a, size_t plane, int y, float *to)
{
    y = y < a->height ? y : a->height - 1;
    if (a->planes == 3)
        memcpy(to, a->image + (plane * (size_t) a->height + (size_t) y) * (size_t) a->width,
               (size_t) a->width * sizeof(float));
    else
        for (int x = 0; x < a->width; x++)
            to[x] = pixel(a, plane, y, x);
    for (int x = a->width; x < a->w; x++)
        to[x] = to[a->width - 1];
}

static void transform_rows(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const size_t plane = piece / row_pieces(a);
    const int first = (int) (piece % row_pieces(a)) * ROWS, end = first + ROWS < a->h ? first + ROWS : a->h;
    float *buffer = a->buffers + (size_t) thread * ROWS * a->row;
    for (int y = first; y < end; y++)
        load_row(a, plane, y, buffer + (size_t) (y - first) * a->row);
    fftwf_execute_dft_r2c(a->rows[end - first < ROWS], buffer, spectrum_of(a, plane) + (size_t) first * a->stride);
}

struct column_piece {
    float complex *f; /* its first column */
    int first, count;
};

static struct column_piece column_piece(const struct sg_anisotropy *a, size_t piece)
{
    const int first = (int) (piece % column_pieces(a)) * COLUMNS;
    return (struct column_piece){spectrum_of(a, piece / column_pieces(a)) + first, first,
                                 first + COLUMNS < a->columns ? COLUMNS : a->columns - first};
}

static void transform_columns(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const struct column_piece c = column_piece(a, piece);
    const bool amplitude = a->params.energy == SG_ENERGY_AMPLITUDE;
    const int bins = a->params.band.bins;
    double energy[APART][256] = {0}; /* of OUTSIDE too: no branch; neighbours often share a bin, but not its sum */
    double whole[256] = {0};         /* of column 0, which has its conjugates itself; the others do not store theirs */
    (void) thread;
    fftwf_execute_dft(a->cols[c.count < COLUMNS], c.f, c.f);
    for (int u = 0; u < a->h; u++) {
        const float *f = (const float *) (c.f + (size_t) u * a->stride);
        const uint8_t *bin = a->direction + u * a->columns + c.first;
        float e[COLUMNS] = {0};
        for (int v = 0; v < c.count; v++)
            e[v] = f[2 * v] * f[2 * v] + f[2 * v + 1] * f[2 * v + 1];
        for (int v = 0; v < c.count && amplitude; v++)
            e[v] = sqrtf(e[v]);
        (c.first ? energy[0] : whole)[bin[0]] += (double) e[0];
        for (int v = 1; v < c.count; v++)
            energy[v % APART][bin[v]] += (double) e[v];
    }
    double *sums = a->energy + piece * (size_t) bins;
    memset(sums, 0, (size_t) bins * sizeof(double));
    for (int b = 0; b < bins; b++) {
        const double sum = (energy[0][b] + energy[1][b]) + (energy[2][b] + energy[3][b]);
        sums[b] += whole[b] + sum;
        sums[(b + bins / 2) % bins] += sum;
    }
}

/* The loss, and each bin's factor in the gradient: dL/dE_b = (ln P_b + H) / (S ln B). */
static double loss_of_bins(struct sg_anisotropy *a)
{
    const int bins = a->params.band.bins;
    const bool power = a->params.energy == SG_ENERGY_POWER;
    double energy[SG_SPECTRUM_BINS_MAX] = {0}, total = 0, entropy = 0;
    for (size_t piece = 0; piece < (size_t) a->planes * column_pieces(a); piece++)
        for (int b = 0; b < bins; b++)
            energy[b] += a->energy[piece * (size_t) bins + (size_t) b];
    for (int b = 0; b < bins; b++)
        total += energy[b] = fmax(energy[b], 0);
    memset(a->factor, 0, sizeof(a->factor));
    const double values = (double) a->planes * (double) a->w * (double) a->h;
    if (!(total > (power ? 1e-12 * values * values : 1e-6 * values))) /* rounding of a flat image */
        return 0;
    for (int b = 0; b < bins; b++)
        entropy -= energy[b] > 0 ? energy[b] / total * log(energy[b] / total) : 0;
    for (int b = 0; b < bins; b++)
        a->factor[b] =
            (float) ((power ? 2 : 1) * (log(fmax(energy[b] / total, 1e-12)) + entropy) / (total * log(bins)));
    return 1 - entropy / log(bins);
}

/* dL/dx = c2r(factor F), and of amplitudes c2r(factor F / |F|): the inverse transform, not normalised, brings the
 * conjugates. */
static void pull_columns(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const struct column_piece c = column_piece(a, piece);
    float factor[256];
    (void) thread;
    memcpy(factor, a->factor, SG_SPECTRUM_BINS_MAX * sizeof(float));
    factor[OUTSIDE] = factor[OUTSIDE - 1] = 0;
    for (int u = 0; u < a->h; u++) {
        float complex *f = c.f + (size_t) u * a->stride;
        const uint8_t *bin = a->direction + u * a->columns + c.first;
        for (int v = 0; v < c.count; v++)
            f[v] *= factor[bin[v]];
        for (int v = 0; v < c.count && a->params.energy == SG_ENERGY_AMPLITUDE; v++) {
            /* f has been scaled: its length is that of the factor times |F| */
            const float size = cabsf(f[v]);
            f[v] = size > 1e-30f ? f[v] / size * fabsf(factor[bin[v]]) : 0;
        }
    }
    fftwf_execute_dft(a->cols_back[c.count < COLUMNS], c.f, c.f);
}

/* Adds a transformed row's gradient to a row of every channel. */
static void add_row(const struct sg_anisotropy *a, size_t plane, const float *from, float weight, int y)
{
    const size_t pixels = (size_t) a->width * (size_t) a->height;
    for (size_t ch = 0; ch < 3; ch++) {
        const float scale = a->planes == 3 ? weight : weight * luma[ch];
        float *to = a->gradient + ch * pixels + (size_t) y * (size_t) a->width;
        for (int x = 0; x < a->width && (a->planes == 1 || ch == plane); x++)
            to[x] += scale * from[x];
    }
}

static float *row_beyond(const struct sg_anisotropy *a, size_t plane, int y)
{
    return a->beyond + (plane * (size_t) (a->h - a->height) + (size_t) (y - a->height)) * (size_t) a->width;
}

static void pull_rows(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const size_t plane = piece / row_pieces(a);
    const int first = (int) (piece % row_pieces(a)) * ROWS, end = first + ROWS < a->h ? first + ROWS : a->h;
    float *buffer = a->buffers + (size_t) thread * ROWS * a->row;
    float complex *f = spectrum_of(a, plane) + (size_t) first * a->stride;
    for (int y = first; y < end; y++)
        memset(f + (size_t) (y - first) * a->stride + a->columns, 0,
               (SG_FFT_COLUMNS(a->w) - (size_t) a->columns) * sizeof(*f));
    fftwf_execute_dft_c2r(a->rows_back[end - first < ROWS], f, buffer);
    for (int y = first; y < end; y++) {
        float *g = buffer + (size_t) (y - first) * a->row;
        for (int x = a->width; x < a->w; x++)
            g[a->width - 1] += g[x];
        if (y < a->height)
            add_row(a, plane, g, a->weight, y);
        else
            memcpy(row_beyond(a, plane, y), g, (size_t) a->width * sizeof(float));
    }
}

double sg_anisotropy_loss(struct sg_anisotropy *a, const float *planes, double weight, float *gradient)
{
    const size_t rows = (size_t) a->planes * row_pieces(a), columns = (size_t) a->planes * column_pieces(a);
    a->image = planes, a->gradient = gradient, a->weight = (float) weight;
    sg_parallel_for(a->ctx, rows, transform_rows, a);
    sg_parallel_for(a->ctx, columns, transform_columns, a);
    const double loss = loss_of_bins(a);
    if (!gradient || loss == 0)
        return loss;
    sg_parallel_for(a->ctx, columns, pull_columns, a);
    sg_parallel_for(a->ctx, rows, pull_rows, a);
    for (size_t plane = 0; plane < (size_t) a->planes; plane++)
        for (int y = a->height; y < a->h; y++)
            add_row(a, plane, row_beyond(a, plane, y), a->weight, a->height - 1);
    return loss;
}
