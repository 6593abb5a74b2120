# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The slow controller: amplitude and frequency as identified are held at the command.

A support reacts to what it carries, and an inverter slips, so the identified excitation is the output times a gain that
is not known. In the logarithm that gain is an offset: an integrator removes it whatever it is, and the loop's own gain,
so its stability, depends on the delay of the identification alone. A second integrator follows a gain that drifts, as
it does along a sweep. Pure: time is what `turn` is called with.
"""

import math
from dataclasses import dataclass

#: Time constant over the delay of the identification [-], and of the second integrator over the first.
_SLOW, _SLOWER = 3.0, 4.0
#: Largest error that is acted on, so that one wrong estimate moves little [-].
_MOST_ERROR = 0.1
#: Where this share of the tolerance is passed a sweep waits.
_WAIT = 0.4


@dataclass(slots=True)
class _Integrator:
    """Of one quantity: the logarithm of the factor, and how fast that drifts [1/s]."""

    limit: float  # of the logarithm
    value: float = 0.0
    drift: float = 0.0

    def turn(self, error: float, seconds: float, slow: float, limited: bool) -> None:
        if limited and error * self.value > 0.0:
            return  # the output cannot follow: what would be summed up now would have to be undone later
        if abs(error) < _MOST_ERROR:  # a large one is no drift: it would carry the output beyond the command
            self.drift += error * seconds / (_SLOWER * slow**2)
        error = max(-_MOST_ERROR, min(_MOST_ERROR, error))
        wanted = self.value + (error / slow + self.drift) * seconds
        self.value = max(-self.limit, min(self.limit, wanted))
        if self.value != wanted:
            self.drift = 0.0

    @property
    def at_limit(self) -> bool:
        return abs(self.value) >= self.limit > 0.0


class Hold:
    """Corrects the output once for each estimate."""

    def __init__(self, tolerance: float, most_correction: float, *, fixed_amplitude: bool = False) -> None:
        """Begin without a correction; see ExcitationSettings. fixed_amplitude: a disc's, which nothing can correct."""
        self._tolerance, self._limit, self._fixed = tolerance, math.log(most_correction), fixed_amplitude
        self.reset()

    def reset(self) -> None:
        """Correct nothing: another command is followed."""
        self._amplitude = _Integrator(0.0 if self._fixed else self._limit)
        self._frequency = _Integrator(self._limit)
        self._settled = 0.0  # since the output is at the command [s]
        self._within, self._slow = 0.0, math.inf  # since the error is within the tolerance; time constant [s]
        self.error = math.inf  # of amplitude or frequency, the larger one, smoothed over the delay [-]
        self._newest = math.inf  # the same of the last estimate, infinite where that is not steady [-]

    @property
    def factors(self) -> tuple[float, float]:
        """By which amplitude and frequency of the command are to be multiplied."""
        return math.exp(self._amplitude.value), math.exp(self._frequency.value)

    @property
    def held(self) -> bool:
        """Whether the last estimate is steady and within the tolerance, as those before: an overshoot crosses it."""
        return self._within >= 2.0 * self._slow and self._newest <= self._tolerance

    @property
    def misses(self) -> bool:
        """Whether the command is missed by more than the tolerance, or it is not known whether it is."""
        return self.error > self._tolerance

    @property
    def at_limit(self) -> bool:
        """Whether the largest correction is made."""
        return self._amplitude.at_limit or self._frequency.at_limit

    @property
    def waits(self) -> bool:
        """Whether a sweep has to wait."""
        return self.error > _WAIT * self._tolerance

    def turn(  # an estimate, and what it is worth
        self,
        wanted: tuple[float, float],
        measured: tuple[float, float],
        seconds: float,
        delay: float,
        *,
        steady: bool = True,
        limited: bool = False,
    ) -> None:
        """Act on an estimate `seconds` after the last one, where the output has been at the command.

        wanted, measured: amplitude [m] or [N], frequency [Hz]; delay: from a change of the output to the estimate that
        shows it whole, the length of its window and the way through the loop [s]; steady: whether it is one of a steady
        tone; limited: whether the output is at its limits.
        """
        self._newest = math.inf
        if not all(math.isfinite(value) and value > 0.0 for value in (*wanted, *measured)):
            self._within = 0.0
            return
        self._settled += seconds
        if self._settled < delay:
            return  # the window still holds the ramp
        slow = self._slow = _SLOW * delay
        errors = [math.log(want / value) for want, value in zip(wanted, measured, strict=True)]
        for integrator, error in zip((self._amplitude, self._frequency), errors, strict=True):
            integrator.turn(error, seconds, slow, limited)
        newest = max(map(abs, errors))
        self._newest = newest if steady else math.inf
        share = min(1.0, seconds / delay)
        self.error = newest if math.isinf(self.error) else self.error + share * (newest - self.error)
        self._within = self._within + seconds if self.error <= self._tolerance else 0.0
