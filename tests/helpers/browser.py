"""Headless Chromium that tests control through its debugging protocol.

One process serves all tests of a session. Each `Browser` is a window that shares nothing with the
others; `Browser.ask` evaluates an expression of JavaScript on its page.
"""

import atexit
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from functools import cache
from pathlib import Path

import pytest
from programs import GUARD

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-background-timer-throttling", "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows", "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe",
]  # fmt: skip
#: The browser takes commands from file 3 and answers on file 4.
START = 'exec "$@" 3<&0 4>&1 0</dev/null 1>/dev/null 2>/dev/null'
NO_WEBGL = """const plain = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.includes("webgl") ? null : plain.call(this, kind, ...more);
};"""


class Chromium:
    """The browser's process, which exchanges JSON over two pipes; a zero byte ends a message."""

    def __init__(self):
        assert CHROMIUM is not None
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.process = subprocess.Popen(
            ["bash", "-c", START, "bash", CHROMIUM, *FLAGS, f"--user-data-dir={self.profile.name}"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
        )  # fmt: skip
        atexit.register(self.close)
        self.windows = {}
        self.unread = b""
        self.count = 0

    def exchange(self, method, session=None, **parameters):
        """Call a method of the protocol and return its result."""
        assert self.process.stdin is not None
        self.count += 1
        request = {"id": self.count, "method": method, "params": parameters}
        if session:
            request["sessionId"] = session
        text = memoryview(json.dumps(request).encode() + b"\0")
        while text:
            text = text[self.process.stdin.write(text) :]
        while (message := self.read()).get("id") != self.count:
            if message.get("sessionId") in self.windows:
                self.windows[message["sessionId"]].note(message)
        assert "error" not in message, message
        return message["result"]

    def read(self):
        """Wait for a message and return it."""
        assert self.process.stdout is not None
        while b"\0" not in self.unread:
            assert select.select([self.process.stdout], [], [], GUARD)[0], "the browser is silent"
            data = os.read(self.process.stdout.fileno(), 2**20)
            assert data, "the browser has ended"
            self.unread += data
        message, _, self.unread = self.unread.partition(b"\0")
        return json.loads(message)

    def close(self):
        self.process.kill()
        self.process.wait()
        self.profile.cleanup()


@cache
def chromium():
    return Chromium()


class Browser:
    """A window with a page; it notes what the page logs and loads.

    addresses: all that the page loaded.
    """

    def __init__(self, url, webgl=False):
        """Open a page; `webgl` enables WebGL on the processor, which is slow."""
        self.exchange = chromium().exchange
        self.logged = []
        self.addresses = []
        self.context = self.exchange("Target.createBrowserContext")["browserContextId"]
        target = self.exchange(
            "Target.createTarget",
            url="about:blank", browserContextId=self.context,
            newWindow=True, width=1440, height=900,
        )["targetId"]  # fmt: skip
        attached = self.exchange("Target.attachToTarget", targetId=target, flatten=True)
        self.session = attached["sessionId"]
        chromium().windows[self.session] = self
        for domain in ("Runtime", "Log", "Network", "Page"):
            self.send(f"{domain}.enable")
        if not webgl:
            self.send("Page.addScriptToEvaluateOnNewDocument", source=NO_WEBGL)
        self.send("Page.navigate", url=url)

    def note(self, message):
        """Note an event."""
        method, words = message["method"], message["params"]
        if method in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"):
            text = json.dumps(words)[:2000]
            if "GL Driver Message" not in text:  # of a picture that is read
                self.logged.append(text)
        elif method in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            self.addresses.append(words.get("url") or words["request"]["url"])

    @property
    def errors(self):
        """What scripts threw, and all that stands on the console."""
        self.ask("0")  # the answer comes after what was logged before
        return self.logged

    def send(self, method, **parameters):
        """Call a method of the protocol for this page and return its result."""
        return self.exchange(method, self.session, **parameters)

    def ask(self, expression):
        """Evaluate an expression on the page, wait for a promise, and return the value."""
        answer = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def await_true(self, expression):
        """Wait until an expression is true on the page and return its value."""
        last = time.monotonic() + GUARD
        tried = f"(() => {{ try {{ return {expression}; }} catch {{ return null; }} }})()"
        while not (value := self.ask(tried)):
            assert time.monotonic() < last, f"waited in vain: {expression}; {self.logged}"
            time.sleep(0.05)
        return value

    def put(self, name, value):
        """Move a slider, choose, or type into a field with an identity."""
        self.ask(
            f"(() => {{ const field = document.getElementById('{name}');"
            f" field.value = {json.dumps(value)}; field.dispatchEvent(new Event('input')); }})()"
        )

    def text_of(self, name):
        """The text of an element with an identity."""
        return self.ask(f"document.getElementById('{name}').textContent")

    def box_of(self, selector):
        """The middle, the width and the height of an element, pixels."""
        return self.ask(
            f"(() => {{ const r = document.querySelector('{selector}').getBoundingClientRect();"
            " return [r.left + r.width / 2, r.top + r.height / 2, r.width, r.height]; })()"
        )

    def find_barriers(self):
        """Rules of WCAG 2.1, levels A and AA, that the page breaks, and where, by axe-core."""
        source = pytest.importorskip("axe_playwright_python").__path__[0]
        self.ask((Path(source) / "axe.min.js").read_text("utf-8"))
        report = self.ask("axe.run(document, {runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa']})")
        assert len(report["passes"]) > 5
        return [(rule["id"], [n["target"] for n in rule["nodes"]]) for rule in report["violations"]]

    def press(self, kind, x, y, **more):
        """Send a mouse event."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, begin, end, **more):
        """Drag the mouse from one place to another."""
        middle = tuple((first + last) / 2 for first, last in zip(begin, end, strict=True))
        self.press("mousePressed", *begin, button="left", clickCount=1, **more)
        for place in (middle, end):
            self.press("mouseMoved", *place, button="left", **more)
        self.press("mouseReleased", *end, button="left", clickCount=1, **more)

    def key(self, key, **more):
        """Press a key and release it."""
        text = {"text": key} if len(key) == 1 else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, **text, **more)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key, **more)

    def resize(self, width, height, scale=1):
        """Give the page another size and so many dots a pixel; wait until it has the size."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=scale, mobile=False,
        )  # fmt: skip
        self.await_true(f"innerWidth === {width}")

    def close(self):
        del chromium().windows[self.session]
        self.exchange("Target.disposeBrowserContext", browserContextId=self.context)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
