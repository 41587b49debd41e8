/* SPDX-License-Identifier: Apache-2.0 */
/* Contexts, handles, buffers, errors, and the module itself. */
#include "core.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

PyObject *core_types[KINDS], *core_context_type;
static PyObject *errors[7]; /* by -code; [0] is the base */

PyObject *error_type(int code)
{
    return code < 0 && code >= -6 ? errors[-code] : errors[0];
}

/* ---- contexts ---- */

static void on_log(void *priv, enum sg_log_level level, const char *message)
{
    struct context *c = priv;
    const PyGILState_STATE state = PyGILState_Ensure();
    PyObject *type, *value, *trace;
    PyErr_Fetch(&type, &value, &trace); /* another callback may have left one */
    PyObject *text = PyUnicode_DecodeUTF8(message, (Py_ssize_t) strlen(message), "replace");
    PyObject *done = text ? PyObject_CallFunction(c->log, "iO", (int) level, text) : NULL;
    /* Ctrl-C on the thread that called the library stays, and is raised where the call ends. */
    const bool stop = !done && !type && PyErr_ExceptionMatches(PyExc_KeyboardInterrupt) &&
                      atomic_load(&c->owner) == PyThread_get_thread_ident();
    if (!done && !stop)
        PyErr_WriteUnraisable(c->log);
    Py_XDECREF(text);
    Py_XDECREF(done);
    if (!stop)
        PyErr_Restore(type, value, trace);
    PyGILState_Release(state);
}

/* On the thread that called the library: an exception left here is raised where the call ends. */
static int on_progress(void *priv, enum sg_stage stage, uint64_t done, uint64_t total)
{
    struct context *c = priv;
    const PyGILState_STATE state = PyGILState_Ensure();
    int cancel = PyErr_Occurred() || PyErr_CheckSignals();
    if (!cancel && c->progress) {
        PyObject *answer =
            PyObject_CallFunction(c->progress, "sKK", sg_stage_name(stage),
                                  (unsigned long long) done, (unsigned long long) total);
        cancel = !answer || (answer != Py_None && PyObject_IsTrue(answer));
        Py_XDECREF(answer);
    }
    PyGILState_Release(state);
    return cancel;
}

static PyObject *context_new(PyTypeObject *type, PyObject *args, PyObject *kw)
{
    static char *names[] = {"threads",   "max_memory", "log", "progress",
                            "log_level", "max_vram",   NULL};
    int threads = 0, level = SG_LOG_WARN;
    unsigned long long max_memory = 0, max_vram = 0;
    PyObject *log = NULL, *progress = NULL;
    if (!PyArg_ParseTupleAndKeywords(args, kw, "|iO&OOiO&:Context", names, &threads, to_u64,
                                     &max_memory, &log, &progress, &level, to_u64, &max_vram))
        return NULL;
    struct context *c = (struct context *) ((allocfunc) PyType_GetSlot(type, Py_tp_alloc))(type, 0);
    if (!c)
        return NULL;
    c->log = log == Py_None ? NULL : log;
    c->progress = progress == Py_None ? NULL : progress;
    Py_XINCREF(c->log);
    Py_XINCREF(c->progress);
    c->max_vram = max_vram;
    const struct sg_ctx_params params = {.threads = threads,
                                         .max_memory = max_memory,
                                         .max_vram = max_vram,
                                         .log = c->log ? on_log : NULL,
                                         .log_priv = c,
                                         .log_level = (enum sg_log_level) level,
                                         .progress = on_progress,
                                         .progress_priv = c};
    c->lock = PyThread_allocate_lock();
    const int code = c->lock ? sg_ctx_create(&c->ctx, &params) : SG_ERR_BUDGET;
    if (code) {
        const bool of_threads = threads < 0 || threads > 256;
        if (code == SG_ERR_USAGE)
            PyErr_Format(error_type(code), "%s: found %d, expected 0 to %d",
                         of_threads ? "threads" : "log_level", of_threads ? threads : level,
                         of_threads ? 256 : SG_LOG_DEBUG);
        else
            PyErr_SetString(error_type(code),
                            "found no memory or threads for a context, expected both");
        Py_DECREF((PyObject *) c);
        return NULL;
    }
    return (PyObject *) c;
}

/* What the garbage collector looks for cycles in. Nothing here breaks one: that is left to what all
 * of them have, the variables of a function or an object, so that every object is whole until it is
 * destroyed, after all that needs it. */
static int context_traverse(PyObject *self, visitproc visit, void *arg)
{
    struct context *c = (struct context *) self;
    Py_VISIT(Py_TYPE(self));
    Py_VISIT(c->log);
    Py_VISIT(c->progress);
    return 0;
}

static void free_object(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    ((freefunc) PyType_GetSlot(type, Py_tp_free))(self);
    Py_DECREF((PyObject *) type);
}

struct dead {
    struct dead *next;
    enum kind kind;
    void *object;
    PyObject *keep;
};

static void destroy(enum kind kind, void *object)
{
    switch (kind) {
    case SCENE:
        sg_scene_destroy(&(struct sg_scene *){object});
        break;
    case MODEL:
        sg_model_destroy(&(struct sg_model *){object});
        break;
    case RENDERER:
        sg_renderer_destroy(&(sg_renderer *){object});
        break;
    case TRAINER:
        sg_trainer_destroy(&(sg_trainer *){object});
        break;
    default:
        sg_attack_destroy(&(sg_attack *){object});
    }
}

/* With the context's lock and without the GIL, for which threads of an object may wait. */
static struct dead *destroy_dead(struct context *c)
{
    struct dead *all = atomic_exchange(&c->dead, NULL);
    for (struct dead *d = all; d; d = d->next)
        destroy(d->kind, d->object);
    return all;
}

/* With the GIL. */
static void forget(struct dead *d)
{
    while (d) {
        struct dead *next = d->next;
        Py_XDECREF(d->keep);
        free(d);
        d = next;
    }
}

/* Destroys what has ended. Where a call has the context, that does so at its end: it may wait for
 * this thread, which is in one of its functions. */
static void bury(struct context *c)
{
    while (atomic_load(&c->dead) && PyThread_acquire_lock(c->lock, NOWAIT_LOCK)) {
        PyThreadState *thread = PyEval_SaveThread();
        atomic_store(&c->owner, PyThread_get_thread_ident());
        struct dead *d = destroy_dead(c);
        atomic_store(&c->owner, 0);
        PyThread_release_lock(c->lock);
        PyEval_RestoreThread(thread);
        forget(d);
    }
}

static void context_dealloc(PyObject *self)
{
    struct context *c = (struct context *) self;
    PyObject_GC_UnTrack(self);
    if (c->lock)
        bury(c);
    sg_ctx_destroy(&c->ctx);
    if (c->lock)
        PyThread_free_lock(c->lock);
    Py_XDECREF(c->log);
    Py_XDECREF(c->progress);
    free_object(self);
}

static PyObject *context_memory(PyObject *self, PyObject *none)
{
    (void) none;
    const sg_ctx *ctx = ((struct context *) self)->ctx;
    PyObject *dict = PyDict_New();
    for (int tag = 0; tag <= SG_MEM_TAGS && dict; tag++) {
        PyObject *pair =
            Py_BuildValue("(KK)", (unsigned long long) sg_mem_current(ctx, (enum sg_mem_tag) tag),
                          (unsigned long long) sg_mem_peak(ctx, (enum sg_mem_tag) tag));
        const char *name = tag == SG_MEM_TAGS ? "total" : sg_mem_tag_name((enum sg_mem_tag) tag);
        if (!pair || PyDict_SetItemString(dict, name, pair))
            Py_CLEAR(dict);
        Py_XDECREF(pair);
    }
    return dict;
}

static PyMethodDef context_methods[] = {{"memory", context_memory, METH_NOARGS, NULL}, {0}};
static PyType_Slot context_slots[] = {{Py_tp_new, context_new},
                                      {Py_tp_dealloc, context_dealloc},
                                      {Py_tp_traverse, context_traverse},
                                      {Py_tp_methods, context_methods},
                                      {0}};
static PyType_Spec context_spec = {.name = "splatguard._core.Context",
                                   .basicsize = sizeof(struct context),
                                   .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_BASETYPE |
                                            Py_TPFLAGS_HAVE_GC,
                                   .slots = context_slots};

/* ---- handles ---- */

static void release(struct handle *h, enum kind kind)
{
    struct dead *d = malloc(sizeof(*d)); /* without memory it is never destroyed */
    if (d) {
        *d = (struct dead){atomic_load(&h->context->dead), kind, h->object, h->keep};
        while (!atomic_compare_exchange_weak(&h->context->dead, &d->next, d))
            ;
        h->keep = NULL;
    }
    bury(h->context);
}

static int handle_traverse(PyObject *self, visitproc visit, void *arg)
{
    struct handle *h = (struct handle *) self;
    Py_VISIT(Py_TYPE(self));
    Py_VISIT((PyObject *) h->context);
    Py_VISIT(h->keep);
    return 0;
}

#define DEALLOC(name, kind)                                                                        \
    static void name(PyObject *self)                                                               \
    {                                                                                              \
        struct handle *h = (struct handle *) self;                                                 \
        PyObject_GC_UnTrack(self);                                                                 \
        release(h, kind);                                                                          \
        Py_CLEAR(h->context);                                                                      \
        free_object(self);                                                                         \
    }
DEALLOC(scene_dealloc, SCENE)
DEALLOC(model_dealloc, MODEL)
DEALLOC(renderer_dealloc, RENDERER)
DEALLOC(trainer_dealloc, TRAINER)
DEALLOC(attack_dealloc, ATTACK)

/* Handles come from functions of the module alone. */
static PyObject *refuse_new(PyTypeObject *type, PyObject *args, PyObject *kw)
{
    (void) args, (void) kw;
    PyErr_Format(PyExc_TypeError, "%R is not to be called", (PyObject *) type);
    return NULL;
}

#define SLOTS(dealloc)                                                                             \
    {                                                                                              \
        {Py_tp_dealloc, dealloc}, {Py_tp_new, refuse_new}, {Py_tp_traverse, handle_traverse},      \
        {                                                                                          \
            0                                                                                      \
        }                                                                                          \
    }
static PyType_Slot slots[KINDS][4] = {SLOTS(scene_dealloc), SLOTS(model_dealloc),
                                      SLOTS(renderer_dealloc), SLOTS(trainer_dealloc),
                                      SLOTS(attack_dealloc)};
static const char *const type_names[KINDS] = {
    "splatguard._core.Scene", "splatguard._core.Model", "splatguard._core.Renderer",
    "splatguard._core.Trainer", "splatguard._core.Attack"};

struct handle *handle_new(enum kind kind, struct context *context, PyObject *list)
{
    PyTypeObject *type = (PyTypeObject *) core_types[kind];
    /* Not the list itself, which the garbage collector would empty before the object ends. */
    PyObject *keep = list ? PyList_AsTuple(list) : NULL;
    struct handle *h =
        list && !keep ? NULL
                      : (struct handle *) ((allocfunc) PyType_GetSlot(type, Py_tp_alloc))(type, 0);
    if (!h) {
        Py_XDECREF(keep);
        return NULL;
    }
    Py_INCREF((PyObject *) context);
    h->context = context;
    h->keep = keep;
    return h;
}

static int convert(PyObject *object, PyObject *type, void *out)
{
    if (!PyObject_TypeCheck(object, (PyTypeObject *) type)) {
        PyErr_Format(PyExc_TypeError, "found %R, expected %R", object, type);
        return 0;
    }
    *(PyObject **) out = object;
    return 1;
}

int to_u64(PyObject *object, void *out)
{
    PyObject *whole = PyNumber_Index(object);
    *(unsigned long long *) out = whole ? PyLong_AsUnsignedLongLong(whole) : 0;
    if (PyErr_Occurred() && PyErr_ExceptionMatches(PyExc_OverflowError))
        PyErr_Format(error_type(SG_ERR_USAGE), "found %R, expected 0 to %llu", whole, ULLONG_MAX);
    Py_XDECREF(whole);
    return !PyErr_Occurred();
}

int to_context(PyObject *object, void *out)
{
    return convert(object, core_context_type, out);
}

int to_scene(PyObject *object, void *out)
{
    return convert(object, core_types[SCENE], out);
}

int to_model(PyObject *object, void *out)
{
    return convert(object, core_types[MODEL], out);
}

int to_renderer(PyObject *object, void *out)
{
    return convert(object, core_types[RENDERER], out);
}

int to_trainer(PyObject *object, void *out)
{
    return convert(object, core_types[TRAINER], out);
}

int to_attack(PyObject *object, void *out)
{
    return convert(object, core_types[ATTACK], out);
}

int to_model_or_none(PyObject *object, void *out)
{
    *(PyObject **) out = NULL;
    return object == Py_None || to_model(object, out);
}

/* ---- calls ---- */

bool call_begin(struct call *call, struct context *context)
{
    if (atomic_load(&context->owner) == PyThread_get_thread_ident()) {
        PyErr_SetString(PyExc_RuntimeError,
                        "found a call of the library in its own callback, expected none with the "
                        "same context");
        return false;
    }
    call->context = context;
    call->thread = PyEval_SaveThread();
    PyThread_acquire_lock(context->lock, WAIT_LOCK);
    atomic_store(&context->owner, PyThread_get_thread_ident());
    return true;
}

bool call_end(struct call *call, int code)
{
    char message[1024] = "";
    if (code)
        strncat(message, sg_last_error(call->context->ctx), sizeof(message) - 1);
    struct dead *d = destroy_dead(call->context);
    atomic_store(&call->context->owner, 0);
    PyThread_release_lock(call->context->lock);
    PyEval_RestoreThread(call->thread);
    forget(d);
    bury(call->context);  /* what ended in between */
    if (PyErr_Occurred()) /* of a callback: it is why the call ended */
        return false;
    if (!code)
        return true;
    PyObject *text = PyUnicode_DecodeUTF8(message, (Py_ssize_t) strlen(message), "replace");
    if (text)
        PyErr_SetObject(error_type(code), text);
    Py_XDECREF(text);
    return false;
}

/* ---- arrays ---- */

static size_t size_of(char item)
{
    return item == 'B' ? 1 : item == 'f' ? 4 : 8;
}

/* The item of a buffer in native order; 0 where it is none of ours. Booleans are bytes. */
static char item_of(const Py_buffer *view)
{
    const char *f = view->format ? view->format : "B";
    f += *f == '@' || *f == '=' || *f == '<';
    const char item = *f == '?' || *f == 'b' || *f == 'c' ? 'B' : *f;
    return f[0] && !f[1] && (item == 'B' || item == 'f' || item == 'd') ? item : 0;
}

void array_release(struct array *a)
{
    if (a->memory) {
        PyBuffer_Release(&a->view);
        Py_CLEAR(a->memory);
    }
    PyMem_Free(a->converted);
    memset(a, 0, sizeof(*a));
}

static bool check_shape(struct array *a, char found, char item, bool convertible, size_t count,
                        const char *what)
{
    const size_t size = found ? size_of(found) : (size_t) a->view.itemsize,
                 items = size ? (size_t) a->view.len / size : 0;
    if (found && items == count && (found == item || (convertible && found != 'B' && item != 'B')))
        return true;
    PyErr_Format(error_type(SG_ERR_USAGE),
                 "%s: found %zu values of type '%s', expected %zu of type '%c'", what, items,
                 a->view.format ? a->view.format : "B", count, item);
    array_release(a);
    return false;
}

bool array_read(struct array *a, PyObject *object, char item, size_t count, const char *what,
                bool none)
{
    memset(a, 0, sizeof(*a));
    if (object == Py_None && none)
        return true;
    a->memory = PyMemoryView_GetContiguous(object, PyBUF_READ, 'C'); /* copies only what has gaps */
    if (!a->memory)
        return false;
    if (PyObject_GetBuffer(a->memory, &a->view, PyBUF_ND | PyBUF_FORMAT)) {
        Py_CLEAR(a->memory);
        return false;
    }
    const char found = item_of(&a->view);
    if (!check_shape(a, found, item, true, count, what))
        return false;
    a->data = a->view.buf;
    if (found == item)
        return true;
    a->data = a->converted = PyMem_Malloc(count * size_of(item) + 1);
    if (!a->converted) {
        array_release(a);
        PyErr_NoMemory();
        return false;
    }
    for (size_t i = 0; i < count; i++)
        if (item == 'f')
            ((float *) a->converted)[i] = (float) ((const double *) a->view.buf)[i];
        else
            ((double *) a->converted)[i] = (double) ((const float *) a->view.buf)[i];
    return true;
}

bool array_write(struct array *a, PyObject *object, char item, size_t count, const char *what,
                 bool none)
{
    memset(a, 0, sizeof(*a));
    if (object == Py_None && none)
        return true;
    if (PyObject_GetBuffer(object, &a->view, PyBUF_WRITABLE | PyBUF_ND | PyBUF_FORMAT))
        return false;
    a->memory = object;
    Py_INCREF(object);
    const char found = item_of(&a->view);
    if (!check_shape(a, found, item, false, count, what))
        return false;
    a->data = a->view.buf;
    return true;
}

void list_take(PyObject **list, PyObject *item)
{
    if (!item || PyList_Append(*list, item))
        Py_CLEAR(*list);
    Py_XDECREF(item);
}

bool same_context(const struct handle *a, const struct handle *b)
{
    if (!b || a->context == b->context)
        return true;
    PyErr_SetString(error_type(SG_ERR_USAGE), "found scene and model of different contexts");
    return false;
}

/* ---- parameters ---- */

/* All digits of a float. Classes that are floats too, such as NumPy's, may print themselves in
 * another way. */
static PyObject *float_text(PyObject *value)
{
    PyObject *plain = PyFloat_FromDouble(PyFloat_AsDouble(value)),
             *text = plain ? PyObject_Repr(plain) : NULL;
    Py_XDECREF(plain);
    return text;
}

/* The text of a value as option tables read it, as bytes. Names of folders are paths as elsewhere:
 * text, bytes or os.PathLike, in any encoding. */
static PyObject *text_of(PyObject *value)
{
    PyObject *text = PyOS_FSPath(value);
    if (text && PyBytes_Check(text))
        return text;
    if (!text && PyErr_ExceptionMatches(PyExc_TypeError)) { /* it is none of these */
        PyErr_Clear();
        if (PyBool_Check(value))
            text = PyUnicode_FromString(value == Py_True ? "true" : "false");
        else
            text = PyFloat_Check(value) ? float_text(value) : PyObject_Str(value);
    }
    PyObject *bytes = text ? PyUnicode_EncodeFSDefault(text) : NULL;
    Py_XDECREF(text);
    return bytes;
}

PyObject *param_name(PyObject *key)
{
    PyObject *name = PyUnicode_AsUTF8String(key);
    const Py_ssize_t n = name ? PyBytes_Size(name) : 0;
    if (n > 1 && PyBytes_AsString(name)[n - 1] == '_') { /* "_" alone is no name */
        PyObject *whole = name;
        name = PyBytes_FromStringAndSize(PyBytes_AsString(whole), n - 1);
        Py_DECREF(whole);
    }
    return name;
}

bool params_set(const struct sg_option *rows, void *params, PyObject *dict, PyObject *keep)
{
    PyObject *key, *value;
    Py_ssize_t at = 0;
    while (PyDict_Next(dict, &at, &key, &value)) {
        if (value == Py_None)
            continue;
        PyObject *name = param_name(key), *text = name ? text_of(value) : NULL;
        bool good = text && !PyList_Append(keep, text);
        if (good) {
            const char *n = PyBytes_AsString(name);
            char expected[160] = "";
            const bool whole = (size_t) PyBytes_Size(name) == strlen(n);
            const struct sg_option *row = whole ? sg_option_find(rows, n) : NULL;
            const bool is_switch = row && row->type == SG_OPTION_SWITCH;
            if (!row)
                PyErr_Format(PyExc_TypeError,
                             "found parameter %R, which is none of these; see "
                             "splatguard.options()",
                             key);
            else if ((size_t) PyBytes_Size(text) != strlen(PyBytes_AsString(text)))
                PyErr_Format(errors[-SG_ERR_USAGE], "%s: found %R, expected no zero byte", n,
                             value);
            else if (is_switch && PyBool_Check(value))
                *(bool *) ((char *) params + row->offset) = value == Py_True;
            else if (!sg_option_set(row, params, PyBytes_AsString(text), expected,
                                    sizeof(expected)))
                PyErr_Format(errors[-SG_ERR_USAGE], "%s: found %R, expected %s%s", n, value,
                             is_switch ? "true, false or " : "", expected);
            good = !PyErr_Occurred();
        }
        Py_XDECREF(name);
        Py_XDECREF(text);
        if (!good)
            return false;
    }
    return true;
}

bool camera_read(struct sg_camera *camera, PyObject *object)
{
    struct array a;
    if (!array_read(&a, object, 'd', 18, "camera", false))
        return false;
    const double *v = a.data;
    if (!(v[0] >= 1 && v[0] <= SG_SIDE_MAX && v[1] >= 1 && v[1] <= SG_SIDE_MAX)) {
        char found[80]; /* PyErr_Format knows no %g */
        snprintf(found, sizeof(found), "%g x %g", v[0], v[1]);
        PyErr_Format(errors[-SG_ERR_USAGE],
                     "camera: found an image of %s pixels, expected sides of 1 to %d", found,
                     SG_SIDE_MAX);
        array_release(&a);
        return false;
    }
    *camera = (struct sg_camera){
        .width = (int) v[0], .height = (int) v[1], .fx = v[2], .fy = v[3], .cx = v[4], .cy = v[5]};
    memcpy(camera->R, v + 6, sizeof(camera->R));
    memcpy(camera->t, v + 15, sizeof(camera->t));
    array_release(&a);
    return true;
}

/* ---- the module ---- */

/* PyModule_AddObjectRef came with 3.10. */
static bool add_object(PyObject *module, const char *name, PyObject *object)
{
    Py_INCREF(object);
    if (!PyModule_AddObject(module, name, object))
        return true;
    Py_DECREF(object);
    return false;
}

static bool add_error(PyObject *module, int index, const char *name, const char *doc,
                      PyObject *second)
{
    char full[64];
    snprintf(full, sizeof(full), "splatguard.%s", name);
    PyObject *bases = !index   ? NULL
                      : second ? PyTuple_Pack(2, errors[0], second)
                               : PyTuple_Pack(1, errors[0]);
    errors[index] = PyErr_NewExceptionWithDoc(full, doc, bases, NULL);
    Py_XDECREF(bases);
    return errors[index] && add_object(module, name, errors[index]);
}

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, .m_name = "splatguard._core",
                                        .m_size = -1};

PyMODINIT_FUNC PyInit__core(void);
PyMODINIT_FUNC PyInit__core(void)
{
    PyObject *module = PyModule_Create(&definition);
    bool good =
        module && add_error(module, 0, "Error", "Any failure of the library.", NULL) &&
        add_error(module, 1, "UsageError", "An argument or parameter is not allowed.",
                  PyExc_ValueError) &&
        add_error(module, 2, "InputError", "A file or folder is missing, malformed or unwritable.",
                  PyExc_ValueError) &&
        add_error(module, 3, "BudgetError",
                  "A limit on memory or counts would be exceeded; the message says how much is "
                  "needed.",
                  PyExc_MemoryError) &&
        add_error(module, 4, "InternalError", "A bug, or the system refused something basic.",
                  PyExc_RuntimeError) &&
        add_error(module, 5, "Cancelled", "A progress function cancelled the call.", NULL) &&
        add_error(module, 6, "PoisonedError", "The photos look poisoned, which was refused.",
                  NULL) &&
        (core_context_type = PyType_FromSpec(&context_spec)) != NULL;
    for (int k = 0; k < KINDS && good; k++) {
        PyType_Spec spec = {.name = type_names[k],
                            .basicsize = sizeof(struct handle),
                            .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC,
                            .slots = slots[k]};
        core_types[k] = PyType_FromSpec(&spec);
        good = core_types[k] != NULL;
    }
    if (good)
        good = add_object(module, "Context", core_context_type) &&
               !PyModule_AddFunctions(module, core_object_methods) &&
               !PyModule_AddFunctions(module, core_scene_methods) &&
               !PyModule_AddFunctions(module, core_work_methods);
    if (!good)
        Py_CLEAR(module);
    return module;
}
