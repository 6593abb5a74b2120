# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""NI's gRPC device server as far as an analogue input task needs it, on loopback, over the stand-in library.

Built from the stubs that ship in `nidaqmx[grpc]`. Like NI's own server it hands each call to the local library, an
error travelling in the trailing metadata as `ni-error` and a time-out of a read in its response's status.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent import futures
from ctypes import byref, c_double, c_int, c_uint, c_ulonglong, c_void_p
from pathlib import Path
from typing import Any

import grpc
import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as types
from nidaqmx._stubs import nidaqmx_pb2_grpc as stubs

NOT_YET = -200284
INVALID_TASK = -200088
TEXT = 2048
#: What the library takes of a request besides the task, by the name of the call.
ARGUMENTS: dict[str, Callable[[Any], list[Any]]] = {
    "CfgSampClkTiming": lambda request: [
        request.source.encode(), c_double(request.rate), request.active_edge_raw, request.sample_mode_raw,
        c_ulonglong(request.samps_per_chan),
    ],
    "CreateAIVoltageChan": lambda request: channel(request),
    "CreateAIAccelChan": lambda request: channel(
        request, c_double(request.sensitivity), request.sensitivity_units_raw, request.current_excit_source_raw,
        c_double(request.current_excit_val),
    ),
    "StartTask": lambda _request: [],
    "StopTask": lambda _request: [],
    "ClearTask": lambda _request: [],
}  # fmt: skip


def channel(request: Any, *sensor: Any) -> list[Any]:
    names = [request.physical_channel.encode(), request.name_to_assign_to_channel.encode()]
    limits = [c_double(request.min_val), c_double(request.max_val)]
    scale = request.custom_scale_name.encode()
    return [*names, request.terminal_config_raw, *limits, request.units_raw, *sensor, scale]


class Servicer(stubs.NiDAQmxServicer):  # type: ignore[misc]  # nidaqmx has no types
    """The calls of a continuous analogue input task. A task is known by the name it was made with."""

    def __init__(self, library: Path) -> None:
        self.library = ctypes.CDLL(str(library))
        self._tasks: dict[str, c_void_p] = {}

    def CreateTask(self, request: Any, context: Any) -> Any:  # noqa: N802  # as NI has it
        handle, name = c_void_p(), request.session_name or f"task{len(self._tasks)}"
        self.check(context, self.library.DAQmxCreateTask(name.encode(), byref(handle)))
        self._tasks[name] = handle
        return types.CreateTaskResponse(task={"name": name}, new_session_initialized=True)

    def ReadAnalogF64(self, request: Any, context: Any) -> Any:  # noqa: N802
        values, read = np.empty(request.array_size_in_samps), c_int()
        place = values.ctypes.data_as(ctypes.POINTER(c_double))
        how = request.num_samps_per_chan, c_double(request.timeout), request.fill_mode_raw
        task = self.task(request, context)
        code = self.library.DAQmxReadAnalogF64(task, *how, place, c_uint(values.size), byref(read), None)
        self.check(context, 0 if code == NOT_YET else code)
        return types.ReadAnalogF64Response(status=code, read_array=values, samps_per_chan_read=read.value)

    def GetErrorString(self, request: Any, _context: Any) -> Any:  # noqa: N802
        return types.GetErrorStringResponse(error_string=self._text(request.error_code))

    def task(self, request: Any, context: Any) -> c_void_p:
        if request.task.name not in self._tasks:
            self.check(context, INVALID_TASK)  # which raises
        return self._tasks[request.task.name]

    def forget(self, request: Any) -> None:
        self._tasks.pop(request.task.name, None)

    def _text(self, code: int) -> str:
        text = ctypes.create_string_buffer(TEXT)
        self.library.DAQmxGetErrorString(code, text, TEXT)
        return text.value.decode()

    def check(self, context: Any, code: int) -> None:
        if code < 0:
            context.set_trailing_metadata((("ni-error", str(code)),))
            context.abort(grpc.StatusCode.UNKNOWN, self._text(code))


def passed_on(name: str) -> Any:
    """Return the call that hands its arguments to the library."""

    def call(servicer: Servicer, request: Any, context: Any) -> Any:
        task = servicer.task(request, context)
        if name == "ClearTask":
            servicer.forget(request)
        servicer.check(context, getattr(servicer.library, f"DAQmx{name}")(task, *ARGUMENTS[name](request)))
        return getattr(types, f"{name}Response")()

    return call


def attribute(owner: str, kind: str) -> Any:
    """Return the call that reads an attribute of the system, a device or a task; `kind`: its type by NI's name."""

    def get(servicer: Servicer, request: Any, context: Any) -> Any:
        value: Any = {"UInt32": c_uint(), "Double": c_double()}.get(kind)
        text = ctypes.create_string_buffer(TEXT)
        place, size = (text, TEXT) if kind == "String" else (byref(value), 0)
        subject: list[Any] = [request.device_name.encode()] if owner == "Device" else []
        if owner in ("Task", "Timing", "Read"):
            subject = [servicer.task(request, context)]
        call = getattr(servicer.library, f"DAQmxGet{owner}Attribute")
        servicer.check(context, call(*subject, request.attribute_raw, place, size))
        response = getattr(types, f"Get{owner}Attribute{kind}Response")
        return response(value=text.value.decode() if kind == "String" else value.value)

    return get


for name in ARGUMENTS:
    setattr(Servicer, name, passed_on(name))
for owner, kinds in (
    ("SystemInfo", ["UInt32"]), ("Device", ["UInt32", "String"]), ("Task", ["UInt32", "String"]),
    ("Timing", ["Double"]), ("Read", ["UInt32"]),
):  # fmt: skip
    for kind in kinds:
        setattr(Servicer, f"Get{owner}Attribute{kind}", attribute(owner, kind))


class Server:
    """The server on a loopback port of its own, for as long as the `with` lasts; `address` is what a client names."""

    def __init__(self, library: Path, port: int = 0) -> None:
        self._workers = futures.ThreadPoolExecutor(max_workers=4)
        self._server = grpc.server(self._workers)
        stubs.add_NiDAQmxServicer_to_server(Servicer(library), self._server)
        self.address = f"127.0.0.1:{self._server.add_insecure_port(f'127.0.0.1:{port}')}"

    def __enter__(self) -> Server:
        self._server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop(grace=None).wait()
        self._workers.shutdown()
