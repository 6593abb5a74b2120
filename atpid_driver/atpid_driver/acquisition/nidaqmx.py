# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""An NI-9230 (or another simultaneous module) through NI's own `nidaqmx` package, here or over gRPC.

IEPE inputs are set up as accelerometers of 1 V/g, so that the reading in g is the voltage: the sensor's own
sensitivity belongs to its calibration file, in one place (docs/decisions/0019-acquisition.md).
"""

import importlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from atpid_common.errors import extras
from atpid_driver.acquisition import protocol
from atpid_driver.acquisition.protocol import Channel, Device, DeviceIdentity, NiSettings, Volts

_BUFFER_SECONDS = 10.0
_READ_TIMEOUT = 2.0
_ONE_VOLT_PER_G = 1000.0  # [mV/g]

_MISSING_RUNTIME = (
    "NI-DAQmx is not installed: install the NI-DAQmx driver from ni.com (`python -m nidaqmx installdriver`), set "
    "`library` to the path of libnidaqmx.so, or set `grpc` to the PC that has the hardware"
)
_HINTS: dict[int, tuple[type[protocol.AcquisitionError], str]] = {
    -200279: (protocol.StreamLostError, "the computer fell behind and samples were overwritten"),
    -200284: (protocol.StreamLostError, "the module sends no samples"),
    -200088: (protocol.StreamLostError, "the task does not exist any more"),
    -201003: (protocol.DeviceMissingError, "the module cannot be reached: check cable and power"),
    -200324: (protocol.DeviceMissingError, "the module is absent: check cable, power and its name in NI MAX"),
    -200220: (protocol.DeviceMissingError, "no module has the name given as `device`: look it up in NI MAX"),
    -200170: (protocol.SetupRefusedError, "a terminal does not exist on the module: an NI-9230 has ai0, ai1, ai2"),
    -200077: (
        protocol.SetupRefusedError,
        "the module cannot run at this rate: an NI-9230 takes 12.8 kS/s divided by n",
    ),
}


def load_nidaqmx(path: str = "") -> ModuleType:
    """Return the package `nidaqmx`; with `path`, it loads NI's library from there instead of searching."""
    with extras("NI module", protocol.LibraryMissingError):
        package = importlib.import_module("nidaqmx")
    if path:
        vars(importlib.import_module("nidaqmx._lib"))["find_library"] = lambda _name: path
    return package


@contextmanager
def named_errors(nidaqmx: ModuleType, where: str = "") -> Iterator[None]:
    """Raise nidaqmx's errors as an AcquisitionError: one line, the code, what to do; where: the gRPC server asked."""
    theirs = nidaqmx.errors
    try:
        yield
    except theirs.DaqNotFoundError:
        raise protocol.LibraryMissingError(_MISSING_RUNTIME) from None
    except theirs.RpcError as error:
        raise protocol.DeviceMissingError(
            f"the gRPC device server at {where} does not answer ({error.description}): start it or correct `grpc`"
        ) from None
    except theirs.DaqError as error:
        code = int(error.error_code)
        text = str(error).splitlines()[0]
        kind, hint = _HINTS.get(code, (protocol.StreamLostError, text))
        raise kind(f"{hint} (NI-DAQmx {code})", code) from None


class NiAcquisition(Device[NiSettings]):
    """One continuous task on one module. See Acquisition for what each call promises."""

    _nidaqmx: ModuleType
    _link: Any = None
    _task: Any = None

    def open(self) -> DeviceIdentity:
        """Read the module's type and serial number, and check the latter."""
        settings = self._settings
        self._nidaqmx = load_nidaqmx(settings.library)
        with self._named_errors():
            system = importlib.import_module("nidaqmx.system")
            device = system.Device(settings.device, grpc_options=self._options())
            model, serial = device.product_type, int(device.serial_num)
        self._check_serial(f"{settings.device} is a {model} with", serial)
        return DeviceIdentity(model.replace(" ", "-").lower(), serial)

    def start(self) -> float:
        """Make the task, start it and return the rate the module coerced the one asked for to."""
        self.stop()
        settings = self._settings
        with self._named_errors():
            readers = importlib.import_module("nidaqmx.stream_readers")
            self._task = self._nidaqmx.Task(grpc_options=self._options())
            for channel in settings.channels:
                self._add(channel)
            self._task.timing.cfg_samp_clk_timing(
                settings.rate,
                sample_mode=self._nidaqmx.constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=max(int(_BUFFER_SECONDS * settings.rate), 4 * settings.scans_per_block),
            )
            self._task.start()
            self._reader = readers.AnalogMultiChannelReader(self._task.in_stream)
            self._reader.verify_array_shape = False
            return self._started(float(self._task.timing.samp_clk_rate))

    def _take(self) -> tuple[Volts, int]:
        """Wait in DAQmx, paced by the module's clock."""
        scans = self._settings.scans_per_block
        columns = np.empty((len(self._settings.channels), scans))
        with self._named_errors():
            self._reader.read_many_sample(columns, scans, _READ_TIMEOUT + 2.0 * scans / self._settings.rate)
            return np.ascontiguousarray(columns.T), int(self._task.in_stream.avail_samp_per_chan)

    def stop(self) -> None:
        """Stop and clear the task, whatever state the module is in."""
        task, self._task, self._rate = self._task, None, None
        if task is None:
            return
        try:
            with self._named_errors():
                task.close()
        except protocol.AcquisitionError:
            task._handle = None  # so that its finaliser does not warn about a task that the module has lost already

    def close(self) -> None:
        """Clear the task and close the connection."""
        self.stop()
        if self._link is not None:
            self._link.close()
            self._link = None

    def _options(self) -> object:
        """Return fresh gRPC options for one task, or None for the local library."""
        if not self._settings.grpc:
            return None
        if self._link is None:
            with extras("NI module on another PC", protocol.LibraryMissingError):
                import grpc

            self._link = grpc.insecure_channel(self._settings.grpc)
        return self._nidaqmx.GrpcSessionOptions(self._link, "")

    def _add(self, channel: Channel) -> None:
        settings, constants = self._settings, self._nidaqmx.constants
        terminal = f"{settings.device}/{channel.terminal}"
        limits = {"min_val": -settings.voltage_range, "max_val": settings.voltage_range}
        if channel.kind == "voltage":
            self._task.ai_channels.add_ai_voltage_chan(terminal, **limits)
            return
        self._task.ai_channels.add_ai_accel_chan(
            terminal,
            units=constants.AccelUnits.G,
            sensitivity=_ONE_VOLT_PER_G,
            sensitivity_units=constants.AccelSensitivityUnits.MILLIVOLTS_PER_G,
            current_excit_source=constants.ExcitationSource.INTERNAL,
            current_excit_val=settings.excitation_current,
            **limits,
        )

    def _named_errors(self) -> AbstractContextManager[None]:
        return named_errors(self._nidaqmx, self._settings.grpc)
