# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the page is served, to whom, and the token that another computer needs."""

import hmac
import importlib.util
import ipaddress
import os
import secrets
import socket
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass

from atpid_common.errors import InputError

HOST, PORT = "127.0.0.1", 8420
#: The token of a page that is not for this computer alone; in the environment, since parameters are public.
TOKEN = "ATPID_LIVE_TOKEN"
_SHORTEST = 16  # characters of a token that is given
#: Names under which a browser on this computer reaches the loopback.
_LOCAL = ("127.0.0.1", "localhost", "::1")


class LiveError(InputError):
    """A live page that cannot be served; one line: what was given, what is allowed, what to do."""


@dataclass(frozen=True)
class Address:
    """Host and port to listen on, and the token; "" on the loopback."""

    host: str = HOST
    port: int = PORT
    token: str = ""

    @property
    def url(self) -> str:
        """The page's address, with the token where one is needed."""
        host, token = _reachable(self.host), f"?token={self.token}" if self.token else ""
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/{token}"

    def may_be_named(self, host: str) -> bool:
        """Whether a request may name this host: on the loopback no other, or a page from elsewhere could reach it."""
        name = host.rsplit(":", 1)[0] if host.count(":") == 1 or "]" in host else host
        return bool(self.token) or name.strip("[]").lower() in _LOCAL

    def fits(self, token: str) -> bool:
        """Whether `token` opens the page; compared in the same time whatever it is."""
        return not self.token or hmac.compare_digest(self.token.encode(), token.encode())


def address_of(host: str, port: int, environment: Mapping[str, str] = os.environ) -> Address:
    """Return the address; beyond the loopback its token is that of the environment, or a new one.

    Raises LiveError for what is no address of this computer, and for a token that is too short.
    """
    try:
        found = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError:
        raise LiveError(
            f"live page: host: given {host!r}; allowed: an address of this computer, such as 127.0.0.1 or 0.0.0.0"
        ) from None
    if found.is_loopback:
        return Address(str(found), port)
    given = environment.get(TOKEN, "")
    if given and (len(given) < _SHORTEST or not given.isascii() or not given.isprintable() or " " in given):
        raise LiveError(f"{TOKEN}: allowed: {_SHORTEST} or more ASCII characters without spaces; or not set")
    return Address(str(found), port, given or secrets.token_urlsafe(16))


def _reachable(host: str) -> str:
    """Return an address at which others reach a server that listens on `host`; this computer's own for 0.0.0.0."""
    if host not in ("0.0.0.0", "::"):
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing: only finds the way out
            return str(probe.getsockname()[0])
        except OSError:
            return HOST


def listening(address: Address) -> socket.socket:
    """Return a socket that listens there. Raises LiveError, in one line, where that is not possible."""
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((address.host, address.port))
        made.listen(128)
    except OSError as error:
        made.close()
        place = f"{address.host}:{address.port}"
        raise LiveError(
            f"live page: {place} cannot be used ({error.strerror}): another program may have it; "
            "stop that, or give another port (--live-port of bench and stand, parameter port of live_node)"
        ) from None
    made.setblocking(False)
    return made


def require_library() -> None:
    """Raise LiveError where the library is missing that serves the page."""
    try:
        found = importlib.util.find_spec("tornado")
    except ValueError:  # hidden
        found = None
    if found is None:
        raise LiveError("live page: it needs tornado: make setup, or sudo apt install python3-tornado")


def prepared(host: str, port: int, environment: MutableMapping[str, str] = os.environ) -> Address:
    """Return the address for a node started from here, tried; its token goes into the environment it inherits.

    Raises LiveError.
    """
    require_library()
    address = address_of(host, port, environment)
    if port:
        listening(address).close()
    if address.token:
        environment[TOKEN] = address.token
    return address
