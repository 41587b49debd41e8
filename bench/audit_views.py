#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures how well fine detail agrees between views, in clean and in poisoned photos.

    bench/audit_views.py SCENE COMMIT MACHINE PHOTOS...

SCENE: a COLMAP scene with pinhole cameras (binary, in sparse/0). PHOTOS: folders that have the photos of
its views in images/, clean and poisoned, at one size. Prints a row of bench/results/audit-views.tsv for
each. Needs NumPy, SciPy and Pillow.

Patches of 13 x 13 pixels around points of the scene are taken from some 24 photos. Each photo has the
two nearest cameras as partners. A patch is taken for a plane that faces both cameras, resampled from
the partner by cubic splines, and aligned within 1.5 pixels by its coarse band. It is left out where
that band correlates by less than 0.7: the point is hidden, or the plane is wrong. The numbers are
medians over the photos of the median over their patches.
"""
import os
import struct
import sys

import numpy as np
from PIL import Image
from scipy import ndimage

HALF = 6  # of a patch, pixels
SIGMAS = (0.7, 1.4, 2.8)  # between the bands, pixels
VIEWS, PARTNERS, POINTS = 24, 2, 150
ANGLE, RATIO = 15, 1.25  # most between the directions to a point, degrees; between its distances
SHIFTS = np.arange(-1.5, 1.6, 0.5)
GREY = np.float32([0.299, 0.587, 0.114])


class Camera:
    def __init__(self, name, pose, size, focal):
        w, x, y, z = pose[:4]
        self.name, (self.width, self.height), self.focal = name, size, np.array(focal)
        self.rotation = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
        self.shift = np.array(pose[4:])
        self.centre = -self.rotation.T @ self.shift

    def project(self, points, scale=1.0):
        """Columns, rows and depths of points (... x 3) in a photo of `scale` times the camera's size."""
        p = points @ self.rotation.T + self.shift
        depth = np.maximum(p[..., 2], 1e-6)
        fx, fy, cx, cy = self.focal * scale
        return fx * p[..., 0] / depth + cx - 0.5, fy * p[..., 1] / depth + cy - 0.5, p[..., 2]

    def rays(self, x, y, scale):
        fx, fy, cx, cy = self.focal * scale
        return np.stack([(x + 0.5 - cx) / fx, (y + 0.5 - cy) / fy, np.ones_like(x)], -1) @ self.rotation


def load(folder):
    """The cameras and the points of a COLMAP model."""
    def read(file, form):
        return struct.unpack("<" + form, file.read(struct.calcsize("<" + form)))

    cameras, intrinsics = [], {}
    with open(folder + "/cameras.bin", "rb") as file:
        for _ in range(*read(file, "Q")):
            number, model, width, height = read(file, "iiQQ")
            if model > 1:
                sys.exit(f"{folder}/cameras.bin: found camera model {model}, expected a pinhole")
            f = read(file, "4d" if model else "3d")
            intrinsics[number] = (width, height), f if model else (f[0], *f)
    with open(folder + "/images.bin", "rb") as file:
        for _ in range(*read(file, "Q")):
            _, *pose, number = read(file, "i7di")
            name = b""
            while (c := file.read(1)) != b"\0":
                if not c:
                    sys.exit(f"{folder}/images.bin: byte {file.tell()}: found the end of the file, "
                             "expected a name")
                name += c
            file.seek(24 * read(file, "Q")[0], 1)
            cameras.append(Camera(name.decode(), pose, *intrinsics[number]))
    points = []
    with open(folder + "/points3D.bin", "rb") as file:
        for _ in range(*read(file, "Q")):
            points.append(read(file, "Q3d3Bd")[1:4])
            file.seek(8 * read(file, "Q")[0], 1)
    return sorted(cameras, key=lambda c: c.name), np.array(points)


def pairs(cameras, points):
    """(camera, partner, points that both see if nothing hides them) of some cameras."""
    random = np.random.default_rng(1)

    def inside(camera):
        x, y, depth = camera.project(points)
        return (depth > 0.05) & (np.minimum(x, y) > 15) & (x < camera.width - 15) & (y < camera.height - 15)

    seen = {c: inside(c) for c in cameras}
    for a in cameras[::max(1, len(cameras) // VIEWS)]:
        to_a = a.centre - points
        far_a = np.linalg.norm(to_a, axis=1)
        found = []
        for b in cameras:
            to_b = b.centre - points
            far_b = np.linalg.norm(to_b, axis=1)
            near = (to_a * to_b).sum(1) > np.cos(np.radians(ANGLE)) * far_a * far_b
            near &= seen[a] & seen[b] & (far_a < RATIO * far_b) & (far_b < RATIO * far_a)
            if b is not a and near.sum() > 200:
                found.append((np.linalg.norm(a.centre - b.centre), b, near))
        for _, b, near in sorted(found, key=lambda f: f[0])[:PARTNERS]:
            yield a, b, random.permutation(points[near])[:POINTS]


def bands(folder, camera):
    """Spline coefficients of the photo's fine, middle and coarse bands, and its scale to the camera."""
    photo = f"{folder}/images/{camera.name}"
    path = next((p for p in (photo, os.path.splitext(photo)[0] + ".png") if os.path.exists(p)), None)
    if path is None:
        return None
    grey = np.asarray(Image.open(path).convert("RGB")).astype(np.float32) @ GREY
    levels = [grey] + [ndimage.gaussian_filter(grey, s) for s in SIGMAS]
    return [ndimage.spline_filter(a - b) for a, b in zip(levels, levels[1:])], grey.shape[1] / camera.width


def sample(band, x, y):
    return ndimage.map_coordinates(band, [y, x], order=3, prefilter=False).ravel()


def correlation(a, b):
    a, b = a - a.mean(), b - b.mean()
    return a @ b / np.sqrt((a @ a) * (b @ b) + 1e-9)


def within(x, y, shape):
    return min(x.min(), y.min()) >= 8 and x.max() < shape[1] - 8 and y.max() < shape[0] - 8


def compare(a, b, points, photo_a, photo_b):
    """The bands' correlations, and their deviations in the photo of `a`, for each patch that counts."""
    (bands_a, scale_a), (bands_b, scale_b) = photo_a, photo_b
    step_y, step_x = np.mgrid[-HALF:HALF + 1, -HALF:HALF + 1]
    for point in points:
        x, y, _ = a.project(point, scale_a)
        x, y = x + step_x, y + step_y
        normal = sum((c.centre - point) / np.linalg.norm(c.centre - point) for c in (a, b))
        rays = a.rays(x, y, scale_a)
        depth = ((point - a.centre) @ normal) / (rays @ normal)
        u, v, _ = b.project(a.centre + rays * depth[..., None], scale_b)
        if not within(x, y, bands_a[0].shape) or not within(u, v, bands_b[0].shape):
            continue
        patch = [sample(band, x, y) for band in bands_a]
        best, dx, dy = max((correlation(patch[2], sample(bands_b[2], u + dx, v + dy)), dx, dy)
                           for dx in SHIFTS for dy in SHIFTS)
        if best >= 0.7:
            partner = [sample(band, u + dx, v + dy) for band in bands_b]
            yield [correlation(p, q) for p, q in zip(patch, partner)] + [p.std() for p in patch]


def main():
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    scene, commit, machine, *folders = sys.argv[1:]
    all_pairs = list(pairs(*load(scene + "/sparse/0")))
    for folder in folders:
        photos, found = {}, {}
        for a, b, points in all_pairs:
            for c in (a, b):
                if c not in photos:
                    photos[c] = bands(folder, c)
            if photos[a] and photos[b]:
                rows = list(compare(a, b, points, photos[a], photos[b]))
                if len(rows) >= 15:
                    found.setdefault(a, []).append(np.median(rows, 0))
        if not found:
            sys.exit(f"{folder}/images: no two photos share enough points of {scene}")
        middle = np.median([np.mean(f, 0) for f in found.values()], 0)
        print(os.path.basename(folder), len(found), *(f"{m:.2f}" for m in middle[:3]),
              *(f"{m:.1f}" for m in middle[3:]), commit, machine, sep="\t", flush=True)


main()
