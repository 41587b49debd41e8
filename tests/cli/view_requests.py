# SPDX-License-Identifier: Apache-2.0
"""view_requests.py ADDRESS PID RENDERS SCENE: what the server of `splatguard view` answers, over plain sockets.
view_requests.py ADDRESS --draws: whether the picture of the first camera has something in it.
view_requests.py ADDRESS --anchors RENDERS: the pictures of anchors, which have no scores."""
import json
import re
import socket
import struct
import sys
import time
import zlib

address = sys.argv[1]
port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/([0-9a-f]{32})/\n?", address).groups()
here = "127.0.0.1:" + port


def ask(path, method="GET", host=here, headers="", body=b""):
    """Status, headers, body."""
    s = socket.create_connection(("127.0.0.1", int(port)), timeout=20)
    host = "Host: %s\r\n" % host if host is not None else ""
    s.sendall(("%s %s HTTP/1.1\r\n%s%sConnection: close\r\n\r\n" % (method, path, host, headers)).encode() + body)
    answer = b""
    try:
        while piece := s.recv(1 << 16):
            answer += piece
    except ConnectionResetError:
        pass
    s.close()
    head, _, rest = answer.partition(b"\r\n\r\n")
    return (int(head.split()[1]) if head else 0), head.decode().lower(), rest


def page(name, **more):
    return ask("/%s/%s" % (token, name), **more)


def decode(png):
    """Width, height and the rows of an 8-bit RGB PNG."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    at, data, width, height = 8, b"", 0, 0
    while at < len(png):
        n, kind = struct.unpack(">I4s", png[at:at + 8])
        if kind == b"IHDR":
            width, height = struct.unpack(">II", png[at + 8:at + 16])
            assert png[at + 16:at + 18] == b"\x08\x02", "not 8-bit RGB"
        if kind == b"IDAT":
            data += png[at + 8:at + 8 + n]
        at += 12 + n
    data, rows, before = zlib.decompress(data), [], bytearray(3 * width)
    for y in range(height):
        kind, row = data[y * (3 * width + 1)], bytearray(data[y * (3 * width + 1) + 1:(y + 1) * (3 * width + 1)])
        for x in range(3 * width):
            a, b, c = (row[x - 3], before[x], before[x - 3]) if x >= 3 else (0, before[x], 0)
            p = a + b - c
            paeth = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[x] = row[x] + (0, a, b, (a + b) // 2, paeth)[kind] & 255
        rows.append(bytes(row))
        before = row
    return width, height, b"".join(rows)


def picture(kind, view, still=1, scale=1, at=None):
    v = scene["views"][view]
    pose = dict(zip(("qw", "qx", "qy", "qz", "tx", "ty", "tz"), (at or v["q"]) + v["t"]))
    query = dict(kind=kind, view=view, scale=scale, still=still, **pose)
    return page("picture?" + "&".join("%s=%r" % item for item in query.items()))


def drawn(kind, view):
    status, head, png = picture(kind, view)
    assert status == 200 and "content-type: image/png" in head, (status, head)
    return decode(png)


def compare_renders(renders):
    """The pictures are those of `render`."""
    for i, view in enumerate(scene["views"]):
        ours, theirs = drawn(0, i), decode(open("%s/%s/%s.png" % (renders, view["split"], view["name"]), "rb").read())
        off = [abs(a - b) for a, b in zip(ours[2], theirs[2])]
        assert ours[:2] == theirs[:2] and max(off) <= 1 and sum(off) < 1e-3 * len(off), (view["name"], max(off), sum(off) / len(off))


scene = json.loads(page("scene")[2])
if sys.argv[2] == "--draws":
    assert len(set(drawn(0, 0)[2])) > 10, "an empty picture"
    sys.exit()
if sys.argv[2] == "--anchors":
    assert scene["model"] and not scene["scores"] and not scene["next"], scene
    compare_renders(sys.argv[3])
    photo, render, difference = drawn(4, 0)[2], drawn(0, 0)[2], drawn(3, 0)[2]
    assert all(abs(min(255, 4 * abs(a - b)) - c) <= 4 for a, b, c in zip(photo, render, difference)), "another difference"
    assert len(set(drawn(1, 0)[2])) > 10 and len(set(drawn(2, 0)[2])) > 10, "no depth or no alpha"
    assert [picture(kind, 0)[0] for kind in (5, 6, 7)] == [503] * 3, "scores of anchors"
    assert picture(0, 0)[0] == 200, "nothing is drawn any more"
    sys.exit()
pid, renders, folder = sys.argv[2:]

# Who is let in.
assert page("")[0] == 200
assert ask("/")[0] == 403
assert ask("/" + token)[0] == 403
wrong = token[:-1] + ("0" if token[-1] != "0" else "1")
for name in ("", "view.js", "scene", "picture", "model.ply", "none"):
    assert ask("/%s/%s" % (wrong, name))[0] == 403, name
    assert page(name, host="evil.example:" + port)[0] == 403, name
    assert page(name, host="127.0.0.1")[0] == 403, name
    assert page(name, headers="Origin: http://evil.example\r\n")[0] == 403, name
    assert page(name, headers="Origin: null\r\n")[0] == 403, name
    assert page(name, headers="Host: %s\r\n" % here)[0] in (400, 403), name
assert page("", host=None)[0] in (400, 403)
assert page("", host="localhost:" + port)[0] == 200
assert page("", headers="Origin: http://%s\r\n" % here)[0] == 200
assert page("pause", method="POST", headers="Content-Length: 0\r\nOrigin: http://evil.example\r\n")[0] == 403
assert page("none")[0] == 404
assert page("", method="PUT", headers="Content-Length: 0\r\n")[0] == 405
assert page("../%s/" % token)[0] == 404
assert page("pause", method="POST", headers="Content-Length: 3\r\n", body=b"abc")[0] == 0, "a body was taken"
head = page("")[1]
for line in ("content-security-policy: default-src 'none';", "x-content-type-options: nosniff", "referrer-policy: no-referrer",
             "cache-control: no-store"):
    assert line in head, line
assert "unsafe" not in head and "http:" not in head
for name in ("", "view.js", "view.css", "page.css"):
    assert not re.search(rb"(src|href)=.?(https?:|//)|@import|url\(", page(name)[2]), name

# The pictures are those of `render`, and the photos those of the scene.
compare_renders(renders)
photo, render, difference = drawn(4, 0)[2], drawn(0, 0)[2], drawn(3, 0)[2]
assert len(set(photo)) > 10
for a, b, c in zip(photo, render, difference):
    assert abs(min(255, 4 * abs(a - b)) - c) <= 4, (a, b, c)
assert len(set(drawn(1, 0)[2])) > 10 and len(set(drawn(2, 0)[2])) > 10, "no depth or no alpha"
# Scores: other colours than hits, and red is what the filter would remove, the rest is grey.
assert scene["scores"] and scene["next"]
score, hits, gone = drawn(5, 0)[2], drawn(6, 0)[2], drawn(7, 0)[2]
assert len(set(score)) > 10 and score != hits and gone != render
assert score == drawn(5, 0)[2] and hits == drawn(6, 0)[2]
red = []
for i in range(len(scene["views"])):
    pixels = list(zip(*[iter(drawn(7, i)[2])] * 3))
    assert all(abs(g - b) <= 1 and r >= g - 1 for r, g, b in pixels)
    red.append(sum(r > g + 20 for r, g, b in pixels) / len(pixels))
assert max(red) > 0 and min(red) < 0.1, red  # Gaussians without a hit are the first: they are seen in test views only
assert picture(0, 0, still=0)[1].count("image/jpeg") == 1
assert decode(picture(0, 0, scale=0.5)[2])[:2] == (scene["views"][0]["width"] // 2, scene["views"][0]["height"] // 2)
q = scene["views"][0]["q"]
for bad in ([0, 0, 0, 0], [float("nan")] + q[1:], [3, 0, 0, 0]):
    assert picture(0, 0, at=bad)[0] == 400, bad
assert picture(8, 0)[0] == 400 and picture(0, 0, scale=7)[0] == 400 and picture(0, 0, still=2)[0] == 400
assert page("picture")[0] == 400
assert page("picture?kind=0&view=99999&scale=1&still=1&qw=1&qx=0&qy=0&qz=0&tx=0&ty=0&tz=0")[0] == 503


# Strangers: 200 that say nothing, 20 that never finish, and 300 pictures that nobody fetches.
def resident():
    return int(re.search(r"VmRSS:\s+(\d+)", open("/proc/%s/status" % pid).read()).group(1)) * 1024


before = resident()
idle = [socket.create_connection(("127.0.0.1", int(port))) for _ in range(200)]
slow = [socket.create_connection(("127.0.0.1", int(port))) for _ in range(20)]
for s in slow:
    s.sendall(b"GET / HTTP/1.1\r\nX: ")
begin = time.monotonic()
assert picture(0, 0)[0] == 200
assert time.monotonic() - begin < 5, "strangers hold the page up"
for _ in range(40):
    for s in slow:
        s.sendall(b"y" * 100)
v = scene["views"][0]
line = "GET /%s/picture?kind=0&view=0&scale=1&still=1&qw=1&qx=0&qy=0&qz=0&tx=0&ty=0&tz=4 HTTP/1.1\r\nHost: %s\r\n\r\n" % (token, here)
hungry = []
for _ in range(30):
    s = socket.create_connection(("127.0.0.1", int(port)))
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    s.sendall(line.encode() * 10)
    hungry.append(s)
time.sleep(1)
grown = resident() - before
assert grown < 128 << 20, "strangers cost %d bytes" % grown
for s in idle + slow + hungry:
    s.close()
until = time.monotonic() + 20
while picture(0, 0)[0] != 200:
    assert time.monotonic() < until, "the page does not come back"

# More connections than the server has: those without the token make room, the oldest first.
def crowd(text):
    held = []
    for _ in range(300):
        held.append(socket.create_connection(("127.0.0.1", int(port))))
        held[-1].sendall(text)
    begin = time.monotonic()
    assert picture(0, 0)[0] == 200
    assert time.monotonic() - begin < 5, "%d strangers hold the page up" % len(held)
    for s in held:
        s.close()


crowd(b"")
crowd(b"GET / HTTP/1.1\r\nX: ")
crowd(("GET /%s/ HTTP/1.1\r\nHost: %s\r\n\r\n" % ("0" * 32, here)).encode())
print("220 strangers and 300 pictures that wait: %d kB" % (grown // 1024))
