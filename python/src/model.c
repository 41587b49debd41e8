/* SPDX-License-Identifier: Apache-2.0 */
/* Models and renderers. */
#include "core.h"

#include <limits.h>
#include <string.h>

/* The handle, or NULL where making it has failed. */
static PyObject *made(struct handle *h, bool good)
{
    if (good)
        return (PyObject *) h;
    Py_XDECREF((PyObject *) h);
    return NULL;
}

static PyObject *model_new(PyObject *module, PyObject *args)
{
    (void) module;
    struct context *c;
    Py_ssize_t count;
    int degree;
    if (!PyArg_ParseTuple(args, "O&ni", to_context, &c, &count, &degree))
        return NULL;
    if (count < 0)
        return PyErr_Format(error_type(SG_ERR_USAGE), "count: found %zd, expected at least 0",
                            count);
    struct handle *h = handle_new(MODEL, c, NULL);
    return made(h, h && CALL(c, sg_model_create(c->ctx, (size_t) count, degree, &h->model)));
}

static PyObject *model_from_points(PyObject *module, PyObject *args)
{
    (void) module;
    struct context *c;
    PyObject *xyz_object, *rgb_object;
    struct array xyz, rgb;
    Py_ssize_t n;
    int degree;
    if (!PyArg_ParseTuple(args, "O&OOni", to_context, &c, &xyz_object, &rgb_object, &n, &degree) ||
        !array_read(&xyz, xyz_object, 'f', 3 * (size_t) n, "points", false))
        return NULL;
    struct handle *h = NULL;
    bool good =
        array_read(&rgb, rgb_object, 'B', 3 * (size_t) n, "colors", false) &&
        (h = handle_new(MODEL, c, NULL)) &&
        CALL(c, sg_model_init_points(c->ctx, xyz.data, rgb.data, (size_t) n, degree, &h->model));
    array_release(&xyz);
    array_release(&rgb);
    return made(h, good);
}

static PyObject *model_read(PyObject *module, PyObject *args)
{
    (void) module;
    struct context *c;
    PyObject *path;
    unsigned long long most;
    char file[PATH_MAX];
    if (!PyArg_ParseTuple(args, "O&O&O&", to_context, &c, PyUnicode_FSConverter, &path, to_u64,
                          &most))
        return NULL;
    struct handle *h = handle_new(MODEL, c, NULL);
    const bool good =
        h && CALL(c, sg_run_find_model(c->ctx, PyBytes_AsString(path), 0, file, sizeof(file))
                         ?: sg_model_read_drawable(c->ctx, file, most, &h->model));
    Py_DECREF(path);
    return made(h, good);
}

static PyObject *model_write(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    PyObject *path;
    int format;
    struct sg_model_file file = sg_model_file_default();
    if (!PyArg_ParseTuple(args, "O&O&i|i", to_model, &h, PyUnicode_FSConverter, &path, &format,
                          &file.spz_version))
        return NULL;
    const char *name = PyBytes_AsString(path);
    file.format = format ? (enum sg_model_format) format : sg_model_format_of(name);
    const bool unused = PyTuple_Size(args) > 3 && file.format && file.format != SG_MODEL_SPZ;
    if (unused)
        PyErr_Format(error_type(SG_ERR_USAGE),
                     "spz_version: found without effect on the format %s, expected spz",
                     sg_model_format_name(file.format));
    const bool good =
        !unused && CALL(h->context, sg_model_write(h->context->ctx, h->model, name, &file));
    Py_DECREF(path);
    return good ? Py_BuildValue("") : NULL;
}

static PyObject *model_shape(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    if (!PyArg_ParseTuple(args, "O&", to_model, &h))
        return NULL;
    return Py_BuildValue("(ni)", (Py_ssize_t) h->model->count, h->model->sh_degree);
}

/* Unlike the shape it can change, so that it is read and set as the library does. */
static PyObject *model_active(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    int degree;
    if (!PyArg_ParseTuple(args, "O&", to_model, &h) ||
        !CALL(h->context, (degree = h->model->active_sh_degree, SG_OK)))
        return NULL;
    return PyLong_FromLong(degree);
}

static PyObject *model_activate(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    int degree;
    if (!PyArg_ParseTuple(args, "O&i", to_model, &h, &degree))
        return NULL;
    if (degree < 0 || degree > h->model->sh_degree)
        return PyErr_Format(error_type(SG_ERR_USAGE), "found SH degree %d, expected 0 to %d",
                            degree, h->model->sh_degree);
    return CALL(h->context, (h->model->active_sh_degree = degree, SG_OK)) ? Py_BuildValue("")
                                                                          : NULL;
}

static PyObject *model_field(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    const char *field;
    PyObject *object;
    int set;
    struct array a;
    if (!PyArg_ParseTuple(args, "O&sOp", to_model, &h, &field, &object, &set))
        return NULL;
    const int width = sg_model_field_width(field, h->model->sh_degree);
    if (width < 0)
        return PyErr_Format(PyExc_KeyError, "%s", field);
    const size_t count = h->model->count * (size_t) width;
    if (!(set ? array_read(&a, object, 'f', count, field, false)
              : array_write(&a, object, 'f', count, field, false)))
        return NULL;
    sg_ctx *ctx = h->context->ctx;
    const bool good =
        CALL(h->context, set ? sg_model_set_array(ctx, h->model, field, a.data, 0)
                             : sg_model_get_array(ctx, h->model, field, (float *) a.data, 0));
    array_release(&a);
    return good ? Py_BuildValue("") : NULL;
}

static PyObject *fields(PyObject *module, PyObject *args)
{
    (void) module;
    int degree;
    if (!PyArg_ParseTuple(args, "i", &degree))
        return NULL;
    PyObject *list = PyList_New(0);
    const char *name;
    for (int i = 0; list && (name = sg_model_field_name(i)); i++) {
        PyObject *pair = Py_BuildValue("(si)", name, sg_model_field_width(name, degree));
        list_take(&list, pair);
    }
    return list;
}

static PyObject *model_select(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *from;
    struct sg_model_selection s = sg_model_selection_default();
    int crop;
    if (!PyArg_ParseTuple(args, "O&ip(dddddd)d", to_model, &from, &s.sh_degree, &crop, &s.low[0],
                          &s.low[1], &s.low[2], &s.high[0], &s.high[1], &s.high[2], &s.min_opacity))
        return NULL;
    s.crop = crop;
    struct handle *h = handle_new(MODEL, from->context, NULL);
    return made(h, h && CALL(from->context,
                             sg_model_select(from->context->ctx, from->model, &s, &h->model)));
}

static PyObject *model_inspect(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    struct sg_model_info i;
    if (!PyArg_ParseTuple(args, "O&", to_model, &h) ||
        !CALL(h->context, sg_model_inspect(h->context->ctx, h->model, &i)))
        return NULL;
    return Py_BuildValue("{s:n,s:i,s:(ddd),s:(ddd),s:(ddddd),s:(ddddd),s:n,s:n,s:n}", "gaussians",
                         (Py_ssize_t) i.count, "sh_degree", i.sh_degree, "min", i.min[0], i.min[1],
                         i.min[2], "max", i.max[0], i.max[1], i.max[2], "scale_percentiles",
                         i.scale_percentile[0], i.scale_percentile[1], i.scale_percentile[2],
                         i.scale_percentile[3], i.scale_percentile[4], "opacity_percentiles",
                         i.opacity_percentile[0], i.opacity_percentile[1], i.opacity_percentile[2],
                         i.opacity_percentile[3], i.opacity_percentile[4], "nonfinite",
                         (Py_ssize_t) i.nonfinite, "zero_rotation", (Py_ssize_t) i.zero_rotation,
                         "transparent", (Py_ssize_t) i.transparent);
}

#define UNASKED INT_MIN

/* An appearance that is asked for is one that the model has. */
static int settle_appearance(sg_ctx *ctx, const struct sg_model *model, struct sg_render_params *p)
{
    if (p->appearance != UNASKED)
        return sg_render_check_appearance(ctx, model, p);
    p->appearance = sg_render_params_default().appearance;
    return SG_OK;
}

static PyObject *renderer_new(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *model, *h = NULL;
    PyObject *dict, *keep = PyList_New(0);
    const char *engine, *cpu;
    struct sg_render_params p = sg_render_params_default();
    p.appearance = UNASKED;
    if (keep &&
        PyArg_ParseTuple(args, "O&zzO!(fff)", to_model, &model, &engine, &cpu, &PyDict_Type, &dict,
                         &p.background[0], &p.background[1], &p.background[2]) &&
        params_set(sg_render_options(), &p, dict, keep) && (h = handle_new(RENDERER, model->context, NULL)) &&
        /* A model that is not finite can be inspected but not drawn. */
        !CALL(model->context, settle_appearance(model->context->ctx, model->model, &p)
                                  ?: sg_model_check(model->context->ctx, model->model, "model")
                                  ?: sg_renderer_create(model->context->ctx, engine, cpu,
                                                        model->model, &p, &h->renderer)))
        Py_CLEAR(h);
    Py_XDECREF(keep);
    return (PyObject *) h;
}

static PyObject *render(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *r;
    PyObject *camera_object, *objects[3];
    struct sg_camera camera;
    struct array rgb = {0}, alpha = {0}, depth = {0};
    struct sg_render_stats stats;
    if (!PyArg_ParseTuple(args, "O&OOOO", to_renderer, &r, &camera_object, &objects[0], &objects[1],
                          &objects[2]) ||
        !camera_read(&camera, camera_object))
        return NULL;
    const size_t pixels = (size_t) camera.width * (size_t) camera.height;
    const bool good =
        array_write(&rgb, objects[0], 'f', 3 * pixels, "color", false) &&
        array_write(&alpha, objects[1], 'f', pixels, "alpha", true) &&
        array_write(&depth, objects[2], 'f', pixels, "depth", true) &&
        CALL(r->context,
             (r->drawn = 0, sg_render(r->renderer, &camera, (float *) rgb.data,
                                      (float *) alpha.data, (float *) depth.data, &stats))
                 ?: (r->drawn = 3 * pixels, SG_OK));
    array_release(&rgb);
    array_release(&alpha);
    array_release(&depth);
    return good ? Py_BuildValue("{s:K,s:K,s:K,s:K,s:I}", "visible",
                                (unsigned long long) stats.visible, "instances",
                                (unsigned long long) stats.instances, "pairs",
                                (unsigned long long) stats.pairs, "max_tile",
                                (unsigned long long) stats.max_tile, "bands", stats.bands)
                : NULL;
}

static PyObject *render_backward(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *r, *out;
    PyObject *object;
    struct array gradient;
    if (!PyArg_ParseTuple(args, "O&OO&", to_renderer, &r, &object, to_model, &out))
        return NULL;
    /* Others draw with the renderer as well: evaluate(), and other threads until the call begins.
     */
    const size_t values = r->drawn;
    bool same = values;
    if (values && !array_read(&gradient, object, 'f', values, "gradient", false))
        return NULL;
    const bool good =
        values && CALL(r->context, (same = r->drawn == values)
                                       ? sg_render_backward(r->renderer, gradient.data, out->model)
                                       : SG_OK);
    if (values)
        array_release(&gradient);
    if (!same)
        PyErr_SetString(error_type(SG_ERR_USAGE),
                        "backward: found no view that render() has drawn last, expected one");
    return good && same ? Py_BuildValue("") : NULL;
}

PyMethodDef core_object_methods[] = {{"model_new", model_new, METH_VARARGS, NULL},
                                     {"model_from_points", model_from_points, METH_VARARGS, NULL},
                                     {"model_read", model_read, METH_VARARGS, NULL},
                                     {"model_write", model_write, METH_VARARGS, NULL},
                                     {"model_shape", model_shape, METH_VARARGS, NULL},
                                     {"model_active", model_active, METH_VARARGS, NULL},
                                     {"model_activate", model_activate, METH_VARARGS, NULL},
                                     {"model_field", model_field, METH_VARARGS, NULL},
                                     {"fields", fields, METH_VARARGS, NULL},
                                     {"model_select", model_select, METH_VARARGS, NULL},
                                     {"model_inspect", model_inspect, METH_VARARGS, NULL},
                                     {"renderer_new", renderer_new, METH_VARARGS, NULL},
                                     {"render", render, METH_VARARGS, NULL},
                                     {"render_backward", render_backward, METH_VARARGS, NULL},
                                     {0}};
