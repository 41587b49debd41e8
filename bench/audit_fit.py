#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fits the audit's weights (src/defense/audit_weights.h) and says how well they do on kinds and scenes left out.

    bench/audit_fit.py VARIANTS.npz COMMIT MACHINE [WEIGHTS.h]

VARIANTS.npz: from bench/audit_variants.py. Prints sentences and writes the tables of bench/results/audit.md, whose rows name COMMIT and
MACHINE; then scripts/tables. WEIGHTS.h: writes the weights, fitted to all. Needs NumPy.
"""
import sys

import numpy as np

HIDDEN = 8  # units of each network
STEPS, RATE, PENALTY = 200, 0.03, 6e-3  # of the squared weights, for rows whose weights add up to 1
AMPLITUDE_PENALTY = 2e-2
LIMIT = 4  # standard deviations to which features are cut
POISONED, SUSPICIOUS = np.log(9), np.log(1.5)  # logits of the scores 0.9 and 0.6
FIRST = 18  # statistic of texture in struct sg_audit_features; before it, the number of tiles
SCENES = ("lego", "bonsai", "train", "fox", "garden", "brighton")


def texture_names():
    for plane in ("luma", "luma/2", "luma/4", "red-green", "(red-green)/2", "blue-green", "(blue-green)/2"):
        luma = plane.startswith("luma")
        middle = ("50", "25", "75") if luma else ("50",)
        yield from (f"{plane} energy {q}" for q in ("10", "50", "90"))
        yield f"{plane} energy deviation"
        yield from (f"{plane} next {q}" for q in middle)
        yield f"{plane} second 50"
        yield from (f"{plane} evenness {q}" for q in middle)
        yield from (f"{plane} curvature evenness {q}" for q in middle)
        yield from (f"{plane} {what}" for what in ("direction 50", "direction deviation", "extremes 50"))
        yield from (f"{plane} oscillation {q}" for q in ("10", "50", "90"))
        if luma:
            yield from (f"{plane} bin {k}" for k in range(9))
            yield f"{plane} energy with brightness"
    yield from (f"range {q}" for q in ("2", "5", "10", "25", "50", "75"))
    yield from (f"closed range {q}" for q in ("10", "25", "50", "75"))
    yield from (f"open range {q}" for q in ("5", "25", "50"))
    yield from ("closed share", "open ends", "closed ends")


NAMES = list(texture_names())


SHARES = {"clean, noisy": 0.5, "noise": 0.7}  # of families, per row
COLUMNS = ("kind", "family", "form", "epsilon", "source", "photo", "area")


class Data:
    """The rows of some areas: 0 is the whole photo, 1 to 8 its halves and quarters."""

    def __init__(self, path, whole=True):
        d = np.load(path)
        x = d["features"]
        rows = (x[:, FIRST - 1] >= 2) & ((d["area"] == 0) == whole)
        for name in COLUMNS:
            setattr(self, name, d[name][rows])
        self.x = x[rows, FIRST:]
        down, across, share, noisy = x[rows][:, [2, 3, 4, 7]].T  # osc_down, osc_across, osc_share, noisy
        self.strong = 13.5 * share + 4.7 * np.abs(np.log((down + 0.5) / (across + 0.5))) + 9.7 * noisy
        self.poisoned = self.epsilon > 0
        self.fitted = ~np.char.startswith(self.family, "weak:") & (self.family != "spared")

    def groups(self):
        """What is left out together: each scene, and the kinds of photos in eight parts."""
        kinds = [k for k in sorted(set(self.kind)) if k not in SCENES]
        return [[s] for s in SCENES] + [kinds[i::8] for i in range(8)]

    def left_out(self, group):
        """Rows of these kinds, and rows that may be fitted without them and without their poison."""
        own = np.isin(self.kind, group)
        return own, self.fitted & ~own & ~np.isin(self.source, group)


def row_weights(d, rows):
    """Clean and poisoned weigh alike, and so do kinds within them; some families count more or less."""
    w = np.zeros(len(d.kind))
    for label in (False, True):
        kinds = set(d.kind[rows & (d.poisoned == label)])
        for kind in kinds:
            own = rows & (d.poisoned == label) & (d.kind == kind)
            part = np.array([SHARES.get(f, 1) for f in d.family[own]])
            w[own] = part / part.sum() / len(kinds) / 2
    return w[rows]


class Scale:
    def __init__(self, x):
        self.mean, self.size = x.mean(0), x.std(0) + 1e-6

    def __call__(self, x):
        return np.c_[np.clip((x - self.mean) / self.size, -LIMIT, LIMIT), np.ones(len(x))]


def network(x, y, w, penalty, slope_of):
    """Adam on all rows: sum w loss + penalty / 2 weights^2, for x V + tanh(x U) u; x's last column is the constant."""
    rng, n, x = np.random.default_rng(1), x.shape[1], x.astype(np.float32)
    weights = [rng.normal(0, n**-0.5, (n, HIDDEN)), rng.normal(0, HIDDEN**-0.5, HIDDEN), np.zeros(n)]
    weights[2][-1] = slope_of(None, y, w)
    first, second = ([np.zeros_like(v) for v in weights] for _ in range(2))
    for step in range(1, STEPS + 1):
        u, out, v = (a.astype(np.float32) for a in weights)
        h = np.tanh(x @ u)
        d = slope_of(h @ out + x @ v, y, w).astype(np.float32)
        slopes = [x.T @ (d[:, None] * out * (1 - h * h)), h.T @ d, x.T @ d]
        rate = RATE * min(1, 2 * (1 - step / STEPS) + 0.05)
        for k in range(3):
            shrunk = weights[k].copy()
            if k != 1:
                shrunk[-1] = 0  # constants are free
            slope = slopes[k] + penalty * shrunk
            first[k] = 0.9 * first[k] + 0.1 * slope
            second[k] = 0.99 * second[k] + 0.01 * slope**2
            weights[k] = weights[k] - rate * (first[k] / (1 - 0.9**step)) / (np.sqrt(second[k] / (1 - 0.99**step)) + 1e-8)
    return weights


def run(weights, x):
    return np.tanh(x @ weights[0]) @ weights[1] + x @ weights[2]


def logistic_slope(z, y, w):
    return 0 if z is None else w * (1 / (1 + np.exp(-np.clip(z, -30, 30))) - y)


def square_slope(z, y, w):
    return (w * y).sum() / w.sum() if z is None else w * (z - y) / w.sum()


def fit(d, rows):
    """Scale, network of the score, network of ln(tau)."""
    scale = Scale(d.x[rows])
    score = network(scale(d.x[rows]), d.poisoned[rows].astype(float), row_weights(d, rows), PENALTY, logistic_slope)
    rows = rows & d.poisoned
    return scale, score, network(scale(d.x[rows]), np.log(d.epsilon[rows]), row_weights(d, rows), AMPLITUDE_PENALTY, square_slope)


def bounded(tau):
    return np.clip(np.exp(tau), 4, 32)


def calibrate(d, z):
    """Slope and constant of the logit over z, so that scores are probabilities; Newton's method."""
    rows, v = d.fitted, np.zeros(2)
    x, y, w = np.c_[z[rows], np.ones(rows.sum())], d.poisoned[rows], row_weights(d, rows)
    for _ in range(25):
        p = 1 / (1 + np.exp(-np.clip(x @ v, -30, 30)))
        v = v - np.linalg.solve((x * (w * p * (1 - p))[:, None]).T @ x + 1e-9 * np.eye(2), x.T @ (w * (p - y)))
    return v


def highest(d, parts, z, tau, z_parts, tau_parts, offset):
    """The evidence of the photo or of its part with the most, and the amplitude there."""
    places = {key: i for i, key in enumerate(zip(d.kind, d.family, d.form, d.epsilon, d.source, d.photo))}
    z, tau = z.copy(), tau.copy()
    for i, key in enumerate(zip(parts.kind, parts.family, parts.form, parts.epsilon, parts.source, parts.photo)):
        k = places.get(key)
        if k is not None and z_parts[i] - offset > z[k]:
            z[k], tau[k] = z_parts[i] - offset, tau_parts[i]
    return z, tau


def area(clean, poisoned):
    """Share of the pairs in which the poisoned one is higher; equals count half."""
    both = np.sort(clean)
    low, high = np.searchsorted(both, poisoned, "left"), np.searchsorted(both, poisoned, "right")
    return (low + high).mean() / 2 / len(both) if len(both) and len(poisoned) else float("nan")


def table(name, head, rows, run):
    """Writes bench/results/NAME.tsv. run: the commit and the machine, columns of every row."""
    with open(f"bench/results/{name}.tsv", "w", encoding="utf-8") as f:
        f.write("\t".join((*head, "commit", "machine")) + "\n")
        for row in rows:
            cells = ("" if r != r else r if isinstance(r, str) else f"{r:.3f}" for r in row)
            f.write("\t".join((*cells, *run)) + "\n")


def quantile(values, part):
    """As src/defense/audit.c has it."""
    values = np.sort(values)
    return values[min(int(part * len(values) + 1e-9), len(values) - 1)]


def trimmed_mean(values):
    """As src/defense/audit.c has it."""
    n, place = len(values), np.arange(len(values))
    return (np.clip(np.minimum(place + 1, 0.8 * n) - np.maximum(place, 0.2 * n), 0, 1) * np.sort(values)).sum() / (0.6 * n)


def verdicts(d, rows, z, *keys):
    """Logit of each set: as src/defense/audit.c judges it."""
    label = np.array(["/".join(map(str, k)) for k in zip(*(key[rows] for key in keys))])
    sets = {}
    for name in sorted(set(label)):
        own = z[rows][label == name]
        sets[name] = max(trimmed_mean(own), quantile(own, 0.5) - 1)
    return sets


def tolerance(d, z, tau, own, error):
    """That of `--tolerance auto`, if it looked at these crops alone: of PNG, JPEG and half size."""
    for form in ("png", "jpeg", "half"):
        rows = own & (d.form == form) & (z > SUSPICIOUS)
        yield np.median(tau[rows]) * (1 + error) if rows.any() else 0


def report(d, z, tau, error, run):
    clean = d.family == "clean"
    sets = verdicts(d, clean, z, d.kind, d.form)
    print(f"Clean photos left out: {100 * (z[clean] > POISONED).mean():.1f} % called poisoned, "
          f"{100 * ((z[clean] > SUSPICIOUS) & (z[clean] <= POISONED)).mean():.1f} % suspicious. Clean sets (a kind in a form): "
          f"{sum(v > POISONED for v in sets.values())} of {len(sets)} poisoned, {sum(POISONED >= v > SUSPICIOUS for v in sets.values())} suspicious.\n")
    worst = sorted(((100 * (z[clean & (d.kind == k)] > POISONED).mean(), k) for k in set(d.kind[clean])), reverse=True)
    print("Clean sets called poisoned:", ", ".join(f"{k} {1 / (1 + np.exp(-v)):.2f}" for k, v in sets.items() if v > POISONED) or "none", "\n")
    cut = d.family == "clean, cut"
    print(f"Clean cut-outs: {100 * (z[cut] > POISONED).mean():.1f} % called poisoned, {100 * ((z[cut] > SUSPICIOUS) & (z[cut] <= POISONED)).mean():.1f} % suspicious.\n")
    print("Kinds with clean photos called poisoned:", ", ".join(f"{k} {v:.0f} %" for v, k in worst if v > 0), "\n")
    rows = []
    real = np.char.startswith(d.family, "set:")
    for name, family in (("sets left out", real), ("transplants", d.family == "transplant"), ("own ascent", d.family == "tv"),
                         ("noise", d.family == "noise"), ("cut-outs", d.family == "transplant, cut"), ("spared", d.family == "spared")):
        for epsilon in (8, 16, 24):
            own = family & (d.epsilon == epsilon)
            if own.any():
                middle = verdicts(d, own, z, d.kind, d.family, d.form)
                rows.append((name, str(epsilon), area(np.array(list(sets.values())), np.array(list(middle.values()))), area(z[clean], z[own]),
                             *(area(z[clean & (d.form == f)], z[own & (d.form == f)]) for f in ("png", "jpeg", "half", "half-jpeg")),
                             (z[own] > POISONED).mean(), np.median(tau[own]), (np.abs(tau[own] - epsilon) <= 4).mean()))
    table("audit-poisons", ("poison", "epsilon", "AUC sets", "AUC photos", "PNG", "JPEG 75", "half size", "half, JPEG", "called poisoned", "tau, median", "within 4"), rows, run)
    rows = []
    for name in sorted(set(f for f in d.family if f.startswith(("set:", "weak:")))):
        own = d.family == name
        same = clean & (d.kind == d.kind[own][0])
        rows.append((name.removeprefix("set:"), area(z[clean], z[own]), area(z[same], z[own]), (z[own] > POISONED).mean(), (z[own] > SUSPICIOUS).mean(),
                     *(f"{v:.1f}" for v in tolerance(d, z, tau, own, error))))
    table("audit-sets", ("set left out", "AUC, all clean", "AUC, own clean", "poisoned", "not clean", "tolerance, PNG", "JPEG 75", "half size"), rows, run)
    p = 1 / (1 + np.exp(-z))
    w = row_weights(d, np.ones(len(z), bool) & d.fitted)
    p, y = p[d.fitted], d.poisoned[d.fitted]
    rows = []
    for low, high in ((0, .1), (.1, .3), (.3, .6), (.6, .9), (.9, .97), (.97, 1.01)):
        own = (p >= low) & (p < high)
        rows.append((f"{low} to {min(high, 1)}", (w * p)[own].sum() / w[own].sum(), (w * y)[own].sum() / w[own].sum(), str(own.sum())))
    table("audit-scores", ("score", "mean", "share poisoned", "photos"), rows, run)


def main():
    if len(sys.argv) not in (4, 5):
        sys.exit(__doc__)
    d, parts = Data(sys.argv[1]), Data(sys.argv[1], False)
    assert d.x.shape[1] == len(NAMES)
    z, tau, z_parts, tau_parts = (np.zeros(len(rows.kind)) for rows in (d, d, parts, parts))
    for group in d.groups():
        own, rows = d.left_out(group)
        scale, score, amplitude = fit(d, rows)
        for data, logit, levels in ((d, z, tau), (parts, z_parts, tau_parts)):
            own = np.isin(data.kind, group)
            x = scale(data.x[own])
            logit[own], levels[own] = run(score, x), bounded(run(amplitude, x))
    slope, constant = calibrate(d, z)
    z, z_parts = slope * z + constant, slope * z_parts + constant
    offset = part_offset(d, parts, z, z_parts)
    z, tau = highest(d, parts, z, tau, z_parts, tau_parts, offset)
    strong = POISONED - np.quantile(d.strong[d.family == "clean"], 0.995)
    z = np.maximum(z, d.strong + strong)
    own = d.fitted & d.poisoned & (z > SUSPICIOUS)
    w = row_weights(d, own)
    error = np.sqrt((w * (np.log(tau[own]) - np.log(d.epsilon[own])) ** 2).sum() / w.sum())
    report(d, z, tau, error, sys.argv[2:4])
    print(f"Standard error of ln(tau) of photos left out that are not called clean: {error:.2f}. Calibration: {slope:.2f} z {constant:+.2f}. "
          f"Offset of parts: {offset:.2f}. Gross oscillation: {strong:+.2f}.\n")
    if len(sys.argv) == 5:
        scale, score, amplitude = fit(d, d.fitted)
        score[1], score[2] = slope * score[1], slope * score[2]
        score[2][-1] += constant
        write(sys.argv[4], scale, score, amplitude, offset, strong, error)


def part_offset(d, parts, z, z_parts):
    """With which parts make 5 of 1000 clean photos poisoned that are not so as a whole."""
    worst, _ = highest(d, parts, np.full(len(z), -30.0), z, z_parts, z_parts, 0)
    clean = (d.family == "clean") & (worst > -30) & (z < POISONED)
    return max(0, np.quantile(worst[clean], 0.995) - POISONED)


def write(path, scale, score, tau, offset, strong, error):
    def column(v):
        return ", ".join(f"{a:.5f}f" for a in v)

    with open(path, "w", encoding="utf-8") as f:
        f.write("/* SPDX-License-Identifier: Apache-2.0 */\n/* Made by bench/audit_fit.py. */\n#ifndef SG_DEFENSE_AUDIT_WEIGHTS_H\n"
                "#define SG_DEFENSE_AUDIT_WEIGHTS_H\n\n/* Statistics are cut to this many deviations from their mean. */\n"
                f"#define SG_AUDIT_LIMIT {LIMIT}.0\n\n/* Hidden units of each of the two networks: that of the score's logit and that of ln(tau). */\n"
                f"#define SG_AUDIT_HIDDEN {HIDDEN}\n\n/* What a part of a photo needs more than a whole one. */\n#define SG_AUDIT_PART_OFFSET {offset:.3f}\n\n"
                f"/* Added to the evidence of gross oscillation, of which 5 in 1000 clean photos have so much. */\n#define SG_AUDIT_STRONG_CONSTANT {strong:.3f}\n\n"
                f"/* Standard error of ln(tau). */\n#define SG_AUDIT_TAU_ERROR {error:.3f}\n\n"
                "/* A network: constant, constants and weights of the hidden units. */\nstatic const struct {\n    float constant, hidden[SG_AUDIT_HIDDEN], out[SG_AUDIT_HIDDEN];\n"
                "} sg_audit_networks[2] = {\n    /* clang-format off */\n")
        for n in (score, tau):
            f.write(f"    {{{n[2][-1]:.5f}f, {{{column(n[0][-1])}}},\n     {{{column(n[1])}}}}},\n")
        f.write("    /* clang-format on */\n};\n\n/* Of each statistic: its mean and deviation; for each network its direct weight and those to the\n * hidden units. */\n"
                "static const struct {\n    float mean, deviation;\n    struct {\n        float direct, hidden[SG_AUDIT_HIDDEN];\n    } network[2];\n"
                "} sg_audit_weights[] = {\n    /* clang-format off */\n")
        for i, name in enumerate(NAMES):
            f.write(f"    /* {name} */\n    {{{scale.mean[i]:.6f}f, {scale.size[i]:.6f}f,\n     {{{{{score[2][i]:.5f}f, {{{column(score[0][i])}}}}},\n"
                    f"      {{{tau[2][i]:.5f}f, {{{column(tau[0][i])}}}}}}}}},\n")
        f.write("    /* clang-format on */\n};\n\n#endif\n")


if __name__ == "__main__":
    main()
