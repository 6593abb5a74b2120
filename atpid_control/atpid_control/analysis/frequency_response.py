# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frequency response by the estimators H1 and H2, with coherence and error bars.

H1 = G_xy / G_xx is unbiased under noise at the output, H2 = G_yy / G_yx under noise at the input; between them lies the
truth where both have some (Bendat and Piersol, Random Data, 4th ed., section 6.1.4 and chapter 9). An excitation that
passes once, a sweep or a shock, has neither averages nor a period: its response is that of `local_response`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atpid_control.analysis.signals import AnalysisError, Signals, runs
from atpid_control.analysis.spectra import averaged, transform, window_of
from atpid_sim.system import Array

#: Degree of the polynomials; lines on either side of the middle one; bands that are looked at, at most.
_DEGREE, _SIDE, _MOST = 2, 12, 4000
#: Complex values that a band leaves for its residual.
_FREEDOM = 2 * _SIDE + 1 - (3 * _DEGREE + 2)
#: Likeness of the spectra of the strongest quarter and the others, and share of its power they have, below which an
#: excitation passes once [-].
_LIKE, _AT_REST = 0.3, 1e-3


def passes_once(excitation: Array) -> bool:
    """Whether the parts of a signal (n,) without gaps have other spectra, or one alone moves: a sweep, a shock."""
    count = len(excitation) // 4
    if count < 64:
        return False
    quarters = (excitation[: 4 * count] - excitation.mean()).reshape(4, count)
    shape = window_of("hann", count)
    powers = np.array([np.abs(transform(one, shape)) ** 2 for one in quarters])
    strongest = int(np.argmax(powers.sum(axis=1)))
    one, others = powers[strongest], np.delete(powers, strongest, axis=0).mean(axis=0)
    like = float(one @ others) / max(float(np.linalg.norm(one) * np.linalg.norm(others)), 1e-300)
    return like < _LIKE or float(others.sum()) < _AT_REST * float(one.sum())


def _local_response(
    excitation: Array, response: Array, rate: float, excited_from: float
) -> tuple[Array, Array, Array, Array, Array]:
    """Return frequencies (k,) [Hz], response, its relative standard deviation, coherence, and density of excitation.

    Of signals (n,) without gaps, at lines from the first to the last with `excited_from` of the largest density.

    In a band of a few lines of the whole record's transform, Y A = B U + I with polynomials A, B and I of the second
    degree: B / A is the response, and I / A what the motion before the record and after it adds. One mode under its
    support is such a quotient, so that no peak is flattened and no window needed; the residual gives the error bar
    (Pintelon, Schoukens, Vandersteen and Barbe, Mech. Syst. Signal Process. 24, 2010; McKelvey and Guerin, 2012).
    """
    given, answer = (np.fft.rfft(one - one.mean()) for one in (excitation, response))
    density = 2.0 * np.abs(given) ** 2 / (rate * len(excitation))
    smooth = np.convolve(density, np.full(2 * _SIDE + 1, 1.0 / (2 * _SIDE + 1)), mode="same")
    lines = np.flatnonzero(smooth >= excited_from * smooth[_SIDE:-_SIDE].max())
    lines = lines[(lines > _SIDE) & (lines < len(given) - _SIDE)]
    lines = lines[:: -(-len(lines) // _MOST)]
    band = lines[:, None] + np.arange(-_SIDE, _SIDE + 1)
    u, y = (one[band] / np.sqrt(np.mean(np.abs(one[band]) ** 2, axis=1, keepdims=True)) for one in (given, answer))
    powers = np.linspace(-1.0, 1.0, 2 * _SIDE + 1) ** np.arange(_DEGREE + 1)[:, None]
    parts = u[:, None] * powers, np.broadcast_to(powers, (len(lines), *powers.shape)), -y[:, None] * powers[1:]
    columns = np.concatenate(parts, axis=1).transpose(0, 2, 1)
    inverse = np.linalg.pinv(columns, rcond=1e-12)
    found = (inverse @ y[..., None])[..., 0]
    lever = 1.0 - np.einsum("kij,kji->ki", columns, inverse).real
    left = np.abs(y - (columns @ found[..., None])[..., 0]) ** 2 / lever
    size = np.sqrt(np.mean(np.abs(answer[band]) ** 2, axis=1) / np.mean(np.abs(given[band]) ** 2, axis=1))
    # half of a complex value's variance is in its size, half in its phase
    deviation = np.sqrt(0.5 * np.sum(left / lever * np.abs(inverse[:, 0]) ** 2, axis=1))
    relative = deviation / np.maximum(np.abs(found[:, 0]), 1e-300)
    coherence = np.clip(1.0 - left.mean(axis=1), 0.0, 1.0)
    return lines * rate / len(excitation), found[:, 0] * size, relative, coherence, smooth[lines]


#: A line counts as excited from this share of the strongest line's density on: 1 % of its amplitude.
_EXCITED = 1e-4
#: The same of a sweep, and the standard deviation up to which a line of it is trusted [-].
_SWEPT, _KNOWN = 1e-2, 0.1
#: Coherence from which a line is trusted, and averages below which coherence means nothing.
_COHERENT, _FEWEST_AVERAGES = 0.8, 3.0
#: Lines within the half-power width that a peak needs not to be flattened.
_LINES = 4
#: Difference of H2 and H1 at the largest response from which it is named [-].
_APART = 0.05
#: Student's 95 % quantile is that of the normal distribution times 1 + this over the degrees of freedom.
_STUDENT = 1.21
#: Excited lines up to which the excitation is a tone: the main lobe of the window, twice.
_TONE = 8


@dataclass(frozen=True)
class FrequencyResponse:
    """Response over excitation at each line."""

    frequency: Array  # (k,) [Hz]
    h1: Array  # (k,) complex [response unit over excitation unit]
    h2: Array  # (k,) complex
    coherence: Array  # (k,) [-]
    excited: NDArray[np.bool_]  # (k,) lines that the excitation reaches
    averages: float  # independent ones
    smeared: Array  # (k,) how far the window's width may shift H1, relative [-]
    most_excited: int  # the line with the strongest excitation
    local: Array | None = None  # (k,) standard deviation of local models, relative [-]; None: of averages
    clock_error: float = 0.0  # standard deviation of the delay between two devices [s]
    left_out: int = 0  # samples that local models do not use

    @property
    def tone(self) -> bool:
        """Whether the excitation is a tone, so that the response is known there only."""
        return bool(np.count_nonzero(self.excited) <= _TONE)

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Lines (k,) that are excited and coherent, of enough averages."""
        known = True if self.local is None else self.local <= _KNOWN
        return np.asarray(self.excited & (self.coherence >= _COHERENT) & (self.averages >= _FEWEST_AVERAGES) & known)

    @property
    def relative_std(self) -> Array:
        """Standard deviation of |H1| over |H1|, and of its phase [rad] (k,) (Bendat and Piersol, Eq. 9.90).

        With what the window's width may shift H1 by; NaN of too few averages. What two devices' clocks add to the phase
        is in `phase_std`.
        """
        # the residual, or the coherence, is itself estimated: Student's 95 % quantile over the normal one
        student = 1.0 + _STUDENT / (2.0 * self.averages - 2.0) if self.averages > 1.0 else np.nan
        if self.local is not None:
            return np.asarray(student * self.local)
        if self.averages < _FEWEST_AVERAGES:
            return np.full(len(self.frequency), np.nan)
        known = np.maximum(self.coherence, 1e-12)
        chance = (1.0 - np.minimum(known, 1.0)) / (2.0 * known * self.averages)
        return np.asarray(np.hypot(student * np.sqrt(chance), self.smeared))

    @property
    def phase_std(self) -> Array:
        """Standard deviation of the phase of H1 (k,) [rad], of two devices but for a constant delay."""
        return np.asarray(np.hypot(self.relative_std, 2.0 * np.pi * self.frequency * self.clock_error))

    @property
    def strongest(self) -> int:
        """The line with the largest |H1| among those trusted, else among the excited ones; of a tone its own line."""
        if self.tone:
            return self.most_excited
        among = self.trusted if self.trusted.any() else self.excited
        return int(np.argmax(np.where(among, np.abs(self.h1), -1.0)))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the response cannot be trusted, a line each."""
        lines = []
        if self.clock_error:  # NaN, too
            why = "a constant delay between these is in the phase; measure one signal with both"
            lines.append(f"the channels are of two devices: {why}")
        if self.averages < _FEWEST_AVERAGES:
            needed = f"needed: {_FEWEST_AVERAGES:g}"
            lines.append(f"{self.averages:.3g} averages: coherence and error bars mean nothing; {needed}")
        excited = np.count_nonzero(self.excited)
        if low := int(np.count_nonzero(self.excited & (self.coherence < _COHERENT))):
            why = "noise, leakage or impacts; these lines are not trusted"
            lines.append(f"coherence below {_COHERENT:g} at {low} of {excited} excited lines: {why}")
        place = self.strongest
        apart = float(abs(self.h2[place]) / abs(self.h1[place])) - 1.0
        if apart > _APART:
            why = "noise, or lines too far apart; then the error bar is too small"
            lines.append(f"H1 and H2 differ by {100.0 * apart:.2g} % at {self.frequency[place]:.4g} Hz: {why}")
        if self.tone:
            known = "the response holds there; a sweep or noise shows a resonance"
            lines.append(f"only {excited} lines are excited, a tone: {known}")
        elif self.local is None and (width := _half_power_width(self) or _LINES) < _LINES:
            lines.append(f"the peak is {width} lines wide: its height comes out too low; give a finer --resolution")
        if self.left_out:
            lines.append(f"{self.left_out} samples beside the longest part without a gap are not in the response")
        return tuple(lines)


def frequency_response(signals: Signals, resolution: float | None = None, window: str = "") -> FrequencyResponse:
    """Return the response of `signals`, lines `resolution` [Hz] apart. Raises AnalysisError: nothing excites.

    `window`: boxcar, without overlap, for an excitation whose period is the segment; local, without segments, for one
    that passes once; else hann. Empty: local or hann, by the excitation.
    """
    parts = runs(np.isfinite(signals.excitation + signals.response))
    begin, end = max(parts, key=lambda part: part[1] - part[0], default=(0, 0))
    given, answer = (one[begin:end] for one in (signals.excitation, signals.response))
    moves = end - begin > _TONE * _FREEDOM and min(np.ptp(given), np.ptp(answer)) > 0.0
    if moves and (window == "local" or (not window and not resolution and passes_once(given))):
        return _swept(signals, *_local_response(given, answer, signals.rate, _SWEPT), end - begin)
    window = window if window not in ("", "local") else "hann"
    found = averaged(signals.excitation, signals.response, signals.rate, resolution, window)
    inside = found.frequency > 0.0
    strongest = float(found.first[inside].max())
    if strongest <= 0.0 or float(found.second[inside].max()) <= 0.0:
        still = signals.names[0] if strongest <= 0.0 else signals.names[1]
        raise AnalysisError(f"no excitation: {still} is constant; record a run with one, or choose another --input")
    excited = np.asarray(inside & (found.first >= _EXCITED * strongest))
    with np.errstate(divide="ignore", invalid="ignore"):
        h1, h2 = found.cross / found.first, found.second / np.conj(found.cross)
        coherence = np.abs(found.cross) ** 2 / (found.first * found.second)
    most = int(np.argmax(np.where(inside, found.first, -1.0)))
    smeared = _smeared(h1, excited) if window != "boxcar" else np.zeros(len(h1))
    h1, h2 = _in_time(signals, found.frequency, h1, h2)
    known = np.nan_to_num(coherence), excited, found.averages, smeared, most
    return FrequencyResponse(found.frequency, h1, h2, *known, clock_error=signals.clock_error)


def _swept(
    signals: Signals, lines: Array, h: Array, deviation: Array, coherence: Array, density: Array, used: int
) -> FrequencyResponse:
    """Return the response by local models, which is one estimate: no noise is taken for input's or output's."""
    if not len(lines):
        advice = "give --window hann, or a longer part"
        raise AnalysisError(f"the excitation passes once, too short for a response; {advice}")
    (turned,), none, every = _in_time(signals, lines, h), np.zeros(len(lines)), np.full(len(lines), True)
    known = coherence, every, _FREEDOM + 1.0, none, int(np.argmax(density)), deviation
    return FrequencyResponse(lines, turned, turned, *known, signals.clock_error, len(signals.response) - used)


def _in_time(signals: Signals, frequency: Array, *responses: Array) -> list[Array]:
    """Return responses (k,) as if both channels were sampled at once."""
    if not signals.delay:
        return list(responses)
    return [one * np.exp(-2j * np.pi * frequency * signals.delay) for one in responses]


def _smeared(h1: Array, excited: NDArray[np.bool_]) -> Array:
    """Return how far a Hann window shifts H1, which it averages over neighbouring lines, relative (k,) [-].

    The second moment of the window's power is a third of a line squared, so that a sixth of the second difference is
    lost (Bendat and Piersol, section 8.5.1, for spectra); 0 where a neighbour is not excited.
    """
    shift = np.zeros(len(h1))
    known = excited[:-2] & excited[1:-1] & excited[2:]
    shift[1:-1][known] = (np.abs(h1[2:] - 2.0 * h1[1:-1] + h1[:-2]) / (6.0 * np.abs(h1[1:-1])))[known]
    return shift


def _half_power_width(found: FrequencyResponse) -> int | None:
    """Return the lines around the strongest at which |H1| is above 1/sqrt(2) of it; None where the edge is reached."""
    size, place = np.where(found.excited, np.abs(found.h1), np.nan), found.strongest
    below = np.flatnonzero(~(size > size[place] / np.sqrt(2.0)) & np.isfinite(size))
    before, after = below[below < place], below[below > place]
    return int(after[0] - before[-1] - 1) if len(before) and len(after) else None
