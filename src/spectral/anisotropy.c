/* SPDX-License-Identifier: Apache-2.0 */
/* Rows are transformed 32 at a time, and columns 16 at a time, but only those that have
 * coefficients in the band. Coefficients are used while they are in the cache. */
#include "anisotropy.h"

#include <math.h>
#include <string.h>

#include "fft.h"
#include "frequency.h"

#include "math/spectrum.h"

#define ROWS SG_FFT_ROWS   /* a piece of work */
#define LANES SG_FFT_LANES /* columns of a piece of work */
#define APART 4            /* sums of a bin */
#define EXACT_TO 256       /* sides this short are never continued */

struct sg_anisotropy {
    sg_ctx *ctx;
    const struct sg_fft_kernels *fft;
    struct sg_anisotropy_params params;
    int width, height;            /* of the image */
    int w, h;                     /* of the transform */
    int planes;                   /* transformed */
    int columns;                  /* with coefficients in the band: the first ones */
    struct sg_fft *across, *down; /* of a row, of a column */
    uint8_t *direction;           /* panels x h x LANES: bin of each coefficient */
    float *buffers;               /* a thread: `buffer` floats */
    size_t buffer;
    float *f;                               /* planes half spectra */
    float *beyond;                          /* gradient of the rows that continue the image */
    double *energy;                         /* a piece of columns: bins */
    float factor[SG_SPECTRUM_BINS_MAX + 2]; /* of each bin's coefficients in the gradient */
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

const struct sg_anisotropy_params *sg_anisotropy_params_of(const struct sg_anisotropy *a)
{
    return &a->params;
}

int sg_anisotropy_width(int width, bool exact)
{
    return quick(width, 2, exact);
}

int sg_anisotropy_height(int height, bool exact)
{
    return quick(height, 1, exact);
}

static size_t row_pieces(const struct sg_anisotropy *a)
{
    return ((size_t) a->h + ROWS - 1) / ROWS;
}

static size_t column_pieces(const struct sg_anisotropy *a)
{
    return SG_FFT_PANELS(a->columns);
}

/* Floats of a panel. */
static size_t panel_size(const struct sg_anisotropy *a)
{
    return (size_t) a->h * SG_FFT_POINT;
}

static int fill_directions(struct sg_anisotropy *a)
{
    const struct sg_spectrum_params *band = &a->params.band;
    a->columns = sg_spectrum_columns(a->w, a->h, band);
    uint8_t *to = a->direction =
        sg_alloc_raw(a->ctx, SG_MEM_FRAME, column_pieces(a) * (size_t) a->h, LANES);
    if (!to)
        return SG_ERR_BUDGET;
    for (int first = 0; first < a->columns; first += LANES)
        for (int u = 0; u < a->h; u++)
            for (int v = first; v < first + LANES; v++)
                *to++ = v < a->columns
                            ? (uint8_t) sg_spectrum_bin(u, v, a->w, a->h, band, SG_OUTSIDE)
                            : SG_OUTSIDE;
    return SG_OK;
}

/* A thread's buffer holds rows or a column, and the scratch of their transforms. */
static int reserve(struct sg_anisotropy *a)
{
    sg_ctx *ctx = a->ctx;
    const size_t planes = (size_t) a->planes, threads = (size_t) sg_ctx_threads(ctx),
                 width = (size_t) a->width;
    const size_t rows = (a->planes == 1 ? ROWS * width : 0) + 15 + sg_fft_rows_scratch(a->across);
    const size_t column = panel_size(a) + sg_fft_scratch(a->down);
    a->buffer = ((rows > column ? rows : column) + 15) / 16 * 16;
    a->buffers = sg_alloc(ctx, SG_MEM_FRAME, threads * a->buffer, sizeof(float));
    a->f = sg_alloc(ctx, SG_MEM_FRAME, planes * column_pieces(a) * panel_size(a), sizeof(float));
    a->beyond = sg_alloc(ctx, SG_MEM_FRAME, planes * (size_t) (a->h - a->height) + 1,
                         width * sizeof(float));
    a->energy = sg_alloc(ctx, SG_MEM_FRAME,
                         planes * column_pieces(a) * (size_t) a->params.band.bins, sizeof(double));
    return a->buffers && a->f && a->beyond && a->energy ? SG_OK : SG_ERR_BUDGET;
}

struct sg_anisotropy_params sg_anisotropy_params_default(void)
{
    return (struct sg_anisotropy_params){SG_ANISOTROPY_DEFAULTS};
}

int sg_anisotropy_create(sg_ctx *ctx, int width, int height,
                         const struct sg_anisotropy_params *params,
                         const struct sg_fft_kernels *fft, struct sg_anisotropy **out)
{
    *out = NULL;
    struct sg_anisotropy *a = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*a));
    if (!a)
        return SG_ERR_BUDGET;
    *a = (struct sg_anisotropy){.ctx = ctx,
                                .fft = fft ? fft : sg_fft_fastest(),
                                .params = params ? *params : sg_anisotropy_params_default(),
                                .width = width,
                                .height = height};
    a->w = sg_anisotropy_width(width, a->params.exact_size);
    a->h = sg_anisotropy_height(height, a->params.exact_size);
    a->planes = a->params.channels == SG_CHANNELS_LUMA ? 1 : 3;
    if (fill_directions(a) || sg_fft_create(ctx, a->w, &a->across) ||
        sg_fft_create(ctx, a->h, &a->down) || reserve(a)) {
        sg_anisotropy_destroy(&a);
        return SG_ERR_BUDGET;
    }
    *out = a;
    return SG_OK;
}

void sg_anisotropy_destroy(struct sg_anisotropy **p)
{
    struct sg_anisotropy *a = *p;
    if (!a)
        return;
    sg_fft_destroy(&a->across);
    sg_fft_destroy(&a->down);
    sg_free(a->direction);
    sg_free(a->buffers);
    sg_free(a->f);
    sg_free(a->beyond);
    sg_free(a->energy);
    sg_free(a);
    *p = NULL;
}

static const float luma[3] = {SG_LUMA};

static float *panel_of(const struct sg_anisotropy *a, size_t plane, size_t panel)
{
    return a->f + (plane * column_pieces(a) + panel) * panel_size(a);
}

struct row_piece {
    size_t plane;
    int first; /* row */
    struct sg_fft_rows rows;
};

static struct row_piece row_piece(const struct sg_anisotropy *a, size_t piece)
{
    const size_t plane = piece / row_pieces(a);
    const int first = (int) (piece % row_pieces(a)) * ROWS;
    return (struct row_piece){
        .plane = plane,
        .first = first,
        .rows = {.count = a->h - first < ROWS ? a->h - first : ROWS,
                 .width = a->width,
                 .columns = a->columns,
                 .panels = panel_of(a, plane, 0) + (size_t) first * SG_FFT_POINT,
                 .panel = panel_size(a)}};
}

/* Row y of a plane of the image. `room` holds it where it has to be computed. */
static const float *row_of(const struct sg_anisotropy *a, size_t plane, int y, float *room)
{
    const size_t width = (size_t) a->width, pixels = width * (size_t) a->height;
    const float *p = a->image + (size_t) y * width;
    if (a->planes == 3)
        return p + plane * pixels;
    for (size_t x = 0; x < width; x++)
        room[x] = luma[0] * p[x] + luma[1] * p[x + pixels] + luma[2] * p[x + 2 * pixels];
    return room;
}

/* Scratch of the transforms, behind the rows that are computed. */
static float *scratch_of(const struct sg_anisotropy *a, float *buffer)
{
    return buffer + (a->planes == 1 ? ((size_t) a->width * ROWS + 15) / 16 * 16 : 0);
}

/* The image's last column and row are repeated. The jump to the first ones, which an exact
 * transform has too, is kept: a ramp there would change the energy along the axes, most of a smooth
 * image's. */
static void transform_rows(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const struct row_piece p = row_piece(a, piece);
    float *buffer = a->buffers + (size_t) thread * a->buffer;
    const float *rows[ROWS];
    for (int i = 0; i < p.rows.count; i++) {
        const int y = p.first + i < a->height ? p.first + i : a->height - 1;
        rows[i] = row_of(a, p.plane, y, buffer + (size_t) i * (size_t) a->width);
    }
    a->fft->rows(a->across, &p.rows, rows, scratch_of(a, buffer));
}

/* The direction of each coefficient of a piece of columns: h x LANES. */
static const uint8_t *directions_of(const struct sg_anisotropy *a, size_t piece)
{
    return a->direction + piece % column_pieces(a) * (size_t) a->h * LANES;
}

static void transform_columns(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const bool amplitude = a->params.energy == SG_ENERGY_AMPLITUDE,
               axis = piece % column_pieces(a) == 0;
    const int bins = a->params.band.bins;
    const uint8_t *bin = directions_of(a, piece);
    float *f = panel_of(a, 0, piece), *own = a->buffers + (size_t) thread * a->buffer;
    double energy[APART][256] = {0}; /* SG_OUTSIDE has sums too, which avoids a branch. Neighbours
                                        often share a bin, so each lane has its own sum. */
    double whole[256] = {
        0}; /* of column 0, which has its conjugates itself; the others do not store theirs */
    a->fft->columns(a->down, f, own, false, own + panel_size(a));
    for (int u = 0; u < a->h; u++, f += SG_FFT_POINT, own += SG_FFT_POINT, bin += LANES) {
        float e[LANES];
        memcpy(f, own, SG_FFT_POINT * sizeof(float));
        for (int v = 0; v < LANES; v++)
            e[v] = own[v] * own[v] + own[v + LANES] * own[v + LANES];
        for (int v = 0; v < LANES && amplitude; v++)
            e[v] = sqrtf(e[v]);
        (axis ? whole : energy[0])[bin[0]] += (double) e[0];
        for (int v = 1; v < LANES; v++)
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

/* dL/dE_b = (ln P_b + H) / (S ln B). */
double sg_anisotropy_of_bins(const struct sg_anisotropy_params *params, double values,
                             double *energy, float *factor)
{
    const int bins = params->band.bins;
    const bool power = params->energy == SG_ENERGY_POWER;
    double total = 0, entropy = 0;
    for (int b = 0; b < bins; b++)
        total += energy[b] = fmax(energy[b], 0);
    if (!(total > (power ? SG_FLAT_POWER * values * values
                         : SG_FLAT_AMPLITUDE * values))) /* rounding of a flat image */
        return 0;
    for (int b = 0; b < bins; b++)
        entropy -= energy[b] > 0 ? energy[b] / total * log(energy[b] / total) : 0;
    for (int b = 0; b < bins && factor; b++)
        factor[b] = (float) ((power ? 2 : 1) * (log(fmax(energy[b] / total, 1e-12)) + entropy) /
                             (total * log(bins)));
    return 1 - entropy / log(bins);
}

static double loss_of_bins(struct sg_anisotropy *a)
{
    const int bins = a->params.band.bins;
    double energy[SG_SPECTRUM_BINS_MAX] = {0};
    for (size_t piece = 0; piece < (size_t) a->planes * column_pieces(a); piece++)
        for (int b = 0; b < bins; b++)
            energy[b] += a->energy[piece * (size_t) bins + (size_t) b];
    memset(a->factor, 0, sizeof(a->factor));
    return sg_anisotropy_of_bins(&a->params, (double) a->planes * (double) a->w * (double) a->h,
                                 energy, a->factor);
}

/* dL/dx is the real transform back of factor F, and of amplitudes of factor F / |F|: it brings the
 * conjugates, and is not normalised. */
static void pull_columns(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const bool amplitude = a->params.energy == SG_ENERGY_AMPLITUDE;
    const uint8_t *bin = directions_of(a, piece);
    float *f = panel_of(a, 0, piece), *own = a->buffers + (size_t) thread * a->buffer;
    float factor[256];
    memcpy(factor, a->factor, SG_SPECTRUM_BINS_MAX * sizeof(float));
    factor[SG_OUTSIDE] = factor[SG_OUTSIDE - 1] = 0;
    for (int u = 0; u < a->h; u++, bin += LANES) {
        const float *from = f + (size_t) u * SG_FFT_POINT;
        float *to = own + (size_t) u * SG_FFT_POINT, scale[LANES];
        for (int v = 0; v < LANES; v++)
            scale[v] = factor[bin[v]];
        for (int v = 0; v < LANES && amplitude; v++) {
            const float size = sqrtf(from[v] * from[v] + from[v + LANES] * from[v + LANES]);
            scale[v] = size > 1e-15f ? scale[v] / size : 0;
        }
        for (int v = 0; v < LANES; v++)
            to[v] = from[v] * scale[v], to[v + LANES] = from[v + LANES] * scale[v];
    }
    a->fft->columns(a->down, own, f, true, own + panel_size(a));
}

static float *row_beyond(const struct sg_anisotropy *a, size_t plane, int y)
{
    return a->beyond +
           (plane * (size_t) (a->h - a->height) + (size_t) (y - a->height)) * (size_t) a->width;
}

static void pull_rows(void *arg, size_t piece, int thread)
{
    struct sg_anisotropy *a = arg;
    const struct row_piece p = row_piece(a, piece);
    const size_t width = (size_t) a->width, pixels = width * (size_t) a->height;
    float *scratch = a->buffers + (size_t) thread * a->buffer, *rows[ROWS];
    for (size_t ch = 0; ch < 3; ch++) {
        for (int i = 0; i < p.rows.count; i++)
            rows[i] = p.first + i < a->height
                          ? a->gradient + ch * pixels + (size_t) (p.first + i) * width
                          : NULL;
        if ((a->planes == 1 || ch == p.plane) && p.first < a->height)
            a->fft->rows_back(a->across, &p.rows, rows,
                              a->planes == 1 ? a->weight * luma[ch] : a->weight, scratch);
    }
    if (p.first + p.rows.count <= a->height)
        return;
    for (int i = 0; i < p.rows.count; i++) {
        rows[i] = p.first + i < a->height ? NULL : row_beyond(a, p.plane, p.first + i);
        if (rows[i])
            memset(rows[i], 0, width * sizeof(float));
    }
    a->fft->rows_back(a->across, &p.rows, rows, 1, scratch);
}

/* Adds a row of `beyond` to the last row of each of its channels. */
static void add_beyond(const struct sg_anisotropy *a, size_t plane, const float *from)
{
    const size_t width = (size_t) a->width, pixels = width * (size_t) a->height;
    for (size_t ch = 0; ch < 3; ch++) {
        const float scale = a->planes == 3 ? a->weight : a->weight * luma[ch];
        float *to = a->gradient + (ch + 1) * pixels - width;
        for (size_t x = 0; x < width && (a->planes == 1 || ch == plane); x++)
            to[x] += scale * from[x];
    }
}

double sg_anisotropy_loss(struct sg_anisotropy *a, const float *planes, double weight,
                          float *gradient)
{
    const size_t rows = (size_t) a->planes * row_pieces(a),
                 columns = (size_t) a->planes * column_pieces(a);
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
            add_beyond(a, plane, row_beyond(a, plane, y));
    return loss;
}
