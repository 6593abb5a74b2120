# SPDX-License-Identifier: Apache-2.0
# Made by `python tests/message_stubs.py` from the definitions; a test compares.
from array import array
from collections.abc import Sequence


class ComputeMap:
    class Goal:
        def __init__(self, *, scene: str = ..., amplitudes: Sequence[float] = ..., mass_fractions: Sequence[float] = ..., out: str = ..., frequency_ratios: Sequence[float] = ...) -> None: ...
        scene: str
        @property
        def amplitudes(self) -> array[float]: ...
        @amplitudes.setter
        def amplitudes(self, value: Sequence[float]) -> None: ...
        @property
        def mass_fractions(self) -> array[float]: ...
        @mass_fractions.setter
        def mass_fractions(self, value: Sequence[float]) -> None: ...
        out: str
        @property
        def frequency_ratios(self) -> array[float]: ...
        @frequency_ratios.setter
        def frequency_ratios(self, value: Sequence[float]) -> None: ...
    class Result:
        def __init__(self, *, success: bool = ..., message: str = ..., out: str = ..., wall_time: float = ...) -> None: ...
        success: bool
        message: str
        out: str
        wall_time: float
    class Feedback:
        def __init__(self, *, done: int = ..., total: int = ..., remaining: float = ...) -> None: ...
        done: int
        total: int
        remaining: float


class SearchHeight:
    class Goal:
        def __init__(self, *, step: float = ..., dwell: float = ..., lowest: float = ..., highest: float = ...) -> None: ...
        step: float
        dwell: float
        lowest: float
        highest: float
    class Result:
        def __init__(self, *, success: bool = ..., message: str = ..., height: float = ..., beam_amplitude: float = ..., iterations: int = ...) -> None: ...
        success: bool
        message: str
        height: float
        beam_amplitude: float
        iterations: int
    class Feedback:
        def __init__(self, *, iteration: int = ..., height: float = ..., beam_amplitude: float = ..., best_height: float = ...) -> None: ...
        iteration: int
        height: float
        beam_amplitude: float
        best_height: float
