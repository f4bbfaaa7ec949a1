"""Headless browser that tests control through its debugging protocol.

Everything goes through `Browser.ask`, which evaluates an expression of JavaScript on the page.
"""

from __future__ import annotations

import asyncio
import base64
import json
import shutil
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from programs import GUARD

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--remote-debugging-port=0", "--window-size=1440,900",
    "--disable-background-timer-throttling", "--disable-renderer-backgrounding",
]  # fmt: skip
WEBGL, NO_WEBGL = "--enable-unsafe-swiftshader", "--disable-3d-apis"


class Browser:
    """A page in Chromium that records its messages and the addresses that it loads.

    errors: what scripts threw, and all that stands on the console.  addresses: all that the page
    loaded.
    """

    def __init__(self, url: str, webgl: bool = False) -> None:
        """Open a page; `webgl` enables WebGL on the processor, which is slow."""
        assert CHROMIUM is not None
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.process = subprocess.Popen(
            [CHROMIUM, *FLAGS, WEBGL if webgl else NO_WEBGL,
             f"--user-data-dir={self.profile.name}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self.errors: list[str] = []
        self.addresses: list[str] = []
        self.answers: dict[int, asyncio.Future[Any]] = {}
        self.count = 0
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever)
        self.thread.start()
        try:
            self.call(self.open(self.debugger()))
            for domain in ("Runtime", "Log", "Network", "Page"):
                self.send(f"{domain}.enable")
            self.send("Page.navigate", url=url)
        except BaseException:
            self.close()
            raise

    def debugger(self) -> str:
        """Wait for the browser and return the address of the page's debugger."""
        port = Path(self.profile.name) / "DevToolsActivePort"
        last = time.monotonic() + GUARD
        while time.monotonic() < last:
            assert self.process.poll() is None, "the browser has ended"
            words = port.read_text().split() if port.exists() else []
            if len(words) == 2:
                with urlopen(f"http://127.0.0.1:{words[0]}/json/list") as answer:
                    pages = [one for one in json.load(answer) if one["type"] == "page"]
                if pages:
                    return str(pages[0]["webSocketDebuggerUrl"])
            time.sleep(0.02)
        raise AssertionError("the browser does not begin")

    async def open(self, address: str) -> None:
        import aiohttp

        self.session = aiohttp.ClientSession()
        self.line = await self.session.ws_connect(address, max_msg_size=0)
        self.listening = asyncio.create_task(self.listen())

    async def listen(self) -> None:
        async for message in self.line:
            words = json.loads(message.data)
            if words.get("id") in self.answers:
                self.answers.pop(words["id"]).set_result(words)
            elif words.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(words["params"]["exceptionDetails"])[:2000])
            elif words.get("method") in ("Runtime.consoleAPICalled", "Log.entryAdded"):
                if "GL Driver Message" not in message.data:  # of a picture that is read
                    self.errors.append(json.dumps(words["params"])[:2000])
            elif words.get("method") in ("Network.requestWillBeSent", "Network.webSocketCreated"):
                found = words["params"]
                self.addresses.append(found.get("url") or found["request"]["url"])

    def call(self, what: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(what, self.loop).result(GUARD)

    async def exchange(self, method: str, parameters: dict[str, Any]) -> Any:
        self.count += 1
        number = self.count
        self.answers[number] = asyncio.get_running_loop().create_future()
        answer = self.answers[number]
        await self.line.send_str(json.dumps({"id": number, "method": method, "params": parameters}))
        return await answer

    def send(self, method: str, **parameters: Any) -> Any:
        """Call a method of the browser's protocol and return its result."""
        words = self.call(self.exchange(method, parameters))
        assert "error" not in words, words
        return words["result"]

    def ask(self, expression: str) -> Any:
        """Evaluate an expression on the page, wait for a promise, and return the value."""
        found = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def await_true(self, expression: str) -> Any:
        """Wait until an expression is true on the page and return its value."""
        last = time.monotonic() + GUARD
        while time.monotonic() < last:
            tried = f"try {{ return {expression}; }} catch {{ return null; }}"
            if found := self.ask(f"(() => {{ {tried} }})()"):
                return found
            time.sleep(0.05)
        raise AssertionError(f"waited in vain: {expression}; {self.errors}")

    def find_barriers(self) -> list[Any]:
        """Rules of WCAG 2.1, levels A and AA, that the page breaks, and where, by axe-core."""
        source = pytest.importorskip("axe_playwright_python").__path__[0]
        self.ask((Path(source) / "axe.min.js").read_text("utf-8"))
        found = self.ask("axe.run(document, {runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa']})")
        assert len(found["passes"]) > 5
        return [(one["id"], [n["target"] for n in one["nodes"]]) for one in found["violations"]]

    def picture(self, path: Path) -> None:
        data = self.send("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))

    def press(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Send a mouse event."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, begin: tuple[float, float], end: tuple[float, float], **more: Any) -> None:
        """Drag the mouse from one place to another."""
        middle = tuple((one + other) / 2 for one, other in zip(begin, end, strict=True))
        self.press("mousePressed", *begin, button="left", clickCount=1, **more)
        for place in (middle, end):
            self.press("mouseMoved", *place, button="left", **more)
        self.press("mouseReleased", *end, button="left", clickCount=1, **more)

    def key(self, key: str, **more: Any) -> None:
        """Press a key and release it."""
        text = {"text": key} if len(key) == 1 else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, **text, **more)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key, **more)

    def resize(self, width: int, height: int) -> None:
        """Give the page another size, and wait until it has it."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        self.await_true(f"innerWidth === {width}")

    def close(self) -> None:
        async def end() -> None:
            if hasattr(self, "line"):
                await self.line.close()
                self.listening.cancel()
                await self.session.close()

        try:
            self.call(end())
        finally:
            self.process.kill()
            self.process.wait()
            self.loop.call_soon_threadsafe(self.loop.stop)
            self.thread.join()
            self.loop.close()
            self.profile.cleanup()

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
