# SPDX-License-Identifier: Apache-2.0
"""3D Gaussian Splatting from untrusted photos: train, render, audit, attack, defend.

    import splatguard as sg

    scene = sg.Scene.load("garden")                   # COLMAP, Blender or nerfstudio folder
    report = sg.audit(scene)                          # do the photos look poisoned?
    model = sg.train(scene, iterations=7000, callback=lambda step: print(step["psnr"]))
    model.save("garden.ply")
    picture = sg.Renderer(model).render(scene.train[0].camera)

Arrays. What goes in is anything with the buffer protocol: NumPy arrays, memoryview, array.array,
CPU tensors by .numpy(). Arrays that are contiguous and of the right type are not copied on the way
to the library. What comes out is a memoryview with a shape: numpy.asarray(x) has the same memory.

Images are height x width x 3 bytes (sRGB); renders are 3 x height x width float32, not clamped.
Lengths are in scene units. Cameras are those of COLMAP: world to camera, x right, y down, z
forward, pixel centres at 0.5.

Parameters of training, attacks, scenes and renders are those of the command line, with "_" for "-":
options("train") lists them with ranges and help. lambda is written lambda_.

Contexts. Threads, memory limit, log and progress belong to a Context; without one, a default
context is used. Calls of one context wait for each other, those of different contexts run at the
same time; the GIL is free while the library works. A log or progress function must not call the
library with the same context.

Ctrl-C raises KeyboardInterrupt at the next step of whatever runs; see train for what is saved.
"""

import array as _arrays
import itertools as _itertools
import threading as _threading

from . import _core
from ._core import (BudgetError, Cancelled, Error, InputError, InternalError, PoisonedError,
                    UsageError)

__all__ = [
    "Attack", "BudgetError", "Camera", "Cancelled", "Context", "Error", "InputError",
    "InternalError", "Model", "PoisonedError", "Render", "Renderer", "Scene", "Trainer",
    "UsageError", "View", "attack", "audit", "audit_images", "camera_path", "defense_preset",
    "engines", "evaluate", "options", "train",
]
__version__ = _core.version()

_FORMATS = ("auto", "ply", "compressed-ply", "splat", "spz", "ksplat", "sog", "glb")
_SPLITS = {None: 0, "train": 1, "test": 2}


def _array(code, *shape):
    """A new array of a type, zeros."""
    item = {"f": 4, "B": 1}[code]
    size = item
    for side in shape:
        size *= side
    view = memoryview(bytearray(size))
    return view.cast(code, shape) if size else view.cast(code)


def _shape(array, what, last):
    """Checks that an array is height x width (x last); returns its first two sides."""
    view = memoryview(array)
    expected = 3 if last else 2
    if view.ndim != expected or (last and view.shape[2] != last):
        raise UsageError(f"{what}: found an array of shape {view.shape}, expected height x width"
                         + (f" x {last}" if last else ""))
    return view.shape[:2]


def _check_rows(array, count, width, what):
    """Checks that an array with more than one dimension has a row for each Gaussian."""
    shape = memoryview(array).shape
    if len(shape) > 1 and shape[0] != count:
        raise UsageError(f"{what}: found an array of shape {shape}, expected {count} x {width}")


def _expect(value, kinds, what):
    """Checks that an argument is of a class, or of one of some; returns it."""
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    if not isinstance(value, kinds):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise TypeError(f"{what}: found {type(value).__name__}, expected {expected}")
    return value


def _floats(values):
    """Numbers of each view, an array or a list, as an array."""
    return _arrays.array("f", values) if isinstance(values, list) else values


def _number(value):
    """A parameter as a float; None where it is not given, or no number, which is refused later."""
    try:
        return None if value is None else float(value)
    except (TypeError, ValueError):
        return None


def _flag(value, what):
    """Checks that an argument is a bool: a text such as "no" would count as true."""
    if not isinstance(value, bool):
        raise UsageError(f"{what}: found {value!r}, expected true or false")
    return value


class Context(_core.Context):
    """Threads, memory limit, log and progress.

    threads: worker threads, 0 = one per CPU; results do not depend on it.
    max_memory: bytes that may be allocated at once, 0 = no limit; beyond it calls raise
    BudgetError.
    max_vram: likewise of the memory of a device, 0 = nine tenths of what is free.
    log: called as log(level, message) with level 0 = warning, 1 = info, 2 = debug; on any thread.
    log_level: the most detailed level that is sent.
    progress: called as progress(stage, done, total) on the thread of the call; a true result
        cancels the call, which then raises Cancelled.

    memory() returns {purpose: (bytes now, most bytes so far)} with the sum as "total".
    """

    __slots__ = ()


_default = None
_default_lock = _threading.Lock()


def _context(context):
    global _default
    if context is not None:
        return context
    with _default_lock:
        if _default is None:
            _default = Context()
    return _default


class Camera:
    """A pinhole camera.

    width, height: pixels. fx, fy, cx, cy: focal lengths and principal point, pixels; cx and cy are
    the middle by default. R: 3 x 3 rotation and t: 3 numbers, world to camera, x_c = R x_w + t.
    """

    __slots__ = ("width", "height", "fx", "fy", "cx", "cy", "R", "t")

    def __init__(self, width, height, fx, fy=None, cx=None, cy=None,
                 R=((1, 0, 0), (0, 1, 0), (0, 0, 1)), t=(0, 0, 0)):
        self.width, self.height = int(width), int(height)
        self.fx, self.fy = float(fx), float(fx if fy is None else fy)
        self.cx = width / 2 if cx is None else float(cx)
        self.cy = height / 2 if cy is None else float(cy)
        self.R = tuple(tuple(float(v) for v in row) for row in R)
        self.t = tuple(float(v) for v in t)
        if len(self.R) != 3 or any(len(row) != 3 for row in self.R) or len(self.t) != 3:
            raise UsageError("camera: expected R of 3 x 3 and t of 3 numbers")

    def _numbers(self):
        numbers = (self.width, self.height, self.fx, self.fy, self.cx, self.cy,
                   *self.R[0], *self.R[1], *self.R[2], *self.t)
        out = memoryview(bytearray(8 * len(numbers))).cast("d")
        for k, number in enumerate(numbers):
            out[k] = number
        return out

    @classmethod
    def _of(cls, n):
        return cls(n[0], n[1], *n[2:6], R=(n[6:9], n[9:12], n[12:15]), t=n[15:18])

    def __repr__(self):
        return (f"Camera({self.width}, {self.height}, {self.fx:g}, {self.fy:g}, {self.cx:g}, "
                f"{self.cy:g}, R={self.R}, t={self.t})")


class View:
    """A photo for Scene.build, or one of a scene, which another scene can be built of too.

    name: unique text. camera: a Camera for the size of the image. image: height x width x 3 bytes,
    or a function without arguments that returns them whenever the library needs the pixels (a lazy
    photo; it must return the same pixels each time). mask: height x width bytes, 0 = ignored, or
    None. split: "train", "test", or None to leave that to the parameters eval and test_every.
    lossless: the photo is known to be without lossy compression, as PNG is; tolerance="auto" then
    fits it more closely.
    """

    __slots__ = ("name", "camera", "split", "lossless", "file", "_image", "_mask", "_place")

    def __init__(self, name, camera, image, mask=None, split=None, lossless=False):
        self.name, self.camera = name, _expect(camera, Camera, "camera")
        self.split, self.file = split, ""
        self.lossless = _flag(lossless, "lossless")
        self._image, self._mask, self._place = image, mask, None
        if split not in _SPLITS:
            raise UsageError(f'split: found {split!r}, expected None, "train" or "test"')

    def _tuple(self):
        sides = (self.camera.height, self.camera.width)
        image, mask = (self._image, self._mask) if self._place is None else (self.image, self.mask)
        name = self.name

        def checked(pixels):
            if _shape(pixels, name, 3) != sides:
                raise UsageError(f"{name}: found an image of {_shape(pixels, '', 3)}, expected "
                                 f"{sides} (height, width) as its camera")
            return pixels

        if callable(image):
            read, image = image, lambda: checked(read())
        else:
            checked(image)
        if mask is not None and _shape(mask, self.name + ": mask", None) != sides:
            raise UsageError(f"{self.name}: found a mask of another size than its camera")
        return (self.name, self.camera._numbers(), image, mask, _SPLITS[self.split], self.lossless)

    @property
    def image(self):
        """The pixels, height x width x 3 bytes: of a scene's view a copy, as the library has it."""
        if self._place is None:
            return self._image() if callable(self._image) else self._image
        scene, test, index = self._place
        out = _array("B", self.camera.height, self.camera.width, 3)
        _core.scene_pixels(scene, test, index, out, None)
        return out

    @property
    def mask(self):
        """height x width bytes, 0 = ignored; None = every pixel is used."""
        if self._place is None or not self._mask:
            return self._mask if self._place is None else None
        scene, test, index = self._place
        out = _array("B", self.camera.height, self.camera.width)
        _core.scene_pixels(scene, test, index, None, out)
        return out

    def __repr__(self):
        return f"View({self.name!r}, {self.camera.width} x {self.camera.height})"


class Scene:
    """Photos with cameras, and points: made by Scene.load or Scene.build.

    format: "colmap", "blender", "nerfstudio" or "memory". train, test: lists of View. extent:
    radius of the cameras in scene units. center: their mean. white_background: what training and
    evaluate draw on, else black. context: the Context.
    """

    def __init__(self, handle, context):
        self._handle, self.context = handle, context
        info = _core.scene_info(handle)
        self.format, self.extent, self.center = info["format"], info["extent"], info["center"]
        self._points, self.white_background = info["points"], info["white_background"]
        self._names = [v["name"] for v in info["train"]]  # train may be changed
        self.train = [self._view(v, False, i) for i, v in enumerate(info["train"])]
        self.test = [self._view(v, True, i) for i, v in enumerate(info["test"])]

    def _view(self, v, test, index):
        view = View(v["name"], Camera._of(v["camera"]), None, split="test" if test else "train",
                    lossless=v["lossless"])
        view.file, view._mask, view._place = v["file"], v["masked"], (self._handle, test, index)
        return view

    @classmethod
    def load(cls, path, context=None, eval=False, untrained=False, photos_alone=False, **params):
        """Loads a COLMAP, Blender or nerfstudio folder, or a zip archive of one. eval: hold test
        views out of training. untrained: nothing will be trained, so that all may be test views.
        photos_alone: a folder of photos without cameras will do, as for audit; then format is
        "photos". params: see options("scene"). Raises InputError for what is missing or
        malformed."""
        context = _context(context)
        return cls(_core.scene_load(context, path, params, _flag(eval, "eval"),
                                    _flag(untrained, "untrained"),
                                    _flag(photos_alone, "photos_alone")), context)

    @classmethod
    def build(cls, views, points=None, colors=None, context=None, keep_photos=0, eval=False,
              untrained=False, **params):
        """Makes a scene from an iterable of View, which may be a generator: each view is taken
        over before the next is asked for.

        points: n x 3 floats, colors: n x 3 bytes or None; without points training starts from
        random ones. keep_photos: bytes of lazy photos that stay in memory, 0 = all, or with a
        memory limit a quarter of it. eval: every test_every-th view whose split is None is a test
        view. untrained: see load. params: test_every, white_background.
        """
        context = _context(context)
        count = 0
        files = {row["name"] for row in options("scene")} - {"test-every", "white-background"}
        for name in params:
            if name.rstrip("_").replace("_", "-") in files:
                raise UsageError(f"{name}: found with views that are no files, expected test_every "
                                 "or white_background")
        if points is None and colors is not None:
            raise UsageError("colors: found without points, expected both")
        if points is not None:
            count = _shape_rows(points, "points")
            if colors is not None and _shape_rows(colors, "colors") != count:
                raise UsageError("colors: expected as many rows as points")
        tuples = (_expect(view, View, "views")._tuple() for view in views)
        handle = _core.scene_build(context, params, tuples, points, colors, count, keep_photos,
                                   _flag(eval, "eval"), _flag(untrained, "untrained"))
        return cls(handle, context)

    def points(self):
        """(n x 3 floats, n x 3 bytes): positions and colours of the points that came along."""
        xyz, rgb = _array("f", self._points, 3), _array("B", self._points, 3)
        _core.scene_points(self._handle, xyz, rgb)
        return xyz, rgb

    def __repr__(self):
        return (f"<Scene {self.format}: {len(self.train)} training and {len(self.test)} test views, "
                f"{self._points} points>")


def _shape_rows(array, what):
    view = memoryview(array)
    if view.ndim != 2 or view.shape[1] != 3:
        raise UsageError(f"{what}: found an array of shape {view.shape}, expected n x 3")
    return view.shape[0]


class Model:
    """Gaussians. Fields are arrays of named parameters, values as stored (before activation):

        position  n x 3     scene units
        scale     n x 3     natural logarithm of the standard deviation
        rotation  n x 4     quaternion w x y z, any length but 0
        opacity   n x 1     logit
        sh_dc     n x 3     colour = 0.5 + 0.28209479 sh_dc
        sh_rest   n x 3 ((d + 1)^2 - 1)   coefficient k of channel c at 3 (k - 1) + c

    model["position"] is a copy of a field, model["position"] = array sets it, bit by bit.
    """

    def __init__(self, count, sh_degree=3, context=None):
        """count Gaussians, all zeros. sh_degree: 0 to 3."""
        self.context = _context(context)
        self._handle = _core.model_new(self.context, count, sh_degree)

    @classmethod
    def _of(cls, handle, context):
        model = cls.__new__(cls)
        model._handle, model.context = handle, context
        return model

    @classmethod
    def from_arrays(cls, position, scale, rotation, opacity, sh_dc, sh_rest=None, context=None):
        """A model of arrays; the SH degree follows from sh_rest (None: 0)."""
        count = memoryview(position).shape[0]
        width = 0 if sh_rest is None else memoryview(sh_rest).nbytes // max(
            1, count * memoryview(sh_rest).itemsize)
        degree = {0: 0, 9: 1, 24: 2, 45: 3}.get(width)
        if degree is None:
            raise UsageError(f"sh_rest: found {width} values a row, expected 9, 24 or 45")
        model = cls(count, degree, context)
        fields = dict(position=position, scale=scale, rotation=rotation, opacity=opacity,
                      sh_dc=sh_dc)
        if degree:
            fields["sh_rest"] = sh_rest
        for name, values in fields.items():
            model[name] = values
        return model

    @classmethod
    def from_points(cls, points, colors, sh_degree=3, context=None):
        """Initial Gaussians at n >= 4 points (n x 3 floats) with colours (n x 3 bytes)."""
        context, count = _context(context), _shape_rows(points, "points")
        _check_rows(colors, count, 3, "colors")
        return cls._of(_core.model_from_points(context, points, colors, count, sh_degree), context)

    @classmethod
    def load(cls, path, max_gaussians=2**32 - 1, context=None):
        """Reads .ply, compressed .ply, .splat, .spz, .ksplat or .sog, or the newest model of a
        run's folder."""
        context = _context(context)
        return cls._of(_core.model_read(context, path, max_gaussians), context)

    def save(self, path, format="auto", spz_version=None):
        """Writes .ply, .compressed.ply, .splat, .spz, .sog or .glb, by the ending or `format`.
        spz_version: of .spz alone, 2 to 4; None: 3. Replaces an existing file. The new one appears
        whole or not at all."""
        if format not in _FORMATS:
            raise UsageError(f"format: found {format!r}, expected one of {', '.join(_FORMATS)}")
        version = () if spz_version is None else (spz_version,)
        _core.model_write(self._handle, path, _FORMATS.index(format), *version)

    def __len__(self):
        return _core.model_shape(self._handle)[0]

    @property
    def sh_degree(self):
        """Degree that is stored, 0 to 3."""
        return _core.model_shape(self._handle)[1]

    @property
    def active_sh_degree(self):
        """Degree that is drawn, 0 to sh_degree. May be set."""
        return _core.model_active(self._handle)

    @active_sh_degree.setter
    def active_sh_degree(self, degree):
        _core.model_activate(self._handle, degree)

    def __getitem__(self, field):
        width = dict(_core.fields(self.sh_degree))[field]
        out = _array("f", len(self), width)
        _core.model_field(self._handle, field, out, False)
        return out

    def __setitem__(self, field, values):
        width = dict(_core.fields(self.sh_degree))[field]
        _check_rows(values, len(self), width, field)
        _core.model_field(self._handle, field, values, True)

    def arrays(self):
        """All fields, {name: n x width float32}; without sh_rest at degree 0."""
        return {name: self[name] for name, width in _core.fields(self.sh_degree) if width}

    def select(self, sh_degree=3, box=None, min_opacity=0.0):
        """A copy of the Gaussians with at least this opacity (0 to 1) and their centre in box
        ((x, y, z), (X, Y, Z)), of at most this SH degree. Raises InputError if none is left."""
        low, high = box if box is not None else ((0, 0, 0), (0, 0, 0))
        handle = _core.model_select(self._handle, sh_degree, box is not None, (*low, *high),
                                    min_opacity)
        return Model._of(handle, self.context)

    def info(self):
        """Bounds, percentiles of scale and opacity, and what is wrong, as `splatguard info`."""
        return _core.model_inspect(self._handle)

    def __repr__(self):
        return f"<Model: {len(self)} Gaussians, SH degree {self.sh_degree}>"


class Render:
    """A drawn view: color 3 x height x width, alpha and depth height x width or None, float32.

    color is not clamped. depth is the sum of weight x depth in scene units: divide by alpha for
    the mean. stats: visible Gaussians, (Gaussian, tile) instances, pairs, longest tile, bands.
    """

    __slots__ = ("color", "alpha", "depth", "stats")

    def __init__(self, color, alpha, depth, stats):
        self.color, self.alpha, self.depth, self.stats = color, alpha, depth, stats


class Renderer:
    """Draws a model, which is copied.

    background: red, green, blue from 0 to 1. engine: of engines(), or "auto". cpu: a variant of it.
    params: see options("render").
    """

    def __init__(self, model, background=(0.0, 0.0, 0.0), engine=None, cpu=None, **params):
        self.context = _expect(model, Model, "model").context
        self._shape, self._drawn = (len(model), model.sh_degree), None
        self._handle = _core.renderer_new(model._handle, engine, cpu, params, tuple(background))

    def render(self, camera, alpha=False, depth=False):
        """Draws one view; alpha and depth are made on demand. Returns a Render."""
        h, w = _expect(camera, Camera, "camera").height, camera.width
        color = _array("f", 3, h, w)
        a, d = (_array("f", h, w) if wanted else None for wanted in
                (_flag(alpha, "alpha"), _flag(depth, "depth")))
        stats = _core.render(self._handle, camera._numbers(), color, a, d)
        self._drawn = color.shape
        return Render(color, a, d, stats)

    def backward(self, gradient):
        """Gradients of a scalar L: from dL/dcolor (3 x height x width floats) of the view that
        render() drew last, since which evaluate() has not drawn any, to a Model whose fields are
        dL/d of each parameter as stored."""
        shape = memoryview(gradient).shape
        if self._drawn and len(shape) > 1 and shape[-3:] != self._drawn:
            raise UsageError(f"gradient: found an array of shape {shape}, expected {self._drawn}")
        out = Model(*self._shape, context=self.context)
        _core.render_backward(self._handle, gradient, out._handle)
        return out


def _look(scene, audit, params):
    """The audit that the defense follows, or None, and the tolerances of tolerance="auto" without
    such an audit, or None. Takes "auto" out of params."""
    automatic = params.get("tolerance") == "auto"
    if automatic:
        del params["tolerance"]
    if isinstance(audit, dict) and "defense" in audit:
        return audit, None
    if audit not in (None, "defend", "refuse"):
        raise UsageError(f"audit: found {audit!r}, expected a result of audit(scene), "
                         '"defend" or "refuse"')
    if audit is None and not automatic:
        return None, None
    found = _core.audit(scene._handle)
    if audit == "refuse" and found["verdict"] == "poisoned":
        raise PoisonedError(f"found poisoned photos (score {found['score']:.3f}), "
                            "expected clean ones")
    if audit == "defend" and found["verdict"] != "clean":
        return found, None
    return None, found["tolerances"] if automatic else None


def _defended(scene, audit, params):
    """Parameters of the defense by an audit, under those that the caller gives; and its lists of
    numbers per view."""
    try:
        names = [image["name"] for image in audit["images"]]
        found = dict(audit["defense"])
        own = {name: found.pop(name) for name in ("tolerances", "view_weights")}
    except KeyError as e:
        raise UsageError(f"audit: found no {e}, expected a result of audit(scene)") from None
    except (TypeError, ValueError):
        raise UsageError("audit: found lists or names of other types, expected a result of "
                         "audit(scene)") from None
    for k, (name, expected) in enumerate(zip(names, scene._names)):
        if name != expected:
            raise UsageError(f"audit: found {name!r} as photo {k}, expected {expected!r}")
    if len(names) != len(scene._names):
        raise UsageError(f"audit: found {len(names)} photos, expected {len(scene._names)}")
    tolerance = _number(params.get("tolerance"))
    if tolerance is not None:
        found = dict(_core.automatic(scene._handle, audit, tolerance))
        own = {name: found.pop(name) for name in own}
    given = {name.rstrip("_"): value for name, value in params.items() if value is not None}
    unused = ["rho_least"] if "rho" in given else []  # a rho of one's own comes without
    if given.get("strategy") == "mcmc":  # see Trainer
        unused = ["rho", "rho_least", "filter_frequency"]
    for name in unused:
        found.pop(name, None)
    return {**found, **given}, own


class Trainer:
    """A training, step by step.

    scene: a Scene. initial: a Model to start from, or None for the scene's points. resume: a file of
    save, from which the same scene and parameters go on to the same bytes. audit: the result of
    audit(scene), or of audit_images for the photos of scene.train by name and in order: turns the
    defense on as preset auto would, each photo by what was found in it; or
    "defend": audits first, and does that unless the photos look clean; or "refuse": raises
    PoisonedError if they look poisoned. tolerance="auto": as much of each photo as an audit finds.
    tolerances, view_weights: a list or float32 array with a number per training view. defense: True
    or "spectral" turns the spectral defense on, False or "off" (with no audit that would turn it
    on) leaves it off. params: see options("train"), and defense_preset. What has no effect beside
    the others, such as rho without a defense, is refused. iterations: how many a whole training
    has.
    """

    def __init__(self, scene, initial=None, resume=None, audit=None, tolerances=None,
                 view_weights=None, defense=None, **params):
        self.scene, self.context = _expect(scene, Scene, "scene"), scene.context
        if initial is not None and resume is not None:
            raise UsageError("initial: found with resume, which has a model, expected one of both")
        if audit not in (None, "refuse") and defense in (False, "off"):
            raise UsageError("defense: found off, expected no audit that turns it on with it")
        audited = audit == "defend"
        audit, automatic = _look(scene, audit, params)
        tolerances = automatic if tolerances is None else tolerances
        if audit is not None:
            params, own = _defended(scene, audit, params)
            if tolerances is None and params.get("tolerance") is None:
                tolerances = own["tolerances"]
            view_weights = own["view_weights"] if view_weights is None else view_weights
            defense = True if defense is None else defense
        if defense is not None:
            params["defense"] = defense
        on = defense not in (None, False, "off")
        if on and params.get("strategy") == "mcmc" and params.get("rho") is None:
            params["rho"] = 0  # MCMC moves the Gaussians that the filter would remove
        model = None if initial is None else _expect(initial, Model, "initial")._handle
        self._handle, self.iterations = _core.trainer_new(
            scene._handle, model, params, _floats(tolerances), _floats(view_weights), audited,
            resume)

    def step(self):
        """Runs one iteration. Returns a dict: iteration, view (index into scene.train), loss, l1,
        ssim, psnr (dB, before the update), gaussians, cloned, split, pruned, visible, instances,
        filtered, filter_removed. After KeyboardInterrupt or Cancelled the trainer can go on: it is
        as before, or one whole iteration further (see state)."""
        return _core.trainer_step(self._handle)

    @property
    def state(self):
        """iteration, gaussians, variant of the engine, steps, limits and which of them bind."""
        return _core.trainer_state(self._handle)

    @property
    def iteration(self):
        """Iterations so far."""
        return self.state["iteration"]

    def model(self):
        """A copy of the model so far."""
        return Model._of(_core.trainer_model(self._handle), self.context)

    def save(self, path):
        """Saves the whole state for `resume`. Replaces an existing file. The new one appears whole
        or not at all."""
        _core.trainer_save(self._handle, path)


def train(scene, callback=None, save=None, **params):
    """Trains a scene and returns the Model.

    callback: called with the dict of Trainer.step after each iteration; a true result ends the
    training early, and the model so far is returned. save: a path; where KeyboardInterrupt or any
    other exception ends the training, its state is saved there before the exception goes on, so
    that train(scene, resume=save, ...) continues. Other arguments: see Trainer.
    """
    trainer = Trainer(scene, **params)
    if trainer.iteration > trainer.iterations:
        raise UsageError(f"iterations: found {trainer.iterations}, expected at least "
                         f"{trainer.iteration}, those of the saved training")
    try:
        while trainer.iteration < trainer.iterations:
            step = trainer.step()
            if callback is not None and callback(step):
                break
    except BaseException:
        if save is not None:
            trainer.save(save)
        raise
    return trainer.model()


def evaluate(model, scene, split="test", match_colors=False, fps=False, **params):
    """PSNR (dB) and SSIM of a Model, or of a Renderer, on the views of a split, without masked
    pixels: {psnr, ssim, views: [{name, psnr, ssim}]}, and what is asked for. match_colors:
    corrected_psnr and corrected_ssim too, also of each view, after matching the colours of renders
    and photos. Renders have the appearance that params ask for, also where a test photo has one of
    its own. fps: fps too, frames per second. params: of Renderer, for a Model; its background is
    the scene's, while a Renderer has its own."""
    _expect(model, (Model, Renderer), "model"), _expect(scene, Scene, "scene")
    _flag(match_colors, "match_colors"), _flag(fps, "fps")
    if params and isinstance(model, Renderer):
        raise UsageError(f"{next(iter(params))}: found with a Renderer, which has its own, expected "
                         "a Model")
    if isinstance(model, Model):
        params.setdefault("background", (float(scene.white_background),) * 3)
    renderer = model if isinstance(model, Renderer) else Renderer(model, **params)
    if split not in ("train", "test"):
        raise UsageError(f'split: found {split!r}, expected "train" or "test"')
    result = _core.evaluate(scene._handle, renderer._handle, split == "test",
                            match_colors, fps)
    unasked = [] if fps else ["fps"]
    unasked += [] if match_colors else ["corrected_psnr", "corrected_ssim"]
    return {name: value for name, value in result.items() if name not in unasked}


def camera_path(cameras, frames=120, kind="ellipse", context=None):
    """Cameras of a flight: once around what `cameras` look at ("ellipse"; among them where they look
    one way), or from the first to the last through each ("interpolate"). They have the size and
    focal lengths of the first: camera_path([v.camera for v in scene.train])."""
    kinds = ("ellipse", "interpolate")
    if kind not in kinds:
        raise UsageError(f"kind: found {kind!r}, expected one of {kinds}")
    numbers = [_expect(camera, Camera, "cameras")._numbers() for camera in cameras]
    return [Camera._of(n) for n in
            _core.camera_path(_context(context), kinds.index(kind), numbers, frames)]


def audit(scene):
    """Looks for poison in the training photos, from their pixels alone.

    Returns {verdict, score, tau, tau_error, reasons, images, defense, tolerances}. verdict: "clean",
    "suspicious" or "poisoned"; score: 0 to 1; tau: the poison's estimated amplitude in grey levels;
    reasons: sentences; images: a list of {name, verdict, score, tau, tau_error, features} in the
    order of scene.train, of which the verdict can also be "unseen", with score 0, where a mask
    leaves no pixel; defense: for Trainer(audit=...); tolerances: those of tolerance="auto", a
    list of floats, one per training view. All of it can be written as JSON, and read back for
    Trainer(audit=...).
    """
    return _core.audit(_expect(scene, Scene, "scene")._handle)


def audit_images(images, masks=None, names=None, context=None):
    """Audits arrays of height x width x 3 bytes, which need no cameras: what a service does with
    an upload before it touches a disk. images: an iterable. Returns the same as audit."""
    end = object()

    def views():
        numbered = map("image_{:06d}".format, _itertools.count())
        names_left = iter(names) if names is not None else numbered
        masks_left = iter(masks) if masks is not None else _itertools.repeat(None)
        for k, image in enumerate(images):
            h, w = _shape(image, f"image {k}", 3)
            name, mask = next(names_left, end), next(masks_left, end)
            if name is end or mask is end:
                raise UsageError(f"{'names' if name is end else 'masks'}: found {k}, expected one "
                                 "for each image")
            # Any pose will do: an audit reads pixels alone.
            yield View(name, Camera(w, h, w, t=(k, 0, 0)), image, mask, "train")
        # Iterators may be without end.
        for what, given, left in (("names", names, names_left), ("masks", masks, masks_left)):
            if hasattr(given, "__len__") and next(left, end) is not end:
                raise UsageError(f"{what}: found {len(given)}, expected one for each image")

    return audit(Scene.build(views(), context=context))


class Attack:
    """Poison-splat on the training views of a scene, step by step, for measurements.

    proxy: a Model trained on the scene. preset: "auto", "ns", "mip", "tt", or "" for none. params:
    see options("attack"); they have precedence over the preset. iterations: how many steps it has.
    """

    def __init__(self, scene, proxy, preset="auto", **params):
        self.scene, self.context = _expect(scene, Scene, "scene"), scene.context
        _expect(proxy, Model, "proxy")
        self._handle, self.iterations = _core.attack_new(scene._handle, proxy._handle, params,
                                                         preset)

    def step(self):
        """Visits one view. Returns a dict: iteration, view, loss, l1, ssim, psnr, tv, gaussians."""
        return _core.attack_step(self._handle)

    def poison(self, view):
        """The poisoned photo of a training view (its index): height x width x 3 bytes."""
        values, height, width = _core.attack_poison(self._handle, view)
        return memoryview(values).cast("B", (height, width, 3))


def attack(scene, proxy, callback=None, **params):
    """Runs an attack and returns the poisoned photos, {name: height x width x 3 bytes}. callback:
    called with the dict of each step; a true result ends it early. Other arguments: see Attack."""
    work = Attack(scene, proxy, **params)
    for _ in range(work.iterations):
        step = work.step()
        if callback is not None and callback(step):
            break
    return {view.name: work.poison(k) for k, view in enumerate(scene.train)}


def defense_preset(name):
    """The published parameters of the defense for "ns", "tt" or "mip": rho, rho_least,
    filter_frequency, lambda. Use: Trainer(scene, defense=True, **defense_preset("mip"))."""
    return _core.defense_preset(name)


def options(what="train"):
    """The parameters of "train", "attack", "scene" or "render": a list of {name, group, help,
    choices, low, high, expert}."""
    return _core.options(what)


def engines():
    """Engines and CPU variants of this build: {engine, cpu, description, available, chosen}."""
    return _core.engines()
