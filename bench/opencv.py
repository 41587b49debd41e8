#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares `splatguard smooth` with the filters of OpenCV.

    bench/opencv.py COMMIT MACHINE SCENE... > bench/results/smooth-opencv.tsv

A SCENE is a scene of any layout. Its photos are first saved as PNG, so that both filters get the same
values; at most 20 of them are compared. Needs Debian's python3-opencv."""
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
    if subprocess.run([TOOL, *words, "-q"]).returncode:
        sys.exit(f"{TOOL} {words[0]} failed")


def photos(folder):
    """Paths below the folder, evenly spaced."""
    names = sorted(glob.glob("images/**/*.png", root_dir=folder, recursive=True)
                   or glob.glob("train/*.png", root_dir=folder))
    if not names:
        sys.exit(f"{folder}: found no photos")
    return [names[i * len(names) // PHOTOS] for i in range(PHOTOS)] if len(names) > PHOTOS else names


def compare(png, name, function, work):
    smooth = os.path.join(work, name)
    run("smooth", png, "-o", smooth, "--smooth", name, "--save", "png")
    off = numpy.zeros(256, int)
    names = photos(png)
    for path in names:
        ours = cv2.imread(os.path.join(smooth, path)).astype(int)
        theirs = function(cv2.imread(os.path.join(png, path))).astype(int)
        off += numpy.bincount(abs(ours - theirs).ravel(), minlength=256)
    return len(names), off


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    commit, machine, *scenes = sys.argv[1:]
    print("scene", "filter", "photos", "equal, %", "within one grey level, %", "largest difference",
          "OpenCV", "commit", "machine", sep="\t")
    for scene in scenes:
        with tempfile.TemporaryDirectory() as work:
            png = os.path.join(work, "png")
            run("attack", scene, "-o", png, "--method", "noise", "--epsilon", "0", "--save", "png")
            for name, function in FILTERS.items():
                count, off = compare(png, name, function, work)
                print(os.path.basename(scene.rstrip("/")), name, count, f"{100 * off[0] / off.sum():.3f}",
                      f"{100 * off[:2].sum() / off.sum():.4f}", numpy.flatnonzero(off).max(), cv2.__version__, commit,
                      machine, sep="\t", flush=True)


if __name__ == "__main__":
    main()
