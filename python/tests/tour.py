# SPDX-License-Identifier: Apache-2.0
"""Runs the cells of docs/python-tour.md.

    python3 python/tests/tour.py            writes what they print below them, and their pictures
    python3 python/tests/tour.py --check    fails where they print something else, up to 15 % of a number

A cell is a block of python; the block of text and the picture below it are what it made.
"""
import ast
import contextlib
import io
import os
import re
import struct
import sys
import zlib

try:
    import numpy
except ImportError as error:
    print(f"tour skipped: {error}; scripts/setup python installs it")
    sys.exit(77)

ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))
PAGE = os.path.join(ROOT, "docs", "python-tour.md")
CELL = re.compile(r"```python\n(.*?)```\n(\n```text\n(.*?)```\n)?(\n!\[[^\n]*\n)?", re.S)
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def png(rows):
    """rows: height x width x 3 bytes."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(
            ">I", zlib.crc32(kind + data))
    height, width, _ = rows.shape
    lines = b"".join(b"\0" + row.tobytes() for row in rows)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(lines, 9)) + chunk(b"IEND", b""))


def run(code, names):
    """What the cell prints; the value of a last expression is printed as in a notebook."""
    tree = ast.parse(code)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(tree, PAGE, "exec"), names)
        if last:
            value = eval(compile(ast.Expression(last.value), PAGE, "eval"), names)
            if value is not None:
                print(repr(value))
    return out.getvalue()


def alike(found, expected):
    numbers = [[float(x) for x in NUMBER.findall(s)] for s in (found, expected)]
    return NUMBER.sub("#", found) == NUMBER.sub("#", expected) and all(
        abs(a - b) <= 0.15 * max(abs(b), 1) for a, b in zip(*numbers))


def tour(check, folder=os.path.join(ROOT, "docs", "images")):
    """Returns the differences as texts. Without `check` the page is written."""
    made, differences = [], []

    def show(name, images):
        """Pictures side by side, for the page."""
        if not check:
            with open(os.path.join(folder, name + ".png"), "wb") as f:
                f.write(png(numpy.concatenate(images, 1)))
        made.append(name)

    def fill(match):
        del made[:]
        printed = run(match[1], names)
        if check and not alike(printed, match[3] or ""):
            differences.append("found\n%s\nexpected\n%s" % (printed, match[3]))
        return ("```python\n" + match[1] + "```\n" + ("\n```text\n" + printed + "```\n" if printed else "")
                + "".join("\n![%s](images/%s.png)\n" % (n.replace("-", ", "), n) for n in made))

    names = {"show": show}
    with open(PAGE, encoding="utf-8") as f:
        text = f.read()
    filled = CELL.sub(fill, text)
    if not check:
        with open(PAGE, "w", encoding="utf-8") as f:
            f.write(filled)
    return differences


if __name__ == "__main__":
    if sys.argv[1:] not in ([], ["--check"]):
        sys.exit(__doc__)
    sys.exit("\n".join(tour(bool(sys.argv[1:]))) or 0)
