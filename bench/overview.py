#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Sets the scenes of bench/results/evening.tsv side by side.

    bench/overview.py

Writes bench/results/evening-PHOTOS.tsv for each kind of photos: a row is a defense, a column a scene,
whose cells are the most Gaussians as a multiple of clean training, PSNR and SSIM. The best values of a
column are bold."""
import csv
import os

RESULTS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "results")


def unique(values):
    return list(dict.fromkeys(values))


def marked(text):
    return f"**{text[1:]}**" if text.startswith("*") else text


def main():
    with open(os.path.join(RESULTS, "evening.tsv"), newline="") as f:
        rows = list(csv.DictReader(f, delimiter="\t"))
    scenes = unique(r["scene"] for r in rows)
    for photos in unique(r["photos"] for r in rows):
        cells = {(r["defense"], r["scene"]): r for r in rows if r["photos"] == photos}
        with open(os.path.join(RESULTS, f"evening-{photos}.tsv"), "w") as out:
            print("defense", *scenes, "commit", "machine", sep="\t", file=out)
            for defense in unique(d for d, _ in cells):
                of = [cells[defense, s] for s in scenes]
                print(defense, *(f"{r['of clean']}; {marked(r['PSNR, dB'])}; {marked(r['SSIM'])}" for r in of),
                      ", ".join(unique(r["commit"] for r in of)),
                      ", ".join(unique(r["machine"] for r in of)), sep="\t", file=out)


if __name__ == "__main__":
    main()
