# SPDX-License-Identifier: Apache-2.0
"""view_page.py ADDRESS: the page of `splatguard view` in Chromium: it draws, its controls work, it asks nobody else."""
import sys

import browser

if not browser.find():
    print("page not looked at: no Chromium")
    sys.exit()
address = sys.argv[1].strip()
b = browser.Browser()
try:
    b.open(address)
    b.wait("document.readyState === 'complete' && +document.getElementById('canvas').dataset.drawn > 0")
    # The canvas shows what the server draws for the photo's camera, scaled to its size.
    psnr = b.evaluate("""(async () => {
        const still = await fetchPicture(0, 1, 1), other = new OffscreenCanvas(canvas.width, canvas.height).getContext('2d');
        other.drawImage(still, 0, 0, canvas.width, canvas.height);
        const x = context.getImageData(0, 0, canvas.width, canvas.height).data,
            y = other.getImageData(0, 0, canvas.width, canvas.height).data;
        let sum = 0, some = 0;
        for (let i = 0; i < x.length; i++) sum += (x[i] - y[i]) ** 2, some = Math.max(some, i % 4 < 3 ? x[i] : 0);
        return some && 10 * Math.log10(255 * 255 * x.length / (sum || 1));
    })()""")
    assert psnr > 30, "the canvas is %s dB from the render" % psnr

    def after(script, what):
        before = b.evaluate("[camera.c, camera.R].flat(2).join() + [view, kind(), $('mode').value, $('wipe').value].join()")
        drawn = b.evaluate("canvas.dataset.drawn")
        script()
        b.wait("canvas.dataset.drawn !== '%s' || %s" % (drawn, "true" if what == "mode" else "false"))
        now = b.evaluate("[camera.c, camera.R].flat(2).join() + [view, kind(), $('mode').value, $('wipe').value].join()")
        assert before != now, what

    b.evaluate("canvas.focus()")
    for key in ("ArrowLeft", "ArrowDown", "w", "a", "q", "]", "2", "4", "6", "8", "1", ".", "m", "ArrowUp", "d", "r"):
        after(lambda key=key: b.key(key), {"m": "mode"}.get(key, key))
    b.evaluate("$('next').focus()")  # as after a click
    after(lambda: b.key("w"), "w on a button")
    b.evaluate("canvas.focus()")
    for script in ("$('next').click()", "$('previous').click()", "canvas.dispatchEvent(new WheelEvent('wheel', {deltaY: 100}))"):
        after(lambda script=script: b.evaluate(script), script)
    b.key("8")
    b.wait("!busy && !$('legend').hidden && $('legend').textContent.includes('Red')")
    b.key("1")
    b.wait("!busy && $('legend').hidden")
    # A photo that comes after another view was chosen is not taken for that view's.
    asked, shown, chosen = b.evaluate("""(async () => {
        const real = window.fetch, asked = [], wait = ms => new Promise(done => setTimeout(done, ms));
        window.fetch = async url => {
            const query = new URL(url, location).searchParams;
            if (+query.get('kind') === PHOTO) asked.push(+query.get('view')), await wait(200);
            return real(url);
        };
        photoView = -1, $('wipe').value = 50, jump(0);
        while (!asked.length) await wait(10);
        jump(1);
        while (busy) await wait(10);
        window.fetch = real, $('wipe').value = 0;
        return [asked, photoView, view];
    })()""")
    assert asked == [0, 1] and shown == chosen == 1, (asked, shown, chosen)
    # The camera turns about the middle and keeps its distance; at a photo it is the photo's.
    assert b.evaluate("""(() => { jump(0); $('mode').value = 'orbit';
        const far = length(add(camera.c, pivot, -1)); turn(.3, .2);
        return Math.abs(length(add(camera.c, pivot, -1)) / far - 1) < 1e-9 && Math.abs(dot(camera.R[0], camera.R[1])) < 1e-9; })()""")
    # However it is turned, in however large steps, the horizon stays level. Down looks down, and lifts the camera around
    # the middle; right looks right, and takes the camera to the left.
    for mode in "fly", "orbit":
        rolls, turned, moved = b.evaluate("""(() => { jump(0); $('mode').value = MODE;
            const [right, , before] = camera.R, c = camera.c, level = dot(right, up);
            turn(.3, 0); const sideways = [dot(camera.R[2], right), dot(add(camera.c, c, -1), right)];
            jump(0); turn(0, .1); const down = [dot(camera.R[2], up) - dot(before, up), dot(add(camera.c, c, -1), up)];
            jump(0);
            for (let k = 0; k < 10; k++) turn(k % 2 ? -.7 : .7, k % 2 ? -.2 : .2);
            return [Math.abs(dot(camera.R[0], up) - level), [sideways[0], down[0]], [sideways[1], down[1]]]; })()""".replace("MODE", repr(mode)))
        assert rolls < 1e-9, rolls
        assert turned[0] > 0 > turned[1], (mode, turned)
        assert (moved[0] < 0 < moved[1]) if mode == "orbit" else moved == [0, 0], (mode, moved)
    # Back at a photo it turns about the middle again, wherever panning has taken that.
    assert b.evaluate("""(() => { jump(0), step(.3, .2, 0);
        const away = length(add(pivot, middle, -1)); jump(0);
        return away > 0 && length(add(pivot, middle, -1)) === 0; })()""")
    # Only the first button holds the camera; a picture that is replaced is given up.
    turns, closed = b.evaluate("""(async () => {
        const wait = async () => { do await new Promise(done => setTimeout(done, 10)); while (busy); };
        const point = (type, button, clientX) => canvas.dispatchEvent(new PointerEvent(type, {pointerId: 1, button, clientX}));
        const real = ImageBitmap.prototype.close, held = canvas.setPointerCapture, turns = [];
        let closed = 0;
        ImageBitmap.prototype.close = function () { closed++; real.call(this); };
        canvas.setPointerCapture = () => 0; // which knows no pointer of a script
        for (const button of [2, 0]) {
            const before = camera.c.join();
            point('pointerdown', button, 10), point('pointermove', -1, 40), point('pointerup', button, 40);
            turns.push(camera.c.join() !== before);
            await wait();
        }
        ImageBitmap.prototype.close = real, canvas.setPointerCapture = held;
        return [turns, closed];
    })()""")
    assert turns == [False, True] and closed > 0, (turns, closed)
    # What splatguard does not take is said, and can be asked again.
    disabled, said = b.evaluate("""(async () => {
        const real = window.fetch;
        window.fetch = async () => { throw new Error('no connection'); };
        $('stop').click();
        await new Promise(done => setTimeout(done, 50));
        window.fetch = real;
        return [$('stop').disabled, $('message').textContent];
    })()""")
    assert not disabled and "no connection" in said, (disabled, said)
    # Every control has a name and can be reached; nothing is wider than a phone.
    for dark in (False, True):
        b.open(address, 400, 800, dark)
        b.wait("+document.getElementById('canvas')?.dataset.drawn > 0")
        assert b.evaluate("document.documentElement.scrollWidth <= 400"), "wider than the phone"
        ink, paper = b.evaluate("(s => [s.color, s.backgroundColor])(getComputedStyle(document.body))")
        assert (sum(map(int, paper[4:-1].split(","))) < 200) == dark, (ink, paper)
    assert b.evaluate("[...document.querySelectorAll('select, input, button')].every(e => e.labels?.length || e.ariaLabel || e.textContent.trim())")
    assert not b.complaints(), b.complaints()
    foreign = [url for url in b.requests() if not url.startswith(address)]
    assert not foreign, foreign
    print("canvas within %.1f dB of the render" % psnr)
finally:
    b.close()
