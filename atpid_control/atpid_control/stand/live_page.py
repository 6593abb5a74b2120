# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The live page beside a run of `bench` and `stand`, or of nodes that run already: options, and the node."""

import argparse
import sys

from atpid_common.files import Document
from atpid_control.stand.parts import LIVE, Part
from atpid_control.views.live.address import HOST, PORT, LiveError, prepared, require_library


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


def parts(args: argparse.Namespace) -> list[Part]:
    """Return the node that serves the page, where it was asked for, and print its address."""
    if args.live:
        print(f"live page: {args.live_address.url}", file=sys.stderr)
    return [LIVE] if args.live else []


def parameters(args: argparse.Namespace) -> Document:
    """Return what the run sets in it."""
    if not args.live:
        return {}
    return {"host": args.live_address.host, "port": args.live_address.port, "scene": str(args.scene.absolute())}


def serve(args: argparse.Namespace) -> int:
    """Serve the page of nodes that run already, in this process, until interrupted; return the exit status."""
    from atpid_control.nodes import live_node  # needs ROS

    values = {"host": args.host, "port": args.port}
    values |= {"scene": str(args.scene.absolute())} if args.scene else {}
    words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    moved = ["-r", f"__ns:=/{args.namespace.strip('/')}"] if args.namespace else []
    return live_node.main(["--ros-args", *words, *moved])
