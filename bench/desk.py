#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Puts the runs of the plan desk that a database has into bench/results/desk*.tsv.

    bench/desk.py DB MACHINE DATA

DB: of `splatguard bench bench/plans/desk.json`, or of a plan with a part of its runs. MACHINE: its name in
machines.tsv. DATA: the folder of the scenes. A row is the mean over the seeds of a scene, kind of photos and defense;
it replaces the row that the file has. The PSNR on the object is that of bench/object.py, of Blender scenes. Memory is
that of the training, unless it was stopped and continued. * marks the best views of poisoned photos."""
import csv
import json
import os
import sqlite3
import subprocess
import sys

from overview import RESULTS, VIEWS

HERE = os.path.dirname(os.path.abspath(__file__))
FILES = ["desk", "desk", "desk-limits", "desk-ablations", "desk-attackers"]  # of each block of the plan's runs
COLUMNS = ["scene", "photos", "defense", "seeds", "Gaussians, most", "of clean", "Gaussians, end", *VIEWS, "memory, MB",
           "commit", "machine"]


def path_of(file):
    return os.path.join(RESULTS, file + ".tsv")


def name_of(row):
    return row["scene"], row["photos"], row["defense"]


def read_rows(file):
    if not os.path.exists(path_of(file)):
        return {}
    with open(path_of(file), newline="") as f:
        return {name_of(r): r for r in csv.DictReader(f, delimiter="\t")}


def runs_of(db):
    """The metrics of the runs that are done, by scene, photos and defense."""
    groups = {}
    for key, kind, commit, *name in db.execute(
            "SELECT DISTINCT j.key, j.kind, j.commit_id, c.scene, c.photos, c.defense FROM job j JOIN cell c"
            " ON c.key = j.key WHERE j.status = 'done' AND j.kind IN ('train', 'prune') ORDER BY c.seed"):
        run = dict(db.execute("SELECT name, value FROM metric WHERE key = ?", (key,)))
        run["commit"] = commit[:7]
        run["model"] = os.path.join(key, "model.ply" if kind == "prune" else "run")
        groups.setdefault(tuple(name), []).append(run)
    return groups


def row_of(name, runs, clean, machine):
    def mean(metric, form, unit=1):
        values = [r.get(metric) for r in runs]
        return "" if None in values else form % (sum(values) / len(values) / unit)

    if any(r.get("steps") != r.get("iterations") for r in runs):
        for r in runs:
            r.pop("peak_ledger_bytes", None)
    return dict(zip(COLUMNS, [
        *name, str(len(runs)), mean("max_gaussians", "%d"), mean("max_gaussians", "%.2f", clean),
        mean("final_gaussians", "%d"), mean("eval.psnr", "%.2f"), mean("object", "%.2f"), mean("eval.ssim", "%.3f"),
        mean("peak_ledger_bytes", "%.0f", 1e6), ", ".join(dict.fromkeys(r["commit"] for r in runs)), machine]))


def is_same(row, known):
    return known and all(row[c] == known[c].lstrip("*") for c in COLUMNS if c != "object PSNR, dB")


def measure_objects(scene, folder, work, groups):
    """Adds the PSNR on the object to runs of a scene."""
    size = scene.get("size", ["--downscale", "1"])
    runs = [r for of in groups for r in of]
    if not runs or not os.path.exists(os.path.join(folder, "transforms_test.json")):
        return
    lines = subprocess.run([sys.executable, os.path.join(HERE, "object.py"), folder,
                            size[size.index("--downscale") + 1], *(os.path.join(work, r["model"]) for r in runs)],
                           check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    for run, line in zip(runs, lines):
        run["object"] = float(line.split("\t")[-1])


def mark(rows):
    for group in {name_of(r)[:2] for r in rows if r["photos"] != "clean"}:
        of = [r for r in rows if name_of(r)[:2] == group]
        for column in VIEWS:
            for r in of:
                r[column] = r[column].lstrip("*")
            best = max((float(r[column]) for r in of if r[column]), default=None)
            for r in of:
                if r[column] and float(r[column]) == best:
                    r[column] = "*" + r[column]


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    db, machine, data = sys.argv[1:]
    with open(os.path.join(HERE, "plans", "desk.json")) as f:
        plan = json.load(f)
    files = {file: read_rows(file) for file in dict.fromkeys(FILES)}
    groups = runs_of(sqlite3.connect(f"file:{db}?mode=ro", uri=True))
    clean = {s: float(r["Gaussians, most"]) for (s, *of), r in files[FILES[0]].items() if of == ["clean", "off"]}
    clean |= {s: sum(r["max_gaussians"] for r in runs) / len(runs)
              for (s, *of), runs in groups.items() if of == ["clean", "off"]}
    changed = {}
    for name, runs in groups.items():
        block = next((i for i, b in enumerate(plan["runs"]) if name[1] in b["photos"] and name[2] in b["defenses"]), -1)
        if block < 0 or name[0] not in clean:
            sys.exit(f"{db}: found a run of {', '.join(name)}, expected runs of the plan desk, with clean, off of a scene")
        if not is_same(row_of(name, runs, clean[name[0]], machine), files[FILES[block]].get(name)):
            changed[name] = files[FILES[block]]
    for scene, of in plan["scenes"].items():
        measure_objects(of, os.path.join(data, of["path"]), db + ".work",
                        [groups[name] for name in changed if name[0] == scene])
    for name, rows in changed.items():
        rows[name] = row_of(name, groups[name], clean[name[0]], machine)
    order = [list(plan[part]) for part in ("scenes", "photos", "defenses")]
    for file, rows in files.items():
        if not rows:
            continue
        of = [rows[k] for k in sorted(rows, key=lambda k: [o.index(part) for o, part in zip(order, k)])]
        mark(of)
        with open(path_of(file), "w", newline="") as f:
            out = csv.DictWriter(f, COLUMNS, delimiter="\t", lineterminator="\n")
            out.writeheader()
            out.writerows(of)


main()
