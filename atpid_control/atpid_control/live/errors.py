# SPDX-License-Identifier: Apache-2.0
"""Why there is no live page."""

from atpid_common.errors import InputError


class LiveError(InputError):
    """A live page that cannot be served; one line: what was given, what is allowed, what to do."""
