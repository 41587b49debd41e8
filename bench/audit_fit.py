#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fits the weights of the audit's score (src/defense/audit.c) and says how well they do on scenes left out.

    bench/audit_fit.py TOOL SCENE=CLEAN... -- SCENE=POISONED...

SCENE names what is left out together; CLEAN and POISONED are folders, with options after a comma: lego=lego,--downscale,2
"""
import json
import math
import subprocess
import sys

STEPS, RATE, DECAY = 1500, 0.5, 0.003


def terms(f):
    return [math.log(f["osc_quiet"] + 0.1), f["osc_share"],
            abs(math.log((f["osc_down"] + 0.2) / (f["osc_across"] + 0.2))), f["evenness"]]


NAMES = ["ln(osc_quiet + 0.1)", "osc_share", "|ln ratio|", "evenness", "constant"]


def measure(tool, argument, label):
    scene, _, where = argument.partition("=")
    report = subprocess.run([tool, "audit", *where.split(","), "--json", "--quiet"], check=True, capture_output=True)
    return scene, label, [terms(i["features"]) for i in json.loads(report.stdout)["images"]]


def fit(sets):
    """Logistic regression on at most 20 photos a set; clean and poisoned weigh alike, and so do scenes within them."""
    rows = []
    for scene, label, photos in sets:
        some = photos[::max(1, len(photos) // 20)]
        alike = sum(s[0] == scene and s[1] == label for s in sets) * len({s[0] for s in sets if s[1] == label})
        rows += [(x, label, 1 / len(some) / alike) for x in some]
    total = sum(w for _, _, w in rows)
    n = len(rows[0][0])
    mean = [sum(x[k] * w for x, _, w in rows) / total for k in range(n)]
    size = [math.sqrt(sum((x[k] - mean[k]) ** 2 * w for x, _, w in rows) / total) for k in range(n)]
    rows = [([(x[k] - mean[k]) / size[k] for k in range(n)] + [1], y, w) for x, y, w in rows]
    weights = [0.0] * (n + 1)
    for _ in range(STEPS):
        slope = [DECAY * v for v in weights[:-1]] + [0]
        for x, y, w in rows:
            d = w * (1 / (1 + math.exp(-sum(a * b for a, b in zip(weights, x)))) - y)
            slope = [s + d * v for s, v in zip(slope, x)]
        weights = [v - RATE * s for v, s in zip(weights, slope)]
    raw = [weights[k] / size[k] for k in range(n)]
    return raw + [weights[n] - sum(raw[k] * mean[k] for k in range(n))]


def evidence(weights, x):
    return sum(a * b for a, b in zip(weights, x + [1]))


def area(clean, poisoned):
    ranked = sorted([(v, 0) for v in clean] + [(v, 1) for v in poisoned])
    ranks = sum(i + 1 for i, (_, y) in enumerate(ranked) if y)
    return (ranks - len(poisoned) * (len(poisoned) + 1) / 2) / len(poisoned) / len(clean)


def photos(weights, sets, label):
    return [evidence(weights, x) for _, y, found in sets for x in found if y == label]


def main():
    if sys.argv.count("--") != 1 or len(sys.argv) < 5:
        sys.exit(__doc__)
    tool, middle = sys.argv[1], sys.argv.index("--")
    sets = [measure(tool, a, 0) for a in sys.argv[2:middle]] + [measure(tool, a, 1) for a in sys.argv[middle + 1:]]
    weights = fit(sets)
    for name, w in zip(NAMES, weights):
        print(f"{name:20} {w:7.2f}")
    print(f"ROC AUC of single photos: {area(photos(weights, sets, 0), photos(weights, sets, 1)):.4f}")
    for scene in sorted({s[0] for s in sets}):
        own = [s for s in sets if s[0] == scene]
        if {s[1] for s in own} == {0, 1} and len({s[0] for s in sets}) > 1:
            rest = fit([s for s in sets if s[0] != scene])
            print(f"  of {scene}, left out of the fit: {area(photos(rest, own, 0), photos(rest, own, 1)):.4f}")


main()
