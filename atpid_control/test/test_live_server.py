# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live page's server: who is let in, what is sent, and that no browser costs another one anything."""

import asyncio
import json
import socket
from collections.abc import Callable, Coroutine, Iterator
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from typing import Any

import pytest
from test_live_view import block, event, tone
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from atpid_common.testing import PATIENCE
from atpid_control.views.live import server as server_module
from atpid_control.views.live.address import TOKEN, Address, LiveError, address_of, listening, prepared
from atpid_control.views.live.requests import Request
from atpid_control.views.live.server import FILES, MOST, MOST_CONNECTIONS, MOST_OPEN, Answer, LiveServer
from atpid_control.views.live.view import LiveView

SECRET = "a-token-of-the-test"
COOKIE = {"Cookie": f"atpid_live={SECRET}"}
OLD_COOKIE = {"Cookie": "atpid_live=that-of-the-run-before"}


class Operator:
    """Takes requests; answers a stop at once and nothing else by itself."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.open: list[Callable[[Answer], None]] = []

    def __call__(self, request: Request, answer: Callable[[Answer], None]) -> None:
        self.asked.append(request.do)
        if request.do == "stop":
            answer((True, "stopped"))
        else:
            self.open.append(answer)


def served(operator: Operator, token: str = "") -> Iterator[LiveServer]:
    made = LiveServer(LiveView(None), operator, Address(port=0, token=token), ("lookup", "direct"))
    yield made
    made.close()


@pytest.fixture
def operator() -> Operator:
    return Operator()


@pytest.fixture
def server(operator: Operator) -> Iterator[LiveServer]:
    yield from served(operator)


@pytest.fixture
def guarded(operator: Operator) -> Iterator[LiveServer]:
    yield from served(operator, SECRET)


def run(work: Coroutine[Any, Any, object]) -> None:
    asyncio.run(asyncio.wait_for(work, 200.0))


async def connected(server: LiveServer, **headers: str) -> WebSocketClientConnection:
    address = f"ws://127.0.0.1:{server.address.port}/stream"
    return await websocket_connect(HTTPRequest(address, headers=headers))


def refused(server: LiveServer, **headers: str) -> int:
    """Return the status with which a stream is refused."""
    with pytest.raises(HTTPClientError) as error:
        run(connected(server, **headers))
    return error.value.code


async def until(stream: WebSocketClientConnection, kind: str) -> dict[str, Any]:
    while True:
        text = await stream.read_message()
        assert text is not None, "closed"
        message: dict[str, Any] = json.loads(text)
        if message["type"] == kind:
            return message


async def leave(*streams: WebSocketClientConnection) -> None:
    for stream in streams:
        stream.close()
        while await stream.read_message() is not None:
            pass


async def tab(server: LiveServer) -> WebSocketClientConnection:
    """Return a browser that reads, once the server has seen that it does."""
    before = set(server.browsers)
    stream = await connected(server)
    while not any(one.reads for one in set(server.browsers) - before):
        await until(stream, "news")
    return stream


def connection(server: LiveServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.address.port), 200.0)


def tab_that_reads_nothing(server: LiveServer) -> socket.socket:
    made = connection(server)
    lines = (
        "GET /stream HTTP/1.1", f"Host: 127.0.0.1:{server.address.port}", "Connection: Upgrade", "Upgrade: websocket",
        "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "", "",
    )  # fmt: skip
    made.sendall("\r\n".join(lines).encode())
    return made


def get(server: LiveServer, path: str, **headers: str) -> tuple[int, str, Any]:
    """Return status, text and headers; a redirection is not followed."""
    with closing(HTTPConnection("127.0.0.1", server.address.port, timeout=2.0 * PATIENCE)) as client:
        client.request("GET", path, headers=headers)
        answer = client.getresponse()
        return answer.status, answer.read().decode(), answer.headers


def test_the_page_and_its_files_come_from_the_package_and_nothing_from_elsewhere(server: LiveServer) -> None:
    status, page, headers = get(server, "/")
    assert status == 200
    assert "http" not in page.replace("http-equiv", "")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert {get(server, f"/{name}")[0] for name in FILES} == {200}
    assert {get(server, name)[0] for name in ("/server.py", "/../server.py")} == {404}


def test_a_browser_gets_everything_then_what_is_new(server: LiveServer) -> None:
    server.view.on_block(block(0, tone(50)), 0.0)

    async def look() -> None:
        stream = await connected(server)
        assert (await until(stream, "hello"))["methods"] == ["lookup", "direct"]
        assert len((await until(stream, "all"))["rows"]["motion"]) == 50
        server.view.on_event(event("later"), 0.0)
        while not (news := await until(stream, "news"))["events"]:
            pass
        assert [one["text"] for one in news["events"]] == ["later"]
        late = await connected(server)  # and who comes late has all of it
        assert [one["text"] for one in (await until(late, "all"))["events"]] == ["later"]
        await leave(stream)
        assert (await until(late, "news"))["run"] == 1  # who leaves does no harm
        await leave(late)

    run(look())


def test_a_stop_waits_for_no_requests(server: LiveServer, operator: Operator, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "ANSWER", 200.0)

    async def ask() -> None:
        stream = await connected(server)
        for number in range(20):
            await stream.write_message(json.dumps({"number": number, "do": "hold", "on": True}))
        await stream.write_message('{"number": 99, "do": "stop"}')
        while (answer := await until(stream, "answer"))["number"] != 99:
            assert answer["number"] >= MOST_OPEN  # those that are too many
            assert not answer["success"]
        assert (answer["success"], answer["text"]) == (True, "stopped")
        assert len(operator.open) == MOST_OPEN
        operator.open.pop()((True, "held"))
        assert (await until(stream, "answer"))["success"]
        await leave(stream)

    run(ask())
    assert operator.asked.count("hold") == MOST_OPEN


def test_a_stop_without_an_answer_is_not_confirmed_and_answered_once(
    server: LiveServer, operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "ANSWER", 0.3)

    async def ask() -> None:
        stream = await connected(server)
        await stream.write_message('{"number": 3, "do": "disarm"}')
        answer = await until(stream, "answer")
        operator.open.pop()((True, "motor off"))  # too late: the request has ended
        await until(stream, "news")
        await stream.write_message('{"number": 4, "do": "explode"}')
        other = await until(stream, "answer")
        await leave(stream)
        assert (answer["number"], answer["success"]) == (3, False)
        assert all(part in answer["text"] for part in ("0.3 s", "not", "confirmed", "emergency"))
        assert (other["number"], other["success"]) == (None, False)  # and what is no request is refused
        assert len(other["text"].splitlines()) == 1

    run(ask())


def test_a_page_from_elsewhere_is_kept_out(server: LiveServer) -> None:
    """A page of the internet in the same browser, directly or by a name that leads to this computer."""
    assert get(server, "/", Host="evil.example")[0] == 421
    assert refused(server, Origin="http://evil.example") == 403
    assert refused(server, Host="evil.example", Origin="http://evil.example") == 421


def test_with_a_token_nothing_is_given_without_it(guarded: LiveServer) -> None:
    for path in ("/", "/page.js", "/?token=wrong", "/stream"):
        status, text, _ = get(guarded, path)
        assert (status, SECRET in text) == (403, False)
    assert get(guarded, "/", **OLD_COOKIE)[0] == refused(guarded) == 403
    for cookie in ({}, OLD_COOKIE):  # which a right token in the address replaces
        status, _, headers = get(guarded, f"/?token={SECRET}", **cookie)
        assert (status, headers["Location"]) == (302, "/")
        assert headers["Set-Cookie"].startswith(f"{COOKIE['Cookie']};")
    status, page, _ = get(guarded, "/", **COOKIE)
    assert (status, "<main>" in page) == (200, True)
    assert get(guarded, "/page.js", **COOKIE)[0] == 200

    async def look() -> None:
        await leave(await connected(guarded, **COOKIE))

    run(look())


def test_a_browser_that_does_not_read_delays_no_other_and_is_sent_everything_later(server: LiveServer) -> None:
    for number in range(200):
        server.view.on_event(event(f"{number} {30_000 * 'x'}"), 0.0)  # more than a connection takes unread

    async def look() -> None:
        quick = await connected(server)
        await until(quick, "all")
        before = set(server.browsers)
        with tab_that_reads_nothing(server) as slow:
            while not (found := set(server.browsers) - before):
                await until(quick, "news")
            (stalled,) = found
            while stalled.behind:  # until everything so far is on its way to it
                await until(quick, "news")
            while stalled.ready or not stalled.behind:
                await until(quick, "news")  # which goes on
            read = 0
            while stalled.behind:
                read += len(await asyncio.get_running_loop().run_in_executor(None, slow.recv, 1 << 20))
            assert read > 4_000_000
        await leave(quick)

    run(look())


def test_tabs_that_read_nothing_give_way_to_one_that_does_and_its_stop_is_served(server: LiveServer) -> None:
    async def look() -> None:
        first = await tab(server)
        with ExitStack() as stack:
            for count in range(2, MOST + 4):  # more than there is room for
                stack.enter_context(tab_that_reads_nothing(server))
                while len(server.browsers) < min(count, MOST):
                    await until(first, "news")
            last = await tab(server)
            await last.write_message('{"number": 7, "do": "stop"}')
            assert (await until(last, "answer"))["success"]
            await until(first, "news")  # who reads stays, although it came first
            assert len(server.browsers) == MOST
        await leave(last, first)

    run(look())


def test_hundreds_of_idle_connections_block_no_operator_and_end_by_themselves(guarded: LiveServer) -> None:
    """Without a token: each that is one too many ends the oldest of its kind, none that has the page."""
    with ExitStack() as stack:
        idle = [stack.enter_context(connection(guarded)) for _ in range(400)]
        assert get(guarded, "/", **COOKIE)[0] == 200
        assert len(guarded.connections) <= MOST_CONNECTIONS
        for each in (idle[0], idle[-1]):  # the one for another, the other after a while without a request
            assert each.recv(1) == b""


def test_a_port_that_is_taken_is_one_line_and_free_once_the_server_has_closed(server: LiveServer) -> None:
    with pytest.raises(LiveError, match=rf"^.*127\.0\.0\.1:{server.address.port}\b.*--live-port.*$"):
        LiveServer(LiveView(None), Operator(), server.address, ())

    async def look() -> None:
        stream = await connected(server)
        await until(stream, "all")
        await asyncio.get_running_loop().run_in_executor(None, server.close)
        await leave(stream)  # which the server has closed

    run(look())
    listening(server.address).close()


def test_the_token_is_for_other_computers_and_the_loopback_answers_to_its_own_names_only() -> None:
    for host in ("127.0.0.1", "localhost", "::1", "127.0.0.2"):
        assert address_of(host, 8420, {}).token == ""
    first, second = (address_of("0.0.0.0", 8420, {}).token for _ in range(2))
    assert len(first) >= 16
    assert first != second
    assert address_of("0.0.0.0", 8420, {TOKEN: SECRET}).url.endswith(f"/?token={SECRET}")
    environment: dict[str, str] = {}
    given = prepared("0.0.0.0", 0, environment)
    assert environment == {TOKEN: given.token}
    here = Address()
    assert all(here.may_be_named(name) for name in ("127.0.0.1:8420", "localhost:8420", "localhost", "[::1]:8420"))
    assert not any(here.may_be_named(name) for name in ("evil.example", "127.0.0.1.evil.example:80", ""))
    assert Address(token=SECRET).may_be_named("stand.lab")
    for host, token in (("elsewhere.example", ""), ("", ""), ("256.0.0.1", ""), ("0.0.0.0", "short"),
                        ("0.0.0.0", "with a space in the middle")):  # fmt: skip
        with pytest.raises(LiveError, match=r"^.*$"):
            address_of(host, 8420, {TOKEN: token} if token else {})
