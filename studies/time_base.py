# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How well two devices' clocks are known, and the error bars of sweeps and of tones in an acceleration.

Transports, beams and noise are drawn here, the beams' motion by scipy. `--page FILE` puts the tables between the lines
`<!-- made by python -m studies time-base -->` and `<!-- end -->` of a page.
"""

import argparse
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from atpid_common.arguments import file_path, whole
from atpid_control.analysis import Signals, frequency_response
from atpid_control.identification import Identifier, Quality, Settings
from atpid_control.runs.signal import clock_of
from atpid_driver.clock import DeviceClock, time_base_ns
from atpid_sim.display import counting
from atpid_sim.system import Array
from studies.selection_speed import into

TAU, HOUR = 2.0 * math.pi, 3600.0
#: Half a 95 % interval in standard deviations; frequency at which phases are compared [Hz].
WIDTH, AT = 1.959964, 100.0
#: Arguments of the example in the help.
EXAMPLE = "--pairs 1 --signals 5"
#: Largest drift of a crystal [-], and the change of it by temperature within the hour [-].
DRIFT, WANDER = 40e-6, 0.3e-6
Flags = NDArray[np.bool_]
Delays = Callable[[np.random.Generator, Array], Array]


def _usb(random: np.random.Generator, end: Array) -> Array:
    """Return delays (n,), 0.3 ms in the mean; one in fifty has a heavy tail; for 50 s, anywhere, all are 5 ms more."""
    begin = end[0] + random.uniform(-50.0, HOUR)
    tail = (random.random(end.size) < 0.02) * 1e-3 * random.pareto(1.5, end.size)
    return np.asarray(random.exponential(3e-4, end.size) + tail + 5e-3 * ((end > begin) & (end < begin + 50.0)))


def _frames(random: np.random.Generator, end: Array) -> Array:
    """Return delays (n,) until the next of the host's frames of 1 ms, and 0.1 ms more."""
    return np.asarray(np.mod(random.uniform(0.0, 1e-3) - end, 1e-3) + random.exponential(1e-4, end.size))


def _two_stages(random: np.random.Generator, end: Array) -> Array:
    """Return the sum (n,) of two delays of a mean of 0.15 ms: none is nearly without delay."""
    return np.asarray(random.gamma(2.0, 1.5e-4, end.size))


#: Delays, change of the drift [-], length of a block [s].
TRANSPORTS: dict[str, tuple[Delays, float, float]] = {
    "0.3 ms, heavy tail, 50 s late": (_usb, 0.0, 0.05), "the same, with temperature": (_usb, WANDER, 0.05),
    "two stages": (_two_stages, 0.0, 0.05), "frames of 1 ms": (_frames, 0.0, 0.05),
    "the same, blocks of 50.3 ms": (_frames, 0.0, 0.0503),
}  # fmt: skip


def clock_errors(
    random: np.random.Generator, delays: Delays, wander: float, block: float
) -> tuple[Array, float, float]:  # fmt: skip
    """Return an hour's errors of the times read from a bag, second by second (k,) [s], the stated one, and ppm."""
    clock, drift, turn = DeviceClock(), random.uniform(-DRIFT, DRIFT), random.uniform(0.0, TAU)
    index = np.arange(round(HOUR / block), dtype=np.int64)

    def true(device: Array) -> Array:
        bend = wander * HOUR / TAU * (np.cos(turn) - np.cos(TAU * device / HOUR + turn))
        return np.asarray(1000.0 + device * (1.0 + drift) + bend)

    end = np.asarray((index + 1) * block, dtype=np.float64)
    arrival = true(end) + delays(random, true(end))
    stamps = np.empty(index.size, dtype=np.int64)
    for place, (device, host) in enumerate(zip(end.tolist(), arrival.tolist(), strict=True)):
        clock.add(device, host)
        stamps[place] = clock.stamp_ns(device - block)
    found = clock_of(index * round(1e4 * block), stamps, 1e4)
    at: Array = np.arange(0.0, HOUR - 1.0)
    begin = (int(stamps[0]) - time_base_ns()) * 1e-9
    mean = float(np.ptp(true(np.array([0.0, HOUR - 2.0])))) / (at[-1] - at[0]) - 1.0
    return begin + found.times(at * 1e4) - true(at), found.error, 1e6 * (found.drift - mean)


def clocks(pairs: int, seed: int) -> Iterator[str]:
    """Yield the rows of the table of clocks."""
    yield (f"| {pairs} pairs of devices, an hour each | drift between both, worst [ppm] | phase at 100 Hz, root mean "
           "square [degrees] | worst second [degrees] | stated [degrees] |\n|---|---|---|---|---|")  # fmt: skip
    for number, (name, transport) in enumerate(TRANSPORTS.items()):
        random, drifts, apart, stated = np.random.default_rng([seed, number]), [], [], []
        for _ in range(pairs):
            (one, first, ppm), (other, second, more) = (clock_errors(random, *transport) for _ in range(2))
            drifts.append(abs(ppm - more))
            apart.append(360.0 * AT * (one - other))
            stated.append(360.0 * AT * math.hypot(first, second))
        size = np.abs(apart)
        yield (f"| {name} | {max(drifts):.4f} | {np.sqrt(np.mean(size**2)):.3f} | {size.max():.3f} | "
               f"{np.median(stated):.3f} |")  # fmt: skip


def sweep_held(random: np.random.Generator, seconds: float, noise: float) -> tuple[Flags, Flags, float]:
    """Return for the lines swept (k,) whether the intervals of size and phase hold, and how far the peak is off [-].

    A random beam and grain as one mass under a support that is swept at constant amplitude; both lasers have noise [m].
    """
    natural, damping = random.uniform(3.0, 12.0), math.exp(random.uniform(math.log(5e-3), math.log(0.06)))
    low, high = (0.8, 1.2) if random.random() < 0.5 else (0.5, 2.0)
    rate, omega = 1000.0, TAU * natural
    time = np.arange(round(4 * rate * seconds)) / (4 * rate)
    support = 5e-3 * np.sin(TAU * natural * (low * time + (high - low) * time**2 / (2.0 * seconds)))
    top, bottom, _ = cont2discrete(([2 * damping * omega, omega**2], [1.0, 2 * damping * omega, omega**2]),
                                   0.25 / rate, "foh")  # fmt: skip
    beam = lfilter(top.ravel(), bottom, support)
    given, answer = (one[::4] + random.normal(0.0, noise, len(one[::4])) for one in (support, beam))
    found = frequency_response(Signals(rate, given, answer))
    assert found.local is not None
    swept = (found.frequency > 1.02 * low * natural) & (found.frequency < 0.98 * high * natural)
    ratio = 1j * found.frequency / natural
    true = (1.0 + 2.0 * damping * ratio) / (1.0 + 2.0 * damping * ratio + ratio**2)
    off, peak = found.h1 / true, int(np.argmax(np.abs(true)))
    size, phase = (np.abs(one) <= WIDTH * found.relative_std for one in (np.abs(off) - 1.0, np.angle(off)))
    return size[swept], phase[swept], float(np.abs(off[peak] - 1.0))


def sweeps(beams: int, seed: int) -> Iterator[str]:
    """Yield the rows of the table of sweeps."""
    yield f"| {beams} random beams | size | phase | largest response off, worst |\n|---|---|---|---|"
    for seconds, noise in ((30.0, 2e-5), (120.0, 2e-5), (120.0, 1e-4), (300.0, 1e-3)):
        random = np.random.default_rng([seed, round(seconds), round(1e6 * noise)])
        size, phase, peaks = zip(*(sweep_held(random, seconds, noise) for _ in range(beams)), strict=True)
        shares = (100.0 * float(np.mean([held.mean() for held in one])) for one in (size, phase))
        yield (f"| sweep of {seconds:g} s, noise of {1e3 * noise:g} mm | "
               + " | ".join(f"{share:.1f} %" for share in shares) + f" | {100.0 * max(peaks):.2g} % |")  # fmt: skip


def accelerations(tones: int, seed: int) -> Iterator[str]:
    """Yield the rows of the table of tones identified from an acceleration."""
    yield f"| {tones} tones of 2 to 20 Hz | steady | amplitude | frequency |\n|---|---|---|---|"
    settings = Settings(2.0, 1.0, 40.0, 50.0, 5e-5, None, 0.01, 20.0, 0.3, 0.2, 0.5, 1000.0)
    for level in (1e-3, 1e-2, 1e-1):
        random, held = np.random.default_rng([seed, round(1e4 * level)]), []
        for _ in range(tones):
            frequency, amplitude = random.uniform(2.0, 20.0), math.exp(random.uniform(math.log(5e-4), math.log(2e-2)))
            time, size = np.arange(1100) / 1000.0, amplitude * (TAU * frequency) ** 2
            wave = -size * np.sin(TAU * frequency * time + random.uniform(0.0, TAU))
            samples = wave + random.normal(0.0, level * size, time.size) + 0.2
            found = Identifier(settings).push(0, 1000.0, samples, None, float(time[-1]), units=("m/s^2", "m"))
            if found.quality == Quality.STEADY:
                held.append((abs(found.amplitude - amplitude) <= WIDTH * found.amplitude_std,
                             abs(found.frequency - frequency) <= WIDTH * found.frequency_std))  # fmt: skip
        shares = " | ".join(f"{100.0 * share:.1f} %" for share in np.mean(held, axis=0))
        yield f"| noise of {100.0 * level:g} % of the acceleration | {len(held)} | {shares} |"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's arguments."""
    add = parser.add_argument
    add("--pairs", type=whole(1, 1000), default=10, metavar="N", help="pairs of devices a row; default 10")
    add("--signals", type=whole(1, 10_000), default=60, metavar="N", help="beams and tones a row; default 60")
    add("--seed", type=whole(0, 2**32 - 1), default=1, metavar="S", help="of all that is drawn; default 1")
    add("--page", type=file_path, default=None, metavar="FILE", help="page whose table is made anew")


def run(args: argparse.Namespace) -> int:
    """Measure, print, and fill in the page; return 0."""
    lines: list[str] = []
    made = (clocks(args.pairs, args.seed), sweeps(args.signals, args.seed), accelerations(args.signals, args.seed))
    with counting("rows", 17) as count:
        for table in made:
            lines += ["", *table]
            count(len(lines) - 1)
    text = "\n".join(lines[1:])
    print(text)
    if args.page is not None:
        into(args.page, text, "<!-- made by python -m studies time-base -->", "<!-- end -->")
    return 0
