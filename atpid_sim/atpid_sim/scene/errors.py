# SPDX-License-Identifier: Apache-2.0
"""The one error a scene can raise."""

from __future__ import annotations


class SceneError(ValueError):
    """A scene that cannot be used; the message is one line: file, key, what was given, what is allowed."""
