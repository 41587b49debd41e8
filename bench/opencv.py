#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares `splatguard smooth` with the filters of OpenCV.

    bench/opencv.py COMMIT MACHINE SCENE... > bench/results/smooth-opencv.tsv

A SCENE is a folder with photos below it. Its photos are first saved as PNG, so that both filters
get the same values. Needs Debian's python3-opencv."""
import glob
import os
import subprocess
import sys
import tempfile

import cv2
import numpy

TOOL = os.environ.get("SPLATGUARD", "build/splatguard")
PHOTOS = 20
FILTERS = {
    "gaussian": lambda image: cv2.GaussianBlur(image, (5, 5), 1.5),
    "bilateral": lambda image: cv2.bilateralFilter(image, 9, 75, 75),
}


def run(*words):
    subprocess.run([TOOL, *words], check=True, stderr=subprocess.DEVNULL)


def photos(folder):
    """Of Blender and COLMAP layouts, by their path below the folder; test images have alpha."""
    names = glob.glob("images/*.png", root_dir=folder) or glob.glob("train/*.png", root_dir=folder)
    names.sort()
    return names[:: max(1, len(names) // PHOTOS)]


def compare(png, name, function, work):
    smooth = os.path.join(work, name)
    run("smooth", png, "-o", smooth, "--smooth", name, "--save", "png", "-q")
    off = numpy.zeros(256, int)
    names = photos(png)
    for path in names:
        ours = cv2.imread(os.path.join(smooth, path)).astype(int)
        theirs = function(cv2.imread(os.path.join(png, path))).astype(int)
        off += numpy.bincount(abs(ours - theirs).ravel(), minlength=256)
    return len(names), off


def main():
    commit, machine, *scenes = sys.argv[1:]
    print("scene", "filter", "photos", "equal, %", "within one grey level, %", "largest difference",
          "commit", "machine", sep="\t")
    for scene in scenes:
        with tempfile.TemporaryDirectory() as work:
            png = os.path.join(work, "png")
            run("attack", scene, "-o", png, "--method", "noise", "--epsilon", "0", "--save", "png", "-q")
            for name, function in FILTERS.items():
                count, off = compare(png, name, function, work)
                print(os.path.basename(scene.rstrip("/")), name, count, f"{100 * off[0] / off.sum():.3f}",
                      f"{100 * off[:2].sum() / off.sum():.4f}", numpy.flatnonzero(off).max(), commit,
                      machine, sep="\t", flush=True)


if __name__ == "__main__":
    main()
