/* SPDX-License-Identifier: Apache-2.0 */
/* Training, attacks, presets and option tables. */
#include "core.h"

#include <string.h>

/* An array per view that must outlive what is made: copied into a bytes object in `keep`. */
static bool keep_floats(const float **out, PyObject *object, size_t n, const char *what,
                        PyObject *keep)
{
    struct array a;
    *out = NULL;
    if (object == Py_None)
        return true;
    if (!array_read(&a, object, 'f', n, what, false))
        return false;
    PyObject *bytes = PyBytes_FromStringAndSize(a.data, (Py_ssize_t) (n * sizeof(float)));
    array_release(&a);
    if (!bytes || PyList_Append(keep, bytes)) {
        Py_XDECREF(bytes);
        return false;
    }
    *out = (const float *) (const void *) PyBytes_AsString(bytes);
    Py_DECREF(bytes); /* the list has it */
    return true;
}

/* Whether all that was given has an effect. audited: an audit decided about the defense. */
static bool all_used(const struct sg_train_params *p, const struct context *c, PyObject *dict,
                     bool audited)
{
    const struct sg_run_params run = {.train = *p,
                                      .max_memory = sg_mem_limit(c->ctx),
                                      .max_vram = c->max_vram,
                                      .audit = audited ? SG_RUN_AUDIT_DEFEND : SG_RUN_AUDIT_OFF};
    PyObject *key, *value;
    Py_ssize_t at = 0;
    while (PyDict_Next(dict, &at, &key, &value)) {
        PyObject *name = value == Py_None ? NULL : param_name(key);
        const struct sg_option *row =
            name ? sg_option_find(sg_train_options(), PyBytes_AsString(name)) : NULL;
        const char *unused = row ? sg_run_option_unused(&run, row) : NULL;
        if (unused)
            PyErr_Format(error_type(SG_ERR_USAGE), "%s: %s", PyBytes_AsString(name), unused);
        Py_XDECREF(name);
        if (PyErr_Occurred())
            return false;
    }
    if (p->defense.view_weights && !p->defense.on && !audited)
        PyErr_SetString(error_type(SG_ERR_USAGE),
                        "view_weights: found without a defense, expected one with it");
    return !PyErr_Occurred();
}

/* For O&: a path as bytes, or NULL for None. */
static int to_path_or_none(PyObject *object, void *out)
{
    if (object && object != Py_None)
        return PyUnicode_FSConverter(object, out);
    return 1;
}

static PyObject *trainer_new(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *scene, *model, *h = NULL;
    PyObject *dict, *tolerances, *weights, *path = NULL, *keep = PyList_New(0);
    int audited;
    struct sg_train_params p = sg_train_params_default();
    if (!keep ||
        !PyArg_ParseTuple(args, "O&O&O!OOpO&", to_scene, &scene, to_model_or_none, &model,
                          &PyDict_Type, &dict, &tolerances, &weights, &audited, to_path_or_none,
                          &path) ||
        !same_context(scene, model)) {
        Py_XDECREF(keep);
        Py_XDECREF(path);
        return NULL;
    }
    const size_t views = scene->scene->n_train;
    p.white_background = scene->scene->white_background; /* no option: as the scene was loaded */
    const char *checkpoint = path ? PyBytes_AsString(path) : NULL;
    sg_ctx *ctx = scene->context->ctx;
    bool good = !PyList_Append(keep, (PyObject *) scene) &&
                params_set(sg_train_options(), &p, dict, keep) &&
                keep_floats(&p.tolerances, tolerances, views, "tolerances", keep) &&
                keep_floats(&p.defense.view_weights, weights, views, "view_weights", keep) &&
                all_used(&p, scene->context, dict, audited);
    if (good) {
        h = handle_new(TRAINER, scene->context, keep);
        good =
            h && CALL(scene->context,
                      checkpoint ? sg_trainer_resume(ctx, scene->scene, checkpoint, &p, &h->trainer)
                                 : sg_trainer_create(ctx, scene->scene, model ? model->model : NULL,
                                                     &p, &h->trainer));
        if (!good)
            Py_CLEAR(h);
    }
    Py_DECREF(keep);
    Py_XDECREF(path);
    return h ? Py_BuildValue("(Ni)", (PyObject *) h, p.iterations) : NULL;
}

static PyObject *trainer_step(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    struct sg_train_step s;
    if (!PyArg_ParseTuple(args, "O&", to_trainer, &h) ||
        !CALL(h->context, sg_trainer_step(h->trainer, &s)))
        return NULL;
    return Py_BuildValue("{s:i,s:n,s:d,s:d,s:d,s:d,s:n,s:n,s:n,s:n,s:K,s:K,s:O,s:n}", "iteration",
                         s.iteration, "view", (Py_ssize_t) s.view, "loss", s.loss, "l1", s.l1,
                         "ssim", s.ssim, "psnr", s.psnr, "gaussians", (Py_ssize_t) s.gaussians,
                         "cloned", (Py_ssize_t) s.cloned, "split", (Py_ssize_t) s.split, "pruned",
                         (Py_ssize_t) s.pruned, "visible", (unsigned long long) s.render.visible,
                         "instances", (unsigned long long) s.render.instances, "filtered",
                         s.defense.filtered ? Py_True : Py_False, "filter_removed",
                         (Py_ssize_t) s.defense.removed);
}

static PyObject *trainer_state(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    struct sg_train_limits l;
    int iteration;
    size_t gaussians;
    if (!PyArg_ParseTuple(args, "O&", to_trainer, &h) ||
        !CALL(h->context,
              (sg_trainer_limits(h->trainer, &l), iteration = sg_trainer_iteration(h->trainer),
               gaussians = sg_trainer_gaussians(h->trainer), SG_OK)))
        return NULL;
    return Py_BuildValue("{s:i,s:n,s:s,s:K,s:O,s:O,s:O,s:K}", "iteration", iteration, "gaussians",
                         (Py_ssize_t) gaussians, "variant", sg_trainer_variant(h->trainer),
                         "max_gaussians", (unsigned long long) l.max_gaussians, "by_memory",
                         l.by_memory ? Py_True : Py_False, "gaussians_bound",
                         l.gaussians_bound ? Py_True : Py_False, "time_bound",
                         l.time_bound ? Py_True : Py_False, "steps", (unsigned long long) l.steps);
}

static PyObject *trainer_model(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *t, *h;
    if (!PyArg_ParseTuple(args, "O&", to_trainer, &t))
        return NULL;
    h = handle_new(MODEL, t->context, NULL);
    if (h && !CALL(t->context, sg_trainer_model(t->trainer, &h->model)))
        Py_CLEAR(h);
    return (PyObject *) h;
}

static PyObject *trainer_save(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    PyObject *path;
    if (!PyArg_ParseTuple(args, "O&O&", to_trainer, &h, PyUnicode_FSConverter, &path))
        return NULL;
    const bool good = CALL(h->context, sg_trainer_save(h->trainer, PyBytes_AsString(path)));
    Py_DECREF(path);
    return good ? Py_BuildValue("") : NULL;
}

/* What the caller gives has precedence over the preset, but for 0 and the word "preset". */
static bool attack_params(PyObject *dict, const char *preset, enum sg_scene_format format,
                          PyObject *keep, struct sg_attack_params *p)
{
    *p = sg_attack_params_default();
    if (*preset)
        p->iterations = p->inner = p->update_interval = SG_ATTACK_BY_PRESET;
    if (!params_set(sg_attack_options(), p, dict, keep))
        return false;
    if (!*preset || sg_attack_complete(preset, format, p))
        return true;
    PyErr_Format(error_type(SG_ERR_USAGE), "preset: found \"%s\", expected auto, ns, mip or tt",
                 preset);
    return false;
}

static PyObject *attack_new(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *scene, *proxy, *h = NULL;
    PyObject *dict, *keep = PyList_New(0);
    const char *preset;
    struct sg_attack_params p;
    if (keep &&
        PyArg_ParseTuple(args, "O&O&O!s", to_scene, &scene, to_model, &proxy, &PyDict_Type, &dict,
                         &preset) &&
        same_context(scene, proxy) && !PyList_Append(keep, (PyObject *) scene) &&
        attack_params(dict, preset, scene->scene->format, keep, &p)) {
        h = handle_new(ATTACK, scene->context, keep);
        if (h && !CALL(scene->context, sg_attack_create(scene->context->ctx, scene->scene,
                                                        proxy->model, &p, &h->attack)))
            Py_CLEAR(h);
    }
    Py_XDECREF(keep);
    return h ? Py_BuildValue("(Ni)", (PyObject *) h, p.iterations) : NULL;
}

static PyObject *attack_step(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    struct sg_attack_step s;
    if (!PyArg_ParseTuple(args, "O&", to_attack, &h) ||
        !CALL(h->context, sg_attack_step(h->attack, &s)))
        return NULL;
    return Py_BuildValue("{s:i,s:n,s:d,s:d,s:d,s:d,s:d,s:n}", "iteration", s.iteration, "view",
                         (Py_ssize_t) s.view, "loss", s.loss, "l1", s.l1, "ssim", s.ssim, "psnr",
                         s.psnr, "tv", s.tv, "gaussians", (Py_ssize_t) s.gaussians);
}

static PyObject *attack_poison(PyObject *module, PyObject *args)
{
    (void) module;
    struct handle *h;
    Py_ssize_t view;
    if (!PyArg_ParseTuple(args, "O&n", to_attack, &h, &view))
        return NULL;
    /* The scene's own sizes, not those of Python's list of views, which can be changed. */
    const struct sg_scene *scene = ((struct handle *) PyTuple_GetItem(h->keep, 0))->scene;
    if (view < 0 || (size_t) view >= scene->n_train)
        return PyErr_Format(PyExc_IndexError, "view: found %zd, expected 0 to %zu", view,
                            scene->n_train - 1);
    const struct sg_camera *c = &scene->train[view].camera;
    PyObject *rgb = PyByteArray_FromStringAndSize(NULL, 3 * (Py_ssize_t) c->width * c->height);
    if (rgb && !CALL(h->context, sg_attack_poison(h->attack, (size_t) view,
                                                  (uint8_t *) PyByteArray_AsString(rgb))))
        Py_CLEAR(rgb);
    return rgb ? Py_BuildValue("(Nii)", rgb, c->height, c->width) : NULL;
}

static PyObject *defense_preset(PyObject *module, PyObject *args)
{
    (void) module;
    const char *name;
    struct sg_defense_params p = sg_defense_params_default();
    if (!PyArg_ParseTuple(args, "s", &name))
        return NULL;
    if (!sg_defense_preset(name, &p))
        return PyErr_Format(error_type(SG_ERR_USAGE),
                            "preset: found \"%s\", expected ns, tt or mip", name);
    return Py_BuildValue("{s:d,s:d,s:d,s:d}", "rho", p.rho, "rho_least", p.rho_least,
                         "filter_frequency", p.frequency, "lambda", p.lambda);
}

static PyObject *option_dict(const struct sg_option *o)
{
    return Py_BuildValue("{s:s,s:s,s:s,s:s,s:d,s:d,s:O}", "name", o->name, "group",
                         o->group ? o->group : "", "help", o->help, "choices",
                         o->choices ? o->choices : "", "low", o->low, "high", o->high, "expert",
                         o->expert ? Py_True : Py_False);
}

static PyObject *options(PyObject *module, PyObject *args)
{
    (void) module;
    static const struct {
        const char *name;
        const struct sg_option *(*rows)(void);
    } tables[] = {{"train", sg_train_options},
                  {"attack", sg_attack_options},
                  {"scene", sg_scene_options},
                  {"render", sg_render_options}};
    const char *name;
    if (!PyArg_ParseTuple(args, "s", &name))
        return NULL;
    for (size_t t = 0; t < sizeof(tables) / sizeof(tables[0]); t++) {
        if (strcmp(name, tables[t].name))
            continue;
        PyObject *list = PyList_New(0);
        for (const struct sg_option *o = tables[t].rows(); o->name && list; o++) {
            PyObject *dict = option_dict(o);
            list_take(&list, dict);
        }
        return list;
    }
    return PyErr_Format(error_type(SG_ERR_USAGE),
                        "found \"%s\", expected train, attack, scene or render", name);
}

static PyObject *engines(PyObject *module, PyObject *none)
{
    (void) module, (void) none;
    PyObject *list = PyList_New(0);
    struct sg_engine_info e;
    for (size_t i = 0; list && sg_engine_list(i, &e); i++) {
        PyObject *dict = Py_BuildValue("{s:s,s:z,s:s,s:O,s:O}", "engine", e.engine, "cpu",
                                       e.variant, "description", e.description, "available",
                                       e.available ? Py_True : Py_False, "chosen",
                                       e.chosen ? Py_True : Py_False);
        list_take(&list, dict);
    }
    return list;
}

static PyObject *version(PyObject *module, PyObject *none)
{
    (void) module, (void) none;
    return PyUnicode_FromString(sg_version());
}

PyMethodDef core_work_methods[] = {{"trainer_new", trainer_new, METH_VARARGS, NULL},
                                   {"trainer_step", trainer_step, METH_VARARGS, NULL},
                                   {"trainer_state", trainer_state, METH_VARARGS, NULL},
                                   {"trainer_model", trainer_model, METH_VARARGS, NULL},
                                   {"trainer_save", trainer_save, METH_VARARGS, NULL},
                                   {"attack_new", attack_new, METH_VARARGS, NULL},
                                   {"attack_step", attack_step, METH_VARARGS, NULL},
                                   {"attack_poison", attack_poison, METH_VARARGS, NULL},
                                   {"defense_preset", defense_preset, METH_VARARGS, NULL},
                                   {"options", options, METH_VARARGS, NULL},
                                   {"engines", engines, METH_NOARGS, NULL},
                                   {"version", version, METH_NOARGS, NULL},
                                   {0}};
