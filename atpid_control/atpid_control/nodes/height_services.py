# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The SelectHeight services: `~/select` by the loop's method, `~/lookup`, `~/pca`, `~/direct`. They move nothing."""

import math
import traceback
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import TypeVar

from atpid_interfaces.srv import SelectHeight
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from atpid_common.errors import AtpidError
from atpid_control.identification import Estimate
from atpid_control.selection import Excitation, HeightSelector, Selection
from atpid_control.selection.checks import HeightRequest, Resonance, range_warnings, resolved
from atpid_control.selection.protocol import box_in_words, reach_of
from atpid_sim.scene import Scene

T = TypeVar("T")


async def computed(node: Node, executor: Executor, compute: Callable[[], T]) -> T:
    """Return what `compute` returns, or raise what it raises; to be awaited in a callback of `node`.

    The callback has to be in a ReentrantCallbackGroup, else it holds up the other callbacks of its group.
    """
    result = executor.submit(compute)
    if not result.done():
        finished = Future()

        def wake(_: object) -> None:
            finished.set_result(None)
            if node.executor is not None:
                node.executor.wake()

        result.add_done_callback(wake)
        await finished
    return result.result()


_METHODS = ("lookup", "pca", "direct")


class HeightServices:
    """Services of a node. A selector is made at the first request, and used by these services only."""

    def __init__(
        self,
        node: Node,
        executor: Executor,
        make: Callable[[str], HeightSelector],
        method: str,
        situation: Callable[[], tuple[Estimate | None, float, Resonance]],
        scene: Scene,
    ) -> None:
        """Serve.

        executor: where heights are computed, one call at a time; make: returns the selector of a method, raises
        SelectionError or MapError; method: the loop's; situation: returns the latest steady estimate, the ceiling's
        height [m] and where heights hold; scene: whose ceiling's range a height may lie beyond.
        """
        self._node, self._executor, self._make, self._situation = node, executor, make, situation
        self._scene, self.method = scene, method
        self._selectors: dict[str, HeightSelector] = {}
        group = ReentrantCallbackGroup()
        for name, used in [("select", ""), *((name, name) for name in _METHODS)]:
            node.create_service(SelectHeight, f"~/{name}", partial(self._answer, used), callback_group=group)

    async def _answer(
        self, method: str, request: SelectHeight.Request, response: SelectHeight.Response
    ) -> SelectHeight.Response:
        method = method or self.method
        try:
            latest, height, resonance = self._situation()
            given = HeightRequest(request.amplitude, request.amplitude_std, request.frequency, request.margin)
            ask = partial(self._select, method, given, latest, resonance, height)
            excitation, chosen = await computed(self._node, self._executor, ask)
        except AtpidError as error:
            return refused(method, str(error), response)
        except Exception as error:  # noqa: BLE001  # a defect: reported, but the loop goes on
            self._node.get_logger().error(f"~/{method}: {traceback.format_exc()}")
            return refused(method, f"internal error: {type(error).__name__}: {error}", response)
        _filled(chosen, f"{excitation.amplitude:.5f} {self._scene.driven_by.unit}", response)
        response.message = "; ".join([response.message, *range_warnings(self._scene, chosen)])
        return response

    def _select(
        self, method: str, request: HeightRequest, latest: Estimate | None, resonance: Resonance, height: float
    ) -> tuple[HeightRequest, Selection]:
        """Return the excitation that a request stands for, and its height."""
        if method not in self._selectors:
            resolved(request, latest, replace(resonance, reach=(0.0, math.inf)))  # refused before a map is read
            self._selectors[method] = self._make(method)
        selector = self._selectors[method]
        asked = resolved(request, latest, replace(resonance, reach=reach_of(selector)))
        excitation = Excitation(asked.amplitude, asked.amplitude_std, asked.frequency)
        return asked, selector.select(excitation, asked.margin, height)


def _filled(chosen: Selection, amplitude: str, response: SelectHeight.Response) -> SelectHeight.Response:
    """Fill the response with a height selected for an amplitude, given in words."""
    note = f" ({chosen.note})" if chosen.note else ""
    response.success, response.message = True, f"{chosen.method}: {chosen.height:.4f} m for {amplitude}{note}"
    response.message += f"; {chosen.no_use}" if chosen.no_use else ""
    response.message += f"; the margin is for {box_in_words(chosen.box)}" if chosen.box else ""
    response.method, response.height = chosen.method, chosen.height
    response.beam_amplitude, response.efficiency = chosen.beam_amplitude, chosen.efficiency
    response.price, response.evaluations, response.wall_time = chosen.price, chosen.evaluations, chosen.wall_s
    return response


def refused(method: str, message: str, response: SelectHeight.Response) -> SelectHeight.Response:
    """Fill the response where there is no height, with the reason."""
    response.success, response.message, response.method = False, message, method
    response.height = response.beam_amplitude = response.efficiency = response.price = math.nan
    return response
