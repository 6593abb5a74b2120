# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N802 - the methods are named by the service that NI defined
"""NI's gRPC device server as far as an analogue input task needs it, on loopback, over the stand-in library.

Built from the stubs that ship in `nidaqmx[grpc]`. Like NI's own server it hands each call to the local library, an
error travelling in the trailing metadata as `ni-error` and a time-out of a read in its response's status.
"""

from __future__ import annotations

import ctypes
from concurrent import futures
from pathlib import Path
from typing import Any

import grpc
import numpy as np
from nidaqmx._stubs import nidaqmx_pb2 as types
from nidaqmx._stubs import nidaqmx_pb2_grpc as stubs

NOT_YET = -200284
INVALID_TASK = -200088
TEXT = 2048


class Servicer(stubs.NiDAQmxServicer):  # type: ignore[misc]  # nidaqmx has no types
    """The calls of a continuous analogue input task. A task is known by the name it was made with."""

    def __init__(self, library: Path) -> None:
        self._library = ctypes.CDLL(str(library))
        self._tasks: dict[str, ctypes.c_void_p] = {}
        self._count = 0

    def CreateTask(self, request: Any, context: Any) -> Any:
        handle = ctypes.c_void_p()
        self._count += 1
        name = request.session_name or f"task{self._count}"
        self._check(context, self._library.DAQmxCreateTask(name.encode(), ctypes.byref(handle)))
        self._tasks[name] = handle
        return types.CreateTaskResponse(task={"name": name}, new_session_initialized=True)

    def CreateAIAccelChan(self, request: Any, context: Any) -> Any:
        sensor = (
            ctypes.c_double(request.sensitivity),
            request.sensitivity_units_raw,
            request.current_excit_source_raw,
            ctypes.c_double(request.current_excit_val),
        )
        self._add_channel(self._library.DAQmxCreateAIAccelChan, request, context, *sensor)
        return types.CreateAIAccelChanResponse()

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        self._add_channel(self._library.DAQmxCreateAIVoltageChan, request, context)
        return types.CreateAIVoltageChanResponse()

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:
        code = self._library.DAQmxCfgSampClkTiming(
            self._task(request, context),
            request.source.encode(),
            ctypes.c_double(request.rate),
            request.active_edge_raw,
            request.sample_mode_raw,
            ctypes.c_ulonglong(request.samps_per_chan),
        )
        self._check(context, code)
        return types.CfgSampClkTimingResponse()

    def StartTask(self, request: Any, context: Any) -> Any:
        self._check(context, self._library.DAQmxStartTask(self._task(request, context)))
        return types.StartTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:
        self._check(context, self._library.DAQmxStopTask(self._task(request, context)))
        return types.StopTaskResponse()

    def ClearTask(self, request: Any, context: Any) -> Any:
        task = self._task(request, context)
        self._tasks.pop(request.task.name, None)
        self._check(context, self._library.DAQmxClearTask(task))
        return types.ClearTaskResponse()

    def ReadAnalogF64(self, request: Any, context: Any) -> Any:
        values = np.empty(request.array_size_in_samps)
        read = ctypes.c_int()
        code = self._library.DAQmxReadAnalogF64(
            self._task(request, context),
            request.num_samps_per_chan,
            ctypes.c_double(request.timeout),
            request.fill_mode_raw,
            values.ctypes.data_as(ctypes.POINTER(ctypes.c_double)),
            ctypes.c_uint(values.size),
            ctypes.byref(read),
            None,
        )
        self._check(context, 0 if code == NOT_YET else code)
        return types.ReadAnalogF64Response(status=code, read_array=values, samps_per_chan_read=read.value)

    def GetErrorString(self, request: Any, _context: Any) -> Any:
        return types.GetErrorStringResponse(error_string=self._text(request.error_code))

    def _add_channel(self, create: Any, request: Any, context: Any, *sensor: Any) -> None:
        """Call `create`, whose arguments differ only in those of the sensor."""
        code = create(
            self._task(request, context),
            request.physical_channel.encode(),
            request.name_to_assign_to_channel.encode(),
            request.terminal_config_raw,
            ctypes.c_double(request.min_val),
            ctypes.c_double(request.max_val),
            request.units_raw,
            *sensor,
            request.custom_scale_name.encode(),
        )
        self._check(context, code)

    def _task(self, request: Any, context: Any) -> ctypes.c_void_p:
        handle = self._tasks.get(request.task.name)
        if handle is None:
            self._check(context, INVALID_TASK)
            raise AssertionError("unreachable: abort raises")
        return handle

    def _text(self, code: int) -> str:
        text = ctypes.create_string_buffer(TEXT)
        self._library.DAQmxGetErrorString(code, text, TEXT)
        return text.value.decode()

    def _check(self, context: Any, code: int) -> None:
        if code < 0:
            context.set_trailing_metadata((("ni-error", str(code)),))
            context.abort(grpc.StatusCode.UNKNOWN, self._text(code))


def attribute(owner: str, kind: str) -> Any:
    """Return the call that reads an attribute of the system, a device or a task; `kind`: its type by NI's name."""

    def get(servicer: Servicer, request: Any, context: Any) -> Any:
        value: Any = {"UInt32": ctypes.c_uint(), "Double": ctypes.c_double()}.get(kind)
        text = ctypes.create_string_buffer(TEXT)
        place, size = (text, TEXT) if kind == "String" else (ctypes.byref(value), 0)
        subject: list[Any] = [request.device_name.encode()] if owner == "Device" else []
        if owner in ("Task", "Timing", "Read"):
            subject = [servicer._task(request, context)]
        call = getattr(servicer._library, f"DAQmxGet{owner}Attribute")
        servicer._check(context, call(*subject, request.attribute_raw, place, size))
        response = getattr(types, f"Get{owner}Attribute{kind}Response")
        return response(value=text.value.decode() if kind == "String" else value.value)

    return get


for owner, kind in (
    ("SystemInfo", "UInt32"),
    ("Device", "UInt32"),
    ("Device", "String"),
    ("Task", "UInt32"),
    ("Task", "String"),
    ("Timing", "Double"),
    ("Read", "UInt32"),
):
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
