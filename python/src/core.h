/* SPDX-License-Identifier: Apache-2.0 */
/* The extension module splatguard._core: handles of the library's objects and calls over buffers.
 * The package around it (python/splatguard) has the interface that people see.
 *
 * One build serves CPython 3.9 and later. The stable ABI has had the buffer protocol since 3.11,
 * which is why the limited API of 3.11 is asked for; functions and layouts are those of 3.9, and
 * nothing newer is called. */
#ifndef SG_PYTHON_CORE_H
#define SG_PYTHON_CORE_H

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030b0000
#include <Python.h>
#include <pythread.h>
#include <stdatomic.h>
#include <stdbool.h>

#include <splatguard/splatguard.h>

struct dead; /* objects that ended, of which none is destroyed during a call */

/* A context, and the lock that lets one thread at a time use it. */
struct context {
    PyObject_HEAD sg_ctx *ctx;
    PyThread_type_lock lock;
    atomic_ulong owner; /* thread that is in a call, 0 = none */
    _Atomic(struct dead *) dead;
    PyObject *log, *progress;
    unsigned long long max_vram;
};

/* Every other object: what it holds, its context, and what must outlive it. */
struct handle {
    PyObject_HEAD struct context *context;
    PyObject *keep; /* a tuple, or NULL */
    union {
        void *object;
        struct sg_scene *scene;
        struct sg_model *model;
        sg_renderer *renderer;
        sg_trainer *trainer;
        sg_attack *attack;
    };
    size_t drawn; /* values of the image that render() has drawn last with a renderer, or 0 */
};

enum kind { SCENE, MODEL, RENDERER, TRAINER, ATTACK, KINDS };
extern PyObject *core_types[KINDS];
extern PyObject *core_context_type;

PyObject *error_type(int code); /* the exception of an SG_ERR_* */

/* A new handle, which keeps what is in the list, or NULL. NULL with an exception. */
struct handle *handle_new(enum kind kind, struct context *context, PyObject *list);
/* For PyArg_ParseTuple with O&. */
int to_u64(PyObject *object, void *out);     /* unsigned long long *; "K" takes -1 for the most */
int to_context(PyObject *object, void *out); /* struct context ** */
int to_scene(PyObject *object, void *out);   /* struct handle **, as all below */
int to_model(PyObject *object, void *out);
int to_renderer(PyObject *object, void *out);
int to_trainer(PyObject *object, void *out);
int to_attack(PyObject *object, void *out);
int to_model_or_none(PyObject *object, void *out); /* NULL for None */

/* A call of the library: between begin and end the context is locked and the GIL is free. */
struct call {
    struct context *context;
    PyThreadState *thread;
};
bool call_begin(struct call *call, struct context *context);
/* Raises what `code` means; true where it is SG_OK. */
bool call_end(struct call *call, int code);
/* Both around an expression that is a code. */
#define CALL(context, expression)                                                                  \
    ({                                                                                             \
        struct call call_;                                                                         \
        call_begin(&call_, context) && call_end(&call_, expression);                               \
    })

/* Appends an item, which it releases. Where that fails, or there is no item, the list becomes NULL
 * with an exception. */
void list_take(PyObject **list, PyObject *item);
/* Whether a scene and a model (or NULL) may be used together, or an exception. */
bool same_context(const struct handle *a, const struct handle *b);

/* Buffers. Rows of an array that is not contiguous are copied. */
struct array {
    Py_buffer view;
    PyObject *memory;
    void *converted; /* owned */
    const void *data;
};
/* item: 'B' bytes, 'f' floats or 'd' doubles, of which the array must have exactly `count`; floats
 * and doubles are converted into each other. None becomes NULL where that is allowed. */
bool array_read(struct array *a, PyObject *object, char item, size_t count, const char *what,
                bool none);
/* To be filled; contiguous and of this type. */
bool array_write(struct array *a, PyObject *object, char item, size_t count, const char *what,
                 bool none);
void array_release(struct array *a);

/* Fields of a params struct from a dict by the names of option tables; texts go to the list keep.
 */
bool params_set(const struct sg_option *rows, void *params, PyObject *dict, PyObject *keep);
/* The name that a key of such a dict means, as bytes: lambda_ is lambda. */
PyObject *param_name(PyObject *key);

/* width height fx fy cx cy, then R and t, from an array of 18 doubles. */
bool camera_read(struct sg_camera *camera, PyObject *object);

extern PyMethodDef core_object_methods[], core_scene_methods[], core_work_methods[];

#endif
