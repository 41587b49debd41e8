# SPDX-License-Identifier: Apache-2.0
"""Chromium without a window, driven over its debugging pipe: Python's own library is enough.

python3 browser.py URL PREFIX   takes pictures of a page: light and dark, 400 and 1600 pixels wide.
"""
import base64
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time


SOFTWARE_GPU = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


def find():
    return shutil.which("chromium") or shutil.which("google-chrome")


class Browser:
    def __init__(self, webgl=False):
        self.folder = tempfile.mkdtemp(prefix="splatguard-browser-")
        to_read, self.to = os.pipe()
        self.come, to_write = os.pipe()

        def pipes():  # Chromium reads from 3 and writes to 4
            read, write = os.dup(to_read), os.dup(to_write)
            os.dup2(read, 3)
            os.dup2(write, 4)

        self.process = subprocess.Popen(
            [find(), "--headless", "--no-sandbox", *(SOFTWARE_GPU if webgl else ["--disable-gpu", "--disable-3d-apis"]), "--remote-debugging-pipe", "--no-first-run",
             "--disable-dev-shm-usage", "--user-data-dir=" + self.folder, "about:blank"],
            preexec_fn=pipes, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_read)
        os.close(to_write)
        self.number, self.rest, self.events, self.session = 0, b"", [], None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for part in ("Page", "Runtime", "Log", "Network"):
            self.call(part + ".enable")

    def message(self, until):
        while b"\0" not in self.rest:
            if not select.select([self.come], [], [], max(0, until - time.monotonic()))[0]:
                raise TimeoutError("no answer from Chromium")
            piece = os.read(self.come, 1 << 16)
            if not piece:
                raise EOFError("Chromium has ended")
            self.rest += piece
        text, self.rest = self.rest.split(b"\0", 1)
        return json.loads(text)

    def call(self, method, seconds=60, **parameters):
        self.number += 1
        order = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            order["sessionId"] = self.session
        os.write(self.to, json.dumps(order).encode() + b"\0")
        until = time.monotonic() + seconds
        while True:
            answer = self.message(until)
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(method + ": " + answer["error"]["message"])
                return answer["result"]
            self.events.append(answer)

    def evaluate(self, script):
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(script + ": " + json.dumps(answer["exceptionDetails"])[:500])
        return answer["result"].get("value")

    def wait(self, script, seconds=30):
        until = time.monotonic() + seconds
        while not self.evaluate(script):
            if time.monotonic() > until:
                raise TimeoutError(script)
            time.sleep(0.05)

    def open(self, url, width=1000, height=900, dark=False):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600)
        self.call("Emulation.setEmulatedMedia",
                  features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=url)
        self.wait("location.href === " + json.dumps(url))

    def key(self, key):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, text=key if len(key) == 1 and kind == "keyDown" else "")

    def complaints(self):
        """Errors of scripts and of the console, and what the security policy refused."""
        return [json.dumps(e)[:400] for e in self.events
                if e.get("method") == "Runtime.exceptionThrown" or e.get("method") == "Log.entryAdded"
                or e.get("method") == "Runtime.consoleAPICalled" and e["params"]["type"] == "error"]

    def requests(self):
        return [e["params"]["request"]["url"] for e in self.events if e.get("method") == "Network.requestWillBeSent"]

    def picture(self, path, whole=True):
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
        data = self.call("Page.captureScreenshot", captureBeyondViewport=whole, **({"clip": clip} if whole else {}))["data"]
        with open(path, "wb") as f:
            f.write(base64.b64decode(data))
        return size

    def close(self):
        os.close(self.to)
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self.come)
        shutil.rmtree(self.folder, ignore_errors=True)


if __name__ == "__main__":
    browser = Browser()
    for dark in (False, True):
        for width in (400, 1600):
            browser.open(sys.argv[1], width, 900, dark)
            time.sleep(2)
            browser.picture("%s-%s-%d.png" % (sys.argv[2], "dark" if dark else "light", width))
    print(browser.complaints())
    browser.close()
