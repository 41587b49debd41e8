# SPDX-License-Identifier: Apache-2.0
import ast
import gc
import gzip
import itertools
import json
import math
import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
import time
import types
import weakref

import numpy as np
import pytest

import splatguard as sg
import tour

SIDE = 40
SHORT = dict(iterations=30, init_points=150, sh_degree=1, sh_interval=5, densify_from_iter=4,
             densification_interval=5, densify_until_iter=25)


def camera(angle, side=SIDE):
    s, c = math.sin(angle), math.cos(angle)
    return sg.Camera(side, side, side, R=((c, 0, s), (0, 1, 0), (-s, 0, c)), t=(0, 0, 4))


def photo(k, side=SIDE):
    y, x = np.mgrid[0:side, 0:side]
    return np.stack([100 + 2 * x, 90 + 3 * y, 60 + 5 * (x + y + 7 * k) % 90], -1).astype(np.uint8)


def scene_of(views=6, context=None, **params):
    return sg.Scene.build((sg.View(f"view_{k}", camera(k), photo(k)) for k in range(views)),
                          context=context, **params)


def model_of(n=30, degree=1, seed=1, context=None):
    r = np.random.default_rng(seed)
    f = lambda *s: r.normal(size=s).astype(np.float32)
    rest = {0: 0, 1: 9, 2: 24, 3: 45}[degree]
    return sg.Model.from_arrays(f(n, 3) * 0.5, -1.5 + 0.2 * f(n, 3), f(n, 4), f(n, 1), f(n, 3),
                                0.1 * f(n, rest) if rest else None, context=context)


# ---- arrays ----

@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_model_arrays_are_bit_exact(degree):
    model = model_of(37, degree)
    for name, values in model.arrays().items():
        bits = np.random.default_rng(3).integers(0, 2**32, values.shape, np.uint32)
        model[name] = bits.view(np.float32)  # NaNs with payloads too
        assert np.array_equal(np.asarray(model[name]).view(np.uint32), bits)
    assert len(model.arrays()) == (6 if degree else 5)


def test_results_share_memory_with_numpy():
    out = model_of()["position"]
    array = np.asarray(out)
    array[0, 0] = 7
    assert out[0, 0] == 7 and array.dtype == np.float32 and array.shape == (30, 3)


def test_arrays_with_gaps_and_doubles_are_taken():
    model = sg.Model(5, 0)
    wide = np.arange(40, dtype=np.float64).reshape(5, 8)
    model["position"] = wide[:, 2:5]
    assert np.array_equal(model["position"], wide[:, 2:5].astype(np.float32))
    flipped = photo(1)[::-1]
    scene = sg.Scene.build([sg.View("a", camera(0), flipped)])
    assert np.array_equal(scene.train[0].image, flipped)


def test_wrong_arrays_are_refused():
    model = sg.Model(5, 0)
    for wrong in (np.zeros((5, 4), np.float32), np.zeros((5, 3), np.int32), np.zeros(14, np.float32)):
        with pytest.raises(ValueError, match="position: found .* expected 15"):
            model["position"] = wrong
    with pytest.raises(ValueError, match="position: found 15 values of type 'e', expected 15 of"):
        model["position"] = np.zeros((5, 3), np.float16)
    flat = np.arange(15, dtype=np.float32)
    with pytest.raises(sg.UsageError, match=r"position: found an array of shape \(3, 5\)"):
        model["position"] = flat.reshape(3, 5)
    model["position"] = flat
    assert np.array_equal(model["position"], flat.reshape(5, 3))
    with pytest.raises(sg.UsageError, match=r"colors: found an array of shape \(3, 5\)"):
        sg.Model.from_points(np.zeros((5, 3)), np.zeros((3, 5), np.uint8))
    for access in (lambda: model["colour"], lambda: model.__setitem__("colour", flat)):
        with pytest.raises(KeyError):
            access()
    with pytest.raises(sg.UsageError, match="found an image of"):
        sg.Scene.build([sg.View("a", camera(0), photo(0, 20))])
    with pytest.raises(TypeError):
        model["position"] = [1.0] * 15
    with pytest.raises(TypeError):
        type(model._handle)()


# ---- scenes ----

def test_scene_has_what_was_put_in():
    mask = (np.arange(SIDE * SIDE).reshape(SIDE, SIDE) % 3 > 0).astype(np.uint8) * 255
    points = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
    colors = np.arange(60, dtype=np.uint8).reshape(20, 3)
    scene = sg.Scene.build([sg.View("a", camera(0), photo(0), mask),
                            sg.View("b", camera(1), photo(1), split="test", lossless=True),
                            sg.View("c", camera(2), lambda: photo(2))], points, colors)
    assert [v.name for v in scene.train] == ["a", "c"] and [v.name for v in scene.test] == ["b"]
    assert np.array_equal(scene.train[0].mask, mask) and scene.train[1].mask is None
    assert np.array_equal(scene.train[1].image, photo(2))
    assert scene.test[0].lossless and not scene.train[0].lossless
    assert scene.test[0].camera.R == camera(1).R and scene.test[0].camera.t == (0, 0, 4)
    xyz, rgb = scene.points()
    assert np.array_equal(xyz, points) and np.array_equal(rgb, colors)


def test_views_of_a_scene_make_another():
    mask = np.zeros((SIDE, SIDE), np.uint8)
    mask[5:, :20] = 255
    scene = sg.Scene.build([sg.View("a", camera(0), photo(0), mask=mask, lossless=True),
                            sg.View("b", camera(1), photo(1), split="test"),
                            sg.View("c", camera(2), lambda: photo(2))])
    part = sg.Scene.build([scene.train[0], *scene.test])
    assert [v.name for v in part.train + part.test] == ["a", "b"]
    assert np.array_equal(part.train[0].image, photo(0)) and part.train[0].lossless
    assert np.array_equal(part.train[0].mask, mask) and part.test[0].mask is None
    # Of another context, which has no photo of the first.
    other = sg.Scene.build(scene.train, context=sg.Context(threads=1))
    assert np.array_equal(other.train[1].image, photo(2))


def test_lazy_photos_train_the_same_model():
    context, reads = sg.Context(threads=2), []

    def lazy(k):
        def read():
            reads.append(k)
            return photo(k)
        return read

    scene = sg.Scene.build((sg.View(f"view_{k}", camera(k), lazy(k)) for k in range(6)),
                           context=context, keep_photos=1)
    ours = sg.train(scene, **SHORT).arrays()
    assert len(reads) > 20  # read again when they were needed
    theirs = sg.train(scene_of(context=context), **SHORT).arrays()
    for name in theirs:
        assert np.array_equal(ours[name], theirs[name])


def test_errors_of_photos_and_generators_arrive():
    def broken():
        raise OSError("no such photo")

    with pytest.raises(OSError, match="no such photo"):
        sg.Scene.build([sg.View("a", camera(0), broken)])

    def views():
        yield sg.View("a", camera(0), photo(0))
        raise LookupError("the generator")

    with pytest.raises(LookupError, match="the generator"):
        sg.Scene.build(views())


# ---- training ----

def test_train_with_callback_and_resume(tmp_path):
    scene, steps = scene_of(), []
    whole = sg.train(scene, callback=steps.append, **SHORT)
    assert [s["iteration"] for s in steps] == list(range(1, 31))
    assert all(math.isfinite(s["loss"]) for s in steps)

    def interrupt(step):
        if step["iteration"] == 12:
            raise KeyboardInterrupt

    saved = tmp_path / "state.bin"
    with pytest.raises(KeyboardInterrupt):
        sg.train(scene, callback=interrupt, save=saved, **SHORT)
    resumed = sg.train(scene, resume=saved, **SHORT)
    for name, values in whole.arrays().items():
        assert np.array_equal(resumed[name], values)
    with pytest.raises(sg.InputError, match=r"state.bin: seed: found 42, expected 9, that of this run$"):
        sg.train(scene, resume=saved, seed=9, **SHORT)
    assert len(sg.train(scene, callback=lambda step: step["iteration"] == 3, **SHORT)) == 150
    steps.clear()
    sg.train(scene, callback=steps.append, **{**SHORT, "iterations": None, "iterations_": 5})
    assert [step["iteration"] for step in steps] == [1, 2, 3, 4, 5]
    assert sg.Trainer(scene).iterations == 30000


def test_progress_cancels_and_reports():
    seen = []
    context = sg.Context(threads=1, progress=lambda *a: seen.append(a) or len(seen) > 40)
    with pytest.raises(sg.Cancelled):
        sg.train(scene_of(context=context), **{**SHORT, "iterations": 1000})
    assert "train" in {stage for stage, _, _ in seen}


def test_signal_interrupts_and_saves(tmp_path):
    # A shell that runs the tests in the background has told them to ignore SIGINT.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    scene, saved = scene_of(), tmp_path / "state.bin"
    timer = threading.Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT))

    def begin(_step):
        if timer.ident is None:
            timer.start()

    with pytest.raises(KeyboardInterrupt):
        sg.train(scene, save=saved, callback=begin, **{**SHORT, "iterations": 10_000_000})
    timer.join()
    assert saved.stat().st_size > 1000


def test_gil_is_free_and_contexts_are_independent():
    counts, stop = [0], threading.Event()

    def count():
        while not stop.is_set():
            counts[0] += 1
            time.sleep(0)

    context = sg.Context(threads=1)
    renderer = sg.Renderer(model_of(3000, 3, context=context))
    thread = threading.Thread(target=count)
    thread.start()
    before = counts[0]
    renderer.render(camera(0, 2000))
    assert counts[0] > before + 5
    stop.set()
    thread.join()
    models = []
    threads = [threading.Thread(target=lambda: models.append(sg.train(scene_of(
        context=sg.Context(threads=1)), **SHORT))) for _ in range(3)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(models) == 3
    for name, values in models[0].arrays().items():
        assert np.array_equal(models[1][name], values) and np.array_equal(models[2][name], values)


def test_objects_end_while_a_call_has_their_context():
    context = sg.Context(threads=2)
    mine, others = [model_of(300, context=context)], [model_of(300, context=context)]
    entered, gone, seen = threading.Event(), threading.Event(), []
    armed = False

    def image():
        if armed:  # on any thread of the context, while the call waits for it
            mine.clear()
            entered.set()
            seen.append(gone.wait(60))
        return np.zeros((64, 64, 3), np.uint8)

    scene = sg.Scene.build([sg.View(f"{k}", sg.Camera(64, 64, 64), image) for k in range(20)],
                           context=context, keep_photos=1)
    armed = True
    thread = threading.Thread(target=sg.audit, args=(scene,), daemon=True)
    thread.start()
    assert entered.wait(60)
    others.clear()  # does not wait for the call
    gone.set()
    thread.join(60)
    assert not thread.is_alive() and seen and all(seen)
    assert context.memory()["model"][0] == 0


def test_cycles_through_callbacks_end():
    # A service's object that has a context or a scene, which call methods of it.
    class Service:
        def __init__(self):
            self.context = sg.Context(threads=2, progress=self.progress, log=self.log)
            self.scene = sg.Scene.build(
                (sg.View(f"view_{k}", camera(k), lambda k=k: self.photo(k)) for k in range(3)),
                context=self.context, keep_photos=1)
            self.trainer = sg.Trainer(self.scene, tolerances=[1.0] * 3, **SHORT)
            self.trainer.step()

        def progress(self, stage, done, total):
            return False

        def log(self, level, message):
            pass

        def photo(self, k):
            return photo(k)

    def threads():
        return len(os.listdir("/proc/self/task"))

    gc.collect()
    before = threads()
    ended = [weakref.ref(Service()) for _ in range(3)]
    assert threads() > before
    gc.collect()
    assert not any(service() for service in ended)
    assert threads() == before


def test_the_process_ends_while_a_daemon_is_in_a_call():
    program = """
import threading, time
import splatguard as sg
context = sg.Context(threads=1)
model = sg.Model(5, 0, context=context)
entered = threading.Event()
def image():
    entered.set()
    time.sleep(0.2)
    return memoryview(bytes(48)).cast("B", (4, 4, 3))
views = [sg.View(str(k), sg.Camera(4, 4, 4), image) for k in range(50)]
threading.Thread(target=sg.Scene.build, args=(views,), kwargs={"context": context},
                 daemon=True).start()
entered.wait()
"""
    assert subprocess.run([sys.executable, "-c", program], timeout=120).returncode == 0


def test_a_callback_must_not_call_its_own_context():
    seen, trainers = [[] for _ in range(4)], []

    def progress(*_):
        calls = (model.info, lambda: model.active_sh_degree,
                 lambda: setattr(model, "active_sh_degree", 0),
                 lambda: [trainer.state for trainer in trainers])
        for call, errors in zip(calls, seen):
            try:
                call()
            except RuntimeError as error:
                errors.append(str(error))

    context = sg.Context(progress=progress)
    model = model_of(context=context)
    trainers.append(sg.Trainer(scene_of(context=context), **SHORT))
    for _ in range(2):
        trainers[0].step()
    for errors in seen:
        assert errors and all("own callback" in error for error in errors)
    assert trainers[0].state["iteration"] == trainers[0].iteration == 2


# ---- rendering ----

def test_gradients_are_those_of_finite_differences():
    model = model_of(6, 2, seed=4)
    model["scale"] = np.full((6, 3), -0.7, np.float32) + np.float32([0, 0.1, 0.2])
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    weight = np.stack([np.cos(x / 9), np.sin(y / 8), np.cos((x + y) / 11)]).astype(np.float32)

    def loss():
        drawn = sg.Renderer(model, background=(0.2, 0.5, 0.1)).render(camera(0.3))
        return float((np.asarray(drawn.color).astype(np.float64) * weight).sum())

    renderer = sg.Renderer(model, background=(0.2, 0.5, 0.1))
    with pytest.raises(ValueError, match="no view"):
        renderer.backward(np.zeros(0, np.float32))
    renderer.render(camera(0.3))
    with pytest.raises(sg.UsageError, match=r"gradient: found an array of shape \(40, 40, 3\)"):
        renderer.backward(weight.transpose(1, 2, 0))
    gradients = renderer.backward(weight)
    for name, values in model.arrays().items():
        values, found = np.array(values), np.asarray(gradients[name])
        expected = np.zeros_like(found)
        for index in np.ndindex(values.shape):
            kept = values[index]
            values[index] = kept + 4e-3
            model[name] = values
            above = loss()
            values[index] = kept - 4e-3
            model[name] = values
            below = loss()
            values[index] = kept
            model[name] = values
            expected[index] = (above - below) / 8e-3
        # Not value by value: a step lets pixels cross the opacity from which they are drawn.
        error = np.linalg.norm(found - expected) / np.linalg.norm(expected)
        assert error < 0.1, name


class NumpyTorch:
    """What the example of docs/python.md uses of torch, so that it is tested where that is absent."""
    float32 = np.float32

    class Tensor(np.ndarray):
        detach = contiguous = lambda self: self
        numpy = lambda self: np.asarray(self)

    class autograd:
        class Function:
            @classmethod
            def apply(cls, *inputs):
                cls.ctx = types.SimpleNamespace()
                return cls.forward(cls.ctx, *inputs)

    @classmethod
    def from_numpy(cls, array):
        return array.view(cls.Tensor)

    @classmethod
    def frombuffer(cls, buffer, dtype):
        return cls.from_numpy(np.frombuffer(buffer, dtype))


@pytest.mark.parametrize("name", ["torch", "numpy"])
def test_torch_example(name):
    torch = pytest.importorskip("torch") if name == "torch" else NumpyTorch
    with open(os.path.join(tour.ROOT, "docs", "python.md"), encoding="utf-8") as f:
        code = re.search(r"```python\n(class Rasterise.*?)```", f.read(), re.S)[1]
    names = {"torch": torch, "numpy": np, "sg": sg}
    exec(code, names)
    rasterise = names["Rasterise"]
    fields = ("position", "scale", "rotation", "opacity", "sh_dc", "sh_rest")
    model = model_of(6, 2, seed=4)
    model["scale"] = np.full((6, 3), -0.7, np.float32) + np.float32([0, 0.1, 0.2])
    values = [np.array(model[f]) for f in fields]
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    weight = np.stack([np.cos(x / 9), np.sin(y / 8), np.cos((x + y) / 11)]).astype(np.float32)

    def loss(arrays):
        drawn = rasterise.apply(camera(0.3), *(torch.from_numpy(a) for a in arrays))
        return float((np.asarray(drawn).astype(np.float64) * weight).sum())

    inputs = [torch.from_numpy(v.copy()) for v in values]
    if name == "torch":
        for tensor in inputs:
            tensor.requires_grad_()
        (rasterise.apply(camera(0.3), *inputs) * torch.from_numpy(weight)).sum().backward()
        gradients = [tensor.grad.numpy() for tensor in inputs]
    else:
        rasterise.apply(camera(0.3), *inputs)
        gradients = rasterise.backward(rasterise.ctx, torch.from_numpy(weight))
        assert gradients[0] is None  # the camera
        gradients = gradients[1:]
    for k, gradient in enumerate(gradients):  # along the gradient itself
        along = np.asarray(gradient) / np.linalg.norm(gradient)
        moved = [[v + side * 4e-3 * along if i == k else v for i, v in enumerate(values)]
                 for side in (1, -1)]
        found = (loss(moved[0]) - loss(moved[1])) / 8e-3
        assert found == pytest.approx(np.linalg.norm(gradient), rel=0.03), fields[k]


def test_render_alpha_and_depth():
    model = model_of(500)
    drawn = sg.Renderer(model).render(camera(0), alpha=True, depth=True)
    alpha, depth = np.asarray(drawn.alpha), np.asarray(drawn.depth)
    assert drawn.color.shape == (3, SIDE, SIDE) and alpha.max() > 0.9
    inside = alpha > 0.5
    assert 2 < np.median(depth[inside] / alpha[inside]) < 6
    plain = sg.Renderer(model, engine="ref").render(camera(0))
    assert plain.alpha is None
    assert np.abs(np.asarray(plain.color) - np.asarray(drawn.color)).max() < 1e-3
    with pytest.raises(sg.UsageError, match="R that is off a rotation by 1 .determinant 0"):
        sg.Renderer(model).render(sg.Camera(10, 10, 5, R=np.zeros((3, 3))))
    with pytest.raises(sg.UsageError, match="camera: found an image of 20000 x 10 pixels, expected sides of 1 to 16384"):
        sg.Renderer(model).render(sg.Camera(20000, 10, 5))
    model["opacity"] = np.full((500, 1), np.nan, np.float32)
    with pytest.raises(sg.InputError, match="opacity"):
        sg.Renderer(model)


def test_evaluate():
    scene = scene_of(views=6, eval=True, test_every=3)
    model = sg.train(scene, **SHORT)
    scores = sg.evaluate(model, scene, match_colors=True)
    assert [v["name"] for v in scores["views"]] == ["view_0", "view_3"]
    drawn = np.asarray(sg.Renderer(model).render(scene.test[0].camera).color).transpose(1, 2, 0)
    rounded = np.floor(np.clip(drawn, 0, 1) * 255 + 0.5)
    mse = np.mean((rounded - np.asarray(scene.test[0].image).astype(np.float64)) ** 2)
    assert abs(10 * math.log10(255**2 / mse) - scores["views"][0]["psnr"]) < 0.05
    names = {"psnr", "ssim", "corrected_psnr", "corrected_ssim"}
    for name in names:
        assert abs(np.mean([v[name] for v in scores["views"]]) - scores[name]) < 1e-9
    assert all(v["corrected_psnr"] != v["psnr"] for v in scores["views"])
    assert set(scores) == names | {"views"} and set(scores["views"][0]) == names | {"name"}
    plain = sg.evaluate(model, scene)
    assert set(plain) == {"psnr", "ssim", "views"}
    assert set(plain["views"][0]) == {"name", "psnr", "ssim"}


@pytest.mark.parametrize("white", [False, True])
def test_background_is_that_of_the_scene(white):
    """What is hardly there shows the background: white photos fit a white one."""
    photos = np.full((SIDE, SIDE, 3), 255, np.uint8)
    scene = sg.Scene.build([sg.View(f"v{k}", camera(k), photos) for k in range(3)],
                           white_background=white)
    model = model_of()
    model["opacity"] = np.full((30, 1), -12, np.float32)
    found = sg.evaluate(model, scene, split="train")["psnr"]
    loss = sg.Trainer(scene, initial=model, iterations=1).step()["l1"]
    assert scene.white_background is white
    assert (found > 60 and loss < 0.01) if white else (found < 1 and loss > 0.9)
    assert sg.evaluate(model, scene, split="train", background=(1, 1, 1))["psnr"] > 60


def test_mcmc_with_a_defense():
    scene = scene_of()
    found = json.loads(json.dumps(sg.audit(scene)))
    for params in (dict(audit=found), dict(defense=True)):
        assert len(sg.train(scene, strategy="mcmc", cap_max=200, **SHORT, **params))


def test_lazy_photos_have_the_shape_of_their_camera():
    c = sg.Camera(32, 24, 30)
    image = np.zeros((24, 32, 3), np.uint8)
    for axes in ((1, 0, 2), (2, 0, 1)):
        wrong = np.ascontiguousarray(image.transpose(axes))
        with pytest.raises(sg.UsageError, match="^a: found an (image|array) of"):
            sg.Scene.build([sg.View("a", c, lambda: wrong)])
    assert len(sg.Scene.build([sg.View("a", c, lambda: image)]).train) == 1


def test_scenes_from_memory_refuse_what_is_for_files():
    views = [sg.View("a", camera(0), photo(0))]
    for params in (dict(smooth="bilateral"), dict(downscale=2), dict(strict=True)):
        with pytest.raises(sg.UsageError, match="^" + next(iter(params)) + ": found with views"):
            sg.Scene.build(views, **params)
    with pytest.raises(sg.UsageError, match="^colors: found without points"):
        sg.Scene.build(views, colors=np.zeros((1, 3), np.uint8))
    with pytest.raises(TypeError):
        sg.Scene.build(views, nothing=1)


def test_signal_inside_a_log_function_interrupts():
    def log(level, message):
        signal.raise_signal(signal.SIGINT)

    context = sg.Context(log=log, log_level=2)
    with pytest.raises(KeyboardInterrupt):
        sg.train(scene_of(context=context), **SHORT)


def test_texts_with_zero_bytes_are_refused(tmp_path):
    with pytest.raises(sg.UsageError, match="^iterations: found"):
        sg.train(scene_of(), iterations="3\0abc")
    with pytest.raises(TypeError):
        sg.train(scene_of(), **{"iterations\0abc": 3})


def test_camera_path():
    around = [camera(2 * math.pi * k / 12) for k in range(12)]
    frames = sg.camera_path(around, 30)
    assert len(frames) == 30 and frames[0].width == SIDE and frames[7].fx == SIDE
    for f in frames:
        R, t = np.array(f.R), np.array(f.t)
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-9
        assert np.abs(R @ np.zeros(3) + t - (0, 0, np.linalg.norm(t))).max() < 1e-6
    between = sg.camera_path((c for c in around), 23, "interpolate")
    assert np.abs(np.array(between[4].R) - np.array(around[2].R)).max() < 1e-9
    model = model_of(50)
    assert np.asarray(sg.Renderer(model).render(frames[3]).color).shape == (3, SIDE, SIDE)
    for wrong, error in ((dict(kind="spiral"), "spiral"), (dict(frames=0), "0 frames"),
                         (dict(frames=-1), "0 frames"), (dict(cameras=[]), "0 cameras")):
        with pytest.raises(sg.UsageError, match=error):
            sg.camera_path(**{**dict(cameras=around), **wrong})
    with pytest.raises(sg.InputError, match="one place"):
        sg.camera_path(around[:1])


def test_names_of_photos_need_not_be_utf8(tmp_path):
    model = tmp_path / "sparse" / "0"
    model.mkdir(parents=True)
    (tmp_path / "images").mkdir()
    (model / "cameras.txt").write_text(f"1 PINHOLE {SIDE} {SIDE} 60 60 20 20\n")
    (model / "points3D.txt").write_text("1 0 0 4 90 90 90 0.5\n")
    names = [b"caf\xe9.png", b"plain.png"]
    (model / "images.txt").write_bytes(b"".join(
        b"%d 1 0 0 0 %d 0 0 1 %s\n\n" % (k + 1, k, name) for k, name in enumerate(names)))
    for k, name in enumerate(names):
        with open(os.path.join(os.fsencode(tmp_path / "images"), name), "wb") as f:
            f.write(tour.png(photo(k)))
    scene = sg.Scene.load(tmp_path, eval=True, test_every=2)
    scores = sg.evaluate(model_of(context=scene.context), scene)
    assert [v["name"] for v in scores["views"]] == [v.name for v in scene.test]
    assert os.fsdecode(names[0])[:-4] in [v["name"] for v in scores["views"]]
    again = sg.Scene.build(scene.train + scene.test, untrained=True)
    assert sorted(v.name for v in again.train + again.test) == sorted(
        os.fsdecode(name)[:-4] for name in names)
    with pytest.raises(ValueError, match="null byte"):
        sg.Scene.build([sg.View("a\0b", camera(0), photo(0))])


def test_names_of_folders_need_not_be_utf8(tmp_path):
    names = dict(colmap=b"sparse/caf\xe9", images=b"images\xff", masks=b"masks\xe9")
    for name in names.values():
        os.makedirs(os.path.join(os.fsencode(tmp_path), name))
    files = {
        ("colmap", b"cameras.txt"): b"1 PINHOLE %d %d 60 60 20 20\n" % (SIDE, SIDE),
        ("colmap", b"points3D.txt"): b"1 0 0 4 90 90 90 0.5\n",
        ("colmap", b"images.txt"): b"1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n",
        ("images", b"a.png"): tour.png(photo(0)), ("images", b"b.png"): tour.png(photo(1)),
        ("masks", b"a.png"): tour.png(np.zeros((SIDE, SIDE, 3), np.uint8))}
    for (folder, name), content in files.items():
        with open(os.path.join(os.fsencode(tmp_path), names[folder], name), "wb") as f:
            f.write(content)
    for kind in (bytes, os.fsdecode, lambda name: pathlib.Path(os.fsdecode(name))):
        scene = sg.Scene.load(tmp_path, **{key: kind(name) for key, name in names.items()})
        assert [view.mask is not None for view in scene.train] == [True, False]
    with pytest.raises(sg.InputError, match="masks.: found no such folder"):
        sg.Scene.load(tmp_path, **{**names, "masks": b"masks\xfe"})
    with pytest.raises(sg.UsageError, match="images: found b'a.x00b', expected no zero byte"):
        sg.Scene.load(tmp_path, images=b"a\0b")


# ---- attack and defense ----

def test_defense_alone_is_the_preset_ns():
    kinds = ({"defense": True}, {"defense": "spectral"}, {"defense": True, **sg.defense_preset("ns")}, {})
    known, named, preset, none = (
        bytes(sg.train(scene_of(), filter_interval=5, **SHORT, **kind)["position"]) if kind else
        bytes(sg.train(scene_of(), **SHORT)["position"]) for kind in kinds)
    assert known == named == preset != none


def test_the_default_context_is_one(monkeypatch):
    def slow():
        time.sleep(0.02)
        return object()

    monkeypatch.setattr(sg, "_default", None)
    monkeypatch.setattr(sg, "Context", slow)
    barrier, found = threading.Barrier(8), []

    def ask():
        barrier.wait()
        found.append(sg._context(None))

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(set(map(id, found))) == 1


def test_photos_alone(tmp_path):
    for k in range(3):
        (tmp_path / f"{k}.png").write_bytes(tour.png(photo(k)))
    with pytest.raises(sg.InputError, match="found no scene"):
        sg.Scene.load(tmp_path)
    scene = sg.Scene.load(tmp_path, photos_alone=True)
    assert scene.format == "photos" and [v.name for v in scene.train] == ["0.png", "1.png", "2.png"]
    assert len(sg.audit(scene)["images"]) == 3
    with pytest.raises(sg.InputError, match="found photos without cameras"):
        sg.train(scene, **SHORT)


def test_audit_of_100_arrays_without_a_file(monkeypatch):
    y, x = np.mgrid[0:96, 0:96]
    r = np.random.default_rng(0)

    def clean(k):
        rgb = np.stack([128 + 60 * np.sin((x + 9 * k) / 23), 128 + 60 * np.cos((y - k) / 19),
                        100 + (x + y) / 3], -1)
        return np.clip(rgb, 0, 255).astype(np.uint8)

    def poisoned(k):
        return np.clip(clean(k) + 16 * np.sign(r.normal(size=(96, 96, 3))), 0, 255).astype(np.uint8)

    def refuse(*_args, **_kw):
        raise AssertionError("a file was opened")

    monkeypatch.setattr("builtins.open", refuse)
    bad = sg.audit_images(poisoned(k) for k in range(100))
    good = sg.audit_images((clean(k) for k in range(100)), names=(f"n{k:03}" for k in range(100)))
    assert bad["verdict"] == "poisoned" and len(bad["images"]) == 100 and bad["reasons"]
    assert good["verdict"] == "clean" and good["images"][7]["name"] == "n007"
    assert bad["score"] > good["score"]


def test_audited_images_have_names_and_masks_each():
    image = np.zeros((16, 16, 3), "u1")
    with pytest.raises(sg.UsageError, match="names: found 1, expected one for each image"):
        sg.audit_images([image, image], names=["a"])
    with pytest.raises(sg.UsageError, match="masks: found 1, expected one for each image"):
        sg.audit_images([image, image], masks=iter([None]))
    with pytest.raises(sg.UsageError, match="names: found 2, expected one for each image"):
        sg.audit_images([image], names=["a", "b"])
    with pytest.raises(sg.UsageError, match="masks: found 3, expected one for each image"):
        sg.audit_images(iter([image, image]), masks=[None] * 3)
    assert len(sg.audit_images([image + np.arange(16, dtype="u1")[:, None, None]], names=map(str, itertools.count()),
                               masks=itertools.repeat(None))["images"]) == 1


def test_every_wrong_argument_is_a_usage_error():
    scene = scene_of()
    for call in (lambda: sg.defense_preset("x"), lambda: sg.options("x"), lambda: sg.Model(-1),
                 lambda: sg.Trainer(scene, audit={})):
        with pytest.raises(sg.UsageError):
            call()


def test_floats_of_other_classes():
    scene = scene_of()

    class Odd(float):
        def __repr__(self):
            return f"odd({float(self)})"

    sg.Trainer(scene, lambda_dssim=Odd(0.25))
    sg.Trainer(scene, lambda_dssim=np.float64(0.25))


def test_training_does_not_end_before_it_began(tmp_path):
    scene = scene_of()
    trainer = sg.Trainer(scene, iterations=20)
    for _ in range(5):
        trainer.step()
    trainer.save(tmp_path / "state")
    with pytest.raises(sg.UsageError, match="iterations"):
        sg.train(scene, resume=tmp_path / "state", iterations=3)


@pytest.mark.parametrize("noise", [0, 16])
def test_what_an_audit_decides(noise):
    y, x = np.mgrid[0:96, 0:96]
    r = np.random.default_rng(1)

    def views():
        for k in range(4):
            rgb = np.stack([128 + 60 * np.sin((x + 9 * k) / 23), 128 + 60 * np.cos((y - k) / 19),
                            100 + (x + y) / 3], -1) + noise * np.sign(r.normal(size=(96, 96, 3)))
            yield sg.View(f"p{k}", camera(k, 96), np.clip(rgb, 0, 255).astype(np.uint8))

    scene = sg.Scene.build(views())
    few = dict(iterations=2, init_points=50)
    if noise:
        with pytest.raises(sg.PoisonedError):
            sg.train(scene, audit="refuse", **few)
    else:
        assert len(sg.train(scene, audit="refuse", **few)) > 0
    plain, defended, tolerant = (bytes(np.asarray(sg.train(scene, **few, **how)["position"]).tobytes())
                                 for how in ({}, {"audit": "defend"}, {"tolerance": "auto"}))
    assert (plain == defended) == (plain == tolerant) == (not noise)

    found = sg.audit(scene)
    for numbers in found["tolerances"], found["defense"]["tolerances"], found["defense"]["view_weights"]:
        assert len(numbers) == 4 and all(isinstance(x, float) for x in numbers)
    assert any(found["tolerances"]) == bool(noise)
    again = json.loads(json.dumps(found))
    assert again == found
    for how in (dict(audit=again), dict(audit=found, view_weights=found["defense"]["view_weights"]),
                dict(audit=found, tolerances=np.float32(found["defense"]["tolerances"])),
                dict(audit=found, lambda_=None, rho=None, tolerance=None)):  # as if not given
        model = sg.train(scene, **few, **how)
        assert bytes(model["position"]) == bytes(sg.train(scene, audit=found, **few)["position"])
    # A tolerance that does not cover what was found leaves the photos to the regulariser.
    both = [bytes(sg.train(scene, audit=again, tolerance=t, lambda_=weight, **few)["position"])
            for t in (0, 2, 40) for weight in (1, 6)]
    assert [both[k] == both[k + 1] for k in (0, 2, 4)] == ([False, False, True] if noise else [True] * 3)
    # An audit of other photos, or one that is not whole.
    broken = json.loads(json.dumps(found))
    del broken["images"][1]["features"]["slope"]
    text = json.loads(json.dumps(found))
    text["images"][1]["score"] = "high"
    for wrong, match in (({**found, "images": found["images"][::-1]}, "audit: found 'p3' as photo 0, expected 'p0'"),
                         ({**found, "images": found["images"][:3]}, "audit: found 3 photos, expected 4"),
                         ({**found, "images": found["images"] * 2}, "audit: found 8 photos, expected 4"),
                         ({"defense": found["defense"]}, "audit: found no 'images', expected"),
                         ({**found, "images": 5}, "audit: found lists or names of other types"),
                         ({**found, "defense": "abc"}, "audit: found lists or names of other types"),
                         ({**found, "defense": {}}, "audit: found no 'tolerances', expected")):
        with pytest.raises(sg.UsageError, match=match):
            sg.train(scene, audit=wrong, **few)
    for wrong, match in (broken, "audit: found no slope, expected"), (text, "audit: found 'high' as score, expected"):
        with pytest.raises(sg.UsageError, match=match):
            sg.train(scene, audit=wrong, tolerance=4, **few)
    named = sg.audit_images((v.image for v in views()), names=[v.name for v in scene.train])
    assert len(sg.train(scene, audit=named, **few)) > 0
    for wrong in 300, "much":
        with pytest.raises(sg.UsageError, match=f"tolerance: found '?{wrong}"):
            sg.train(scene, audit=found, tolerance=wrong, **few)
    with pytest.raises(ValueError, match="tolerances: found 3 values .* expected 4"):
        sg.train(scene, tolerances=[1.0, 2.0, 3.0], **few)


def test_sizes_are_those_of_the_library():
    """Python's list of views can be changed, and evaluate() draws other sizes with a renderer."""
    scene = scene_of()
    model = sg.train(scene, **SHORT)
    work = sg.Attack(scene, model, preset="", iterations=1, inner=1)
    work.step()
    view = scene.train[0].camera
    scene.train.clear()
    assert work.poison(0).shape == (view.height, view.width, 3)
    for index in -1, 10 ** 6:
        with pytest.raises(IndexError, match="view: found"):
            work.poison(index)
    renderer = sg.Renderer(model)
    drawn = renderer.render(camera(0))
    sg.evaluate(renderer, scene_of(), split="train")
    with pytest.raises(ValueError, match="no view"):
        renderer.backward(drawn.color)
    with pytest.raises(ValueError, match="no view"):
        renderer.backward(np.zeros(0, np.float32))


def test_attack_keeps_its_bound_and_audit_defends():
    scene, visits = scene_of(), []
    model = sg.train(scene, **SHORT)
    poison = sg.attack(scene, model, callback=visits.append, preset="", iterations=12, inner=3,
                       epsilon=8)
    assert len(visits) == 12
    for view in scene.train:
        difference = np.asarray(poison[view.name]).astype(int) - np.asarray(view.image)
        assert 0 < np.abs(difference).max() <= 8
    assert len(sg.train(scene, audit=sg.audit(scene), **SHORT)) > 0
    with pytest.raises(sg.UsageError):
        sg.train(scene, audit="refused", **SHORT)
    found = sg.audit(scene)
    assert len(sg.train(scene, audit=found, tolerance=16, **SHORT)) > 0
    preset = sg.defense_preset("mip")
    trainer = sg.Trainer(scene, defense=True, filter_interval=5, **{**SHORT, **preset})
    assert any([trainer.step()["filtered"] for _ in range(20)])


def test_attack_leaves_numbers_to_its_preset():
    scene, model = scene_of(), model_of()
    for left in (0, "preset"):
        assert sg.Attack(scene, model, iterations=left, inner=1).iterations == 12000
    steps = [sg.Attack(scene, model, iterations=2, **given).step() for given in
             ({}, {"inner": "preset"}, {"inner": 25})]
    assert steps[0] == steps[1] == steps[2]
    with pytest.raises(sg.UsageError, match="iterations: found 0"):
        sg.Attack(scene, model, preset="", iterations=0)


def test_defense_is_a_bool_or_a_word():
    scene = scene_of()
    few, strong = dict(SHORT, iterations=20), dict(rho=0.3, filter_interval=5)
    on = [len(sg.train(scene, defense=value, **few, **strong)) for value in (True, "spectral")]
    off = [len(sg.train(scene, defense=value, **few)) for value in (False, "off", None)]
    assert on[0] == on[1] < off[0] == off[1] == off[2]
    for wrong in ("no", "false", "", 1, ["spectral"]):
        for audit in (None, sg.audit(scene)):
            with pytest.raises(sg.UsageError,
                               match=r"defense: found .* expected true, false or one of off\|spectral"):
                sg.train(scene, defense=wrong, audit=audit, **few)
    for audit in ("defend", sg.audit(scene)):
        for off in (False, "off"):
            with pytest.raises(sg.UsageError, match="defense: found off, expected no audit"):
                sg.train(scene, defense=off, audit=audit, **few)


def test_arguments_without_effect_are_refused(tmp_path):
    scene, model = scene_of(), model_of()
    with pytest.raises(sg.UsageError, match="initial: found with resume"):
        sg.Trainer(scene, initial=model, resume=tmp_path / "state.bin", **SHORT)
    with pytest.raises(sg.InputError):
        sg.Trainer(scene, resume="", **SHORT)  # not a new training
    with pytest.raises(sg.UsageError, match="background: found with a Renderer"):
        sg.evaluate(sg.Renderer(model), scene, split="train", background=(1, 1, 1))


def test_appearances_that_a_model_does_not_have_are_refused():
    scene = scene_of(views=3)
    few = dict(iterations=1, init_points=50, model="scaffold", voxel_size=0.2)
    for wrong in 0, "mean", "zero", "index":
        for plain in model_of(), sg.train(scene, **few):
            with pytest.raises(sg.UsageError, match=f"appearance: found {wrong}, expected none"):
                sg.Renderer(plain, appearance=wrong)
    model = sg.train(scene, photo_appearance=True, **few)
    for good in 2, "mean", "zero", "index", None:
        sg.Renderer(model, appearance=good)
    with pytest.raises(sg.UsageError, match="appearance: found 3, expected a photo from 0 to 2"):
        sg.evaluate(model, scene, split="train", appearance=3)


def test_parameters_without_effect_are_refused():
    scene = scene_of(views=3)
    few = dict(iterations=1, init_points=50)
    found = sg.audit(scene)
    for unused, expected in (
            (dict(rho=0.3), "rho: found without a defense, expected --defense spectral or"),
            (dict(rho=0.3, defense=False), "rho: found without a defense"),
            (dict(rho=0.3, defense="off"), "rho: found without a defense"),
            (dict(rho=0.3, audit="refuse"), "rho: found without a defense"),
            (dict(lambda_=1.5), "lambda: found without a defense"),
            (sg.defense_preset("mip"), "rho: found without a defense"),
            (dict(filter_interval=5), "filter_interval: found without a defense"),
            (dict(filter_frequency=5), "filter_frequency: found without a defense"),
            (dict(tolerance=0, tolerance_tv=2), "tolerance_tv: .* --tolerance or --audit defend"),
            (dict(view_weights=np.ones(3, np.float32)), "view_weights: found without a defense"),
            (dict(cap_max=100), "cap_max: found without effect, expected --strategy mcmc"),
            (dict(strategy="mcmc", absgrad=True), "absgrad: found without effect"),
            (dict(mip_kernel=0.2), "mip_kernel: found without effect, expected --model mip"),
            (dict(keep_filter=True), "keep_filter: found without effect, expected --model mip"),
            (dict(voxel_size=0.1), "voxel_size: found without effect, expected --model scaffold")):
        with pytest.raises(sg.UsageError, match=expected):
            sg.train(scene, **few, **unused)
        with pytest.raises(sg.UsageError, match=expected):
            sg.Trainer(scene, **few, **unused)
    for used in (dict(rho=0.3, defense=True), dict(rho=0.3, audit="defend"), dict(rho=None),
                 dict(rho=0.3, audit=found), dict(tolerance="auto", tolerance_tv=2),
                 dict(tolerances=np.ones(3, np.float32), tolerance_tv=2),
                 dict(max_gaussians=100, filter_frequency=5), dict(strategy="mcmc", cap_max=100),
                 dict(view_weights=np.ones(3, np.float32), audit="defend"),
                 dict(model="mip", mip_kernel=0.2)):
        sg.train(scene, **few, **used)
    for limit in (dict(max_memory=1 << 30), dict(max_vram=1 << 30)):
        limited = scene_of(views=3, context=sg.Context(**limit))
        sg.train(limited, filter_frequency=5, engine="cpu", **few)


# ---- errors, files, memory ----

def test_arguments_of_other_types_are_named():
    scene, model = scene_of(views=3), model_of()
    renderer = sg.Renderer(model)
    for call, what, expected in (
            (lambda x: sg.train(x), "scene", "Scene"), (lambda x: sg.Trainer(x), "scene", "Scene"),
            (lambda x: sg.train(scene, initial=x), "initial", "Model"),
            (lambda x: sg.audit(x), "scene", "Scene"),
            (lambda x: sg.evaluate(x, scene), "model", "Model or Renderer"),
            (lambda x: sg.evaluate(model, x), "scene", "Scene"),
            (lambda x: sg.attack(x, model), "scene", "Scene"),
            (lambda x: sg.Attack(scene, x), "proxy", "Model"),
            (lambda x: sg.Renderer(x), "model", "Model"),
            (lambda x: renderer.render(x), "camera", "Camera"),
            (lambda x: sg.camera_path([x]), "cameras", "Camera"),
            (lambda x: sg.View("a", x, photo(0)), "camera", "Camera"),
            (lambda x: sg.Scene.build([x]), "views", "View")):
        for wrong, found in ("a path", "str"), (scene.train, "list"):
            with pytest.raises(TypeError, match=f"^{what}: found {found}, expected {expected}$"):
                call(wrong)


def test_limits_of_contexts():
    for wrong in (dict(threads=-1), dict(threads=257), dict(log_level=3), dict(log_level=-1)):
        (name, value), = wrong.items()
        most = {"threads": 256, "log_level": 2}[name]
        with pytest.raises(sg.UsageError, match=f"^{name}: found {value}, expected 0 to {most}$"):
            sg.Context(**wrong)
    for call in (lambda n: sg.Context(max_memory=n), lambda n: sg.Context(max_vram=n),
                 lambda n: scene_of(keep_photos=n), lambda n: sg.Model.load("/", max_gaussians=n)):
        for n in -1, 1 << 64:
            with pytest.raises(sg.UsageError, match=f"found {n}, expected 0 to {(1 << 64) - 1}"):
                call(n)
        with pytest.raises(TypeError):
            call(1.5)
    assert sg.Context(max_memory=np.int64(1 << 20)).memory()["total"] == (0, 0)


def test_flags_are_bools():
    scene, model = scene_of(views=3), model_of()
    renderer = sg.Renderer(model)
    for call in (lambda: sg.train(scene, absgrad="no"), lambda: sg.train(scene, exposure="no"),
                 lambda: scene_of(eval="no"), lambda: scene_of(untrained="no"),
                 lambda: scene_of(white_background="no"), lambda: sg.Scene.load("/", eval="no"),
                 lambda: sg.Scene.load("/", untrained="no"),
                 lambda: sg.View("a", camera(0), photo(0), lossless="no"),
                 lambda: renderer.render(camera(0), alpha="no"),
                 lambda: renderer.render(camera(0), depth="no"),
                 lambda: sg.evaluate(model, scene, match_colors="no"),
                 lambda: sg.evaluate(model, scene, fps="no")):
        with pytest.raises(sg.UsageError, match="^[a-z_]+: found 'no', expected true or false$"):
            call()


def test_errors_have_classes_and_names():
    with pytest.raises(sg.UsageError, match="iterations: found -1"):
        sg.train(scene_of(), iterations=-1)
    with pytest.raises(TypeError, match="iteratoins"):
        sg.train(scene_of(), iteratoins=1)
    with pytest.raises(TypeError, match="'_'"):
        sg.Scene.load("/nowhere", **{"_": 1})
    assert "_".encode()[0] == 0x5f  # the interpreter has one for all
    with pytest.raises(sg.InputError, match="/nowhere"):
        sg.Scene.load("/nowhere")
    context = sg.Context(max_memory=1 << 20)
    with pytest.raises(sg.BudgetError):
        sg.Model(100_000, 3, context=context)
    with pytest.raises(MemoryError):
        scene_of(views=300, context=context)
    with pytest.raises(ValueError, match="different contexts"):
        sg.train(scene_of(context=sg.Context()), initial=model_of())
    scene = scene_of()
    with pytest.raises(sg.InputError, match="found no Gaussians"):  # and not taken for None
        sg.Trainer(scene, initial=sg.Model(0, 1, context=scene.context))
    assert len(sg.train(scene, iterations=None, callback=lambda step: True)) > 0
    assert issubclass(sg.Cancelled, sg.Error) and issubclass(sg.BudgetError, MemoryError)


def test_files_of_models(tmp_path):
    model = model_of(300, 2)
    model.save(tmp_path / "m.ply")
    for name, values in sg.Model.load(tmp_path / "m.ply").arrays().items():
        assert np.array_equal(values, model[name])
    for ending in ("splat", "spz", "compressed.ply"):
        model.save(tmp_path / f"m.{ending}")
        back = np.asarray(sg.Model.load(tmp_path / f"m.{ending}")["position"])
        if ending != "compressed.ply":
            assert np.abs(back - np.asarray(model["position"])).max() < 5e-3
    for name in "ply", "compressed-ply", "splat", "spz", "sog", "glb":
        model.save(tmp_path / f"by_ending.{name.replace('-', '.')}")
        model.save(tmp_path / "by_name", format=name)
        assert (tmp_path / "by_name").read_bytes() == (tmp_path / f"by_ending.{name.replace('-', '.')}").read_bytes(), name
    versions = []
    for version in 2, 3:
        model.save(tmp_path / "v.spz", spz_version=version)
        versions.append(gzip.decompress((tmp_path / "v.spz").read_bytes())[4])
    assert versions == [2, 3]
    model.save(tmp_path / "v.spz")
    assert gzip.decompress((tmp_path / "v.spz").read_bytes())[4] == 3
    for name, format in ("v.ply", "auto"), ("v.spz", "ply"), ("v.spz", "sog"):
        before = sorted(os.listdir(tmp_path))
        with pytest.raises(sg.UsageError, match="spz_version: found without effect on the format "):
            model.save(tmp_path / name, format, spz_version=3)
        assert sorted(os.listdir(tmp_path)) == before
    for wrong in 0, 5:
        with pytest.raises(sg.UsageError, match=f"spz_version: found {wrong}, expected 2 to 4"):
            model.save(tmp_path / "v.spz", spz_version=wrong)
    model_of(20, 0).save(tmp_path / "m.ply")  # replaces the file
    assert len(sg.Model.load(tmp_path / "m.ply")) == 20
    box = ((-9, -9, -9), (0, 9, 9))
    assert len(model.select(box=box)) == (np.asarray(model["position"])[:, 0] <= 0).sum()


def test_the_newest_model_of_a_run_is_loaded(tmp_path):
    for iteration, n in (7, 40), (30, 50):
        folder = tmp_path / "run" / "point_cloud" / f"iteration_{iteration}"
        folder.mkdir(parents=True)
        model_of(n).save(folder / "point_cloud.ply")
    assert len(sg.Model.load(tmp_path / "run")) == 50
    with pytest.raises(sg.InputError, match="expected a run folder"):
        sg.Model.load(tmp_path)


def test_options_and_help():
    assert {o["name"] for o in sg.options("train")} >= {"iterations", "lambda", "rho"}
    assert all(o["help"] for what in ("train", "attack", "scene", "render")
               for o in sg.options(what))
    assert any(e["chosen"] for e in sg.engines())
    for name in sg.__all__:
        assert getattr(sg, name).__doc__, name


def test_stubs_have_what_the_package_has():
    path = os.path.join(os.path.dirname(sg.__file__), "__init__.pyi")
    with open(path, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    classes = {n.name: n for n in tree.body if isinstance(n, ast.ClassDef)}
    assert set(classes) | {n.name for n in tree.body if isinstance(n, ast.FunctionDef)} >= set(
        sg.__all__)
    for name, node in classes.items():
        if issubclass(getattr(sg, name), BaseException):
            continue
        public = {m for m in vars(getattr(sg, name)) if not m.startswith("_")}
        stubbed = {m.name for m in node.body if isinstance(m, ast.FunctionDef)} | {
            m.target.id for m in node.body if isinstance(m, ast.AnnAssign)}
        assert public <= stubbed, f"{name}: {public - stubbed}"


def rss():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_nothing_leaks_over_1000_objects():
    context, image = sg.Context(threads=1), photo(0)
    points = np.random.default_rng(0).normal(size=(8, 3))

    def round_trip():
        scene = sg.Scene.build([sg.View("a", camera(0), image),
                                sg.View("b", camera(1), lambda: image)], context=context)
        model = sg.Model.from_points(points, image[0, :8], 1, context=context)
        renderer = sg.Renderer(model)
        renderer.backward(renderer.render(camera(0)).color)
        sg.Trainer(scene, initial=model, iterations=2).step()
        with pytest.raises(sg.InputError):
            sg.Model.load("/nowhere", context=context)

    for _ in range(50):
        round_trip()
    gc.collect()
    before = rss()
    for _ in range(1000):
        round_trip()
    gc.collect()
    assert context.memory()["total"][0] == 0
    assert rss() - before < 4 << 20
    for _ in range(200):
        sg.Context(threads=2)
    assert rss() - before < 6 << 20
