# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live page's server: who is let in, what is sent, and that no browser costs another one anything."""

import asyncio
import json
import os
import resource
import socket
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from typing import Any, TypeVar
from urllib.error import HTTPError
from urllib.request import HTTPCookieProcessor, OpenerDirector, Request, build_opener

import pytest
from test_live_view import block, event, tone
from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from atpid_control.views.live.address import TOKEN, Address, LiveError, address_of, listening, prepared
from atpid_control.views.live.requests import Request as Asked
from atpid_control.views.live.server import DROPPED, FILES, MOST, MOST_CONNECTIONS, Answer, LiveServer
from atpid_control.views.live.view import LiveView

T = TypeVar("T")
SECRET = "a-token-of-the-test"


class Operator:
    """Takes requests; answers a stop at once and nothing else until `release`."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.open: list[Callable[[Answer], None]] = []

    def __call__(self, request: Asked, answer: Callable[[Answer], None]) -> None:
        self.asked.append(request.do)
        if request.do == "stop":
            answer((True, "motor off"))
        else:
            self.open.append(answer)


@pytest.fixture
def server() -> Iterator[LiveServer]:
    made = LiveServer(LiveView(None), Operator(), Address(port=0), ("lookup", "direct"))
    yield made
    made.close()


@pytest.fixture
def guarded() -> Iterator[LiveServer]:
    made = LiveServer(LiveView(None), Operator(), Address(port=0, token=SECRET), ("lookup",))
    yield made
    made.close()


def run(work: Coroutine[Any, Any, T]) -> T:
    return asyncio.run(asyncio.wait_for(work, 30.0))


def origin(server: LiveServer) -> str:
    return f"127.0.0.1:{server.address.port}"


async def connected(server: LiveServer, headers: dict[str, str] | None = None) -> WebSocketClientConnection:
    request = HTTPRequest(f"ws://{origin(server)}/stream", headers=headers or {})
    return await websocket_connect(request)


async def until(stream: WebSocketClientConnection, kind: str) -> dict[str, Any]:
    """Return the next message of a kind."""
    while True:
        text = await stream.read_message()
        assert text is not None, "closed"
        message: dict[str, Any] = json.loads(text)
        if message["type"] == kind:
            return message


UPGRADE = (
    "Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
)  # fmt: skip


def refused(server: LiveServer, **headers: str) -> int:
    """Return the status with which a stream is refused."""
    connection = HTTPConnection("127.0.0.1", server.address.port, timeout=30.0)
    try:
        connection.request("GET", "/stream", headers={**dict(line.split(": ") for line in UPGRADE), **headers})
        return connection.getresponse().status
    finally:
        connection.close()


async def leave(stream: WebSocketClientConnection) -> None:
    stream.close()
    while await stream.read_message() is not None:
        pass


def get(server: LiveServer, path: str, opener: OpenerDirector | None = None, **headers: str) -> tuple[int, str, Any]:
    try:
        request = Request(f"http://{origin(server)}{path}", headers=headers)
        with (opener or build_opener()).open(request, timeout=30.0) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except HTTPError as error:
        with error:
            return error.code, error.read().decode(), error.headers


def test_the_page_and_its_files_come_from_the_package_and_nothing_from_elsewhere(server: LiveServer) -> None:
    status, page, headers = get(server, "/")
    assert status == 200
    assert "http" not in page.replace("http-equiv", "")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    for name in FILES:
        assert get(server, f"/{name}")[0] == 200
    assert get(server, "/server.py")[0] == 404
    assert get(server, "/../server.py")[0] == 404


def test_a_browser_gets_everything_then_what_is_new(server: LiveServer) -> None:
    server.view.on_block(block(0, tone(50)), 0.0)

    async def look() -> None:
        stream = await connected(server)
        assert (await until(stream, "hello"))["methods"] == ["lookup", "direct"]
        assert len((await until(stream, "all"))["rows"]["motion"]) == 50
        server.view.on_event(event("later"), 0.0)
        while True:
            news = await until(stream, "news")
            if news["events"]:
                break
        assert [one["text"] for one in news["events"]] == ["later"]
        late = await connected(server)  # and who comes late has all of it
        assert [one["text"] for one in (await until(late, "all"))["events"]] == ["later"]
        await leave(stream)
        assert (await until(late, "news"))["run"] == 1  # who leaves does no harm
        await leave(late)

    run(look())


def test_a_stop_does_not_wait_for_other_requests(server: LiveServer) -> None:
    async def ask() -> None:
        stream = await connected(server)
        for number in range(20):
            await stream.write_message(json.dumps({"number": number, "do": "hold", "on": True}))
        await stream.write_message('{"number": 99, "do": "stop"}')
        while (answer := await until(stream, "answer"))["number"] != 99:
            assert not answer["success"]
            assert "too many" in answer["text"]
        assert (answer["success"], answer["text"]) == (True, "motor off")
        assert "no answer within 2 s" in (await until(stream, "answer"))["text"]
        await leave(stream)

    run(ask())
    assert isinstance(server.act, Operator)
    assert server.act.asked.count("hold") == 8


def test_a_stop_without_an_answer_is_not_confirmed_and_answered_once(server: LiveServer) -> None:
    async def ask() -> str:
        stream = await connected(server)
        await stream.write_message('{"number": 3, "do": "disarm"}')
        answer = await until(stream, "answer")
        assert isinstance(server.act, Operator)
        server.act.open.pop()((True, "motor off"))  # too late: the request has ended
        await until(stream, "news")
        await leave(stream)
        assert not answer["success"]
        return str(answer["text"])

    assert run(ask()) == "no answer within 2 s; motor off is not confirmed: use the emergency stop"


def test_what_is_no_request_is_refused_in_one_line(server: LiveServer) -> None:
    async def ask() -> dict[str, Any]:
        stream = await connected(server)
        await stream.write_message('{"number": 1, "do": "explode"}')
        answer = await until(stream, "answer")
        await leave(stream)
        return answer

    answer = run(ask())
    assert not answer["success"]
    assert len(answer["text"].splitlines()) == 1


def test_a_page_from_elsewhere_is_kept_out(server: LiveServer) -> None:
    """A page of the internet in the same browser, directly or by a name that leads to this computer."""
    assert get(server, "/", Host="evil.example")[0] == 421
    assert refused(server, Origin="http://evil.example") == 403
    assert refused(server, Host="evil.example", Origin="http://evil.example") == 421


def test_with_a_token_nothing_is_given_without_it(guarded: LiveServer) -> None:
    for path in ("/", "/page.js", "/?token=wrong", "/stream"):
        status, text, _ = get(guarded, path)
        assert (status, SECRET in text) == (403, False)
    assert refused(guarded) == 403
    opener = build_opener(HTTPCookieProcessor())
    status, page, _ = get(guarded, f"/?token={SECRET}", opener)
    assert (status, "<main>" in page) == (200, True)
    assert get(guarded, "/page.js", opener)[0] == 200  # by the cookie

    async def look() -> None:
        await leave(await connected(guarded, {"Cookie": f"atpid_live={SECRET}"}))

    run(look())


def test_a_browser_that_does_not_read_delays_no_other_and_is_sent_everything_later(server: LiveServer) -> None:
    for number in range(200):
        server.view.on_event(event(f"{number} {30_000 * 'x'}"), 0.0)  # more than a connection takes unread

    async def look() -> None:
        quick = await connected(server)
        await until(quick, "all")
        before = set(server.browsers)
        with socket.create_connection(("127.0.0.1", server.address.port)) as slow:
            slow.sendall("\r\n".join(["GET /stream HTTP/1.1", f"Host: {origin(server)}", *UPGRADE, "", ""]).encode())
            while not (found := set(server.browsers) - before):
                await until(quick, "news")
            (stalled,) = found
            while stalled.behind:  # until everything so far is on its way to it
                await until(quick, "news")
            while stalled.ready or not stalled.behind:
                await until(quick, "news")  # which goes on
            slow.settimeout(30.0)
            read = 0
            while stalled.behind:
                read += len(await asyncio.get_running_loop().run_in_executor(None, slow.recv, 1 << 20))
            assert read > 4_000_000
        await leave(quick)

    run(look())


def test_a_right_token_in_the_address_beats_the_cookie_of_an_earlier_run_and_replaces_it(guarded: LiveServer) -> None:
    opener = build_opener(HTTPCookieProcessor())
    opener.addheaders = [("Cookie", "atpid_live=that-of-the-run-before")]
    status, text, _ = get(guarded, "/", opener)
    assert (status, "open the address" in text) == (403, True)
    connection = HTTPConnection("127.0.0.1", guarded.address.port, timeout=30.0)
    try:
        connection.request("GET", f"/?token={SECRET}", headers={"Cookie": "atpid_live=that-of-the-run-before"})
        answer = connection.getresponse()
        assert (answer.status, answer.headers["Location"]) == (302, "/")
        assert answer.headers["Set-Cookie"].startswith(f"atpid_live={SECRET};")
    finally:
        connection.close()


async def tab(server: LiveServer) -> WebSocketClientConnection:
    """Return a browser that reads, once the server has seen that it does."""
    before = set(server.browsers)
    stream = await connected(server)
    while not (new := set(server.browsers) - before) or not any(one.reads for one in new):
        await until(stream, "news")
    return stream


def test_tabs_that_read_nothing_give_way_to_one_that_does_and_its_stop_is_served(server: LiveServer) -> None:
    async def look() -> None:
        first = await tab(server)
        with ExitStack() as stack:
            for count in range(2, MOST + 4):  # more than there is room for
                idle = stack.enter_context(socket.create_connection(("127.0.0.1", server.address.port)))
                idle.sendall(
                    "\r\n".join(["GET /stream HTTP/1.1", f"Host: {origin(server)}", *UPGRADE, "", ""]).encode()
                )
                while len(server.browsers) < min(count, MOST):
                    await until(first, "news")
            operator = await tab(server)
            await operator.write_message('{"number": 7, "do": "stop"}')
            assert (await until(operator, "answer"))["success"]
            await until(first, "news")  # who reads stays, although it came first
            assert len(server.browsers) == MOST
        await leave(operator)
        await leave(first)

    run(look())


def test_of_tabs_that_all_read_the_first_learns_that_another_has_its_place(server: LiveServer) -> None:
    async def look() -> None:
        streams = [await tab(server) for _ in range(MOST + 1)]
        await leave(streams[0])
        assert streams[0].close_code == DROPPED
        for stream in streams[1:]:
            await until(stream, "news")
            await leave(stream)

    run(look())


def test_hundreds_of_idle_connections_block_no_operator_and_end_by_themselves(guarded: LiveServer) -> None:
    """Without a token: each that is one too many ends the oldest of its kind, none that has the page."""
    opener = build_opener(HTTPCookieProcessor())
    with ExitStack() as stack:
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", guarded.address.port))) for _ in range(400)]
        assert get(guarded, f"/?token={SECRET}", opener)[0] == 200
        assert len(guarded.connections) <= MOST_CONNECTIONS
        for each in (idle[0], idle[-1]):  # the one for another, the other after a while without a request
            each.settimeout(30.0)
            assert each.recv(1) == b""


def test_where_files_run_out_the_log_has_one_line_and_the_page_is_served_again(
    server: LiveServer, capfd: pytest.CaptureFixture[str]
) -> None:
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ExitStack() as stack:
        waiting = [stack.enter_context(socket.socket()) for _ in range(8)]
        highest = max(one.fileno() for one in waiting)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 1, limits[1]))
            taken = []
            with suppress(OSError):  # every file that is left
                while True:
                    taken.append(stack.enter_context(open(os.devnull)))
            for each in waiting:
                each.connect(("127.0.0.1", server.address.port))
            said = ""
            while "live page:" not in said:
                said += capfd.readouterr().err
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert get(server, "/")[0] == 200
    said += capfd.readouterr().err
    assert said.splitlines() == ["live page: no connection can be accepted: Too many open files"]


def test_a_port_that_is_taken_is_one_line_and_names_the_option(server: LiveServer) -> None:
    with pytest.raises(LiveError) as error:
        LiveServer(LiveView(None), Operator(), server.address, ())
    assert f"{origin(server)} cannot be used" in str(error.value)
    assert "--live-port" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_closing_ends_the_thread_and_frees_the_port() -> None:
    made = LiveServer(LiveView(None), Operator(), Address(port=0), ())

    async def look() -> None:
        stream = await connected(made)
        await until(stream, "all")
        await asyncio.get_running_loop().run_in_executor(None, made.close)
        await leave(stream)  # which the server has closed

    run(look())
    assert "live page" not in [thread.name for thread in threading.enumerate()]
    listening(made.address).close()
    made.close()


def test_the_token_is_for_other_computers_only() -> None:
    for host in ("127.0.0.1", "localhost", "::1", "127.0.0.2"):
        assert address_of(host, 8420, {}).token == ""
    first, second = (address_of("0.0.0.0", 8420, {}).token for _ in range(2))
    assert len(first) >= 16
    assert first != second
    assert address_of("0.0.0.0", 8420, {TOKEN: SECRET}).url.endswith(f"/?token={SECRET}")
    environment: dict[str, str] = {}
    assert environment == {}
    given = prepared("0.0.0.0", 0, environment)
    assert environment == {TOKEN: given.token}


@pytest.mark.parametrize(("host", "environment"), [
    ("elsewhere.example", {}), ("", {}), ("256.0.0.1", {}), ("0.0.0.0", {TOKEN: "short"}),
    ("0.0.0.0", {TOKEN: "with a space in the middle"}),
])  # fmt: skip
def test_an_address_that_cannot_be_is_one_line(host: str, environment: dict[str, str]) -> None:
    with pytest.raises(LiveError) as error:
        address_of(host, 8420, environment)
    assert len(str(error.value).splitlines()) == 1


def test_the_loopback_answers_to_its_own_names_only() -> None:
    here = Address()
    assert all(here.may_be_named(name) for name in ("127.0.0.1:8420", "localhost:8420", "localhost", "[::1]:8420"))
    assert not any(here.may_be_named(name) for name in ("evil.example", "127.0.0.1.evil.example:80", ""))
    assert Address(token=SECRET).may_be_named("stand.lab")
