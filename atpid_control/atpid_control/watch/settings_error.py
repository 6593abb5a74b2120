# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a watch's settings."""


class WatchError(ValueError):
    """Settings a watch cannot work with."""
