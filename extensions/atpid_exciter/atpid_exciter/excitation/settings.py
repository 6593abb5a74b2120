# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the excitation node. Limits have no defaults."""

from dataclasses import dataclass
from typing import Final

from atpid_driver import SettingsError
from atpid_driver.settings import SupervisedSettings, described

BACKENDS: Final = ("simulated", "labjack_dac", "labjack_stream", "nidaqmx")


@dataclass(frozen=True, kw_only=True)
class ExcitationSettings(SupervisedSettings):
    """Parameters of the excitation node, SI units. Amplitudes are of the support [m], or of a driving force [N]."""

    backend: str = described(
        "what is commanded: the simulated plant's support or force, a T7's analogue output as an inverter's speed, "
        "its stream-out or an NI module's output as a shaker amplifier's input",
        choices=BACKENDS,
    )
    highest_amplitude: float = described(
        "largest amplitude that may be commanded, of the support [m] or of a force [N]; of labjack_dac the eccentric "
        "disc's, the only one there is", "", 1e-9, 1e6,
    )  # fmt: skip
    lowest_frequency: float = described("lowest frequency that may be commanded", "Hz", 0.0, 1e5)
    highest_frequency: float = described("highest frequency that may be commanded", "Hz", 0.0, 1e5)
    rise_time: float = described("from no output to the largest amplitude", "s", 0.01, 600.0, default=2.0)
    frequency_rate: float = described(
        "the frequency changes no faster; a faster sweep is refused", "Hz/s", 1e-4, 1e4, default=1.0
    )
    stop_time: float = described("from any output to none, after a stop and without commands", "s", 0.01, 0.15,
                                 default=0.05)  # fmt: skip
    rate: float = described("states published per second; not used in lockstep", "Hz", 20.0, 200.0, default=20.0)
    stale_timeout: float = described(
        "silence of excitation/command after which the output ramps down; not used in lockstep", "s", 0.1, 60.0,
        default=1.2,
    )  # fmt: skip
    hold_tolerance: float = described("with hold: amplitude and frequency are held within this share", "-", 1e-4, 0.5,
                                      default=0.01)  # fmt: skip
    most_correction: float = described("with hold: the output is at most this many times the command's, or its inverse",
                                       "-", 1.0, 100.0, default=3.0)  # fmt: skip
    hold_timeout: float = described(
        "with hold: so long without a usable estimate, and five periods at least, end the output", "s", 0.2, 60.0,
        default=2.0,
    )  # fmt: skip
    saturation_time: float = described(
        "with hold: so long at its limits, the command missed by more than the tolerance, end the output", "s", 0.1,
        60.0, default=2.0,
    )  # fmt: skip
    calibration: str = described(
        "calibration file of the output, channel drive_frequency [Hz] of labjack_dac, else drive_amplitude", default=""
    )
    calibration_folder: str = described("folder of that file; empty: that of the package's files", default="")
    terminal: str = described("analogue output: DAC0 or DAC1 of a T7, cDAQ1Mod4/ao0 of an NI module", default="DAC0")
    serial: int = described("serial number of the T7; 0: any", "", 0, 2**31 - 1, default=0)
    connection: str = described("how the T7 is connected", choices=("ANY", "USB", "TCP", "ETHERNET", "WIFI"),
                                default="ANY")  # fmt: skip
    sample_rate: float = described("samples per second of a streamed output", "Hz", 100.0, 50_000.0, default=2000.0)
    watchdog: int = described(
        "the T7 itself lets its outputs rest after this silence, where all processes are gone; LabJack advises against "
        "less than 2 to 3 s", "s", 3, 60, default=3,
    )  # fmt: skip
    library: str = described("path of the vendor's library; empty: that of the system", default="")

    def __post_init__(self) -> None:
        """Raise `SettingsError` for an invalid value."""
        super().__post_init__()
        if not 0.0 < self.lowest_frequency < self.highest_frequency:
            raise SettingsError(
                f"lowest_frequency {self.lowest_frequency:g} Hz, highest_frequency {self.highest_frequency:g} Hz: need "
                "0 < lowest < highest"
            )
        if self.backend != "simulated" and not self.calibration:
            raise SettingsError("calibration is empty: give the file that converts the output's voltage")
        if self.backend != "simulated" and self.lockstep:
            raise SettingsError(f"lockstep with backend {self.backend}: a real output has its own clock")
