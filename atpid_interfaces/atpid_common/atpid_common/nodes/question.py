# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A request to another node's service that is made again where no answer comes: discovery may lose the first ones."""

import math
from collections.abc import Callable
from typing import Any

from rclpy.client import Client
from rclpy.task import Future

#: Until a request without an answer is made again [s].
AGAIN = 0.5


class Question:
    """One request at a time to one service."""

    def __init__(self, client: Client, answered: Callable[[Any], None]) -> None:
        """Take the service's client; `answered` is called with each answer, not with that of a request made again."""
        self._client, self._answered = client, answered
        self._asked, self._pending = -math.inf, False
        self._future = Future()

    def ask(self, request: Any, now: float, period: float = 0.0) -> None:
        """Make the request at the steady time `now` [s], unless it is too soon.

        That is less than `period` [s] after the last one, or `AGAIN` where that has no answer.
        """
        wait = AGAIN if self._pending else period
        if now - self._asked < wait or not self._client.service_is_ready():
            return
        self._client.remove_pending_request(self._future)
        self._asked, self._pending = now, True
        self._future = self._client.call_async(request)
        self._future.add_done_callback(self._done)

    def _done(self, future: Future) -> None:
        if future is self._future and future.exception() is None:
            self._pending = False
            self._answered(future.result())
