# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A kernel that several workers need at once is compiled by the first: numba's cache has no lock."""

import fcntl
import hashlib
import os
import re
from contextlib import suppress
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

_compile = Dispatcher.compile
#: One byte of this file, far behind its end, is locked for each kernel; the file itself is not changed.
_file = os.open(__file__, os.O_RDWR)


def _compile_once(kernel: Any, signature: Any) -> Any:
    """Do what `Dispatcher.compile` does, which first looks into the cache, in one process at a time."""
    types = re.sub("0x[0-9a-f]+", "", str(signature))  # addresses in this process
    name = f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}{types}"
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:7], "big")
    with global_compiler_lock:  # before the file's, which the process has only once
        with suppress(OSError):  # each waits for what the other compiles: at once, as without this
            fcntl.lockf(_file, fcntl.LOCK_EX, 1, place)
        try:
            return _compile(kernel, signature)
        finally:
            fcntl.lockf(_file, fcntl.LOCK_UN, 1, place)


def install() -> None:
    """Compile this way from here on."""
    setattr(Dispatcher, "compile", _compile_once)  # noqa: B010 - a method, for mypy
