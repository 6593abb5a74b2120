# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What excites a structure where that is no tone: a sum of tones, a random signal, a shock.

A window of two periods cannot distinguish them from a tone that changes, so eleven periods are looked at. A tone that
steps, ramps or drifts is not several steady ones: it leaves a residual that those do not. In three periods nearly all
of it is a tone with harmonics that changes evenly, which a random signal is not. Nearer than 0.14 of the frequency two
tones are a beat, and a random signal of that bandwidth is one too: its amplitude is followed as it changes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from atpid_common.vocabulary import Quality
from atpid_control.identification.estimate import Estimate, Settings
from atpid_control.identification.window import SampleBuffer, seed_frequency
from atpid_sim.system import Array

_TAU = 2.0 * math.pi
#: Periods of the first tone that are looked at, and samples of each after averaging.
_PERIODS, _A_PERIOD = 11.0, 40
#: Tones at most.
_MOST = 4
#: Tones are apart by this many cycles in that time; so far from a harmonic of the first a tone is none of it.
_APART = 1.5
#: Harmonics of the first tone that are no other one.
_HARMONICS = (2.0, 3.0, 4.0, 5.0)
#: Residual of all tones over the effective value of the smallest up to which they are all there is [-].
_LEFT = 0.3
#: What one tone leaves, over the effective value of another one that would count, up to which there is none [-].
_ALONE = 0.5
#: Gauss-Newton steps from the peaks of the spectrum; periods between looks; looks that agree, and those that end a
#: random signal. One that does not agree takes as many off as agree.
_STEPS, _BETWEEN, _AGREEING, _ENDING = 6, 1.0, 2, 4
#: With more than this share of the samples missing it is not judged.
_MISSING = 0.1
#: Periods in which a tone changes evenly, and the share of the power it leaves there, in the median, from which the
#: signal is random, and below which it is none any more [-].
_EVENLY, _RANDOM, _TONAL = 3.0, 0.03, 0.01
#: A part with less than this share of the power of another one is at rest [-].
_AT_REST = 0.02
#: A shock: means over so long [s] that differ by so many standard deviations are motion; it is over after so many
#: quiet ones, and takes less than this share of the time looked at [-].
_MEAN, _MOTION, _QUIET, _SHARE = 0.05, 8.0, 20, 0.3
_WORDS = {2: "two", 3: "three", 4: "four"}


@dataclass(frozen=True)
class OtherExcitation:
    """What excites the structure, where that is no tone."""

    kind: Literal["tones", "random", "shock"]
    frequencies: tuple[float, ...] = ()  # of tones, the largest first [Hz]
    amplitudes: tuple[float, ...] = ()  # of them; of a random signal its effective value; of a shock its peak [m or N]
    lasted: float = math.nan  # a shock [s]

    @property
    def spoils(self) -> bool:
        """Whether no estimate of a tone can be acted on while it is there."""
        return self.kind != "shock"

    def sentence(self, unit: str) -> str:
        """Return what it is, and what follows; unit: of the amplitudes."""
        if self.kind == "shock":
            what = f"a shock of {self.amplitudes[0]:.3g} {unit} that lasted {self.lasted:.2g} s"
            return f"{what}: no tone, no height for it"
        if self.kind == "random":
            what = f"a random signal excites the structure, {self.amplitudes[0]:.3g} {unit} RMS"
        else:
            parts = [f"{a:.3g} {unit} at {f:.4g} Hz" for f, a in zip(self.frequencies, self.amplitudes, strict=True)]
            what = f"{_WORDS[len(parts)]} tones excite the structure, {', '.join(parts[:-1])} and {parts[-1]}"
        return f"{what}: a height is selected for one tone; the ceiling stays"


class ExcitationWatch:
    """Looks at the newest samples of one channel once a period: is it one tone?"""

    def __init__(self, settings: Settings, rate: float) -> None:
        """Take the share of the first amplitude that counts and the limits of tones; samples come at `rate` [Hz]."""
        self.share, self._hum = settings.second_tone, settings.mains_frequency
        self._limits = settings.lowest_frequency, settings.highest_frequency
        self._buffer = SampleBuffer(1, rate, _PERIODS / settings.lowest_frequency, settings.analysis_rate)
        self.found: OtherExcitation | None = None
        self._next = 0.0  # when to look again [s]
        self._votes = 0
        self._tone = (-math.inf, math.nan)  # when a tone was found last [s], and its frequency [Hz]
        self._steady = -math.inf  # when it was steady [s]
        self._mixed = -math.inf  # until when several tones are among what is looked at [s]

    def push(self, first_index: int, samples: Array, tone: Estimate) -> OtherExcitation | None:
        """Take the next samples (n,) and the tone found in them; return what they are, None: one tone, or nothing."""
        self._buffer.push(first_index, samples[None])
        time, frequency = tone.time, tone.frequency
        if not math.isnan(frequency):
            # between several tones the estimate's frequency wanders
            several = self.found is not None and self.found.frequencies
            self._tone = time, self.found.frequencies[0] if self.found and several else frequency
        self._steady = time if tone.quality == Quality.STEADY else self._steady
        since, frequency = time - self._tone[0], self._tone[1]
        if not self.share > 0.0:
            self.found, self._votes = None, 0
        elif not 0.0 <= since <= _QUIET * _MEAN:  # no tone, and none just before
            if self._due(time, _QUIET * _MEAN):
                self.found, self._votes = self._shock(time), 0
        elif self._due(time, _BETWEEN / frequency):
            self._judge(time, frequency)
        return self.found

    def _due(self, time: float, wait: float) -> bool:
        """Whether to look now, and then not before `wait` [s] are over."""
        if self._next - 2.0 * _PERIODS * wait <= time < self._next:
            return False
        self._next = round(time + wait, 6)
        return True

    def _judge(self, time: float, frequency: float) -> None:
        now = self._look(frequency)
        if now is not None and now.kind == "tones":
            self._mixed = time + _PERIODS / frequency
        elif now is not None and time < self._mixed:
            now = None  # a tone that ends within the time looked at leaves what looks random
        kind, before = now and now.kind, self.found and self.found.kind
        self._votes = max(self._votes - _AGREEING, 0) if kind == before else self._votes + 1
        # tones that grow or end look random for as long as that is within the time looked at
        needed = _ENDING if before == "random" else _PERIODS if kind == "random" else _AGREEING
        if kind == before:
            self.found = now
        elif self._votes >= needed:
            self.found, self._votes = now, 0

    def _look(self, frequency: float) -> OtherExcitation | None:
        buffer = self._buffer
        count = math.ceil(round(_PERIODS / (frequency * buffer.step), 6))
        if count > buffer.size:
            return None
        signal = buffer.newest(count)[0]
        stride = max(1, int(round(1.0 / (_A_PERIOD * frequency * buffer.step), 6)))
        whole = signal[: signal.size // stride * stride].reshape(-1, stride)
        y, step = whole.mean(axis=1), stride * buffer.step
        valid = np.isfinite(y)
        if np.count_nonzero(~valid) > _MISSING * y.size:
            return None
        t, y = np.arange(y.size)[valid] * step, y[valid]
        values, left = _fitted(t, y, [frequency])
        if float(np.sqrt(np.mean(left**2))) < _ALONE * self.share * float(np.hypot(*values[:2])) / math.sqrt(2.0):
            return None
        return self._tones(t, y, step) or self._random(t, y, step, frequency)

    def _tones(self, t: Array, y: Array, step: float) -> OtherExcitation | None:
        length = t[-1] - t[0]
        low, high = self._limits
        seeds: list[float] = []
        left = y
        for count in range(1, _MOST + 1):
            seeds.append(seed_frequency(left * np.hanning(left.size), 1.0 / step, low, high))
            fit = None if math.isnan(seeds[-1]) else _converged(t, y, seeds, length)
            if fit is None:
                return None
            frequencies, amplitudes, left = fit
            seeds = list(frequencies)
            order = np.argsort(amplitudes)[::-1]
            f, a = frequencies[order], amplitudes[order]
            if count == 1 or np.sqrt(np.mean(left**2)) > _LEFT * a[-1] / math.sqrt(2.0):
                continue
            beside = [*(k * f[0] for k in _HARMONICS), *([self._hum] if self._hum > 0.0 else [])]
            apart = [abs(one - other) for k, one in enumerate(f) for other in (*f[:k], *(beside if k else ()))]
            inside = low <= f.min() and f.max() <= high and a[-1] >= self.share * a[0]
            if not inside or min(apart) * length < _APART:
                return None
            return OtherExcitation("tones", tuple(map(float, f)), tuple(map(float, a)))
        return None

    def _random(self, t: Array, y: Array, step: float, frequency: float) -> OtherExcitation | None:
        known = self.found is not None and self.found.kind == "random"
        left = _unevenness(t, y, frequency, self._hum if self._hum * step < 0.4 else 0.0)
        return OtherExcitation("random", (), (float(np.std(y)),)) if left > (_TONAL if known else _RANDOM) else None

    def _shock(self, time: float) -> OtherExcitation | None:
        """Return the shock in a signal that was at rest before, and is again at `time` [s]."""
        buffer = self._buffer
        stride = max(1, round(_MEAN / buffer.step))
        signal = buffer.newest(buffer.size // stride * stride)[0]
        if signal.size < 4 * _QUIET * stride or not np.isfinite(signal).all():
            return None
        steps = np.abs(np.diff(signal.reshape(-1, stride).mean(axis=1)))
        noise = float(np.median(steps)) / 0.6745
        moving = np.flatnonzero(steps > _MOTION * noise + 1e-9 * float(np.ptp(signal)))
        if moving.size == 0 or moving[0] < 2 or steps.size - moving[-1] < _QUIET or moving.size > _SHARE * steps.size:
            return None
        begin, end = moving[0] * stride, (moving[-1] + 2) * stride
        if self._steady >= time - (signal.size - begin) * buffer.step:  # it was a tone that began and ended
            return None
        peak = float(np.abs(signal[begin:end] - np.median(signal[:begin])).max())
        return OtherExcitation("shock", (), (peak,), float((end - begin) * buffer.step))


def _unevenness(t: Array, y: Array, frequency: float, hum: float) -> float:
    """Return the share of the power that an evenly changing tone leaves in three periods, in the median [-].

    t (n,) [s], y (n,); frequency [Hz]: about that of the tone, which each part has its own of; hum [Hz], 0: none.
    """
    length, shares = _EVENLY / frequency, []
    for begin in np.arange(t[0], t[-1] - length, 0.5 * length):
        inside = (t >= begin) & (t < begin + length)
        part, time = y[inside], t[inside] - begin - 0.5 * length
        power = float(np.var(part))
        own = seed_frequency(part * np.hanning(part.size), 1.0 / (t[1] - t[0]), 0.4 * frequency, 2.5 * frequency)
        angle = _TAU * (frequency if math.isnan(own) else own) * time
        columns = [np.ones_like(time), time, time * np.cos(angle), time * np.sin(angle)]
        columns += [function(k * angle) for k in (1.0, *_HARMONICS) for function in (np.cos, np.sin)]
        columns += [function(_TAU * hum * time) for function in (np.cos, np.sin)] if hum else []
        left = part - np.linalg.lstsq(np.array(columns).T, part, rcond=None)[0] @ np.array(columns)
        shares.append((float(np.var(left)), power))
    if not shares:
        return 0.0
    # at rest a part has nothing but noise
    parts, powers = np.array(shares).T
    return float(np.median(np.where(powers > _AT_REST * powers.max(), parts / np.maximum(powers, 1e-300), 0.0)))


def _converged(t: Array, y: Array, seeds: Sequence[float], length: float) -> tuple[Array, Array, Array] | None:
    """Return frequencies (k,) [Hz] and amplitudes (k,) of tones, and what they leave (n,); None: no such fit."""
    count, frequencies = len(seeds), np.array(seeds)
    for _ in range(_STEPS):
        values, left = _fitted(t, y, frequencies)
        cosine, sine = values[0 : 2 * count : 2], values[1 : 2 * count : 2]
        angles = _TAU * np.outer(frequencies, t)
        slopes = _TAU * t * (sine[:, None] * np.cos(angles) - cosine[:, None] * np.sin(angles))
        columns = np.vstack([_columns(t, frequencies), slopes])
        change = np.linalg.lstsq(columns.T, left, rcond=None)[0][-count:]
        frequencies = frequencies + np.clip(change, -0.5 / length, 0.5 / length)
        if not (np.isfinite(frequencies).all() and (frequencies > 0.0).all()):
            return None
    values, left = _fitted(t, y, frequencies)
    return frequencies, np.hypot(values[0 : 2 * count : 2], values[1 : 2 * count : 2]), left


def _columns(t: Array, frequencies: Array | Sequence[float]) -> Array:
    """Return cosine and sine of each frequency [Hz], an offset and a drift (2 n + 2, samples)."""
    tones = [function(_TAU * frequency * t) for frequency in frequencies for function in (np.cos, np.sin)]
    return np.vstack([*tones, np.ones_like(t), t - t.mean()])


def _fitted(t: Array, y: Array, frequencies: Array | Sequence[float]) -> tuple[Array, Array]:
    """Return the coefficients of the columns and what they leave of `y` (n,)."""
    columns = _columns(t, frequencies)
    values = np.asarray(np.linalg.lstsq(columns.T, y, rcond=None)[0], dtype=np.float64)
    return values, np.asarray(y - values @ columns)
