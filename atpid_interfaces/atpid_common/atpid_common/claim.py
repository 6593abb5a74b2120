# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Names that one process at a time holds on this machine: of nodes, of ROS domains, of output folders."""

import socket


def claimed(name: str) -> socket.socket | None:
    """Hold `name` until the socket returned is closed; None where another process holds it.

    It is a Linux abstract socket, which the kernel frees even after SIGKILL, at once and without a file.
    """
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        holder.bind(f"\0atpid/{name}")
    except OSError:
        holder.close()
        return None
    return holder
