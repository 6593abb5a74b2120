# SPDX-License-Identifier: Apache-2.0
# Made by `python tests/message_stubs.py` from the definitions; a test compares.


class SelectHeight:
    class Request:
        def __init__(self, *, amplitude: float = ..., amplitude_std: float = ..., frequency: float = ..., margin: float = ...) -> None: ...
        amplitude: float
        amplitude_std: float
        frequency: float
        margin: float
    class Response:
        def __init__(self, *, success: bool = ..., message: str = ..., height: float = ..., beam_amplitude: float = ..., efficiency: float = ..., price: float = ..., evaluations: int = ..., wall_time: float = ..., method: str = ...) -> None: ...
        success: bool
        message: str
        height: float
        beam_amplitude: float
        efficiency: float
        price: float
        evaluations: int
        wall_time: float
        method: str
