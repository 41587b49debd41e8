/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes: from folders, and from arrays or functions that return arrays. */
#include "core.h"

#include <string.h>

static PyObject *scene_load(PyObject *module, PyObject *args)
{
    (void) module;
    struct context *c;
    PyObject *path, *dict, *keep = PyList_New(0);
    struct sg_scene_params p = sg_scene_params_default();
    struct handle *h = NULL;
    int eval, untrained, alone;
    if (!keep || !PyArg_ParseTuple(args, "O&O&O!ppp", to_context, &c, PyUnicode_FSConverter, &path,
                                   &PyDict_Type, &dict, &eval, &untrained, &alone)) {
        Py_XDECREF(keep);
        return NULL;
    }
    p.eval = eval, p.untrained = untrained, p.photos_alone = alone;
    if (params_set(sg_scene_options(), &p, dict, keep) && (h = handle_new(SCENE, c, NULL)) &&
        !CALL(c, sg_scene_load(c->ctx, PyBytes_AsString(path), &p, &h->scene)))
        Py_CLEAR(h);
    Py_DECREF(path);
    Py_DECREF(keep);
    return (PyObject *) h;
}

/* A photo that a function returns. Capsules of these are kept by the scene, and the functions. */
struct lazy {
    struct context *context;
    PyObject *function; /* borrowed */
    size_t bytes;
};

static int read_lazy(void *priv, uint8_t *rgb)
{
    struct lazy *l = priv;
    const PyGILState_STATE state = PyGILState_Ensure();
    struct array a;
    PyObject *image = PyErr_Occurred() ? NULL : PyObject_CallObject(l->function, NULL);
    const bool good = image && array_read(&a, image, 'B', l->bytes, "image", false);
    if (good) {
        memcpy(rgb, a.data, l->bytes);
        array_release(&a);
    } else if (atomic_load(&l->context->owner) != PyThread_get_thread_ident())
        PyErr_WriteUnraisable(l->function); /* no call ends on this thread to raise it */
    Py_XDECREF(image);
    PyGILState_Release(state);
    return !good;
}

static void free_lazy(PyObject *capsule)
{
    PyMem_Free(PyCapsule_GetPointer(capsule, NULL));
}

static struct lazy *make_lazy(struct context *context, PyObject *function, size_t bytes,
                              PyObject *keep)
{
    struct lazy *l = PyMem_Malloc(sizeof(*l));
    if (!l) {
        PyErr_NoMemory();
        return NULL;
    }
    *l = (struct lazy){context, function, bytes};
    PyObject *capsule = PyCapsule_New(l, NULL, free_lazy);
    if (!capsule) {
        PyMem_Free(l);
        return NULL;
    }
    const int failed = PyList_Append(keep, function) || PyList_Append(keep, capsule);
    Py_DECREF(capsule);
    return failed ? NULL : l;
}

/* item: (name, camera, image or function, mask or None, split, lossless). */
static bool add_view(struct context *c, sg_scene_builder *b, PyObject *item, PyObject *keep)
{
    char *name;
    PyObject *text, *camera, *image, *mask_object;
    int split, lossless;
    struct array rgb = {0}, mask = {0};
    struct sg_view_desc v = {0};
    if (!PyArg_ParseTuple(item, "UOOOip", &text, &camera, &image, &mask_object, &split,
                          &lossless) ||
        !camera_read(&v.camera, camera))
        return false;
    /* The reverse of what names of views are made with. */
    PyObject *bytes = PyUnicode_EncodeFSDefault(text);
    if (!bytes || PyBytes_AsStringAndSize(bytes, &name, NULL)) {
        Py_XDECREF(bytes);
        return false;
    }
    const size_t pixels = (size_t) v.camera.width * (size_t) v.camera.height;
    v.name = name;
    v.split = (enum sg_view_split) split;
    v.lossless = lossless;
    bool good = array_read(&mask, mask_object, 'B', pixels, "mask", true);
    v.mask = mask.data;
    if (good && PyCallable_Check(image)) {
        v.read = read_lazy;
        v.read_priv = make_lazy(c, image, 3 * pixels, keep);
        good = v.read_priv != NULL;
    } else if (good) {
        good = array_read(&rgb, image, 'B', 3 * pixels, "image", false);
        v.rgb = rgb.data;
    }
    good = good && CALL(c, sg_scene_builder_add_view(b, &v));
    array_release(&rgb);
    array_release(&mask);
    Py_DECREF(bytes);
    return good;
}

static PyObject *scene_build(PyObject *module, PyObject *args)
{
    (void) module;
    struct context *c;
    PyObject *dict, *views, *points, *colors, *item;
    Py_ssize_t n;
    unsigned long long keep_bytes;
    int eval, untrained;
    struct sg_scene_params p = sg_scene_params_default();
    sg_scene_builder *b = NULL;
    if (!PyArg_ParseTuple(args, "O&O!OOOnO&pp", to_context, &c, &PyDict_Type, &dict, &views,
                          &points, &colors, &n, to_u64, &keep_bytes, &eval, &untrained))
        return NULL;
    p.eval = eval, p.untrained = untrained;
    PyObject *keep = PyList_New(0), *iterator = PyObject_GetIter(views);
    struct array xyz = {0}, rgb = {0};
    struct handle *h = NULL;
    bool good = keep && iterator && params_set(sg_scene_options(), &p, dict, keep) &&
                CALL(c, sg_scene_builder_create(c->ctx, &p, &b));
    if (good && keep_bytes)
        sg_scene_builder_keep_photos(b, keep_bytes);
    while (good && (item = PyIter_Next(iterator))) {
        good = add_view(c, b, item, keep);
        Py_DECREF(item);
    }
    good = good && !PyErr_Occurred();
    if (good && points != Py_None)
        good = array_read(&xyz, points, 'f', 3 * (size_t) n, "points", false) &&
               array_read(&rgb, colors, 'B', 3 * (size_t) n, "colors", true) &&
               CALL(c, sg_scene_builder_add_points(b, xyz.data, rgb.data, (size_t) n));
    if (good) {
        h = handle_new(SCENE, c, keep);
        if (h && !CALL(c, sg_scene_builder_finish(&b, &h->scene)))
            Py_CLEAR(h);
    }
    sg_scene_builder_destroy(&b);
    array_release(&xyz);
    array_release(&rgb);
    Py_XDECREF(iterator);
    Py_XDECREF(keep);
    return (PyObject *) h;
}

static PyObject *camera_numbers(const struct sg_camera *c)
{
    PyObject *numbers = PyList_New(0);
    const double head[6] = {c->width, c->height, c->fx, c->fy, c->cx, c->cy};
    for (int k = 0; k < 18 && numbers; k++) {
        const double x = k < 6 ? head[k] : k < 15 ? c->R[k - 6] : c->t[k - 15];
        PyObject *number = PyFloat_FromDouble(x);
        list_take(&numbers, number);
    }
    return numbers;
}

static PyObject *view_dict(const struct sg_view *v)
{
    PyObject *numbers = camera_numbers(&v->camera);
    PyObject *name = numbers ? PyUnicode_DecodeFSDefault(v->name) : NULL,
             *file = name ? PyUnicode_DecodeFSDefault(v->file ? v->file : "") : NULL,
             *dict = file ? Py_BuildValue("{s:O,s:O,s:O,s:O,s:O}", "name", name, "file", file,
                                          "camera", numbers, "masked", v->mask ? Py_True : Py_False,
                                          "lossless", v->lossless ? Py_True : Py_False)
                          : NULL;
    Py_XDECREF(numbers);
    Py_XDECREF(name);
    Py_XDECREF(file);
    return dict;
}

static PyObject *view_list(const struct sg_view *views, size_t n)
{
    PyObject *list = PyList_New(0);
    for (size_t i = 0; i < n && list; i++) {
        PyObject *dict = view_dict(&views[i]);
        list_take(&list, dict);
    }
    return list;
}

static PyObject *scene_info(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    if (!PyArg_ParseTuple(args, "O&", to_scene, &h))
        return NULL;
    const struct sg_scene *s = h->scene;
    PyObject *train = view_list(s->train, s->n_train),
             *test = train ? view_list(s->test, s->n_test) : NULL,
             *dict =
                 test ? Py_BuildValue("{s:s,s:O,s:d,s:(ddd),s:n,s:O,s:O}", "format",
                                      sg_scene_format_name(s->format), "white_background",
                                      s->white_background ? Py_True : Py_False, "extent", s->extent,
                                      "center", s->center[0], s->center[1], s->center[2], "points",
                                      (Py_ssize_t) s->n_points, "train", train, "test", test)
                      : NULL;
    Py_XDECREF(train);
    Py_XDECREF(test);
    return dict;
}

static const struct sg_view *view_of(const struct handle *h, int test, Py_ssize_t index)
{
    const struct sg_scene *s = h->scene;
    const size_t n = test ? s->n_test : s->n_train;
    if (index < 0 || (size_t) index >= n) {
        PyErr_Format(PyExc_IndexError, "found view %zd, expected less than %zu", index, n);
        return NULL;
    }
    return test ? &s->test[index] : &s->train[index];
}

static int copy_pixels(sg_ctx *ctx, const struct sg_view *v, void *out)
{
    const uint8_t *rgb;
    const int code = sg_view_pixels(ctx, v, &rgb);
    if (!code) {
        memcpy(out, rgb, 3 * (size_t) v->camera.width * (size_t) v->camera.height);
        sg_view_release(v);
    }
    return code;
}

static PyObject *scene_pixels(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    int test;
    Py_ssize_t index;
    PyObject *objects[2];
    struct array rgb, mask = {0};
    const struct sg_view *v;
    if (!PyArg_ParseTuple(args, "O&pnOO", to_scene, &h, &test, &index, &objects[0], &objects[1]) ||
        !(v = view_of(h, test, index)))
        return NULL;
    const size_t pixels = (size_t) v->camera.width * (size_t) v->camera.height;
    const bool good =
        array_write(&rgb, objects[0], 'B', 3 * pixels, "image", true) &&
        array_write(&mask, objects[1], 'B', pixels, "mask", true) &&
        (!rgb.data || CALL(h->context, copy_pixels(h->context->ctx, v, (void *) rgb.data)));
    if (good && mask.data && v->mask)
        memcpy((void *) mask.data, v->mask, pixels);
    array_release(&rgb);
    array_release(&mask);
    return good ? Py_BuildValue("") : NULL;
}

static PyObject *scene_points(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    PyObject *objects[2];
    struct array xyz, rgb = {0};
    if (!PyArg_ParseTuple(args, "O&OO", to_scene, &h, &objects[0], &objects[1]))
        return NULL;
    const size_t n = 3 * h->scene->n_points;
    const bool good = array_write(&xyz, objects[0], 'f', n, "points", false) &&
                      array_write(&rgb, objects[1], 'B', n, "colors", false);
    if (good && n) {
        memcpy((void *) xyz.data, h->scene->points, n * sizeof(float));
        memcpy((void *) rgb.data, h->scene->point_colors, n);
    }
    array_release(&xyz);
    array_release(&rgb);
    return good ? Py_BuildValue("") : NULL;
}

/* ---- audit ---- */

/* Features by name: what results of audits have, and what is read back of them. */
#define FEATURE(name) #name, offsetof(struct sg_audit_features, name)
static const struct {
    const char *name;
    size_t at;
} feature_list[] = {{FEATURE(tv_down)},       {FEATURE(tv_across)},  {FEATURE(osc_down)},
                    {FEATURE(osc_across)},    {FEATURE(osc_share)},  {FEATURE(osc_quiet)},
                    {FEATURE(osc_chroma)},    {FEATURE(noisy)},      {FEATURE(half_quiet)},
                    {FEATURE(half_osc)},      {FEATURE(half_share)}, {FEATURE(quarter_osc)},
                    {FEATURE(quarter_share)}, {FEATURE(content)},    {FEATURE(ragged)},
                    {FEATURE(slope)},         {FEATURE(anisotropy)}};
#define FEATURES (sizeof(feature_list) / sizeof(feature_list[0]))

static PyObject *features_dict(const struct sg_audit_features *f)
{
    PyObject *dict = PyDict_New();
    for (size_t k = 0; k < FEATURES && dict; k++) {
        PyObject *value = PyFloat_FromDouble(
            *(const double *) (const void *) ((const char *) f + feature_list[k].at));
        if (!value || PyDict_SetItemString(dict, feature_list[k].name, value))
            Py_CLEAR(dict);
        Py_XDECREF(value);
    }
    return dict;
}

static PyObject *image_dict(const struct sg_audit_image *i)
{
    PyObject *features = features_dict(&i->features);
    PyObject *name = features ? PyUnicode_DecodeFSDefault(i->name) : NULL;
    PyObject *dict =
        name ? Py_BuildValue("{s:O,s:s,s:d,s:d,s:d,s:O}", "name", name, "verdict",
                             sg_audit_verdict_name(i->verdict), "score", i->score, "tau", i->tau,
                             "tau_error", i->tau_error, "features", features)
             : NULL;
    Py_XDECREF(name);
    Py_XDECREF(features);
    return dict;
}

static PyObject *float_list(const float *values, size_t n)
{
    PyObject *list = PyList_New(0);
    for (size_t i = 0; i < n && list; i++)
        list_take(&list, PyFloat_FromDouble((double) values[i]));
    return list;
}

/* What preset auto makes of it: parameters by the names of options, and numbers of each view.
 * tolerance: that of training. scratch: two floats for each. */
static PyObject *automatic_dict(const struct sg_audit *audit, const struct sg_scene *scene,
                                double tolerance, float *scratch)
{
    struct sg_defense_params p = sg_defense_params_default();
    const size_t n = scene->n_train;
    sg_defense_automatic(audit, scene->extent, tolerance, scratch, scratch + n, &p);
    PyObject *weights = float_list(scratch, n),
             *tolerances = weights ? float_list(scratch + n, n) : NULL,
             *dict = tolerances ? Py_BuildValue("{s:d,s:d,s:d,s:d,s:O,s:O}", "rho", p.rho,
                                                "rho_least", p.rho_least, "filter_frequency",
                                                p.frequency, "lambda", p.lambda, "view_weights",
                                                weights, "tolerances", tolerances)
                                : NULL;
    Py_XDECREF(weights);
    Py_XDECREF(tolerances);
    return dict;
}

static PyObject *audit_dict(const struct sg_audit *a, const struct sg_scene *scene)
{
    PyObject *images = PyList_New(0), *reasons = PyList_New(0);
    for (size_t i = 0; i < a->count && images; i++) {
        PyObject *dict = image_dict(&a->images[i]);
        list_take(&images, dict);
    }
    for (size_t i = 0; i < a->count_reasons && reasons; i++) {
        PyObject *text = PyUnicode_FromString(a->reasons[i]);
        list_take(&reasons, text);
    }
    float *scratch = PyMem_Calloc(2 * scene->n_train + 1, sizeof(*scratch));
    PyObject *automatic = NULL, *tolerances = NULL;
    if (!scratch)
        PyErr_NoMemory();
    else if (images && reasons &&
             (automatic = automatic_dict(a, scene, (double) SG_TOLERANCE_AUTO, scratch))) {
        sg_defense_tolerances(a, scratch);
        tolerances = float_list(scratch, scene->n_train);
    }
    PyMem_Free(scratch);
    PyObject *dict =
        tolerances ? Py_BuildValue("{s:s,s:d,s:d,s:d,s:O,s:O,s:O,s:O}", "verdict",
                                   sg_audit_verdict_name(a->verdict), "score", a->score, "tau",
                                   a->tau, "tau_error", a->tau_error, "reasons", reasons, "images",
                                   images, "defense", automatic, "tolerances", tolerances)
                   : NULL;
    Py_XDECREF(images);
    Py_XDECREF(reasons);
    Py_XDECREF(automatic);
    Py_XDECREF(tolerances);
    return dict;
}

static PyObject *audit(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    struct sg_audit *result = NULL;
    if (!PyArg_ParseTuple(args, "O&", to_scene, &h) ||
        !CALL(h->context, sg_audit_scene(h->context->ctx, h->scene, &result)))
        return NULL;
    PyObject *dict = audit_dict(result, h->scene);
    sg_audit_destroy(&result);
    return dict;
}

/* Of an audit's result, which may have been through a file. */
static PyObject *part_of(PyObject *dict, const char *key)
{
    PyObject *value = PyMapping_GetItemString(dict, key);
    if (!value && !PyErr_ExceptionMatches(PyExc_MemoryError))
        PyErr_Format(error_type(SG_ERR_USAGE),
                     "audit: found no %s, expected the result of an audit", key);
    return value;
}

static bool take_number(PyObject *dict, const char *key, double *out)
{
    PyObject *value = part_of(dict, key);
    *out = value ? PyFloat_AsDouble(value) : 0;
    if (value && PyErr_Occurred())
        PyErr_Format(error_type(SG_ERR_USAGE), "audit: found %R as %s, expected a number", value,
                     key);
    Py_XDECREF(value);
    return !PyErr_Occurred();
}

static bool take_image(PyObject *dict, struct sg_audit_image *out)
{
    PyObject *features = part_of(dict, "features");
    bool good = features && take_number(dict, "score", &out->score) &&
                take_number(dict, "tau", &out->tau) &&
                take_number(dict, "tau_error", &out->tau_error);
    for (size_t k = 0; k < FEATURES && good; k++)
        good = take_number(features, feature_list[k].name,
                           (double *) (void *) ((char *) &out->features + feature_list[k].at));
    Py_XDECREF(features);
    return good;
}

/* scene, the result of its audit, tolerance: its "defense" for a training with this tolerance. */
static PyObject *automatic(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    PyObject *dict, *result = NULL;
    struct sg_audit a = {0};
    double tolerance;
    if (!PyArg_ParseTuple(args, "O&Od", to_scene, &h, &dict, &tolerance))
        return NULL;
    const size_t n = h->scene->n_train;
    PyObject *images = part_of(dict, "images");
    float *scratch = PyMem_Calloc(2 * n + 1, sizeof(*scratch));
    a.images = PyMem_Calloc(n + 1, sizeof(*a.images));
    const Py_ssize_t count = images ? PySequence_Size(images) : -1;
    bool good = count >= 0 && take_number(dict, "tau", &a.tau) &&
                take_number(dict, "tau_error", &a.tau_error);
    if (good && (!scratch || !a.images)) {
        PyErr_NoMemory();
        good = false;
    }
    if (good && (size_t) count != n) {
        PyErr_Format(error_type(SG_ERR_USAGE), "audit: found %zd photos, expected %zu", count, n);
        good = false;
    }
    for (; a.count < n && good; a.count++) {
        PyObject *image = PySequence_GetItem(images, (Py_ssize_t) a.count);
        good = image && take_image(image, &a.images[a.count]);
        Py_XDECREF(image);
    }
    if (good)
        result = automatic_dict(&a, h->scene, tolerance, scratch);
    Py_XDECREF(images);
    PyMem_Free(scratch);
    PyMem_Free(a.images);
    return result;
}

static int score(sg_ctx *ctx, sg_renderer *r, const struct sg_scene *s, int test,
                 const struct sg_eval_params *how, struct sg_eval *out)
{
    return sg_evaluate(ctx, r, test ? s->test : s->train, test ? s->n_test : s->n_train, how, out);
}

static PyObject *evaluate(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h, *r;
    struct sg_eval_params how = {0};
    int test, match, fps;
    struct sg_eval e = {0};
    if (!PyArg_ParseTuple(args, "O&O&ppp", to_scene, &h, to_renderer, &r, &test, &match, &fps))
        return NULL;
    how.match_colours = match, how.fps = fps;
    if (!same_context(h, r))
        return NULL;
    if (!CALL(h->context,
              (r->drawn = 0, score(h->context->ctx, r->renderer, h->scene, test, &how, &e))))
        return NULL;
    PyObject *views = PyList_New(0);
    for (size_t i = 0; i < e.views && views; i++) {
        const struct sg_view *v = view_of(h, test, (Py_ssize_t) i);
        const struct sg_view_score *s = &e.per_view[i];
        PyObject *name = PyUnicode_DecodeFSDefault(v->name);
        PyObject *dict =
            match ? Py_BuildValue("{s:N,s:d,s:d,s:d,s:d}", "name", name, "psnr", s->psnr, "ssim",
                                  s->ssim, "corrected_psnr", s->corrected_psnr, "corrected_ssim",
                                  s->corrected_ssim)
                  : Py_BuildValue("{s:N,s:d,s:d}", "name", name, "psnr", s->psnr, "ssim", s->ssim);
        list_take(&views, dict);
    }
    PyObject *dict = views ? Py_BuildValue("{s:d,s:d,s:d,s:d,s:d,s:O}", "psnr", e.psnr, "ssim",
                                           e.ssim, "fps", e.fps, "corrected_psnr", e.corrected_psnr,
                                           "corrected_ssim", e.corrected_ssim, "views", views)
                           : NULL;
    Py_XDECREF(views);
    sg_eval_clear(&e);
    return dict;
}

/* kind, a list of cameras, frames. */
static PyObject *camera_path(PyObject *module, PyObject *args)
{
    (void) module;
    struct context *c;
    int kind;
    PyObject *list, *result = NULL;
    Py_ssize_t frames;
    if (!PyArg_ParseTuple(args, "O&iO!n", to_context, &c, &kind, &PyList_Type, &list, &frames))
        return NULL;
    const Py_ssize_t n = PyList_Size(list), count = frames > 0 ? frames : 0;
    struct sg_camera *cameras = PyMem_Calloc((size_t) n + 1, sizeof(*cameras)),
                     *path = PyMem_Calloc((size_t) count + 1, sizeof(*path));
    if (!cameras || !path)
        PyErr_NoMemory();
    bool good = cameras && path;
    for (Py_ssize_t i = 0; i < n && good; i++)
        good = camera_read(&cameras[i], PyList_GetItem(list, i));
    if (good && CALL(c, sg_camera_path(c->ctx, (enum sg_path_kind) kind, cameras, (size_t) n,
                                       (size_t) count, path)))
        result = PyList_New(0);
    for (Py_ssize_t i = 0; i < count && result; i++)
        list_take(&result, camera_numbers(&path[i]));
    PyMem_Free(cameras);
    PyMem_Free(path);
    return result;
}

PyMethodDef core_scene_methods[] = {{"scene_load", scene_load, METH_VARARGS, NULL},
                                    {"scene_build", scene_build, METH_VARARGS, NULL},
                                    {"scene_info", scene_info, METH_VARARGS, NULL},
                                    {"scene_pixels", scene_pixels, METH_VARARGS, NULL},
                                    {"scene_points", scene_points, METH_VARARGS, NULL},
                                    {"audit", audit, METH_VARARGS, NULL},
                                    {"automatic", automatic, METH_VARARGS, NULL},
                                    {"evaluate", evaluate, METH_VARARGS, NULL},
                                    {"camera_path", camera_path, METH_VARARGS, NULL},
                                    {0}};
