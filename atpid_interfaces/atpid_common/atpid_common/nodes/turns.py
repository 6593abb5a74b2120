# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The executor of a node process: one wait for all that may come, then a call for each entity that is ready."""

from __future__ import annotations

import time
import types
from collections.abc import Callable, Coroutine, Iterator
from contextlib import suppress
from functools import partial
from typing import Any

from rclpy.context import Context
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.task import Task
from rclpy.utilities import timeout_sec_to_nsec
from rclpy.waitable import NumberOfEntities, Waitable

#: Between two looks for events of the middleware, of which every publisher and subscription has two [s].
_EVENTS_PERIOD = 1.0
#: The kinds of entities that are called at once, in this order.
_KINDS = ("timer", "subscription", "client", "service")
#: The kinds in the order in which a wait set counts them.
_COUNTED = ("subscription", "guard_condition", "timer", "client", "service")


class TurnExecutor(SingleThreadedExecutor):
    """Calls what rclpy's executor calls, in its order, for a fraction of its processor time.

    rclpy makes the set that it waits on anew for each callback, and wakes itself once more after it. Here the set is
    made when an entity comes or goes. What is rare is left to rclpy: actions, guard conditions and, looked at once a
    second, the middleware's events. Callback groups do not count, since nothing is called in a second thread.
    """

    _tasks: list[tuple[Task, object, object]]  # rclpy's: each task with the entity and node it is for

    def __init__(self, gather: float = 0.0, *, context: Context | None = None) -> None:
        """Begin without a node; gather: pause before each turn, after which all messages are taken [s]."""
        super().__init__(context=context)
        self._gather = gather
        self._wait_set: Any = None  # None: to be made
        self._add: list[Callable[[], object]] = []  # puts each entity into the set
        self._entities: dict[tuple[str, int], Any] = {}  # by kind, and by the number that the set gives back
        self._rare: list[Waitable] = []
        self._rare_at = 0.0  # when to look for what is rare again, steady [s]

    def add_node(self, node: Node) -> bool:
        """Add a node; return whether it was not there before."""
        self._wait_set = None
        return bool(super().add_node(node))

    def remove_node(self, node: Node) -> None:
        """Remove a node."""
        self._wait_set = None
        super().remove_node(node)

    def wake(self) -> None:
        """End the wait: an entity has come or gone, or a coroutine can go on."""
        self._wait_set = None
        super().wake()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait until something is ready, `timeout_sec` [s] at most; call all that is.

        One message of a topic is taken; with `gather` all there are, but for no longer than that.
        """
        self._go_on()
        if time.monotonic() > self._rare_at:
            self._call_rare()
        time.sleep(self._gather)
        wait_set = self._wait_set or self._make()
        wait_set.clear_entities()
        for add in self._add:
            add()
        wait_set.wait(timeout_sec_to_nsec(timeout_sec))
        if not self._context.ok():
            raise ExternalShutdownException
        entities = self._entities  # others may be made by what is called
        ready = [(kind, number) for kind in _KINDS for number in wait_set.get_ready_entities(kind)]
        rare = [waitable for waitable in self._rare if waitable.is_ready(wait_set)]
        for number in wait_set.get_ready_entities("guard_condition"):
            if guard := entities.get(("guard_condition", number)):  # else the executor's own
                guard._executor_triggered = True
                rare.append(guard)
        until = time.monotonic() + self._gather
        for kind, entity in ((kind, entities.get((kind, number))) for kind, number in ready):
            while entity and self._call(kind, entity) and kind == "subscription" and time.monotonic() < until:
                pass
        if rare:
            self._call_rare()

    def _call(self, kind: str, entity: Any) -> bool:
        """Take what has come for an entity and call its callback; return whether there was something.

        A callback before may have destroyed or reset it.
        """
        taken = None
        with suppress(InvalidHandle), entity.handle:
            if kind != "timer" or entity.handle.is_timer_ready():
                taken = getattr(self, f"_take_{kind}")(entity)
        if taken is None:
            return False
        called = taken()
        with suppress(StopIteration):  # it is done
            called.send(None)
            self.create_task(_awaited, called)
        return True

    def _go_on(self) -> None:
        """Call what waits to be called, and go on with coroutines until each of them waits for something."""
        ended = bool(self._tasks)
        while ended:
            with self._tasks_lock:
                tasks = list(self._tasks)
            for task, *_ in tasks:
                task()
                task.result()
            with self._tasks_lock:
                self._tasks = [entry for entry in self._tasks if not (entry[0].done() or entry[0].cancelled())]
                ended = bool(self._tasks) and any(task.done() for task, *_ in tasks)

    def _call_rare(self) -> None:
        """Call all that is ready as rclpy does it."""
        self._rare_at = time.monotonic() + _EVENTS_PERIOD
        with suppress(TimeoutException):  # there is no more
            while True:
                handler, *_ = self.wait_for_ready_callbacks(timeout_sec=0.0)
                handler()
                handler.result()

    def _make(self) -> Any:
        """Return the set for the entities that there are."""
        nodes = self.get_nodes()
        entities = {
            kind: [entity for node in nodes for entity in getattr(node, f"{kind}s")]
            for kind in (*_KINDS, "guard", "waitable")
        }
        self._rare = [entity for entity in entities.pop("waitable") if not isinstance(entity, EventHandler)]
        entities["guard_condition"] = [*entities.pop("guard"), self._guard]
        count = NumberOfEntities(*(len(entities[kind]) for kind in _COUNTED))
        for waitable in self._rare:
            count += waitable.get_num_entities()
        made = self._wait_set = _rclpy.WaitSet(
            *(getattr(count, f"num_{kind}s") for kind in (*_COUNTED, "event")), self._context.handle
        )
        self._entities = {
            (kind, entity.handle.pointer): entity
            for kind in entities
            for entity in entities[kind]
            if entity is not self._guard
        }
        self._add = [
            partial(getattr(made, f"add_{kind}"), entity.handle) for kind in entities for entity in entities[kind]
        ]
        self._add += [partial(waitable.add_to_wait_set, made) for waitable in self._rare]
        return made


async def _awaited(called: Coroutine[None, None, object]) -> None:
    """Wait for the end of a callback that has been called, and waits for something itself."""
    await _resumed(called)


@types.coroutine
def _resumed(called: Coroutine[None, None, object]) -> Iterator[None]:
    """Go on with a coroutine that has begun; `await` takes none that waits already."""
    with suppress(StopIteration):
        while True:
            yield
            called.send(None)
