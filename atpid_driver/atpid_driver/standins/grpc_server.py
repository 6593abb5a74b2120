# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: N802, D102 - the methods are named by the service that NI defined
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
        code = self._library.DAQmxCreateAIAccelChan(
            self._task(request, context),
            request.physical_channel.encode(),
            request.name_to_assign_to_channel.encode(),
            request.terminal_config_raw,
            ctypes.c_double(request.min_val),
            ctypes.c_double(request.max_val),
            request.units_raw,
            ctypes.c_double(request.sensitivity),
            request.sensitivity_units_raw,
            request.current_excit_source_raw,
            ctypes.c_double(request.current_excit_val),
            request.custom_scale_name.encode(),
        )
        self._check(context, code)
        return types.CreateAIAccelChanResponse()

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        code = self._library.DAQmxCreateAIVoltageChan(
            self._task(request, context),
            request.physical_channel.encode(),
            request.name_to_assign_to_channel.encode(),
            request.terminal_config_raw,
            ctypes.c_double(request.min_val),
            ctypes.c_double(request.max_val),
            request.units_raw,
            request.custom_scale_name.encode(),
        )
        self._check(context, code)
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

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = ctypes.c_uint()
        code = self._library.DAQmxGetSystemInfoAttribute(request.attribute_raw, ctypes.byref(value))
        self._check(context, code)
        return types.GetSystemInfoAttributeUInt32Response(value=value.value)

    def GetDeviceAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = ctypes.c_uint()
        name = request.device_name.encode()
        code = self._library.DAQmxGetDeviceAttribute(name, request.attribute_raw, ctypes.byref(value), 0)
        self._check(context, code)
        return types.GetDeviceAttributeUInt32Response(value=value.value)

    def GetDeviceAttributeString(self, request: Any, context: Any) -> Any:
        text = ctypes.create_string_buffer(TEXT)
        name = request.device_name.encode()
        self._check(context, self._library.DAQmxGetDeviceAttribute(name, request.attribute_raw, text, TEXT))
        return types.GetDeviceAttributeStringResponse(value=text.value.decode())

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:
        text = ctypes.create_string_buffer(TEXT)
        task = self._task(request, context)
        self._check(context, self._library.DAQmxGetTaskAttribute(task, request.attribute_raw, text, TEXT))
        return types.GetTaskAttributeStringResponse(value=text.value.decode())

    def GetTaskAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = ctypes.c_uint()
        task = self._task(request, context)
        self._check(context, self._library.DAQmxGetTaskAttribute(task, request.attribute_raw, ctypes.byref(value), 0))
        return types.GetTaskAttributeUInt32Response(value=value.value)

    def GetTimingAttributeDouble(self, request: Any, context: Any) -> Any:
        value = ctypes.c_double()
        task = self._task(request, context)
        self._check(context, self._library.DAQmxGetTimingAttribute(task, request.attribute_raw, ctypes.byref(value)))
        return types.GetTimingAttributeDoubleResponse(value=value.value)

    def GetReadAttributeUInt32(self, request: Any, context: Any) -> Any:
        value = ctypes.c_uint()
        task = self._task(request, context)
        self._check(context, self._library.DAQmxGetReadAttribute(task, request.attribute_raw, ctypes.byref(value), 0))
        return types.GetReadAttributeUInt32Response(value=value.value)

    def GetErrorString(self, request: Any, _context: Any) -> Any:
        return types.GetErrorStringResponse(error_string=self._text(request.error_code))

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
