# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reference for the tests: one mass on the moving support in closed form, apart from everything the engine computes.

It stands for the closed damper, a grain that never leaves the floor, or the beam alone.

The thesis's Simplified Model (section 4.4, equations 4.7-4.19) with the amplitude along straight ramps: between kinks
A(t) = a0 + a1 tau, and with u the imaginary part of A e^(i omega t) the motion is the imaginary part of
(q0 + q1 tau + q2 tau^2) e^(i omega t), plus a decaying swing that carries displacement and velocity over each kink.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from atpid_sim.scene import FreeExcitation, HarmonicExcitation, Scene
from atpid_sim.system import Array
from studies.baselines.run import half_peak_to_peak

Points = tuple[tuple[float, float], ...]

#: Points a period in searches for peaks; the interpolation in between is then within 3e-11 of the amplitude.
_POINTS = 64
#: Below this distance from zero, relative to the stiffness, an undamped beam counts as driven exactly at resonance.
_RESONANT = 1e-9
#: Nodes of the quadrature of the energy ledger in each eighth of a period.
_NODES, _NODE_WEIGHTS = np.polynomial.legendre.leggauss(12)


class NoClosedFormError(ValueError):
    """A scene whose motion has no closed form of this kind."""


class OneMass(NamedTuple):
    """What swings, SI units."""

    mass: float
    stiffness: float
    damping: float
    gravity: float


class Motion(NamedTuple):
    """Displacement [m], velocity [m/s], acceleration [m/s^2] of the mass; the support's first two (n,)."""

    x: Array
    v: Array
    a: Array
    support: Array
    support_rate: Array


class Ledger(NamedTuple):
    """Energies since the start [J], and what is left unexplained relative to the largest of them [-]."""

    input: float
    beam_loss: float
    stored: float
    residual: float


@dataclass(frozen=True)
class _Piece:
    """One stretch without kinks, from `start` [s] on."""

    start: float
    a0: float
    a1: float
    q: tuple[complex, complex, complex]
    swing: float
    swing_rate: float


class ClosedForm:
    """The motion of a scene's beam as one mass, known at every time of the run."""

    def __init__(self, scene: Scene, with_grain: bool = True) -> None:
        """Work out all pieces; the beam carries the grain, or swings alone as under a ceiling out of reach.

        Raises NoClosedFormError for a sweep or a measured series.
        """
        mass = scene.total_mass if with_grain else scene.beam.mass
        self.body = OneMass(mass, scene.beam.stiffness, scene.beam.damping, scene.gravity)
        self.duration = scene.duration
        self._omega = 2.0 * math.pi * scene.frequency_hz
        amplitude, deflection = _drive(scene)
        self._rest = -mass * scene.gravity / scene.beam.stiffness
        self._pieces = self._solve(amplitude, deflection)

    def at(self, times: Array) -> Motion:
        """Return the motion at `times` (n,) [s], in any order, not before zero."""
        times = np.asarray(times, dtype=np.float64)
        starts = [piece.start for piece in self._pieces]
        index = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)
        parts = np.empty((5, len(times)))
        for k in np.unique(index):
            chosen = index == k
            parts[:, chosen] = self._piece_at(self._pieces[k], times[chosen])
        return Motion(*parts)

    def amplitude(self, first: float, last: float) -> float:
        """Return half the peak-to-peak displacement [m] between two times [s]."""
        times = self._grid(first, last, _POINTS)
        motion = self.at(times)
        return half_peak_to_peak(times, motion.x, motion.v, motion.a)

    def ledger(self, until: float) -> Ledger:
        """Return the energies from the start to `until` [s], by Gauss quadrature between the kinks."""
        kinks = [piece.start for piece in self._pieces if 0.0 < piece.start < until]
        edges = np.union1d(self._grid(0.0, until, 8), kinks)
        half = 0.5 * np.diff(edges)
        times = (0.5 * (edges[:-1] + edges[1:]))[:, None] + half[:, None] * _NODES
        motion = self.at(times.ravel())
        relative = motion.v - motion.support_rate
        force = self.body.stiffness * (motion.support - motion.x) - self.body.damping * relative
        weights = (half[:, None] * _NODE_WEIGHTS).ravel()
        given = float(weights @ (force * motion.support_rate))
        lost = float(weights @ (self.body.damping * relative**2))
        first, last = self._energy(self.at(np.array([0.0, until]))).tolist()
        scale = max(abs(given), lost, abs(last - first)) or 1.0
        return Ledger(given, lost, last - first, abs(given - lost - (last - first)) / scale)

    def stays_down(self) -> bool:
        """Whether a grain on the floor never leaves it: the beam never falls as fast as it would (1 % margin)."""
        return bool(self.at(self._grid(0.0, self.duration, _POINTS)).a.min() > -0.99 * self.body.gravity)

    def _grid(self, first: float, last: float, points: int) -> Array:
        fastest = max(self._omega, math.sqrt(self.body.stiffness / self.body.mass))
        count = max(2, math.ceil((last - first) * fastest / (2.0 * math.pi) * points) + 1)
        return np.linspace(first, last, count)

    def _energy(self, motion: Motion) -> Array:
        kinetic = 0.5 * self.body.mass * motion.v**2
        spring = 0.5 * self.body.stiffness * (motion.support - motion.x) ** 2
        return kinetic + spring + self.body.mass * self.body.gravity * motion.x

    def _solve(self, amplitude: Points, deflection: float) -> list[_Piece]:
        times = [t for t, _ in amplitude if 0.0 < t < self.duration]
        edges = [0.0, *times, self.duration]
        values = np.interp(edges, [t for t, _ in amplitude], [a for _, a in amplitude])
        x, v = self._rest + deflection, 0.0
        pieces = []
        for k, start in enumerate(edges[:-1]):
            a0, a1 = float(values[k]), float((values[k + 1] - values[k]) / (edges[k + 1] - start))
            bare = _Piece(start, a0, a1, self._particular(a0, a1), 0.0, 0.0)
            forced = self._piece_at(bare, np.array([start]))
            piece = _Piece(start, a0, a1, bare.q, x - float(forced.x[0]), v - float(forced.v[0]))
            pieces.append(piece)
            end = self._piece_at(piece, np.array([edges[k + 1]]))
            x, v = float(end.x[0]), float(end.v[0])
        return pieces

    def _particular(self, a0: float, a1: float) -> tuple[complex, complex, complex]:
        """Coefficients of m q'' + (c + 2 i omega m) q' + (k - m omega^2 + i omega c) q = f0 + f1 tau."""
        mass, stiffness, damping, _ = self.body
        omega = self._omega
        f1 = complex(stiffness, omega * damping) * a1
        f0 = complex(stiffness, omega * damping) * a0 + damping * a1
        direct = complex(stiffness - mass * omega**2, omega * damping)
        first = complex(damping, 2.0 * omega * mass)
        if abs(direct) < _RESONANT * stiffness:
            q2 = f1 / (2.0 * first)
            return 0j, (f0 - 2.0 * mass * q2) / first, q2
        q1 = f1 / direct
        return (f0 - first * q1) / direct, q1, 0j

    def _piece_at(self, piece: _Piece, times: Array) -> Motion:
        tau, omega = times - piece.start, self._omega
        # the fractional period first: a late phase keeps its digits
        turn = np.exp(2j * np.pi * np.mod(times * (omega / (2.0 * np.pi)), 1.0)).astype(np.complex128)
        amplitude: Array = piece.a0 + piece.a1 * tau
        q0, q1, q2 = piece.q
        q, dq, ddq = q0 + tau * (q1 + tau * q2), q1 + 2.0 * tau * q2, 2.0 * q2
        y, dy = self._swing(piece.swing, piece.swing_rate, tau)
        decay, natural = self.body.damping / self.body.mass, self.body.stiffness / self.body.mass
        return Motion(
            self._rest + y + (q * turn).imag,
            dy + ((dq + 1j * omega * q) * turn).imag,
            -decay * dy - natural * y + ((ddq + 2j * omega * dq - omega**2 * q) * turn).imag,
            (amplitude * turn).imag,
            ((piece.a1 + 1j * omega * amplitude) * turn).imag,
        )

    def _swing(self, y0: float, v0: float, tau: Array) -> tuple[Array, Array]:
        """Free decay from y0, v0, under-, over- or critically damped alike."""
        decay, natural = 0.5 * self.body.damping / self.body.mass, self.body.stiffness / self.body.mass
        root = np.sqrt(complex(decay**2 - natural))
        if abs(root) * float(np.max(tau, initial=0.0)) < 1e-6:
            cosine = np.exp(-decay * tau)
            sine = tau * cosine
        else:
            # both exponents are negative: nothing overflows however long or heavily damped the decay is
            slow, fast = np.exp((root - decay) * tau), np.exp(-(root + decay) * tau)
            cosine, sine = (0.5 * (slow + fast)).real, (0.5 * (slow - fast) / root).real
        y = y0 * cosine + (v0 + decay * y0) * sine
        return y, v0 * cosine - (natural * y0 + decay * v0) * sine


def steady_amplitude(body: OneMass, amplitude: float, frequency: float) -> float:
    """Return the steady amplitude [m] under a support amplitude [m] at a frequency [Hz] (equation 4.19's modulus)."""
    omega = 2.0 * math.pi * frequency
    drive = complex(body.stiffness, omega * body.damping)
    resistance = complex(body.stiffness - body.mass * omega**2, omega * body.damping)
    return amplitude * abs(drive) / abs(resistance) if resistance else math.inf


def undamped_amplitude(scene: Scene) -> float:
    """Return half the peak-to-peak displacement [m] of the closed damper in the scene's steady window."""
    return ClosedForm(scene).amplitude(*scene.steady_window)


def _drive(scene: Scene) -> tuple[Points, float]:
    """Return the amplitude points and the deflection at release."""
    excitation = scene.excitation
    if isinstance(excitation, HarmonicExcitation):
        amplitude = excitation.amplitude
        return (((0.0, amplitude),) if isinstance(amplitude, float | int) else amplitude), 0.0
    if isinstance(excitation, FreeExcitation):
        return ((0.0, 0.0),), excitation.free.deflection
    raise NoClosedFormError(
        f"excitation: given {excitation.kind}; allowed here: a tone or a free decay; use impact or soft"
    )
