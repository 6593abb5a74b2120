# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The results of an analysis: rows of a table in words, for terminal and report, and the panels of its picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from atpid_control.analysis.analyse import Analysis
from atpid_control.analysis.frequency_response import FrequencyResponse
from atpid_sim.figure_style import LIGHT, Panels, logarithmic

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def shown_unit(unit: str) -> tuple[float, str]:
    """Return by what a quantity is multiplied where it is shown, and its unit then: lengths are shown in mm."""
    return (1e3, "mm") if unit == "m" else (1.0, unit)


def rows(found: Analysis) -> Iterator[tuple[str, str]]:
    """Yield (what, its value with unit and error bar), or why it could not be computed."""
    signals = found.signals
    if signals.origin:
        yield "origin of the samples", signals.origin
    yield "part", f"{signals.start:.5g} to {signals.start + signals.duration:.5g} s, {signals.rate:.6g} Hz"
    for channel, unit, one in zip(signals.names, signals.units, found.spectra, strict=True):
        (scale, shown), name = shown_unit(unit), channel.replace("_", " ")
        yield f"{name}, root mean square", f"{scale * one.rms:.4g} {shown}"
        yield f"{name}, strongest line", f"{one.frequency[int(np.argmax(one.density[1:])) + 1]:.4g} Hz"
    yield "spectra", f"lines {found.spectra[0].resolution:.3g} Hz apart, {found.spectra[0].averages:.3g} averages"
    yield from _response_rows(found)
    yield from _decay_rows(found)
    yield from _order_rows(found)


def _response_rows(found: Analysis) -> Iterator[tuple[str, str]]:
    response = found.response
    if response is None:
        yield "frequency response", found.skipped["frequency_response"]
        return
    place = response.strongest
    error = 100.0 * response.relative_std[place]
    bar = f" ± {error:.2g} %" if math.isfinite(error) else ""
    h1, h2 = abs(response.h1[place]), abs(response.h2[place])
    what = "response to the tone" if response.tone else "largest response"
    what += "" if response.trusted[place] else " (not trusted)"
    given, answer = found.signals.units
    unit = "" if given == answer else f" {answer}/{given}"
    yield what, f"at {response.frequency[place]:.4g} Hz: H1 {h1:.4g}{bar}, H2 {h2:.4g}{unit}"
    phase = math.degrees(np.angle(response.h1[place]))
    error = math.degrees(response.phase_std[place])
    bar = f" ± {error:.2g}" if math.isfinite(error) else ""
    yield "its phase, coherence", f"{phase:.4g}{bar} degrees, {response.coherence[place]:.4f}"
    yield "lines trusted", f"{response.trusted.sum()} of {response.excited.sum()} that are excited"


def _decay_rows(found: Analysis) -> Iterator[tuple[str, str]]:
    decay = found.decay
    if decay is None:
        yield "decrement", found.skipped["decrement"]
        return
    yield "free decay", f"{decay.begin:.4g} to {decay.end:.4g} s"
    yield "its frequency", f"{decay.frequency:.6g} ± {decay.frequency_std:.2g} Hz"
    yield "its damping ratio", f"{decay.damping_ratio:.4g} ± {decay.damping_ratio_std:.2g}"
    yield "logarithmic decrement", f"{decay.log_decrement:.4g} ± {decay.log_decrement_std:.2g}"
    if len(decay.ratios):
        yield "ratios of successive peaks", f"{decay.ratios.min():.4g} to {decay.ratios.max():.4g}"


def _order_rows(found: Analysis) -> Iterator[tuple[str, str]]:
    orders = found.orders
    if orders is None:
        yield "orders", found.skipped["orders"]
        return
    scale, unit = shown_unit(found.signals.units[1])
    given, given_unit = shown_unit(found.signals.units[0])
    tone = f"{given * orders.excitation:.4g} {given_unit} at {orders.frequency:.6g} Hz"
    yield "excitation", f"{tone}, {orders.begin:.4g} to {orders.end:.4g} s"
    found_orders = zip(orders.amplitude, orders.amplitude_std, orders.phase, strict=True)
    for number, (amplitude, error, phase) in enumerate(found_orders, 1):
        text = f"{scale * amplitude:.4g} ± {scale * error:.1g} {unit}, {math.degrees(phase):.4g} degrees"
        yield f"order {number}", text
    yield "distortion (THD)", f"{100.0 * orders.distortion:.3g} %"


#: Points a trace is drawn with at most, and decades of a density shown below its largest.
_POINTS, _DECADES = 20_000, 1e-10
#: Standard deviations that noise alone exceeds once in a hundred times.
_NOISE = 3.0
#: Of response and excitation.
_COLOURS = "C0", LIGHT.given_text


def panels(found: Analysis) -> Panels:
    """Return the panels of an analysis."""
    last = _decay if found.orders is None else _orders
    traces, densities, end = (partial(drawer, found=found) for drawer in (_traces, _densities, last))
    sizes, phases, coherence = (
        partial(_of_response, found=found, title=title, drawer=drawer)
        for title, drawer in (("Frequency response", _sizes), ("Phase of H1", _phases), ("Coherence", _coherence))
    )
    return [[traces, densities], [sizes, phases], [coherence, end]]


def _traces(ax: Axes, found: Analysis) -> None:
    signals = found.signals
    (scale, unit), (given, given_unit) = (shown_unit(one) for one in reversed(signals.units))
    step = max(1, len(signals.response) // _POINTS)
    values_of = scale * signals.response, given * signals.excitation
    for values, name, colour in zip(values_of, reversed(signals.names), _COLOURS, strict=True):
        ax.plot(signals.time[::step], values[::step], colour, linewidth=0.7, label=name.replace("_", " "))
    ax.set(xlabel="time [s]", ylabel=" and ".join(dict.fromkeys((unit, given_unit))), title="Traces")


def _densities(ax: Axes, found: Analysis) -> None:
    for one, name, colour in zip(reversed(found.spectra), reversed(found.signals.names), _COLOURS, strict=True):
        ax.semilogy(one.frequency[1:], one.density[1:], colour, linewidth=0.9, label=name.replace("_", " "))
    top = max(float(one.density[1:].max()) for one in found.spectra)
    title = f"Power spectral density, lines {found.spectra[0].resolution:.3g} Hz apart"
    # eight times the median power's frequency: beyond it the response has nothing to show
    total = np.cumsum(found.spectra[1].density[1:])
    lines = found.spectra[1].frequency
    end = min(lines[-1], 8.0 * lines[int(np.searchsorted(total, 0.5 * total[-1])) + 1])
    ax.set(xlim=(0.0, end), ylim=(_DECADES * top, 3.0 * top), title=title)
    units = dict.fromkeys(reversed(found.signals.units))
    ax.set(xlabel="frequency [Hz]", ylabel=" and ".join(f"{unit}²/Hz" for unit in units))


def _excited(response: FrequencyResponse) -> tuple[float, float]:
    """Return from where to where lines are excited [Hz], with a little room."""
    lines = response.frequency[response.excited]
    room = max(0.05 * float(np.ptp(lines)), 2.0 * float(response.frequency[1] - response.frequency[0]))
    return max(0.0, float(lines.min()) - room), float(lines.max()) + room


def _absent(ax: Axes, title: str, reason: str) -> None:
    ax.set(title=title, xticks=[], yticks=[])
    ax.text(0.5, 0.5, reason, ha="center", va="center", wrap=True, fontsize=9, transform=ax.transAxes)


def _of_response(ax: Axes, found: Analysis, title: str, drawer: Callable[[Axes, str, FrequencyResponse], None]) -> None:
    if found.response is None:
        _absent(ax, title, found.skipped.get("frequency_response", ""))
    else:
        drawer(ax, title, found.response)


def _sizes(ax: Axes, title: str, response: FrequencyResponse) -> None:
    shown, trusted = response.excited, response.trusted
    logarithmic(ax)
    points = (("H2", response.h2, "C1", 5), ("H1", response.h1, LIGHT.given_text, 4))
    for name, values, colour, size in points:
        label = f"{name}, excited lines"
        ax.plot(response.frequency[shown], np.abs(values[shown]), ".", color=colour, markersize=size, label=label)
    at, sizes = response.frequency[trusted], np.abs(response.h1[trusted])
    bars = 2.0 * sizes * response.relative_std[trusted]
    ax.errorbar(at, sizes, bars, fmt="C0.", markersize=6, linewidth=0.8, label="H1 trusted, ±2σ")
    alone = " of a tone: known at its line alone" if response.tone else ""
    ax.set(xlim=_excited(response), xlabel="frequency [Hz]", ylabel="response / excitation", title=title + alone)


def _phases(ax: Axes, title: str, response: FrequencyResponse) -> None:
    shown, trusted = response.excited, response.trusted
    for chosen, colour in ((shown, LIGHT.given_text), (trusted, "C0")):
        ax.plot(response.frequency[chosen], np.degrees(np.angle(response.h1[chosen])), ".", color=colour)
    ax.set(xlim=_excited(response), ylim=(-190.0, 190.0), xlabel="frequency [Hz]", ylabel="degrees", title=title)


def _coherence(ax: Axes, title: str, response: FrequencyResponse) -> None:
    shown = response.excited
    ax.plot(response.frequency, response.coherence, LIGHT.given, linewidth=0.8)
    ax.plot(response.frequency[shown], response.coherence[shown], "C0.")
    title = f"{title}; dots: excited lines; {response.averages:.3g} averages"
    ax.set(xlim=_excited(response), ylim=(0.0, 1.05), xlabel="frequency [Hz]", ylabel="coherence", title=title)


def _orders(ax: Axes, found: Analysis) -> None:
    orders = found.orders
    assert orders is not None
    scale, unit = shown_unit(found.signals.units[1])
    numbers = np.arange(1, len(orders.amplitude) + 1)
    floor = scale * _NOISE * orders.amplitude_std
    known = scale * orders.amplitude > floor
    bottom = 0.3 * min(floor.min(), scale * orders.amplitude[0])
    ax.bar(numbers[known], scale * orders.amplitude[known] - bottom, bottom=bottom, color="C0")
    ax.plot(numbers, floor, "_", color="C1", markersize=28, label=f"noise, {_NOISE:g} σ; an order below it has no bar")
    title = f"Orders, {orders.begin:.4g} to {orders.end:.4g} s; distortion {100.0 * orders.distortion:.2g} %"
    ax.set(yscale="log", xlim=(0.4, len(numbers) + 0.6), ylim=(bottom, None), xticks=numbers)
    ax.set(xlabel=f"order (1: {orders.frequency:.4g} Hz)", ylabel=unit, title=title)


def _decay(ax: Axes, found: Analysis) -> None:
    decay, title = found.decay, "Free decay"
    if decay is None:
        _absent(ax, title, found.skipped.get("decrement", ""))
        return
    time = found.signals.time
    inside = (time >= decay.begin) & (time <= decay.end)
    fall = 2.0 * np.pi * decay.frequency * decay.damping_ratio / np.sqrt(1.0 - decay.damping_ratio**2)
    envelope = decay.amplitude * np.exp(-fall * (time[inside] - decay.begin))
    rest = float(np.nanmean(found.signals.response[inside][len(envelope) // 2 :]))
    scale, unit = shown_unit(found.signals.units[1])
    moved = scale * (found.signals.response[inside] - rest)
    ax.plot(time[inside], moved, LIGHT.given_text, linewidth=0.8, label="from its mean")
    fit = f"fit: {decay.frequency:.4g} Hz, ζ {100.0 * decay.damping_ratio:.3g} %"
    ax.plot(time[inside], scale * envelope, "C0", label=fit)
    ax.plot(time[inside], -scale * envelope, "C0")
    ax.set(xlabel="time [s]", ylabel=unit, title=title)
