# SPDX-License-Identifier: Apache-2.0
"""report_choose.py URL: the figures of a report have the defenses that are ticked, each with a colour of its own."""
import sys

import browser

if not browser.find():
    print("choices not tried: no Chromium")
    sys.exit()
b = browser.Browser()
try:
    b.open(sys.argv[1], 1000, 900)
    b.wait("document.querySelectorAll('#defenses input').length > 0")
    marks = "[...document.querySelectorAll('#gaussians .mark')].map(m => m.style.fill)"
    first = b.evaluate(marks)
    assert len(set(first)) == 20, first
    b.evaluate("document.querySelectorAll('#defenses button')[1].click()")
    assert b.evaluate("document.querySelectorAll('.mark').length") == 0
    b.evaluate("document.querySelector('#defenses input[value=d30]').click()")
    assert b.evaluate(marks) == first[:1] + first[:1], b.evaluate(marks)
    assert not b.complaints(), b.complaints()
    b.evaluate("document.querySelectorAll('#defenses button')[0].click()")
    assert len(b.evaluate(marks)) == 2 * b.evaluate("document.querySelectorAll('#defenses input').length")
finally:
    b.close()
