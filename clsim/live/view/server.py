"""The page's web server: static files and one WebSocket, in a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from clsim.errors import InputError
from clsim.live.view import colormaps
from clsim.live.view.commands import LARGEST_MESSAGE, Seen, WantFrames, parse_message
from clsim.live.view.hub import Hub, Watcher

if TYPE_CHECKING:
    from aiohttp import web

    from clsim.live.view.playback import Playback

DEFAULT_PORT = 8787
STATUS_PERIOD_S = 0.25
MOST_PAGES = 32
"""Browser tabs at a time; each costs memory and, with a recording, a reader."""
_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self' ws:"


@dataclass(eq=False)
class _Page:
    """A browser tab that is connected."""

    watcher: Watcher
    hub: Hub
    playback: Playback | None


class PageServer:
    """Serves the page at ``url`` until ``close``.

    Who watches a stream can change nothing; who watches a recording plays it for himself alone.

    Args:
        hello: what a page must know first: title, width, height, live.
        status: called four times a second while somebody watches; its numbers are shown.
        host: address to listen on; only loopback is safe, because nothing is encrypted and anybody may watch.
        port: None takes the usual port or, if that is in use, a free one; 0 takes a free one.
        listener: what ``listen`` returned for them, if it was asked before; the server closes it.
        play: called in the server's thread when a page joins, to play a recording into that page's own hub; None
            where all pages watch one stream, ``hub``.
    """

    def __init__(
        self,
        hello: dict[str, Any],
        status: Callable[[], dict[str, Any]],
        host: str = "127.0.0.1",
        port: int | None = None,
        listener: socket.socket | None = None,
        play: Callable[[Hub], Playback] | None = None,
    ) -> None:
        """Start to serve.

        Raises:
            InputError: aiohttp is missing, or the address cannot be used.
        """
        require_aiohttp()
        self._hello, self._status, self._play = hello, status, play
        self._listener = listener or listen(host, port)
        self._host = host
        self.port: int = self._listener.getsockname()[1]
        shown = "localhost" if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{self.port}/"
        self.warning = None if _is_loopback(host) else f"{self.url}: every machine that reaches it can watch the events"
        self._loop = asyncio.new_event_loop()
        self.hub = Hub(self._loop)
        self._pages: set[_Page] = set()
        self._told: dict[str, str] = {}
        """What every page has to know, by type: also those that join later."""
        self._stop = asyncio.Event()
        self._ready: Future[None] = Future()
        self._thread = threading.Thread(target=self._run, name="clsim-view", daemon=True)
        self._thread.start()
        self._ready.result()

    def close(self) -> None:
        """Tell the pages that the stream has ended, and stop. Safe to call twice."""
        if self._thread.is_alive():
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()

    def tell(self, kind: str, text: str) -> None:
        """Hand a text message to every page, also to those that join later. From any thread."""
        with contextlib.suppress(RuntimeError):  # the loop has closed: the view is over
            self._loop.call_soon_threadsafe(self._tell, kind, text)

    def _tell(self, kind: str, text: str) -> None:
        self._told[kind] = text
        for page in self._pages:
            page.watcher.put_text(kind, text)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except BaseException as error:
            if self._ready.done():
                raise
            self._ready.set_exception(error)
        finally:
            left = asyncio.all_tasks(self._loop)
            for task in left:
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
            self._loop.close()

    async def _serve(self) -> None:
        from aiohttp import web

        @web.middleware
        async def guard(request: web.Request, handler: Any) -> web.StreamResponse:
            self._refuse_strangers(request)
            response: web.StreamResponse = await handler(request)
            return response

        app = web.Application(middlewares=[guard])
        for name, (body, kind) in _page_files().items():
            app.router.add_get(f"/{name}", _static(body, kind))
        app.router.add_get("/", _static(*_page_files()["index.html"]))
        app.router.add_get("/stream", self._stream)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.2)
        await runner.setup()
        await web.SockSite(runner, self._listener).start()
        self._ready.set_result(None)
        ticker = asyncio.create_task(self._tick())
        await self._stop.wait()
        ticker.cancel()
        self._tell("end", json.dumps({"type": "end"}))
        await self._drain()
        await runner.cleanup()

    async def _drain(self) -> None:
        """Give browsers that keep up a moment to take the last events."""
        for _ in range(20):
            await asyncio.sleep(0.02)
            if not any(page.watcher.texts or page.watcher.waiting_events for page in self._pages):
                return

    def _refuse_strangers(self, request: web.Request) -> None:
        """Refuse other sites' pages: neither by their own WebSocket nor by a name that they point at this machine."""
        from aiohttp import web

        origin = request.headers.get("Origin")
        if origin is not None and origin.partition("://")[2] != request.host:
            raise web.HTTPForbidden(text="this stream is for its own page only")
        if _is_loopback(self._host) and not _is_loopback(request.url.host or ""):
            raise web.HTTPForbidden(text="this stream is for this machine only")

    async def _stream(self, request: web.Request) -> web.WebSocketResponse:
        from aiohttp import web

        if len(self._pages) >= MOST_PAGES:
            raise web.HTTPServiceUnavailable(text=f"{MOST_PAGES} pages watch already; close one")
        watcher = Watcher()
        page = _Page(watcher, self.hub if self._play is None else Hub(self._loop), None)
        self._pages.add(page)
        socket = web.WebSocketResponse(heartbeat=20.0, compress=False, max_msg_size=LARGEST_MESSAGE)
        try:
            await socket.prepare(request)
            page.hub.watchers.add(watcher)  # before it hears of us: from then on it misses nothing
            if self._play is not None:
                page.playback = self._play(page.hub)
            await socket.send_str(json.dumps({"type": "hello"} | self._hello))
            for kind, text in self._told.items():
                watcher.put_text(kind, text)
            self._tell_status(page)
            await self._serve_page(page, socket)
        except ConnectionError:
            pass
        finally:
            self._pages.discard(page)
            page.hub.leave(watcher)
            if page.playback is not None:
                page.playback.close()
        return socket

    async def _serve_page(self, page: _Page, socket: web.WebSocketResponse) -> None:
        sender = asyncio.create_task(_send(socket, page.watcher))
        try:
            async for message in socket:
                self._receive(page, message.data)
        finally:
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await sender

    def _receive(self, page: _Page, text: str | bytes) -> None:
        message = parse_message(text)
        if isinstance(message, Seen):
            page.watcher.seen = message.packets
            page.watcher.changed.set()
        elif isinstance(message, WantFrames):
            page.watcher.wants_frames = message.wanted
        elif message is not None and page.playback is not None:
            page.playback.control(message)
            self._tell_status(page)

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(STATUS_PERIOD_S)
            for page in self._pages:
                self._tell_status(page)

    def _tell_status(self, page: _Page) -> None:
        own = {} if page.playback is None else page.playback.status()
        missed = {"missed_events": page.watcher.missed_events}
        page.watcher.put_text("status", json.dumps({"type": "status"} | self._status() | own | missed))


async def _send(socket: web.WebSocketResponse, watcher: Watcher) -> None:
    """Send what waits; a browser that does not read holds up this task and nothing else."""
    with contextlib.suppress(ConnectionError):
        while True:
            await watcher.changed.wait()
            watcher.changed.clear()
            while watcher.texts:
                await socket.send_str(watcher.texts.pop(next(iter(watcher.texts))))
            while (packet := watcher.next_packet()) is not None:
                await socket.send_bytes(packet)


def require_aiohttp() -> None:
    """Raise InputError if the page cannot be served for lack of aiohttp."""
    try:
        import aiohttp.web  # noqa: F401
    except ImportError:
        raise InputError("the page needs aiohttp: pip install 'clsim[view]', or use `view` terminal") from None


def _page_files() -> dict[str, tuple[bytes, str]]:
    page = {
        entry.name: (entry.read_bytes(), _TYPES["." + entry.name.rpartition(".")[2]])
        for entry in files("clsim.live.view").joinpath("page").iterdir()
        if entry.is_file() and "." + entry.name.rpartition(".")[2] in _TYPES
    }
    tables = {
        name: {theme: colormaps.lut(name, theme).reshape(-1).tolist() for theme in ("dark", "light")}
        for name in (*colormaps.NAMES, *colormaps.KINDS)
    }
    page["colormaps.json"] = (json.dumps(tables, separators=(",", ":")).encode(), "application/json")
    return page


def _static(body: bytes, kind: str) -> Any:
    async def handler(_: web.Request) -> web.Response:
        from aiohttp import web

        headers = {"Cache-Control": "no-store", "Content-Security-Policy": _POLICY, "X-Content-Type-Options": "nosniff"}
        return web.Response(body=body, content_type=kind, charset="utf-8", headers=headers)

    return handler


def listen(host: str = "127.0.0.1", port: int | None = None) -> socket.socket:
    """Return a socket that listens where the page is to be served; raises InputError if the address cannot be used."""
    for attempt in (DEFAULT_PORT, 0) if port is None else (port,):
        try:
            family, _, _, _, name = socket.getaddrinfo(host, attempt, type=socket.SOCK_STREAM)[0]
            listener = socket.socket(family, socket.SOCK_STREAM)
            try:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listener.bind(name)
                listener.listen(64)
                return listener
            except OSError:
                listener.close()
                raise
        except (OSError, OverflowError) as error:
            failure = error
    cause = getattr(failure, "strerror", None) or failure
    raise InputError(f"`port`: {host}:{port} cannot be used ({cause}); expected a free port of this machine")


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
