# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Serves the page and its stream, in a thread of its own: one message for all browsers, 25 times a second.

A browser that reads too slowly, or stops, costs nothing: what it has not taken is not queued, and it is sent
everything once it takes again. Connections and browsers are bounded, and one too many ends another one: first those
that have shown no token, or do not read, so that the operator can always connect.
"""

import asyncio
import json
import sys
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from pathlib import Path
from typing import Any

import tornado.httpserver
import tornado.iostream
import tornado.web
import tornado.websocket
from plotly.offline import get_plotlyjs

from atpid_common.files import Document
from atpid_control.views.live.address import Address, LiveError, listening
from atpid_control.views.live.requests import LONGEST, Request, read_request
from atpid_control.views.live.view import LiveView

_DATA = Path(__file__).parent / "data"
#: Between two messages to the browsers, and until a request without an answer is given up; arming takes longer [s].
PERIOD, ANSWER, _ARMING = 0.04, 2.0, 7.0
#: Browsers at once; requests of one of them without an answer, besides a stop; connections that are no stream.
MOST, MOST_OPEN, MOST_CONNECTIONS = 16, 8, 32
#: Between two questions whether a browser is still there; until a request has come, or another one on its connection;
#: until a message that is not taken shows that a browser does not read, and one that is dropped has to be gone [s].
_PING, _HEAD, _STALLED, _LEAVE = 5.0, 5.0, 1.0, 0.5
#: Until a connection is accepted again where one could not be [s].
_AGAIN = 1.0
#: Status with which a browser is dropped for another one: it does not come back by itself.
DROPPED = 1013
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
#: Kinds of the page, of no name, and of the files it consists of.
FILES = {"": "text/html", "page.css": "text/css"}
FILES |= dict.fromkeys(("page.js", "picture.js", "plots.js"), "text/javascript")
#: The library that draws the plots, as the installed package has it.
_PLOTLY = "plotly.min.js"


class LiveServer:
    """The page at an address; `close` ends it."""

    def __init__(self, view: LiveView, act: Act, address: Address, methods: tuple[str, ...]) -> None:
        """Serve at once; `methods`: names to choose from. Raises LiveError where the address cannot be used."""
        self.view, self.act, self.methods = view, act, methods
        self._socket = listening(address)
        self.address = Address(address.host, int(self._socket.getsockname()[1]), address.token)
        self.browsers: dict[_Stream, None] = {}  # in the order they came
        self.connections: dict[tornado.iostream.IOStream, bool] = {}  # that are no stream: whether it may have the page
        self._accepts = True
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
        routes = [(r"/stream", _Stream, given), (r"/([A-Za-z.]*)", _File, given)]
        settings: Document = {"websocket_ping_interval": _PING, "websocket_ping_timeout": _PING}
        settings |= {"websocket_max_message_size": LONGEST, "log_function": lambda _handler: None}
        application = tornado.web.Application(routes, **settings)
        server = _Connections(application, max_body_size=LONGEST, idle_connection_timeout=_HEAD, body_timeout=_HEAD)
        server.open = self.connections
        self._loop.add_reader(self._socket, self._accept, server)
        ready.set()
        while not self._ended.is_set():
            self._send()
            try:
                await asyncio.wait_for(self._ended.wait(), PERIOD)
            except asyncio.TimeoutError:
                continue
        self._loop.remove_reader(self._socket)
        self._socket.close()
        for browser in list(self.browsers):
            browser.close(1001, "the live page has ended")
        await server.close_all_connections()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    def _accept(self, server: "_Connections") -> None:
        """Accept connections; where none can be, for want of files, one line, and once more a second later."""
        try:
            for _ in range(MOST_CONNECTIONS // 2):  # then those that were accepted are read, before they are too many
                connection, address = self._socket.accept()
                connection.setblocking(False)
                server.handle_stream(tornado.iostream.IOStream(connection), address)
                self._accepts = True
        except (BlockingIOError, ConnectionAbortedError):
            return
        except OSError as error:
            if self._accepts:
                print(f"live page: no connection can be accepted: {error.strerror}", file=sys.stderr, flush=True)
            self._accepts = False
            while server.open:
                server.close_one()
            self._loop.remove_reader(self._socket)
            self._loop.call_later(_AGAIN, self._listen_again, server)

    def _listen_again(self, server: "_Connections") -> None:
        if self._socket.fileno() >= 0:  # it has not ended
            self._loop.add_reader(self._socket, self._accept, server)

    def take_in(self, browser: "_Stream") -> None:
        """Serve a browser; one too many ends the first that does not read, else the one that came first."""
        if len(self.browsers) >= MOST:
            idle = (one for one in self.browsers if not one.reads)
            next(idle, next(iter(self.browsers))).drop()
        self.browsers[browser] = None

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


class _Connections(tornado.httpserver.HTTPServer):
    """Connections that are no stream: one too many ends the oldest that has not shown that it may have the page."""

    open: dict[tornado.iostream.IOStream, bool]

    def handle_stream(self, stream: tornado.iostream.IOStream, address: tuple[object, ...]) -> None:
        """Serve a connection."""
        if len(self.open) >= MOST_CONNECTIONS:
            self.close_one()
        self.open[stream] = False
        super().handle_stream(stream, address)

    def close_one(self) -> None:
        """End a connection."""
        stream = next((stream for stream, admitted in self.open.items() if not admitted), next(iter(self.open)))
        del self.open[stream]
        stream.close()

    def on_close(self, server_conn: Any) -> None:
        """Forget a connection that has ended, or has become a stream."""
        self.open.pop(server_conn.stream, None)
        super().on_close(server_conn)


class _Guarded(tornado.web.RequestHandler):
    """Answers only who names this server, and has the token where one is needed."""

    def initialize(self, server: LiveServer) -> None:
        """Take the server."""
        self.server = server

    def prepare(self) -> None:
        """Refuse everybody else."""
        if not self.server.address.may_be_named(self.request.host):
            raise tornado.web.HTTPError(421, reason="Misdirected Request")
        # the address first: a browser may have the cookie of an earlier run
        if not any(map(self.server.address.fits, (self.get_query_argument("token", ""), self.get_cookie(_COOKIE, "")))):
            raise tornado.web.HTTPError(403)
        stream = getattr(self.request.connection, "stream", None)
        if stream in self.server.connections:
            self.server.connections[stream] = True

    def set_default_headers(self) -> None:
        """Let the page load nothing from elsewhere."""
        for name, value in _HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    def write_error(self, status_code: int, **_kwargs: object) -> None:
        """Answer in one line."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        needs = "this page needs its token: open the address that the live page printed when it started"
        self.finish(f"{needs}\n" if status_code == 403 else f"{status_code}\n")


class _File(_Guarded):
    """What the page consists of, and the page itself; a token in its address becomes a cookie, so as not to stay."""

    def get(self, name: str) -> None:
        if not name and self.get_query_argument("token", ""):
            self.set_cookie(_COOKIE, self.server.address.token, httponly=True, samesite="Strict", path="/")
            self.redirect("/")
        elif name == _PLOTLY:
            self.set_header("Content-Type", "text/javascript; charset=utf-8")
            self.set_header("Cache-Control", "private, max-age=86400")  # 5 MB, the same until the package changes
            self.finish(get_plotlyjs())
        elif name in FILES:
            self.set_header("Content-Type", f"{FILES[name]}; charset=utf-8")
            self.finish((_DATA / (name or "page.html")).read_bytes())
        else:
            raise tornado.web.HTTPError(404)


class _Stream(_Guarded, tornado.websocket.WebSocketHandler):
    """One browser. Its requests do not wait for each other: a stop must not."""

    behind = True  # whether it has to be sent everything
    _sending: asyncio.Task[None] | None = None
    _sent = 0.0  # steady [s]
    _answered = False  # the ping it began with

    def open(self, *_args: str, **_kwargs: str) -> None:
        """Begin with the methods there are."""
        self._tasks: set[asyncio.Task[None]] = set()
        self.set_nodelay(True)
        self.server.take_in(self)
        self.ping()
        self.send(_text({"type": "hello", "methods": self.server.methods}))

    def on_pong(self, data: bytes) -> None:
        """Take that it reads."""
        del data
        self._answered = True

    @property
    def reads(self) -> bool:
        """Whether it has shown that it reads what it is sent, and has not stopped to."""
        return self._answered and (self.ready or time.monotonic() - self._sent < _STALLED)

    def drop(self) -> None:
        """End it for another one."""
        self.on_close()
        connection = getattr(self.ws_connection, "stream", None)
        self.close(DROPPED, "another page was opened, and there are no more at once")
        if connection is not None:  # one that does not read takes no farewell
            asyncio.get_running_loop().call_later(_LEAVE, connection.close)

    @property
    def ready(self) -> bool:
        """Whether it has taken what it was sent."""
        return self._sending is None

    def send(self, text: str) -> None:
        """Send, unless the last message is still on its way: it is then behind."""
        if self._sending is not None:
            self.behind = True
            return
        self._sent = time.monotonic()
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

    async def _answer(self, number: int | None, answer: Answer) -> None:
        try:
            text = {"type": "answer", "number": number, "success": answer[0], "text": answer[1]}
            await self.write_message(_text(text))
        except tornado.websocket.WebSocketClosedError:
            self.on_close()

    async def _do(self, request: Request) -> None:
        answered: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()

        def answer(found: Answer) -> None:
            if not answered.done():
                answered.set_result(found)

        self.server.act(request, lambda found: self.server.later(lambda: answer(found)))
        limit = _ARMING if request.do == "arm" else ANSWER
        try:
            found = await asyncio.wait_for(answered, limit)
        except asyncio.TimeoutError:
            stop = "; motor off is not confirmed: use the emergency stop" if request.do in ("stop", "disarm") else ""
            found = (False, f"no answer within {limit:g} s{stop}")
        await self._answer(request.number, found)

    def on_close(self) -> None:
        """Forget it."""
        self.server.browsers.pop(self, None)


def _text(message: object) -> str:
    return json.dumps(message, separators=(",", ":"), allow_nan=False)
