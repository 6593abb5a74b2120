# SPDX-License-Identifier: Apache-2.0
"""Serves the page and its stream, in a thread of its own: one message for all browsers, 25 times a second.

A browser that reads too slowly, or stops, costs nothing: what it has not taken is not queued, and it is sent
everything once it takes again.
"""

import asyncio
import json
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any

import tornado.httpserver
import tornado.web
import tornado.websocket
from plotly.offline import get_plotlyjs

from atpid_control.live.address import Address, listening
from atpid_control.live.errors import LiveError
from atpid_control.live.requests import LONGEST, Request, read_request
from atpid_control.live.view import LiveView

DATA = Path(__file__).parent / "data"
#: Between two messages to the browsers, and until a request without an answer is given up [s].
PERIOD, ANSWER = 0.04, 2.0
#: Browsers at once; requests of one of them without an answer, besides a stop.
MOST, MOST_OPEN = 16, 8
#: Between two questions whether a browser is still there [s].
_PING = 5.0
_COOKIE = "atpid_live"
_HEADERS = {
    # Plotly writes styles into the page
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
#: Success, and one line.
Answer = tuple[bool, str]
#: Called with a request and what takes its answer, from any thread, once.
Act = Callable[[Request, Callable[[Answer], None]], None]
FILES = {
    "page.css": "text/css", "page.js": "text/javascript", "picture.js": "text/javascript",
    "plots.js": "text/javascript",
}  # fmt: skip
#: The library that draws the plots, as the installed package has it.
PLOTLY = "plotly.min.js"


class LiveServer:
    """The page at an address; `close` ends it."""

    def __init__(self, view: LiveView, act: Act, address: Address, methods: tuple[str, ...]) -> None:
        """Serve at once; `methods`: names to choose from. Raises LiveError where the address cannot be used."""
        self.view, self.act, self.methods = view, act, methods
        self._socket = listening(address)
        self.address = Address(address.host, int(self._socket.getsockname()[1]), address.token)
        self.browsers: set[_Stream] = set()
        self._ended: asyncio.Event | None = None
        ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, args=(ready,), name="live page", daemon=True)
        self._thread.start()
        ready.wait()

    def close(self) -> None:
        """End the page; the browsers see that it has ended."""
        if self._thread.is_alive():
            assert self._ended is not None
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join()

    def later(self, do: Callable[[], None]) -> None:
        """Call `do` in the server's thread; after `close` nothing happens."""
        with suppress(RuntimeError):  # it has been closed
            self._loop.call_soon_threadsafe(do)

    def _run(self, ready: threading.Event) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve(ready))
        finally:
            self._loop.close()

    async def _serve(self, ready: threading.Event) -> None:
        self._ended = asyncio.Event()
        given = {"server": self}
        application = tornado.web.Application(
            [(r"/", _Page, given), (r"/stream", _Stream, given), (r"/([A-Za-z.]+)", _File, given)],
            websocket_ping_interval=_PING, websocket_ping_timeout=_PING, websocket_max_message_size=LONGEST,
            log_function=lambda _handler: None,
        )  # fmt: skip
        server = tornado.httpserver.HTTPServer(application, max_body_size=LONGEST, idle_connection_timeout=60.0)
        server.add_socket(self._socket)
        ready.set()
        while not self._ended.is_set():
            self._send()
            try:
                await asyncio.wait_for(self._ended.wait(), PERIOD)
            except asyncio.TimeoutError:
                continue
        server.stop()
        for browser in list(self.browsers):
            browser.close(1001, "the live page has ended")
        await server.close_all_connections()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    def _send(self) -> None:
        """Send what is new to every browser that has taken the message before."""
        if not self.browsers:
            self.view.drop_news()
            return
        now = time.monotonic()
        text, everything = _text(self.view.news(now)), ""
        for browser in list(self.browsers):
            if not browser.behind:
                browser.send(text)
            elif browser.ready:
                everything = everything or _text(self.view.everything(now))
                browser.behind = False
                browser.send(everything)


class _Guarded(tornado.web.RequestHandler):
    """Answers only who names this server, and has the token where one is needed."""

    def initialize(self, server: LiveServer) -> None:
        """Take the server."""
        self.server = server

    def prepare(self) -> None:
        """Refuse everybody else."""
        if not self.server.address.may_be_named(self.request.host):
            raise tornado.web.HTTPError(421, reason="Misdirected Request")
        if not self.server.address.fits(self.get_cookie(_COOKIE) or self.get_query_argument("token", "")):
            raise tornado.web.HTTPError(403)

    def set_default_headers(self) -> None:
        """Let the page load nothing from elsewhere."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    def write_error(self, status_code: int, **_kwargs: Any) -> None:
        """Answer in one line."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        needs = "this page needs its token: open the address that the live page printed when it started"
        self.finish(f"{needs}\n" if status_code == 403 else f"{status_code}\n")


class _Page(_Guarded):
    """The page itself; a token in the address becomes a cookie, so that it does not stay there."""

    def get(self) -> None:
        if self.get_query_argument("token", ""):
            self.set_cookie(_COOKIE, self.server.address.token, httponly=True, samesite="Strict", path="/")
            self.redirect("/")
            return
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish((DATA / "page.html").read_bytes())


class _File(_Guarded):
    """What the page consists of."""

    def get(self, name: str) -> None:
        if name == PLOTLY:
            self.set_header("Content-Type", "text/javascript; charset=utf-8")
            self.set_header("Cache-Control", "private, max-age=86400")  # 5 MB, the same until the package changes
            self.finish(get_plotlyjs())
            return
        if name not in FILES:
            raise tornado.web.HTTPError(404)
        self.set_header("Content-Type", f"{FILES[name]}; charset=utf-8")
        self.finish((DATA / name).read_bytes())


class _Stream(_Guarded, tornado.websocket.WebSocketHandler):
    """One browser. Its requests do not wait for each other: a stop must not."""

    behind = True  # whether it has to be sent everything
    _sending: asyncio.Task[None] | None = None

    def prepare(self) -> None:
        """Refuse a browser too many, too."""
        super().prepare()
        if len(self.server.browsers) >= MOST:
            raise tornado.web.HTTPError(503)

    def open(self, *_args: str, **_kwargs: str) -> None:
        """Begin with the methods there are."""
        self._tasks: set[asyncio.Task[None]] = set()
        self.set_nodelay(True)
        self.server.browsers.add(self)
        self.send(_text({"type": "hello", "methods": self.server.methods}))

    @property
    def ready(self) -> bool:
        """Whether it has taken what it was sent."""
        return self._sending is None

    def send(self, text: str) -> None:
        """Send, unless the last message is still on its way: it is then behind."""
        if self._sending is not None:
            self.behind = True
            return
        self._sending = asyncio.create_task(self._send(text))

    async def _send(self, text: str) -> None:
        try:
            await self.write_message(text)
        except tornado.websocket.WebSocketClosedError:
            self.on_close()
        finally:
            self._sending = None

    def on_message(self, message: str | bytes) -> None:
        """Do a request and answer it; what is none is answered, too."""
        try:
            request = read_request(message)
        except LiveError as error:
            self._begin(self._answer(None, (False, str(error))))
            return
        if len(self._tasks) < MOST_OPEN or request.do == "stop":
            self._begin(self._do(request))
        else:
            self._begin(self._answer(request.number, (False, "too many requests without an answer: wait for them")))

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _do(self, request: Request) -> None:
        await self._answer(request.number, await self._done(request))

    async def _answer(self, number: int | None, answer: Answer) -> None:
        try:
            text = {"type": "answer", "number": number, "success": answer[0], "text": answer[1]}
            await self.write_message(_text(text))
        except tornado.websocket.WebSocketClosedError:
            self.on_close()

    async def _done(self, request: Request) -> Answer:
        answered: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()

        def answer(found: Answer) -> None:
            if not answered.done():
                answered.set_result(found)

        self.server.act(request, lambda found: self.server.later(lambda: answer(found)))
        try:
            return await asyncio.wait_for(answered, ANSWER)
        except asyncio.TimeoutError:
            return False, f"no answer within {ANSWER:g} s"

    def on_close(self) -> None:
        """Forget it."""
        self.server.browsers.discard(self)


def _text(message: Any) -> str:
    return json.dumps(message, separators=(",", ":"), allow_nan=False)
