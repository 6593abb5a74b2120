# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The results of an analysis in words: rows of a table, for terminal and report."""

import math
from collections.abc import Iterator

import numpy as np

from atpid_control.analysis.analyse import Analysis


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
    what = ("response to the tone" if response.tone else "largest response") + (
        "" if response.trusted[place] else " (not trusted)"
    )
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
