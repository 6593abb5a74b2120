# SPDX-License-Identifier: Apache-2.0
"""One SelectHeight service a method (`~/lookup`, `~/pca`, `~/direct`): what each would choose; nothing moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from atpid_interfaces.srv import SelectHeight
from rclpy.node import Node

from atpid_control.hold import Estimate
from atpid_control.selection import HeightSelector, SelectionError, make_selector
from atpid_sim.maps import MapError
from atpid_sim.scene import Scene

METHODS = ("lookup", "pca", "direct")


class HeightServices:
    """Services of a node; a method is made ready when it is first asked."""

    def __init__(
        self,
        node: Node,
        scene: Scene,
        height_map: Path | None,
        latest: Callable[[], Estimate | None],
        height: Callable[[], float],
    ) -> None:
        """Serve; `latest` gives the last steady estimate, `height` where the ceiling is [m]."""
        self._scene, self._map, self._latest, self._height = scene, height_map, latest, height
        self._selectors: dict[str, HeightSelector] = {}
        for method in METHODS:
            node.create_service(SelectHeight, f"~/{method}", self._answering(method))

    def _answering(self, method: str) -> Callable[[SelectHeight.Request, SelectHeight.Response], SelectHeight.Response]:
        def answer(request: SelectHeight.Request, response: SelectHeight.Response) -> SelectHeight.Response:
            try:
                if method not in self._selectors:
                    self._selectors[method] = make_selector(method, self._scene, self._map)
                return select_height(self._selectors[method], request, response, self._latest(), self._height())
            except (SelectionError, MapError) as error:
                return refused(method, str(error), response)

        return answer


def select_height(
    selector: HeightSelector,
    request: SelectHeight.Request,
    response: SelectHeight.Response,
    latest: Estimate | None,
    height: float,
) -> SelectHeight.Response:
    """Answer for the amplitude asked about or, where it is 0 or NaN, for the latest steady estimate.

    height: where the ceiling is [m]. Raises SelectionError.
    """
    amplitude, std, frequency = request.amplitude, request.amplitude_std, request.frequency or math.nan
    if not amplitude > 0.0:
        if latest is None:
            raise SelectionError(
                f"amplitude: given {amplitude:g} and no steady estimate yet; give an amplitude above 0 m"
            )
        amplitude, std, frequency = latest.amplitude, latest.amplitude_std, latest.frequency
    chosen = selector.select(amplitude, std, frequency, margin=request.margin, height=height)
    response.success, response.message = True, f"{chosen.method}: {chosen.height:.4f} m for {amplitude:.5f} m"
    response.method, response.height = chosen.method, chosen.height
    response.beam_amplitude, response.efficiency = chosen.beam_amplitude, chosen.efficiency
    response.price, response.evaluations, response.wall_time = chosen.price, chosen.evaluations, chosen.wall_s
    return response


def refused(method: str, message: str, response: SelectHeight.Response) -> SelectHeight.Response:
    """Answer that there is no height, and why."""
    response.success, response.message, response.method = False, message, method
    response.height = response.beam_amplitude = response.efficiency = response.price = math.nan
    return response
