"""The process that serves the page: `python -m facets.live.web.server`.

It subscribes to the run that has started it. It is a separate process, less urgent than the run,
and never waits for a page. Each page gets the next news as soon as it has taken the last.
"""

from __future__ import annotations

import asyncio
import os
import socket
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import InputError
from ...core.extras import require_extra
from ..streams.run_feed import RunFeed
from .guard import Guard, place
from .hub import Hub, Page

if TYPE_CHECKING:
    from aiohttp import web

#: Maximum rate of the news to a page, 1/s.
UPDATES_PER_S = 30
#: The connection to a page that takes nothing for this time is closed, s; the page reconnects.
STUCK_TIMEOUT_S = 15.0
#: Time for pages to take the last messages at the end, s.
CLOSE_TIMEOUT_S = 2.5
#: Maximum number of samples that are condensed at once, so that pages are served in between.
MAX_ROWS_AT_ONCE = 20_000
#: How much less urgent than the run this process is.
NICE = 10
TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".json": "application/json",
}


def assets() -> dict[str, Path]:
    """Return the files that a browser may load, by their paths on the page."""
    paths = {}
    package = Path(__file__).parent
    folders = {"": package / "assets", "vendor/": package / "vendor"}
    for prefix, folder in folders.items():
        for path in folder.rglob("*"):
            if path.suffix in TYPES:
                paths[prefix + path.relative_to(folder).as_posix()] = path
    return paths


class Server:
    """Serves the page of a hub to the requests that the guard allows."""

    def __init__(self, hub: Hub, guard: Guard, drawn: dict[str, str], feed: RunFeed) -> None:
        """drawn: texts of scripts that the run supplies, by their path on the page."""
        self.hub, self.guard, self.feed = hub, guard, feed
        self.files, self.drawn = assets(), drawn
        self.tasks: set[asyncio.Task[Any]] = set()

    def app(self) -> web.Application:
        """The application with the page's addresses, which refuses whoever `guard` does."""
        from aiohttp import web

        @web.middleware
        async def admit(request: web.Request, handler: Any) -> web.StreamResponse:
            reason = self.guard.complaint(
                request.match_info.get("token", ""),
                request.headers.get("Host", ""),
                request.headers.get("Origin"),
            )
            if reason:
                raise web.HTTPForbidden(text=f"403: {reason}\n")
            response: web.StreamResponse = await handler(request)
            return response

        app = web.Application(middlewares=[admit])
        app.router.add_get("/{token}", self.redirect)
        app.router.add_get("/{token}/stream", self.stream)
        app.router.add_get("/{token}/{path:.*}", self.file)
        return app

    def headers(self, request: web.Request) -> dict[str, str]:
        """Security headers: no external resources, no caching, no framing, no referrer."""
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
            f"img-src 'self' data: blob:; connect-src 'self' ws://{request.host}; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        return {
            "Content-Security-Policy": policy,
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
        }

    async def redirect(self, request: web.Request) -> web.StreamResponse:
        """Redirect an address without its last slash to the page."""
        from aiohttp import web

        raise web.HTTPFound(f"/{self.guard.token}/")

    async def file(self, request: web.Request) -> web.StreamResponse:
        """Answer with a part of the page; raises 404 for an unknown one."""
        from aiohttp import web

        name = request.match_info["path"] or "index.html"
        if name not in self.files and name not in self.drawn:
            raise web.HTTPNotFound(text="404: the page has no such part\n")
        text = self.drawn.get(name)
        return web.Response(
            body=self.files[name].read_bytes() if text is None else text.encode(),
            content_type=TYPES[PurePosixPath(name).suffix],
            charset="utf-8",
            headers=self.headers(request),
        )

    async def stream(self, request: web.Request) -> web.StreamResponse:
        """Send the news to one page, as fast as it takes them."""
        from aiohttp import web

        line = web.WebSocketResponse(compress=False, heartbeat=STUCK_TIMEOUT_S, max_msg_size=4096)
        await line.prepare(request)
        page = Page(self.hub)
        self.hub.pages.add(page)
        page.wake.set()
        sending_news = asyncio.create_task(self.send_news(line, page, request))
        self.tasks.add(sending_news)
        try:
            async for message in line:  # also hears the end of the page
                if message.data == "resume":
                    self.feed.reply(resume=True)
        finally:
            self.hub.pages.discard(page)
            sending_news.cancel()
            with suppress(asyncio.CancelledError):
                await sending_news
            self.tasks.discard(sending_news)
        return line

    async def send_news(
        self, line: web.WebSocketResponse, page: Page, request: web.Request
    ) -> None:
        """Send messages to one page until it has all; a page that takes none is dropped."""
        try:
            while not page.finished:
                await page.wake.wait()
                page.wake.clear()
                for message in page.messages():
                    if isinstance(message, str):
                        sending = line.send_str(message)
                    else:
                        sending = line.send_bytes(message)
                    await asyncio.wait_for(sending, STUCK_TIMEOUT_S)
            await asyncio.wait_for(line.close(), CLOSE_TIMEOUT_S)
        except (TimeoutError, OSError, RuntimeError):
            self.hub.pages.discard(page)
            if request.transport is not None:
                request.transport.abort()


async def condense(hub: Hub, feed: RunFeed) -> None:
    """Take in samples and statuses, and pass the news to the pages, until the run ends."""
    last_rate = -1.0
    while not feed.ended:
        rows, statuses = feed.take(MAX_ROWS_AT_ONCE)
        hub.take(np.concatenate([np.empty(0, feed.dtype), *rows]))
        for status in statuses:
            hub.hear(status)
        rate = hub.rate()
        if rows or statuses or rate != last_rate:
            hub.share()
        last_rate = rate
        feed.report(feed.next - feed.lost, len(hub.pages))
        await asyncio.sleep(0.0 if sum(map(len, rows)) >= MAX_ROWS_AT_ONCE else 1 / UPDATES_PER_S)
    good = "The run has ended."
    bad = "The program that acquires has ended without a message; see its terminal."
    hub.end(good if feed.has_end else bad, feed.has_end)
    hub.share()


def listening(host: str, port: int) -> socket.socket:
    """A socket at an address. Raises `InputError` where that cannot be had."""
    try:
        family, kind, _, _, where = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        line = socket.socket(family, kind)
        if os.name == "posix":
            line.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        line.bind(where)
        line.listen()
    except OSError as error:
        raise InputError(
            f"--web {place(host, port)}: {error.strerror or error}; give another port, or 0 for "
            "any free port"
        ) from None
    return line


async def serve(feed: RunFeed, line: socket.socket) -> None:
    """Serve the page at an open socket until the run ends."""
    from aiohttp import web

    page = feed.setup["page"]
    hub = Hub({**feed.about, **feed.setup["about"]})
    port = line.getsockname()[1]
    server = Server(hub, Guard(page["token"], page["host"], port), page["drawn"], feed)
    runner = web.AppRunner(server.app(), access_log=None, handle_signals=False)
    await runner.setup()
    await web.SockSite(runner, line, shutdown_timeout=0.1).start()
    feed.reply(ready=True, port=port)
    await condense(hub, feed)
    if server.tasks:
        await asyncio.wait(set(server.tasks), timeout=CLOSE_TIMEOUT_S)
    await asyncio.wait_for(runner.cleanup(), CLOSE_TIMEOUT_S)


def main() -> None:
    """Serve the page of a run; an address that cannot be had is reported to the run."""
    with suppress(OSError, AttributeError):
        os.nice(NICE)
    with RunFeed() as feed:
        try:
            require_extra("aiohttp", "--web")
            line = listening(feed.setup["page"]["host"], feed.setup["page"]["port"])
        except InputError as error:
            feed.reply(error=str(error))
            return
        with suppress(TimeoutError):
            asyncio.run(serve(feed, line))


if __name__ == "__main__":
    main()
