# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a watch's settings."""

from atpid_common.errors import InputError


class WatchError(InputError):
    """Settings a watch cannot work with."""
