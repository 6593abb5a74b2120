# SPDX-License-Identifier: Apache-2.0
"""The entry point of a node's executable: loads the node's module, which takes seconds, with signals handled."""

import importlib

from atpid_common.errors import DONE
from atpid_common.interrupt import Interrupt


def run_executable(module: str) -> int:
    """Import `module` and run its `main`; return the exit status. An interrupt while loading ends with status 0."""
    with Interrupt() as interrupt:
        try:
            if interrupt.received:
                return DONE
            loaded = importlib.import_module(module)
            # the exception is lost where it is raised in a callback of the interpreter, such as a finaliser
            return DONE if interrupt.received else int(loaded.main())
        except BaseException:
            # a library that is being loaded may turn KeyboardInterrupt into an error of its own
            if interrupt.received:
                return DONE
            raise
        finally:
            interrupt.ignore_further()
