/* SPDX-License-Identifier: Apache-2.0 */
/* Poison-splat: total variation and its gradients, the bound, and the loop around them. */
#include "attack/ascent.h"
#include "attack/attack.h"
#include "image/total_variation.h"

#include <unistd.h>

#include "engine/cpu/dispatch.h"

#include "models.h"
#include "races.h"

static const char *const form_names[] = {"vertical2", "aniso", "iso"};

static double tv_of_channel(const double *plane, int w, int h, enum sg_attack_tv form)
{
    double sum = 0;
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            const double here = plane[y * w + x];
            const double v = y + 1 < h ? plane[(y + 1) * w + x] - here : 0;
            const double u = x + 1 < w ? plane[y * w + x + 1] - here : 0;
            sum += form == SG_ATTACK_TV_VERTICAL2 ? 2 * fabs(v)
                   : form == SG_ATTACK_TV_ANISO   ? fabs(v) + fabs(u)
                                                  : sqrt(v * v + u * u + 1e-12);
        }
    return sum;
}

/* Against differences of a double-precision sum, on values so far apart that no sign flips. */
static void test_gradients(void **state)
{
    (void) state;
    enum { W = 7, H = 5 };
    for (int form = SG_ATTACK_TV_VERTICAL2; form <= SG_ATTACK_TV_ISO; form++) {
        double exact[W * H];
        float plane[W * H], found[W];
        for (int i = 0; i < W * H; i++)
            exact[i] = (double) (plane[i] = draw(3, (uint64_t) i, 0, 1));
        for (int y = 0; y < H; y++) {
            sg_tv_gradient_row(plane, W, H, y, (enum sg_attack_tv) form, found);
            for (int x = 0; x < W; x++) {
                const double kept = exact[y * W + x], step = 1e-5;
                exact[y * W + x] = kept + step;
                const double more = tv_of_channel(exact, W, H, (enum sg_attack_tv) form);
                exact[y * W + x] = kept - step;
                const double less = tv_of_channel(exact, W, H, (enum sg_attack_tv) form);
                exact[y * W + x] = kept;
                const double expected = (more - less) / (2 * step);
                if (!(fabs((double) found[x] - expected) < 2e-3))
                    fail_msg("%s at %d, %d: %g, expected %g", form_names[form], x, y,
                             (double) found[x], expected);
            }
        }
    }
}

/* The published form ignores horizontal differences, and has a gradient at the ends of a ramp only.
 */
static void test_ramps(void **state)
{
    (void) state;
    enum { N = 6 };
    float along[N * N], down[N * N], g[N];
    for (int i = 0; i < N * N; i++)
        along[i] = (float) (i % N) / N, down[i] = (float) (i / N) / N;
    for (int y = 0; y < N; y++) {
        sg_tv_gradient_row(along, N, N, y, SG_ATTACK_TV_VERTICAL2, g);
        for (int x = 0; x < N; x++)
            assert_true(g[x] == 0);
        sg_tv_gradient_row(down, N, N, y, SG_ATTACK_TV_VERTICAL2, g);
        for (int x = 0; x < N; x++)
            assert_true(g[x] == (y == 0 ? -2.0f : y == N - 1 ? 2.0f : 0));
    }
}

static void test_byte_variation(void **state)
{
    (void) state;
    /* 2 x 2 pixels of grey 10 20 / 40 80 */
    const uint8_t rgb[12] = {10, 10, 10, 20, 20, 20, 40, 40, 40, 80, 80, 80};
    assert_float_equal(sg_total_variation(rgb, 2, 2, SG_ATTACK_TV_VERTICAL2), 2 * (30 + 60) / 4.0,
                       1e-9);
    assert_float_equal(sg_total_variation(rgb, 2, 2, SG_ATTACK_TV_ANISO), (30 + 60 + 10 + 40) / 4.0,
                       1e-9);
    assert_float_equal(sg_total_variation(rgb, 2, 2, SG_ATTACK_TV_ISO),
                       (sqrt(30 * 30 + 100) + 60 + 40) / 4.0, 1e-9);
}

/* ---- attacks on each photo alone ---- */

/* The same in all channels. The caller frees rgb. */
static struct sg_view make_photo(int width, int height, uint8_t (*value)(int x, int y))
{
    struct sg_view v = {.name = (char *) "photo", .camera = make_camera(width, height, 3)};
    v.rgb = malloc(3 * (size_t) width * (size_t) height);
    for (int i = 0; i < 3 * width * height; i++)
        v.rgb[i] = value(i / 3 % width, i / 3 / width);
    return v;
}

static uint8_t grey(int x, int y)
{
    (void) x, (void) y;
    return 120;
}

static void naive(int threads, const struct sg_view *photo, uint64_t index,
                  const struct sg_attack_params *p, enum sg_naive_attack method, uint8_t *rgb)
{
    sg_ctx *ctx = make_context(threads);
    assert_int_equal(sg_attack_naive(ctx, photo, index, p, method, rgb), SG_OK);
    sg_ctx_destroy(&ctx);
}

/* Reaches epsilon, is the same in all channels, and is no steeper than a cosine of the wavelength
 * and its rounding. */
static void test_drift(void **state)
{
    (void) state;
    enum { W = 80, H = 56, LEVELS = 16 };
    struct sg_view photo = make_photo(W, H, grey);
    uint8_t rgb[2][3 * W * H];
    const float wavelengths[] = {0, 20, W, 4000};
    int raised = 0;
    for (size_t k = 0; k < 4; k++)
        for (uint64_t view = 0; view < 8; view++) {
            const struct sg_attack_params *p =
                sg_attack_params(.epsilon = LEVELS / 255.0f, .wavelength = wavelengths[k]);
            naive(1, &photo, view, p, SG_NAIVE_DRIFT, rgb[0]);
            naive(3, &photo, view, p, SG_NAIVE_DRIFT, rgb[1]);
            assert_memory_equal(rgb[0], rgb[1], sizeof(rgb[0]));
            const double steepest = 2 * acos(-1) * LEVELS / (double) (k ? wavelengths[k] : W) + 1;
            int most = 0, least = LEVELS;
            for (int i = 0; i < 3 * W * H; i++) {
                const int change = rgb[0][i] - 120;
                most = abs(change) > most ? abs(change) : most;
                least = abs(change) < least ? abs(change) : least;
                assert_int_equal(rgb[0][i], rgb[0][i / 3 * 3]);
                if (i % (3 * W) >= 3)
                    assert_true(abs(rgb[0][i] - rgb[0][i - 3]) <= steepest);
                if (i >= 3 * W)
                    assert_true(abs(rgb[0][i] - rgb[0][i - 3 * W]) <= steepest);
                raised += k == 3 && i == 0 && change > 0;
            }
            assert_int_equal(most, LEVELS);
            assert_true(k == 3 ? least == LEVELS
                               : least < LEVELS / 2); /* at 4000: one step of exposure */
            naive(1, &photo, view + 100, p, SG_NAIVE_DRIFT, rgb[1]);
            if (k < 3)
                assert_memory_not_equal(rgb[0], rgb[1], sizeof(rgb[0]));
        }
    assert_in_range(raised, 1, 7); /* some photos become lighter, some darker */
    naive(1, &photo, 0, sg_attack_params(.seed = 7), SG_NAIVE_DRIFT, rgb[0]);
    naive(1, &photo, 0, sg_attack_params(.seed = 8), SG_NAIVE_DRIFT, rgb[1]);
    assert_memory_not_equal(rgb[0], rgb[1], sizeof(rgb[0]));
    free(photo.rgb);
}

/* Left half flat, right half a texture of growing contrast. */
static uint8_t half_flat(int x, int y)
{
    return (uint8_t) (x < 40 ? 90 : 110 + (x * 7 + y * 11) % 5 * (x - 38) / 8);
}

/* The bound as its definition has it: of a pixel, in whole levels. */
static int bound_of(const struct sg_view *photo, int x, int y, int levels, double texture)
{
    const int w = photo->camera.width, h = photo->camera.height;
    double sum = 0, n = 0;
    for (int v = y - 3; v <= y + 3; v++)
        for (int u = x - 3; u <= x + 3; u++)
            for (int ch = 0; ch < 3; ch++) {
                if (u < 0 || v < 0 || u >= w || v >= h)
                    continue;
                const uint8_t *p = photo->rgb + 3 * (v * w + u) + ch;
                if (u + 1 < w)
                    sum += abs(p[3] - p[0]), n++;
                if (v + 1 < h)
                    sum += abs(p[3 * w] - p[0]), n++;
            }
    return n > 0 && sum / n < texture ? (int) (levels * (sum / n) / texture + 1e-6)
           : n > 0                    ? levels
                                      : 0;
}

/* No value leaves its own bound, which it reaches; flat parts stay byte for byte; no bound exceeds
 * epsilon. */
static void test_texture(void **state)
{
    (void) state;
    static const int sizes[][2] = {{80, 56}, {3, 2}, {1, 1}, {7, 90}};
    for (size_t k = 0; k < 4; k++) {
        const int w = sizes[k][0], h = sizes[k][1], values = 3 * w * h;
        struct sg_view photo = make_photo(w, h, half_flat);
        uint8_t *rgb[2] = {malloc((size_t) values), malloc((size_t) values)};
        for (int method = SG_NAIVE_NOISE; method <= SG_NAIVE_TV; method++) {
            const struct sg_attack_params *p =
                sg_attack_params(.texture = 6, .inner = 30, .tv = SG_ATTACK_TV_ANISO);
            int reached = 0, changed = 0, full = 0;
            naive(1, &photo, 1, p, (enum sg_naive_attack) method, rgb[0]);
            naive(3, &photo, 1, p, (enum sg_naive_attack) method, rgb[1]);
            assert_memory_equal(rgb[0], rgb[1], (size_t) values);
            for (int i = 0; i < values; i++) {
                const int x = i / 3 % w, y = i / 3 / w, change = abs(rgb[0][i] - photo.rgb[i]);
                const int bound = bound_of(&photo, x, y, 16, 6);
                if (change > bound)
                    fail_msg("%d x %d at %d, %d: changed by %d, the bound is %d", w, h, x, y,
                             change, bound);
                assert_true(x >= 36 || change == 0);
                reached += bound > 0 && change == bound;
                changed += bound > 0;
                full += change == 16;
            }
            if (k == 0)
                assert_true(changed > values / 4 && reached > changed / 2 && full > 0);
        }
        free(rgb[0]);
        free(rgb[1]);
        free(photo.rgb);
    }
}

/* ---- the loop ---- */

#define SIDE 40
#define VIEWS 4

struct fixture {
    sg_ctx *ctx;
    struct sg_scene scene;
    struct sg_view views[VIEWS];
    struct sg_model *proxy;
};

/* The proxy has learned its photos perfectly: they are its renders. */
static int set_up(void **state)
{
    struct fixture *f = calloc(1, sizeof(*f));
    *state = f;
    f->ctx = make_context(2);
    f->proxy = make_model(f->ctx, 150, 1, 21);
    f->proxy->active_sh_degree = 1;
    make_photos(f->ctx, f->proxy, SIDE, f->views, VIEWS);
    f->scene = (struct sg_scene){
        .path = (char *) "fixture", .train = f->views, .n_train = VIEWS, .extent = 2};
    return 0;
}

static int tear_down(void **state)
{
    struct fixture *f = *state;
    for (int i = 0; i < VIEWS; i++)
        free(f->views[i].rgb);
    sg_model_destroy(&f->proxy);
    const bool leaked = sg_mem_current(f->ctx, SG_MEM_TAGS) != 0;
    sg_ctx_destroy(&f->ctx);
    free(f);
    return leaked;
}

static sg_attack *begin(struct fixture *f, const struct sg_attack_params *p)
{
    sg_attack *a;
    if (sg_attack_create(f->ctx, &f->scene, f->proxy, p, &a))
        fail_msg("%s", sg_last_error(f->ctx));
    return a;
}

static size_t advance(struct fixture *f, sg_attack *a, int steps)
{
    struct sg_attack_step s = {0};
    for (int i = 0; i < steps; i++)
        if (sg_attack_step(a, &s))
            fail_msg("%s", sg_last_error(f->ctx));
    return s.gaussians;
}

#define SHORT SG_ATTACK_DEFAULTS, .iterations = 200, .densification_interval = 20

/* Of attacks that count hits: the memory sanitizer does not follow the masked loads of AVX-512. */
#ifdef SG_SANITIZE_MEMORY
#define COUNTS .cpu = "avx2"
#else
#define COUNTS .cpu = NULL
#endif

#ifdef SG_SANITIZE_THREAD /* one takes half a minute, and the threads of each are the same */
#define FIRST_FORM SG_ATTACK_TV_ISO
#else
#define FIRST_FORM SG_ATTACK_TV_VERTICAL2
#endif

/* The decoy grows, the written poison stays within the bound, and it varies more than the photo. */
static void test_bounded(void **state)
{
    struct fixture *f = *state;
    for (int form = FIRST_FORM; form <= SG_ATTACK_TV_ISO; form++) {
        sg_attack *a = begin(f, &(struct sg_attack_params){SHORT, .tv = (enum sg_attack_tv) form});
        const size_t grown = advance(f, a, 200);
        if (!(grown > f->proxy->count * 5 / 4))
            fail_msg("%s: %zu Gaussians from %zu", form_names[form], grown, f->proxy->count);
        for (size_t v = 0; v < VIEWS; v++) {
            uint8_t poison[3 * SIDE * SIDE];
            assert_int_equal(sg_attack_poison(a, v, poison), SG_OK);
            int most = 0;
            for (int i = 0; i < 3 * SIDE * SIDE; i++)
                most = abs(poison[i] - f->views[v].rgb[i]) > most
                           ? abs(poison[i] - f->views[v].rgb[i])
                           : most;
            assert_true(most <= 16 && most >= 8);
            assert_true(
                sg_total_variation(poison, SIDE, SIDE, (enum sg_attack_tv) form) >
                1.05 * sg_total_variation(f->views[v].rgb, SIDE, SIDE, (enum sg_attack_tv) form));
        }
        sg_attack_destroy(&a);
    }
}

/* Without a bound the poison leaves the photo, and the decoy grows. */
static void test_unbounded(void **state)
{
    struct fixture *f = *state;
    sg_attack *a = begin(f, &(struct sg_attack_params){SHORT, .epsilon = INFINITY});
    assert_true(advance(f, a, 200) > f->proxy->count * 5 / 4);
    uint8_t poison[3 * SIDE * SIDE];
    assert_int_equal(sg_attack_poison(a, 0, poison), SG_OK);
    int most = 0;
    for (int i = 0; i < 3 * SIDE * SIDE; i++)
        most =
            abs(poison[i] - f->views[0].rgb[i]) > most ? abs(poison[i] - f->views[0].rgb[i]) : most;
    assert_true(most > 64);
    sg_attack_destroy(&a);
}

/* Positions stay unless asked to move; growth copies them. */
static void test_positions(void **state)
{
    struct fixture *f = *state;
    for (int moves = 0; moves < 2; moves++) {
        sg_attack *a = begin(f, &(struct sg_attack_params){SHORT, .move_positions = moves,
                                                           .densification_interval = 1000});
        struct sg_model *decoy;
        advance(f, a, 10);
        assert_int_equal(sg_attack_decoy(a, &decoy), SG_OK);
        assert_int_equal(decoy->active_sh_degree, 1);
        int moved = 0;
        for (size_t i = 0; i < decoy->count; i++)
            for (int k = 0; k < 3; k++)
                moved += *sg_model_at(decoy, i, k) != *sg_model_at(f->proxy, i, k);
        assert_int_equal(moved > 0, moves);
        sg_model_destroy(&decoy);
        sg_attack_destroy(&a);
    }
}

/* The decoy is densified every 20 iterations, though not in the last. No step is taken then, also
 * where gradients are summed over views; all others are, also the last. From the first time on,
 * what is larger than a tenth of the extent goes. */
static void test_schedule(void **state)
{
    struct fixture *f = *state;
    *sg_model_at(f->proxy, 3, SG_P_SCALE) = logf(0.4f); /* the extent is 2 */
    *sg_model_at(f->proxy, 3, SG_P_OPACITY) = 3;
    for (int sums = 0; sums < 2; sums++) {
        const struct sg_attack_params p = {SG_ATTACK_DEFAULTS, .iterations = 100,
                                           .densification_interval = 20,
                                           .update_interval = sums ? 5 : 1};
        sg_attack *a = begin(f, &p);
        size_t before = f->proxy->count;
        int growths = 0;
        for (int it = 1; it <= 100; it++) {
            struct sg_model *decoy;
            float largest = -INFINITY;
            const size_t now = advance(f, a, 1);
            assert_true(now == before || (it % 20 == 0 && it < 100));
            growths += now > before;
            before = now;
            if (it < 19 || it > 20)
                continue;
            assert_int_equal(sg_attack_decoy(a, &decoy), SG_OK);
            for (size_t i = 0; i < decoy->count; i++)
                for (int k = 0; k < 3; k++)
                    largest = fmaxf(largest, *sg_model_at(decoy, i, SG_P_SCALE + k));
            assert_true(largest > logf(0.2f) ? it == 19 : it == 20); /* halves are 0.25 */
            sg_model_destroy(&decoy);
        }
        assert_true(growths > 0);
        assert_int_equal(a->trainer->adam_steps[SG_G_OPACITY], sums ? 100 / 5 - 4 : 100 - 4);
        sg_attack_destroy(&a);
    }
}

/* The steps begin at what the decoy shows, not at the photo. Bounded or not, the first one brings
 * all values into [0, 1]. */
static void test_start(void **state)
{
    enum { VALUES = 3 * SIDE * SIDE };
    struct fixture *f = *state;
    sg_renderer *r;
    for (size_t i = 0; i < f->proxy->count; i++) /* another scene than the photos' */
        *sg_model_at(f->proxy, i, SG_P_SH) += 0.2f;
    assert_int_equal(sg_renderer_create(f->ctx, NULL, NULL, f->proxy, NULL, &r), SG_OK);
    for (int bounded = 0; bounded < 2; bounded++) {
        float photo[VALUES], shown[VALUES], scratch[VALUES];
        double rows[3 * SIDE], tv[2];
        struct sg_attack_step s;
        sg_attack *a =
            begin(f, &(struct sg_attack_params){SHORT, .inner = 2,
                                                .epsilon = bounded ? 16 / 255.0f : INFINITY});
        const struct ascent how = {.epsilon = a->params.epsilon,
                                   .step = a->params.step,
                                   .steps = a->params.inner,
                                   .form = a->params.tv};
        assert_int_equal(sg_attack_step(a, &s), SG_OK);
        assert_int_equal(sg_render(r, &f->views[s.view].camera, shown, NULL, NULL, NULL), SG_OK);
        for (int i = 0; i < VALUES; i++)
            photo[i] =
                (float) f->views[s.view].rgb[3 * (i % (SIDE * SIDE)) + i / (SIDE * SIDE)] / 255.0f;
        for (int k = 0; k < 2; k++) {
            float x[VALUES];
            memcpy(x, k ? photo : shown, sizeof(x));
            assert_int_equal(sg_ascend(a->trainer->engine, &how, photo, SIDE, SIDE, x, scratch),
                             SG_OK);
            tv[k] = sg_tv_planes(f->ctx, x, SIDE, SIDE, how.form, rows) / VALUES;
        }
        assert_float_equal(s.tv, tv[0], 1e-4 * tv[0]); /* signs at a border */
        assert_true(fabs(tv[1] - tv[0]) > 1e-2 * tv[0]);
        sg_attack_destroy(&a);
    }
    sg_renderer_destroy(&r);
}

/* A poison is what the decoy shows in the end, within the bound, and not an image of the steps. */
static void test_shown(void **state)
{
    struct fixture *f = *state;
    sg_attack *a = begin(f, &(struct sg_attack_params){SHORT});
    struct sg_model *decoy;
    sg_renderer *r;
    advance(f, a, 60);
    assert_int_equal(sg_attack_decoy(a, &decoy), SG_OK);
    assert_int_equal(sg_renderer_create(f->ctx, NULL, NULL, decoy, NULL, &r), SG_OK);
    for (size_t v = 0; v < VIEWS; v++) {
        uint8_t poison[3 * SIDE * SIDE], shown[3 * SIDE * SIDE];
        float planes[3 * SIDE * SIDE];
        int differ = 0;
        assert_int_equal(sg_attack_poison(a, v, poison), SG_OK);
        assert_int_equal(sg_render(r, &f->views[v].camera, planes, NULL, NULL, NULL), SG_OK);
        sg_quantise(planes, SIDE, SIDE, shown);
        for (int i = 0; i < 3 * SIDE * SIDE; i++) {
            const int photo = f->views[v].rgb[i], low = photo - 16, high = photo + 16,
                      within = shown[i] < low    ? low
                               : shown[i] > high ? high
                                                 : shown[i];
            assert_int_equal(poison[i], within);
            differ += within != photo;
        }
        assert_true(differ > 1000);
    }
    sg_renderer_destroy(&r);
    sg_model_destroy(&decoy);
    sg_attack_destroy(&a);
}

/* Against an audit: the bound of each pixel, exactly, in a poison that all views agree on. */
static void test_textured(void **state)
{
    struct fixture *f = *state;
    sg_attack *a = begin(f, &(struct sg_attack_params){SHORT, .texture = 12});
    advance(f, a, 100);
    int quiet = 0, reached = 0;
    for (size_t v = 0; v < VIEWS; v++) {
        uint8_t poison[3 * SIDE * SIDE];
        assert_int_equal(sg_attack_poison(a, v, poison), SG_OK);
        for (int i = 0; i < 3 * SIDE * SIDE; i++) {
            const int bound = bound_of(&f->views[v], i / 3 % SIDE, i / 3 / SIDE, 16, 12);
            const int change = abs(poison[i] - f->views[v].rgb[i]);
            if (change > bound)
                fail_msg("view %zu, value %d: changed by %d, the bound is %d", v, i, change, bound);
            quiet += bound < 16;
            reached += bound > 0 && change == bound;
        }
    }
    assert_true(quiet > 1000 && reached > 1000);
    sg_attack_destroy(&a);
}

/* Mean of what is left of |a - b| beyond a tolerance, in grey levels. */
static double beyond(const uint8_t *a, const uint8_t *b, int tolerance)
{
    double sum = 0;
    for (int i = 0; i < 3 * SIDE * SIDE; i++)
        sum += fmax(abs(a[i] - b[i]) - tolerance, 0);
    return sum / (3 * SIDE * SIDE);
}

/* With the tolerance, a clean model has a higher loss at these poisons than at those of an attacker
 * who does not know the tolerance. The decoy, which learns as the victim would, has a lower one. */
static void test_victim_tolerance(void **state)
{
    skip_without_races();
    enum { EPSILON = 16, TOLERANCE = 10 };
    struct fixture *f = *state;
    double clean[2] = {0}, decoy = 0;
    size_t grown[2];
    for (int knows = 0; knows < 2; knows++) {
        const struct sg_attack_params p = {SHORT, .victim_tolerance = knows ? TOLERANCE : 0};
        sg_attack *a = begin(f, &p);
        struct sg_model *m;
        sg_renderer *r;
        grown[knows] = advance(f, a, 200);
        assert_int_equal(sg_attack_decoy(a, &m), SG_OK);
        assert_int_equal(sg_renderer_create(f->ctx, "ref", NULL, m, NULL, &r), SG_OK);
        for (size_t v = 0; v < VIEWS; v++) {
            uint8_t poison[3 * SIDE * SIDE], shown[3 * SIDE * SIDE];
            float planes[3 * SIDE * SIDE];
            assert_int_equal(sg_attack_poison(a, v, poison), SG_OK);
            assert_true(beyond(poison, f->views[v].rgb, EPSILON) == 0);
            assert_int_equal(sg_render(r, &f->views[v].camera, planes, NULL, NULL, NULL), SG_OK);
            sg_quantise(planes, SIDE, SIDE, shown);
            clean[knows] += beyond(poison, f->views[v].rgb, TOLERANCE) / VIEWS;
            decoy += knows ? beyond(poison, shown, TOLERANCE) / VIEWS : 0;
        }
        sg_renderer_destroy(&r);
        sg_model_destroy(&m);
        sg_attack_destroy(&a);
    }
    if (!(clean[1] > 1.2 * clean[0] && decoy < 0.8 * clean[1] && grown[1] > f->proxy->count &&
          grown[1] < grown[0]))
        fail_msg("beyond the tolerance: %g, %g against it, %g of the decoy; %zu and %zu Gaussians",
                 clean[0], clean[1], decoy, grown[0], grown[1]);
}

/* Positions of the proxy that are still in the decoy. */
static size_t kept_of(const struct fixture *f, sg_attack *a, size_t *count)
{
    struct sg_model *decoy;
    size_t kept = 0;
    assert_int_equal(sg_attack_decoy(a, &decoy), SG_OK);
    *count = decoy->count;
    for (size_t i = 0; i < f->proxy->count; i++) {
        bool found = false;
        for (size_t j = 0; j < decoy->count && !found; j++)
            found = *sg_model_at(decoy, j, 0) == *sg_model_at(f->proxy, i, 0) &&
                    *sg_model_at(decoy, j, 1) == *sg_model_at(f->proxy, i, 1) &&
                    *sg_model_at(decoy, j, 2) == *sg_model_at(f->proxy, i, 2);
        kept += found;
    }
    sg_model_destroy(&decoy);
    return kept;
}

/* At the limit of the decoy growth stops, and the Gaussians of the scene stay. At that of a victim
 * growth goes on, and those of the scene make room. */
static void test_victim_gaussians(void **state)
{
    skip_without_races();
    enum { LIMIT = 160 };
    struct fixture *f = *state;
#define DENSE SG_ATTACK_DEFAULTS, .iterations = 200, .densification_interval = 5
    const struct sg_attack_params p[] = {{DENSE, .max_gaussians = LIMIT},
                                         {DENSE, COUNTS, .victim_gaussians = LIMIT}};
    size_t kept[2], count[2];
    for (int knows = 0; knows < 2; knows++) {
        sg_attack *a = begin(f, &p[knows]);
        advance(f, a, 200);
        kept[knows] = kept_of(f, a, &count[knows]);
        sg_attack_destroy(&a);
    }
    if (!(count[0] <= LIMIT && count[1] <= LIMIT && count[1] > LIMIT * 9 / 10 &&
          4 * kept[1] < 3 * kept[0]))
        fail_msg("%zu and %zu Gaussians, %zu and %zu of the scene's", count[0], count[1], kept[0],
                 kept[1]);
}

/* The same bytes for any number of threads, and saved and restored, with gradients summed over
 * views too. */
static void test_resume(void **state)
{
    struct fixture *f = *state;
    char path[] = "/tmp/sg-attack-XXXXXX";
    close(mkstemp(path));
    const struct sg_attack_params cases[] = {{SHORT, .epsilon = INFINITY},
                                             {SHORT, .epsilon = INFINITY, .update_interval = 5},
                                             {SHORT, .texture = 12},
                                             {SHORT, .victim_tolerance = 12},
                                             {SHORT, COUNTS, .victim_gaussians = 160}};
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        const struct sg_attack_params *p = &cases[k];
        sg_ctx *single = make_context(1);
        sg_attack *whole, *first = begin(f, p), *second;
        struct sg_model *a, *b;
        assert_int_equal(sg_attack_create(single, &f->scene, f->proxy, p, &whole), SG_OK);
        advance(f, whole, 100);
        advance(f, first, 45);
        assert_int_equal(sg_attack_save(first, path), SG_OK);
        assert_int_equal(sg_attack_resume(f->ctx, &f->scene, path, p, &second), SG_OK);
        assert_int_equal(sg_attack_iteration(second), 45);
        sg_trainer *training;
        assert_int_equal(sg_trainer_resume(f->ctx, &f->scene, path, NULL, &training), SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(f->ctx),
                               "found a checkpoint of an attack, expected one of a training"));
        assert_null(training);
        advance(f, second, 55);
        assert_int_equal(sg_attack_decoy(whole, &a), SG_OK);
        assert_int_equal(sg_attack_decoy(second, &b), SG_OK);
        assert_int_equal(a->count, b->count);
        assert_memory_equal(a->params, b->params,
                            a->capacity * (size_t) sg_param_count(1) * sizeof(float));
        for (size_t v = 0; v < VIEWS; v++) {
            uint8_t poison[2][3 * SIDE * SIDE];
            assert_int_equal(sg_attack_poison(whole, v, poison[0]), SG_OK);
            assert_int_equal(sg_attack_poison(second, v, poison[1]), SG_OK);
            assert_memory_equal(poison[0], poison[1], sizeof(poison[0]));
        }
        sg_attack *other;
        struct sg_attack_params changed[] = {*p, *p, *p, *p};
        changed[0].step = 0.5f;
        changed[2].victim_tolerance = 3;
        changed[3].victim_gaussians = 170;
        changed[1].texture = 3, changed[1].epsilon = 16 / 255.0f;
        for (size_t i = 0; i < sizeof(changed) / sizeof(changed[0]); i++) {
            assert_int_equal(sg_attack_resume(f->ctx, &f->scene, path, &changed[i], &other),
                             SG_ERR_INPUT);
            assert_non_null(strstr(sg_last_error(f->ctx), "other parameters"));
        }
        assert_int_equal(sg_trainer_create(f->ctx, &f->scene, f->proxy, NULL, &training), SG_OK);
        assert_int_equal(sg_trainer_save(training, path), SG_OK);
        sg_trainer_destroy(&training);
        assert_int_equal(sg_attack_resume(f->ctx, &f->scene, path, p, &other), SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(f->ctx),
                               "found a checkpoint of a training, expected one of an attack"));
        assert_null(other);
        if (p->update_interval > 1) {
            advance(f, first, 1);
            assert_int_equal(sg_attack_save(first, path),
                             SG_ERR_USAGE); /* gradients are being summed */
        }
        sg_model_destroy(&a);
        sg_model_destroy(&b);
        sg_attack_destroy(&whole);
        sg_attack_destroy(&first);
        sg_attack_destroy(&second);
        sg_ctx_destroy(&single);
    }
    unlink(path);
}

static void test_refusals(void **state)
{
    struct fixture *f = *state;
    sg_attack *a = (void *) f;
    const struct sg_attack_params bad[] = {
        {SHORT, .epsilon = -1},
        {SHORT, .epsilon = NAN},
        {SHORT, .inner = -1},
        {SHORT, .step = NAN},
        {SHORT, .update_interval = 0},
        {SHORT, .iterations = 0},
        {SHORT, .opacity_lr = 2},
        {SHORT, .engine = "nonsense"},
        {SHORT, .tv = 3},
        {SHORT, .wavelength = -1},
        {SHORT, .texture = 256},
        {SHORT, .victim_tolerance = 256},
        {SHORT, .victim_gaussians = 3},
        {SHORT, .victim_gaussians = 160, .max_gaussians = 160},
        {SHORT, .victim_gaussians = 160, .model = SG_ATTACK_SCAFFOLD},
        {SHORT, .texture = 4, .epsilon = INFINITY}};
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        assert_int_equal(sg_attack_create(f->ctx, &f->scene, f->proxy, &bad[i], &a), SG_ERR_USAGE);
        assert_null(a);
        assert_true(sg_last_error(f->ctx)[0]);
    }
    struct sg_scene empty = f->scene;
    empty.n_train = 0;
    assert_int_equal(sg_attack_create(f->ctx, &empty, f->proxy, NULL, &a), SG_ERR_INPUT);
    a = begin(f, NULL);
    uint8_t byte;
    assert_int_equal(sg_attack_poison(a, VIEWS, &byte), SG_ERR_USAGE);
    sg_attack_destroy(&a);
}

int main(void)
{
#define LOOP(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gradients),
        cmocka_unit_test(test_ramps),
        cmocka_unit_test(test_byte_variation),
        cmocka_unit_test(test_drift),
        cmocka_unit_test(test_texture),
        LOOP(test_bounded),
        LOOP(test_unbounded),
        LOOP(test_positions),
        LOOP(test_schedule),
        LOOP(test_start),
        LOOP(test_shown),
        LOOP(test_textured),
        LOOP(test_victim_tolerance),
        LOOP(test_victim_gaussians),
        LOOP(test_resume),
        LOOP(test_refusals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
