# SPDX-License-Identifier: Apache-2.0
"""The live page beside a run of `bench` and `stand`: its options, and the node that serves it."""

import argparse
import sys
from pathlib import Path
from typing import Any

from atpid_common.arguments import whole, word
from atpid_control.graph.parts import LIVE
from atpid_control.live.address import HOST, PORT, prepared, require_library
from atpid_control.live.errors import LiveError
from atpid_control.security import enclave_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add = parser.add_argument
    add("--live", action="store_true", help="show the run in a browser while it goes on, in real time (docs/live.md)")
    host = "address to serve the live page on; another than the loopback needs the token that is printed"
    add("--live-host", type=word, default=HOST, metavar="ADDRESS", help=f"{host}; default: %(default)s")
    port = "TCP port of the live page; default: %(default)s"
    add("--live-port", type=whole(1, 65535), default=PORT, metavar="PORT", help=port)


def check(args: argparse.Namespace) -> None:
    """Raise LiveError for options that do not fit, or an address that cannot be used; nothing is started yet.

    Without the library that serves the page, the run goes on without it: one line says what to install.
    """
    if not args.live:
        if (args.live_host, args.live_port) != (HOST, PORT):
            raise LiveError("--live-host, --live-port: given without --live; allowed: with it")
        return
    try:
        require_library()
    except LiveError as error:
        print(f"left out: {error}", file=sys.stderr)
        args.live = False
        return
    args.live_address = prepared(args.live_host, args.live_port)


def announced(args: argparse.Namespace) -> bool:
    """Print the page's address, where it was asked for; return whether it was."""
    if args.live:
        print(f"live page: {args.live_address.url}", file=sys.stderr)
    return bool(args.live)


def parameters(args: argparse.Namespace) -> dict[str, Any]:
    """Return the node's parameters."""
    own = {"host": args.live_address.host, "port": args.live_address.port, "scene": str(args.scene.absolute())}
    return LIVE.configured() | own


def command(parameter_file: Path) -> tuple[str, list[str]]:
    """Return its name and command."""
    words = ["--ros-args", *enclave_arguments(LIVE.name), "--params-file", str(parameter_file)]
    return LIVE.name, [str(LIVE.executable), *words]
