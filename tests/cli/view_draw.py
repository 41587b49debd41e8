# SPDX-License-Identifier: Apache-2.0
"""view_draw.py ADDRESS: the page of `splatguard view` where the browser draws the model with WebGL.
view_draw.py ADDRESS VIEWS: figures instead: when it draws, and how near to the engine at so many of the photos' cameras."""
import sys
import time
import urllib.error
import urllib.request

import browser

address = sys.argv[1].strip()
try:
    urllib.request.urlopen(address + "playcanvas.js").close()
except urllib.error.HTTPError as error:
    assert error.code == 404, error
    print("WebGL not tested: this build is without PlayCanvas (scripts/setup npm)")
    sys.exit()
if not browser.find():
    print("WebGL not tested: no Chromium")
    sys.exit()

# What both draw for the camera of the page, at the size of the canvas.
COMPARE = """(async () => {
    const picture = (source, w, h) => {
        const to = new OffscreenCanvas(w, h).getContext('2d');
        to.drawImage(source, 0, 0, w, h);
        return to.getImageData(0, 0, w, h).data;
    };
    const {width, height} = canvas, ours = picture(await fetchPicture(0, width / scene.views[view].width, 1), width, height);
    const theirs = picture(canvas, width, height), colours = new Set();
    let sum = 0;
    for (let i = 0; i < ours.length; i++) {
        sum += (ours[i] - theirs[i]) ** 2;
        if (i % 4 === 0) colours.add(theirs[i] << 16 | theirs[i + 1] << 8 | theirs[i + 2]);
    }
    return [10 * Math.log10(255 * 255 * ours.length * .75 / (sum || 1)), colours.size];
})()"""
b = browser.Browser(webgl=True)
try:
    psnr = []
    b.open(address, 1000, 1000)
    b.wait("document.getElementById('canvas')?.dataset.loaded", 60)
    assert b.evaluate("canvas.dataset.loaded") != "failed", b.evaluate("trouble")
    settled = "drawing && !busy && !wanted && render === drawing.canvas"
    b.wait(settled)
    seconds = b.evaluate("performance.now()") / 1e3  # since the page was asked for

    def compare(what):
        """When the Gaussians are sorted for the camera."""
        until = time.monotonic() + 20
        while True:
            b.wait(settled)
            psnr, colours = b.evaluate(COMPARE)
            if psnr > 30 and colours > 10:
                return psnr
            assert time.monotonic() < until, "%s: %d colours, %.1f dB between WebGL and the engine" % (what, colours, psnr)
            time.sleep(0.1)

    if len(sys.argv) > 2:
        photos, views = b.evaluate("scene.views.length"), int(sys.argv[2])
        for i in range(views):
            b.evaluate("jump(%d)" % (i * photos // views))
            b.wait(settled)
            time.sleep(2)  # sorting
            psnr.append(compare("view %d" % (i * photos // views)))
        print("%.1f s, %.2f dB on average, %.2f dB at least" % (seconds, sum(psnr) / len(psnr), min(psnr)))
        sys.exit()
    psnr.append(compare("a photo's camera"))
    b.evaluate("canvas.focus()")
    for key in ("ArrowLeft", "w", "m", "ArrowUp", "]"):
        before = b.evaluate("canvas.toDataURL()")
        b.key(key)
        psnr.append(compare(key))
        assert key == "m" or before != b.evaluate("canvas.toDataURL()"), key + " changes nothing"

    # The other pictures are the engine's, and so are the colours where the page wants that; a wipe shows the photo.
    for key, here in (("2", False), ("1", True), ("b", False), ("b", True)):
        b.key(key)
        b.wait("!busy && !wanted && (render === drawing.canvas) === %s" % str(here).lower())
    if b.evaluate("scene.photos"):
        before = b.evaluate("canvas.toDataURL()")
        b.key(".")
        b.wait("!busy && canvas.toDataURL() !== '%s'" % before)

    b.open(address, 400, 800, True)
    b.wait("document.getElementById('canvas')?.dataset.loaded")
    compare("a phone")
    assert b.evaluate("document.documentElement.scrollWidth <= 400"), "wider than the phone"
    # Another than the browser's GPU draws where that is gone.
    b.evaluate("drawing.canvas.getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()")
    b.wait("!drawing && !busy && render instanceof ImageBitmap")
    b.wait("$('message').textContent.includes('splatguard draws it')")
    assert not b.complaints(), b.complaints()
    foreign = [url for url in b.requests() if not url.startswith((address, "blob:" + address[:address.index("/", 7)]))]
    assert not foreign, foreign
    print("WebGL draws after %.1f s, %.1f to %.1f dB from the engine" % (seconds, min(psnr), max(psnr)))
finally:
    b.close()
