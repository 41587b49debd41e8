# SPDX-License-Identifier: Apache-2.0
"""page_look.py URL: a page on a phone and on a desk, in light and dark: nothing is too wide, too small to read, faint or cut off,
and on paper no table is."""
import sys

import browser

if not browser.find():
    print("page not looked at: no Chromium")
    sys.exit()
b = browser.Browser()
try:
    for dark in (False, True):
        for width in (400, 1000, 1600):
            b.open(sys.argv[1], width, 900, dark)
            b.wait("document.readyState === 'complete' && !!document.body")
            where = "%d pixels, %s" % (width, "dark" if dark else "light")
            inside, shown = b.evaluate("[document.documentElement.scrollWidth, document.documentElement.clientWidth]")
            assert shown <= width and inside <= shown, "%s: %d pixels wide, in %d" % (where, inside, shown)
            small = b.evaluate("""[...document.querySelectorAll('svg text')].filter(t => {
                const m = t.getScreenCTM();
                return Math.hypot(m.a, m.b) * parseFloat(getComputedStyle(t).fontSize) < 11.5;
            }).length""")
            assert not small, "%s: %d labels below 11.5 pixels" % (where, small)
            cut = b.evaluate("""[...document.querySelectorAll('svg text')].filter(t => {
                const a = t.getBoundingClientRect(), b = t.ownerSVGElement.getBoundingClientRect();
                return a.left < b.left - 1 || a.right > b.right + 1 || a.top < b.top - 1 || a.bottom > b.bottom + 1;
            }).map(t => t.textContent)""")
            assert not cut, "%s: labels that are cut off: %s" % (where, cut)
            # Of text, by the definition of the Web Content Accessibility Guidelines.
            contrast = b.evaluate("""(() => {
                const light = c => c.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255).map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
                    .reduce((s, v, i) => s + v * [.2126, .7152, .0722][i], 0);
                const paper = light(getComputedStyle(document.body).backgroundColor);
                return Math.min(...[...document.querySelectorAll('body, h1, td, th, figcaption, p, a, span')].map(e => {
                    const ink = light(getComputedStyle(e).color);
                    return (Math.max(ink, paper) + .05) / (Math.min(ink, paper) + .05);
                }));
            })()""")
            assert contrast >= 4.5, "%s: a contrast of %.1f" % (where, contrast)
    b.call("Emulation.setEmulatedMedia", media="print")
    cut = b.evaluate("""[...document.querySelectorAll('.wide')].filter(e => getComputedStyle(e).overflowX !== 'visible').length""")
    assert not cut, "on paper: %d tables that would have to be scrolled" % cut
    assert not b.complaints(), b.complaints()
    foreign = [url for url in b.requests() if not url.startswith((sys.argv[1], "data:"))]
    assert not foreign, foreign
finally:
    b.close()
