#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Clean and poisoned variants of photos, and what the audit measures of them, for bench/audit_fit.py.

    bench/audit_variants.py LIBRARY PHOTOS SCENES SETS OUT.npz

LIBRARY: libsplatguard.so, built with -DBUILD_SHARED_LIBS=ON. PHOTOS: a folder of clean photos for each kind. SCENES: clean
scenes. SETS: poisoned scenes SCENE-EPSILON-FORM by `splatguard attack --save png`, and c-SCENE, the same scene at the
same size by `--method noise --epsilon 0 --save png`. Needs NumPy and Pillow.
"""
import concurrent.futures
import ctypes
import glob
import io
import json
import os
import sys

import numpy as np
from PIL import Image

SIDE = 384  # photos are cropped to this
EPSILONS = (8, 16, 24)
WEAK = 1.2  # sets whose total variation grew by less are no attack, for want of a good proxy: not fitted
SCENES = {"lego": ("train/*.png", 6), "bonsai": ("images/*", 10), "train": ("images/*", 10), "fox": ("images/*", 8),
          "garden": ("images/*", 12), "brighton": ("images/*", 8)}
FEATURES = 18 + 162  # doubles in struct sg_audit_features, of which the last are the texture
rng = np.random.default_rng(2)


def load(path):
    pixels = np.asarray(Image.open(path))
    if pixels.ndim == 3 and pixels.shape[2] == 4:  # on black
        return (pixels[..., :3] * (pixels[..., 3:] / 255)).round().astype(np.uint8)
    return np.asarray(Image.open(path).convert("RGB"))


def crop(a):
    y, x = (rng.integers(0, max(1, n - SIDE + 1)) for n in a.shape[:2])
    return np.ascontiguousarray(a[y:y + SIDE, x:x + SIDE])


def jpeg(a):
    file = io.BytesIO()
    Image.fromarray(a).save(file, "JPEG", quality=75, subsampling=2)
    return np.asarray(Image.open(file))


def half(a):
    return np.asarray(Image.fromarray(a).resize((a.shape[1] // 2, a.shape[0] // 2), Image.BOX))


FORMS = {"png": lambda a: a, "jpeg": jpeg, "half": half, "half-jpeg": lambda a: jpeg(half(a)),
         "turned": lambda a: a.transpose(1, 0, 2)}


def bound(a):
    return np.clip(np.rint(a), 0, 255).astype(np.uint8)


def blur(n, size):
    x = np.arange(-3, 4)
    kernel = np.exp(-x**2 / (2 * size**2)) / np.exp(-x**2 / (2 * size**2)).sum()
    for axis in (0, 1):
        n = sum(k * np.roll(n, i - 3, axis) for i, k in enumerate(kernel))
    return n


def sensor_noise(a):
    """Photon and read noise, some of it smoothed as demosaicing and resizing do, stronger or weaker in colours."""
    n = rng.normal(0, 1, a.shape)
    size = rng.choice([0, 0.4, 0.6, 0.8])
    n = blur(n, size) if size else n
    grey = n.mean(2, keepdims=True)
    n = grey + rng.uniform(0.2, 1) * (n - grey)
    level = rng.uniform(0.3, 1) * 10 ** rng.uniform(0.3, 1.15)
    return bound(a + level * np.sqrt(rng.uniform(0.02, 0.5) + a / 255 * rng.uniform(0.2, 1.5)) * n / n.std())


def attack_noise(a, epsilon):
    return bound(a + np.clip(2 * rng.normal(0, epsilon, a.shape), -epsilon, epsilon))


def pad_gradient(x, axis):
    """Signs of the differences to the neighbours on both sides of an axis, added up."""
    step = np.sign(np.diff(x, axis=axis))
    ends = [(0, 0)] * 3
    before, after = list(ends), list(ends)
    before[axis], after[axis] = (1, 0), (0, 1)
    return np.pad(step, before) - np.pad(step, after)


def own_ascent(a, epsilon, both):
    """`attack --method tv-per-view`, forms vertical2 and aniso."""
    clean = a.astype(np.float32)
    x = clean
    for _ in range(epsilon // 2 + 4):
        gradient = pad_gradient(x, 0) + (pad_gradient(x, 1) if both else 0)
        x = np.clip(np.clip(x + 2 * np.sign(gradient), clean - epsilon, clean + epsilon), 0, 255)
    return bound(x)


def transplant(a, residual):
    """The change that Poison-splat made to another scene's photo, on this one."""
    h, w = a.shape[:2]
    r = residual[:, ::-1] if rng.random() < 0.5 else residual
    r = np.pad(r, ((0, max(0, h - r.shape[0])), (0, max(0, w - r.shape[1])), (0, 0)), mode="symmetric")
    y, x = rng.integers(0, r.shape[0] - h + 1), rng.integers(0, r.shape[1] - w + 1)
    return bound(a + r[y:y + h, x:x + w])


def resized(residual, epsilon):
    """A finer or coarser poison: the Gaussians of other scenes are of other sizes on the photo."""
    factor = rng.uniform(0.6, 1.6)
    h, w = (int(n * factor) for n in residual.shape[:2])
    planes = [np.asarray(Image.fromarray(residual[..., k].astype(np.float32)).resize((w, h), Image.BILINEAR)) for k in range(3)]
    return np.clip(np.rint(1.3 * np.stack(planes, 2)), -epsilon, epsilon).astype(np.int16)


def painted():
    """Shading and edges without any noise, as in renders."""
    y, x = np.mgrid[0:300, 0:300]
    for i in range(12):
        a, b = rng.uniform(0.02, 0.09, 2)
        c, d = rng.integers(25, 60, 2)
        yield bound(np.stack([90 + 40 * np.sin(x * a + k) + 30 * np.cos(y * b) + (x // c + y // d) % 2 * 30 * (i % 3 > 0)
                              for k in range(3)], 2))


def cut_out(a):
    """An object before nothing, as renders and masked photos are: black or white around a wavy ellipse."""
    h, w = a.shape[:2]
    y, x = np.mgrid[0:h, 0:w]
    y, x = (y - rng.uniform(0.4, 0.6) * h) / (rng.uniform(0.2, 0.5) * h), (x - rng.uniform(0.4, 0.6) * w) / (rng.uniform(0.2, 0.5) * w)
    inside = np.hypot(y, x) < 1 + 0.2 * np.sin(rng.integers(2, 8) * np.arctan2(y, x) + rng.uniform(0, 7))
    return np.where(inside[..., None], a, np.uint8(0 if rng.random() < 0.75 else 255))


def spare(poisoned, clean, part):
    w = int(part * clean.shape[1])
    return np.concatenate([clean[:, :w], poisoned[:, w:]], 1)


def read_sets(folder):
    """NAME: (scene, epsilon, pairs of a clean and a poisoned photo, whether the attack failed)."""
    sets = {}
    for path in sorted(glob.glob(folder + "/*-*/poison.json")):
        place = os.path.dirname(path)
        scene, epsilon, *_ = os.path.basename(place).split("-")
        if scene not in SCENES:
            continue
        with open(path, encoding="utf-8") as f:
            growth = json.load(f)
        weak = growth["tv_after_mean"] < WEAK * growth["tv_before_mean"]
        pairs = []
        files = sorted(glob.glob(place + "/images/*.png") + glob.glob(place + "/train/*.png"))
        for file in files[::max(1, len(files) // 16)][:16]:
            original = folder + "/c-" + scene + file[len(place):]
            if os.path.exists(original):
                a, b = load(original), load(file)
                if (a != b).any():
                    pairs.append((a, b))
        if pairs:
            sets[os.path.basename(place)] = scene, int(epsilon), pairs, weak
    return sets


def areas(h, w):
    """The photo, its halves and its quarters, in whole tiles, as the audit looks at them."""
    y, x = (h + 31) // 64 * 32, (w + 31) // 64 * 32
    return [np.s_[:], np.s_[:, :x], np.s_[:, x:], np.s_[:y], np.s_[y:], np.s_[:y, :x], np.s_[:y, x:], np.s_[y:, :x], np.s_[y:, x:]]


class Measure:
    def __init__(self, library):
        self.library = ctypes.CDLL(os.path.abspath(library))
        self.context = ctypes.c_void_p()
        if self.library.sg_ctx_create(ctypes.byref(self.context), None):
            sys.exit(library + ": no context")
        self.pool = concurrent.futures.ThreadPoolExecutor()
        self.rows = []

    def __call__(self, kind, family, form, epsilon, source, photo, a):
        """source: whose poison it is, so that it is left out together with that scene."""
        a = FORMS[form](a)
        if min(a.shape[:2]) < 96:
            return
        parts = family == "spared" or (family == "clean" and form in ("png", "jpeg"))
        for area, place in enumerate(areas(*a.shape[:2]) if parts else [np.s_[:]]):
            features = self.pool.submit(self.features, np.ascontiguousarray(a[place]))
            self.rows.append((kind, family, form, epsilon, source, photo, area, features))

    def features(self, a):
        out = (ctypes.c_double * (FEATURES + 3))()
        if self.library.sg_audit_measure(self.context, ctypes.c_void_p(a.ctypes.data), None, a.shape[1], a.shape[0], out, None):
            raise MemoryError
        return np.array(out)[:FEATURES]


def draw_residual(pool, source, epsilon):
    """The change to a part of one of its photos, scaled to epsilon."""
    for _ in range(20):
        own, residual = pool[source][rng.integers(len(pool[source]))]
        residual = residual[90:310, 60:340] if source == "lego" else residual  # the object
        if np.abs(residual).mean() > 0.35 * own:
            break
    return np.rint(residual * (epsilon / own)).astype(np.int16)


def cut_outs(measure, kind, photos, pool):
    others = [s for s in pool if s != kind]
    for i, a in enumerate(photos):
        a = cut_out(a)
        for form in rng.permutation(list(FORMS))[:2]:
            measure(kind, "clean, cut", form, 0, "", i, a)
        source = rng.choice(others)
        for epsilon in EPSILONS:
            residual = draw_residual(pool, source, epsilon)
            x = transplant(a, resized(residual, epsilon) if rng.random() < 0.5 else residual)
            measure(kind, "transplant, cut", rng.choice(list(FORMS)), epsilon, source, i, x)


def poisons(measure, kind, photos, pool):
    others = [s for s in pool if s != kind]
    for i, a in enumerate(photos):
        for epsilon in EPSILONS:
            for k, source in enumerate(rng.permutation(others)[:2]):
                residual = draw_residual(pool, source, epsilon)
                x = transplant(a, resized(residual, epsilon) if k else residual)
                measure(kind, "transplant", rng.choice(list(FORMS)), epsilon, source, i, x)
                if epsilon > 8 and i % 3 == 1:
                    measure(kind, "spared", rng.choice(["png", "jpeg"]), epsilon, source, i, spare(x, a, rng.choice([0.3, 0.5])))
            if (i + epsilon // 8) % 2 == 0:
                measure(kind, "tv", rng.choice(list(FORMS)), epsilon, "tv", i, own_ascent(a[:288, :288], epsilon, rng.random() < 0.6))
            elif i % 3 == 0:
                measure(kind, "noise", rng.choice(["png", "jpeg", "half"]), epsilon, "noise", i, attack_noise(a, epsilon))


def main():
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    library, photos, scenes, sets, out = sys.argv[1:]
    measure = Measure(library)
    kinds = {kind: [crop(load(f)) for f in sorted(glob.glob(f"{photos}/{kind}/*"))[:8]]
             for kind in sorted(os.listdir(photos)) if os.path.isdir(f"{photos}/{kind}")}
    for scene, (pattern, count) in SCENES.items():
        files = sorted(glob.glob(f"{scenes}/{scene}/{pattern}"))
        files = files[::max(1, len(files) // count)][:count]
        kinds[scene] = [crop(b) for f in files for a in [load(f)] for b in (a, half(a))]
    kinds["painted"] = list(painted())
    pool = {}
    for name, (scene, epsilon, pairs, weak) in read_sets(sets).items():
        if not weak:
            pool.setdefault(scene, []).extend((epsilon, b.astype(np.int16) - a) for a, b in pairs)
        for i, (a, b) in enumerate(pairs):
            for form in ("png", "jpeg", "half"):
                measure(scene, ("weak:" if weak else "set:") + name, form, epsilon, scene, i, b[:2 * SIDE, :2 * SIDE])
    for kind, own in kinds.items():
        for i, a in enumerate(own):
            for form in ("png", "jpeg", "half", "half-jpeg"):
                measure(kind, "clean", form, 0, "", i, a)
            if i % 2 == 0:
                measure(kind, "clean, noisy", rng.choice(["png", "jpeg", "half"]), 0, "", i, sensor_noise(a))
        poisons(measure, kind, own, pool)
    for kind, own in kinds.items():
        if kind not in SCENES:
            cut_outs(measure, kind, own, pool)
    columns = list(zip(*((*row[:-1], row[-1].result()) for row in measure.rows)))
    names = ("kind", "family", "form", "epsilon", "source", "photo", "area", "features")
    np.savez_compressed(out, **{n: np.array(c) for n, c in zip(names, columns)})


main()
