#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures runs on the object of a Blender scene, apart from its empty background.

    bench/object.py SCENE DOWNSCALE RUN...

SCENE: the clean scene, in Blender's layout, on black. DOWNSCALE: as the runs had it, a whole number. Prints
PSNR over the whole test views and over the object for each run, means over the views. The object is
where alpha is over one half, after both are reduced to the run's size. Needs NumPy and Pillow."""
import glob
import os
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image

TOOL = os.environ.get("SPLATGUARD", "build/splatguard")


def run(*words):
    if subprocess.run([TOOL, *words, "-q"]).returncode:
        sys.exit(f"{TOOL} {words[0]} failed")


def values(path):
    return np.asarray(Image.open(path).convert("RGB"), dtype=float) / 255


def psnr(difference):
    return -10 * np.log10(np.mean(difference ** 2))


def object_of(path, scale):
    alpha = np.asarray(Image.open(path).convert("RGBA"), dtype=float)[..., 3] / 255
    height, width = (n // scale for n in alpha.shape)
    return alpha.reshape(height, scale, width, scale).mean(axis=(1, 3)) > 0.5


def measure(scene, scale, folder, photos, work):
    renders = os.path.join(work, "renders")
    run("render", folder, "--scene", scene, "--downscale", str(scale), "--split", "test", "-o", renders)
    whole, only = [], []
    for path in sorted(glob.glob(renders + "/*.png")):
        name = os.path.basename(path)
        difference = values(path) - values(os.path.join(photos, name))
        whole.append(psnr(difference))
        only.append(psnr(difference[object_of(os.path.join(scene, "test", name), scale)]))
    print(f"{folder}\t{len(whole)} views\t{np.mean(whole):.2f}\t{np.mean(only):.2f}", flush=True)


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    scene, scale, runs = sys.argv[1], int(sys.argv[2]), sys.argv[3:]
    with tempfile.TemporaryDirectory() as work:
        clean = os.path.join(work, "clean")  # the photos as the trainer has them
        run("attack", scene, "-o", clean, "--method", "noise", "--epsilon", "0", "--downscale", str(scale))
        for folder in runs:
            with tempfile.TemporaryDirectory() as room:
                measure(scene, scale, folder, os.path.join(clean, "test"), room)


main()
