# SPDX-License-Identifier: Apache-2.0
"""view_training.py FILE look|stop [--anchors]: a page of `splatguard train --view`, whose address FILE gets, without a
browser."""
import json
import os
import socket
import sys
import time
import urllib.error
import urllib.request

path, what, anchors = sys.argv[1], sys.argv[2], "--anchors" in sys.argv


def get(name, post=False):
    with urllib.request.urlopen(urllib.request.Request(address + name, b"" if post else None), timeout=30) as answer:
        return answer.read()


def state():
    return json.loads(get("state"))


def until(done, what):
    end = time.monotonic() + 60
    while True:
        try:
            if done():
                return
        except urllib.error.HTTPError as error:  # it is being loaded
            if error.code != 503:
                raise
        assert time.monotonic() < end, what
        time.sleep(0.02)


def picture(kind, view):
    v = scene["views"][view]
    pose = "&".join("%s=%r" % x for x in zip(("qw", "qx", "qy", "qz", "tx", "ty", "tz"), v["q"] + v["t"]))
    return get("picture?kind=%d&view=%d&scale=1&still=1&%s" % (kind, view, pose))


with open("looker", "w") as file:
    file.write("is ready")
until(lambda: os.path.exists(path) and os.path.getsize(path), "no address")
with open(path) as file:
    address = file.read().strip()
get("pause", post=True)
until(lambda: state()["paused"], "it does not pause")
scene = json.loads(get("scene"))
assert scene["training"] and scene["model"] and len(scene["views"]) > 4
paused = state()
assert 1 <= paused["iteration"] < paused["iterations"] and paused["gaussians"] > 0 and paused["loss"] > 0 and paused["memory"] > 1 << 20, paused
first = picture(0, 0)
assert bool(scene["scores"]) == bool(scene["next"]) == (not anchors), scene
for kind in () if anchors else (5, 6, 7):
    scores = picture(kind, 0)
    assert scores[:4] == b"\x89PNG" and scores != first and scores == picture(kind, 0), "scores of kind %d" % kind
assert first[:4] == b"\x89PNG" and first == picture(0, 0), "the model moves while it is paused"
time.sleep(0.5)
assert state()["iteration"] == paused["iteration"]
if what == "stop":
    get("stop", post=True)
    sys.exit()

# Strangers, and pictures of all kinds, while it goes on.
place = address.split("/")[2].split(":")
strangers = [socket.create_connection((place[0], int(place[1]))) for _ in range(220)]
for s in strangers[:20]:
    s.sendall(b"GET / HTTP/1.1\r\nX: ")
get("go", post=True)
last, drawn = paused["iteration"], 0
try:
    while True:
        now = state()
        assert not now["paused"] or now["iteration"] == paused["iteration"]
        last = max(last, now["iteration"])
        picture(drawn % (5 if anchors else 8), drawn % len(scene["views"]))
        drawn += 1
except urllib.error.HTTPError as error:  # of pictures that cannot be drawn, unless the training is over
    end = time.monotonic() + 5
    try:
        while time.monotonic() < end:
            state()
            time.sleep(0.05)
        raise AssertionError("the training goes on without pictures") from error
    except (urllib.error.URLError, OSError, ValueError):
        pass
except (urllib.error.URLError, OSError, ValueError):
    pass
assert drawn > 3 and last > paused["iteration"], (drawn, last)
print("%d pictures until iteration %d" % (drawn, last))
