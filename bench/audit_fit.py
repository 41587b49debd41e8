#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fits weights of the audit's score (src/defense/audit.c) and says how well they do on scenes left out.

    bench/audit_fit.py whole|part TOOL SCENE=CLEAN... -- SCENE=POISONED...

whole: the weights for photos that are poisoned as a whole, to be given such; part: those for strong poisons, spared parts or
not. SCENE names what is left out together; CLEAN and POISONED are folders, with options after a comma:
lego=lego,--downscale,2; or what `audit --json` has printed, in NAME.json.
"""
import json
import math
import subprocess
import sys
from bisect import bisect_left, bisect_right

STEPS, RATE, DECAY = 1500, 0.5, 0.003


def log_of(name):
    return lambda f: math.log(f[name] + 0.1)


def log_ratio(f):
    return abs(math.log((f["osc_down"] + 0.5) / (f["osc_across"] + 0.5)))


TERMS = {
    "whole": {
        "ln(half_quiet + 0.1)": log_of("half_quiet"),
        "ln(half_osc + 0.1)": log_of("half_osc"),
        "ln(quarter_osc + 0.1)": log_of("quarter_osc"),
        "half_share": lambda f: f["half_share"],
        "quarter_share": lambda f: f["quarter_share"],
        "|ln ratio|": log_ratio,
    },
    "part": {
        "osc_share": lambda f: f["osc_share"],
        "|ln ratio|": log_ratio,
        "noisy": lambda f: f["noisy"],
    },
}


def measure(terms, tool, argument, label):
    scene, _, where = argument.partition("=")
    if where.endswith(".json"):
        with open(where, encoding="utf-8") as f:
            report = f.read()
    else:
        command = [tool, "audit", *where.split(","), "--json", "--quiet"]
        report = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    return scene, label, [[term(i["features"]) for term in terms.values()] for i in json.loads(report)["images"]]


def fit(sets):
    """Logistic regression on at most 20 photos a set; clean and poisoned weigh alike, and so do scenes within them."""
    rows = []
    for scene, label, photos in sets:
        some = photos[::-(-len(photos) // 20)]
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
    """Share of the pairs in which the poisoned one is higher; equals count half."""
    clean = sorted(clean)
    return sum(bisect_left(clean, v) + bisect_right(clean, v) for v in poisoned) / 2 / len(poisoned) / len(clean)


def photos(weights, sets, label):
    return [evidence(weights, x) for _, y, found in sets for x in found if y == label]


def main():
    if sys.argv.count("--") != 1 or len(sys.argv) < 6 or sys.argv[1] not in TERMS:
        sys.exit(__doc__)
    terms, tool, middle = TERMS[sys.argv[1]], sys.argv[2], sys.argv.index("--")
    sets = [measure(terms, tool, a, 0) for a in sys.argv[3:middle]]
    sets += [measure(terms, tool, a, 1) for a in sys.argv[middle + 1:]]
    weights = fit(sets)
    for name, w in zip([*terms, "constant"], weights):
        print(f"{name:20} {w:7.2f}")
    print(f"ROC AUC of single photos: {area(photos(weights, sets, 0), photos(weights, sets, 1)):.4f}")
    for scene in sorted({s[0] for s in sets}):
        own = [s for s in sets if s[0] == scene]
        others = [s for s in sets if s[0] != scene]
        if {s[1] for s in own} == {s[1] for s in others} == {0, 1}:
            rest = fit(others)
            print(f"  of {scene}, left out of the fit: {area(photos(rest, own, 0), photos(rest, own, 1)):.4f}")


main()
