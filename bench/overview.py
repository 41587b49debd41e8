#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Sets measurements side by side.

    bench/overview.py

From bench/results/evening.tsv it writes evening-PHOTOS.tsv for each kind of photos: a row is a defense, a column a
scene, whose cells are the most Gaussians as a multiple of clean training, PSNR and SSIM. The best values of a column
are bold. From tolerance.tsv it writes tolerance-back.tsv: a row is a poisoned set, a column a defense, whose cells are
the shares of the lost PSNR and SSIM that come back, and the Gaussians as a multiple of clean training. From desk.tsv
it writes desk-back.tsv: a row is a defense, a column a kind of photos, whose cells are the shares of the lost PSNR, of
that on the object and of the SSIM, and the most Gaussians as a multiple of clean training; or what is lost, for clean
photos and without a defense. From desk.tsv and desk-limits.tsv it writes desk-budgets.tsv: a row is who stays, a column
a kind of photos and a limit, whose cells are the PSNR, that on the object and the SSIM."""
import csv
import os

RESULTS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "results")


def unique(values):
    return list(dict.fromkeys(values))


def marked(text):
    return f"**{text[1:]}**" if text.startswith("*") else text


def read(name):
    with open(os.path.join(RESULTS, name), newline="") as f:
        return list(csv.DictReader(f, delimiter="\t"))


def write_evening():
    rows = read("evening.tsv")
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


def write_tolerance():
    rows = read("tolerance.tsv")
    groups = {}
    for r in rows:
        groups.setdefault((r["scene"], r["size"], r["photos"]), {})[r["defense"].split(",")[0]] = r
    with open(os.path.join(RESULTS, "tolerance-back.tsv"), "w") as out:
        print("scene", "size", "photos", "undefended", "the paper's preset", "bilateral smoothing", "auto",
              sep="\t", file=out)
        for (scene, size, photos), of in groups.items():
            if "clean" in photos or "none" not in of:
                continue
            seed = ", ".join(["clean"] + [p for p in photos.split(", ") if p.startswith("seed")])
            clean = groups.get((scene, size, seed)) or groups[scene, size, "clean"]

            def cell(defense):
                r = of.get(defense)
                if not r:
                    return ""
                times = f"{int(r['Gaussians, end'].lstrip('*')) / int(clean['none']['Gaussians, end']):.2f}"
                back = [r[k].lstrip("*") or "-" for k in ("given back: PSNR, %", "SSIM, %")]
                return times if defense == "none" else "; ".join([*back, times])

            preset = next((d for d in of if d in ("ns", "mip", "tt")), "")
            print(scene, size, photos, *(cell(d) for d in ("none", preset, "bilateral smoothing", "auto")),
                  sep="\t", file=out)


VIEWS = ["PSNR, dB", "object PSNR, dB", "SSIM"]


def views(row):
    return [float(row[column].lstrip("*")) for column in VIEWS]


def tail(rows):
    return [", ".join(unique(r[column] for r in rows)) for column in ("commit", "machine")]


def write_desk_back(rows):
    kinds = unique(r["photos"] for r in rows if r["photos"] != "clean")
    of = {(r["scene"], r["photos"], r["defense"]): r for r in rows}
    with open(os.path.join(RESULTS, "desk-back.tsv"), "w") as out:
        print("scene", "defense", "clean", *kinds, "commit", "machine", sep="\t", file=out)
        for scene, defense in unique((r["scene"], r["defense"]) for r in rows):
            clean = views(of[scene, "clean", "off"])

            def cell(photos):
                row, off = of.get((scene, photos, defense)), of.get((scene, photos, "off"))
                if not row or not off:
                    return ""
                lost = [c - v for c, v in zip(clean, views(off))]
                if photos == "clean" or defense == "off":
                    psnr, only, ssim = (v - c for v, c in zip(views(row), clean))
                    text = f"{psnr:+.2f} / {only:+.2f} dB / {ssim:+.3f}"
                else:
                    text = " / ".join(str(round(100 * (v - o) / n)) for v, o, n in zip(views(row), views(off), lost)) + " %"
                best = "*" if row["PSNR, dB"].startswith("*") else ""
                return f"{best}{text}; {row['of clean']}"

            print(scene, defense, *(cell(p) for p in ("clean", *kinds)),
                  *tail([r for r in rows if (r["scene"], r["defense"]) == (scene, defense)]), sep="\t", file=out)


LIMITS = ["1.00", "0.50", "0.25"]
WAYS = {"universal threshold": ("ut-clean", "", ""),
        "filter's score": ("cap", "half", "quarter"),
        "at random": ("cap-random", "half-random", "quarter-random"),
        "MCMC": ("mcmc", "half-mcmc", "quarter-mcmc"),
        "LightGaussian, after training": ("full-lightgaussian", "half-lightgaussian", "quarter-lightgaussian"),
        "PUP 3D-GS, after training": ("full-pup", "half-pup", "quarter-pup"),
        "`auto`, filter's score": ("full-auto", "half-auto", "quarter-auto")}


def limited(of, photos, name):
    """The row of a run with a limit. A limit that a run does not reach by itself changes nothing."""
    auto = of.get((photos, "auto"))
    if name == "full-auto" and auto and float(auto["of clean"]) <= 1:
        return auto
    return of.get((photos, name))


def write_desk_budgets(rows):
    kinds = unique(r["photos"] for r in rows)
    of = {(r["photos"], r["defense"]): r for r in rows if r["scene"] == "lego"}
    with open(os.path.join(RESULTS, "desk-budgets.tsv"), "w") as out:
        print("who stays", *(f"{p}, {limit}" for p in kinds for limit in LIMITS), "commit", "machine", sep="\t",
              file=out)
        for way, names in WAYS.items():
            cells = [limited(of, p, name) for p in kinds for name in names]
            if not any(cells):
                continue
            print(way, *(" / ".join(r[c].lstrip("*") for c in VIEWS) if r else "" for r in cells),
                  *tail([r for r in cells if r]), sep="\t", file=out)


def write_desk():
    rows = read("desk.tsv")
    write_desk_back(rows)
    limits = read("desk-limits.tsv")
    kinds = {r["photos"] for r in limits}
    write_desk_budgets([r for r in rows if r["photos"] in kinds] + limits)


def main():
    write_evening()
    write_tolerance()
    write_desk()


if __name__ == "__main__":
    main()
