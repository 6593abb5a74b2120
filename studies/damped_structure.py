# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""An integration of a structure with its damper that shares nothing with the packages: what designs are checked by.

Fourth-order Runge and Kutta of the structure's modes and the grain with Tsuji's law, a hundred steps in an impact and,
before it, steps that halve the gap. Steady states are solved with the damping between modes that the packages leave
out.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from atpid_design.problem import Deviation, Problem, grain_radius
from atpid_sim.kernel import kernel
from atpid_sim.system import Array

#: Periods in which an amplitude is taken.
WINDOW = 16
#: Poisson's ratio, as the design states it; steps in an impact, in a period of the excitation and of a mode in flight.
_POISSON, _IMPACT_STEPS, _FLIGHT_STEPS, _MODE_STEPS = 0.2, 100, 400, 40
#: A motion counts as regular up to this change between periods of the same parity, over the amplitude [-].
_REGULAR = 0.02


class Physics(NamedTuple):
    """Everything a run needs; of the modes (modes,) each, whose displacements add up to the container's."""

    mass: Array  # [kg]
    stiffness: Array  # [N/m]
    damping: Array  # [N s/m]
    direct: Array  # force for a unit of the drive's signal
    rate: Array  # and of its velocity
    grain: float  # [kg]
    gravity: float  # [m/s^2]
    diameter: float  # [m]
    contact: float  # k of Tsuji's law [N/m^1.5]
    loss: float  # c of Tsuji's law [N s/m^1.25]
    amplitude: float  # of the support [m] or the force [N]
    omega: float  # [rad/s]

    @property
    def reduced(self) -> float:
        """Mass that an impact of the grain meets [kg]."""
        return float(1.0 / (np.sum(1.0 / self.mass) + 1.0 / self.grain))


class Motion(NamedTuple):
    """What a run shows in its last `WINDOW` periods."""

    amplitude: float  # half peak-to-peak [m]
    ceiling: float  # largest force [N]
    floor: float
    regular: bool


@kernel
def _force(overlap: float, rate: float, contact: float, loss: float) -> float:
    if overlap <= 0.0:
        return 0.0
    force: float = max(0.0, contact * overlap**1.5 + loss * rate * overlap**0.25)
    return force


@kernel
def _ceiling(p: Any, t: float, height: float, start: float, travel: float) -> tuple[float, float]:
    if t <= start:
        return p.diameter, 0.0
    if t >= start + travel:
        return height, 0.0
    speed = (height - p.diameter) / travel
    return p.diameter + speed * (t - start), speed


@kernel
def _container(p: Any, y: Array) -> tuple[float, float]:
    n, x, v = len(p.mass), 0.0, 0.0
    for r in range(n):
        x += y[r]
        v += y[n + r]
    return x, v


@kernel
def _slope(p: Any, t: float, y: Array, h: float, speed: float, out: Array) -> None:
    """Fill in the derivative of y: modes' displacements, their velocities, the grain's, its velocity."""
    n = len(p.mass)
    x, v = _container(p, y)
    signal, rate = p.amplitude * math.sin(p.omega * t), p.amplitude * p.omega * math.cos(p.omega * t)
    floor = _force(x - y[2 * n], v - y[2 * n + 1], p.contact, p.loss)
    top = _force(p.diameter + y[2 * n] - x - h, y[2 * n + 1] - v - speed, p.contact, p.loss)
    for r in range(n):
        driven = p.direct[r] * signal + p.rate[r] * rate - p.stiffness[r] * y[r] - p.damping[r] * y[n + r]
        out[r], out[n + r] = y[n + r], (driven - floor + top) / p.mass[r]
    out[n] -= p.gravity
    out[2 * n], out[2 * n + 1] = y[2 * n + 1], (floor - top) / p.grain - p.gravity


@kernel
def integrate(
    p: Any, start_state: Array, height: float, start: float, travel: float, end: float, fine: float, window: int
) -> Any:
    """Return least and largest structure displacement in the window, largest forces, strobed displacements."""
    period = 2.0 * math.pi / p.omega
    begin = end - window * period
    coarse = period / _FLIGHT_STEPS
    n, t = len(p.mass), 0.0
    for r in range(n):
        coarse = min(coarse, 2.0 * math.pi * math.sqrt(p.mass[r] / p.stiffness[r]) / _MODE_STEPS)
    low, high, ceiling, floor = 1e300, -1e300, 0.0, 0.0
    strobe = np.zeros(window)
    y = start_state.copy()
    k1, k2, k3, k4 = np.zeros_like(y), np.zeros_like(y), np.zeros_like(y), np.zeros_like(y)
    while t < end:
        h, speed = _ceiling(p, t, height, start, travel)
        x, v = _container(p, y)
        gap = min(y[2 * n] - x, x + h - p.diameter - y[2 * n])
        _slope(p, t, y, h, speed, k1)
        pull = abs(k1[2 * n + 1])
        for r in range(n):
            pull += abs(k1[n + r])
        step = min(max(0.5 * gap / (abs(v - y[2 * n + 1]) + speed + 4.0 * pull * fine), fine), coarse)
        h2, s2 = _ceiling(p, t + 0.5 * step, height, start, travel)
        _slope(p, t + 0.5 * step, y + 0.5 * step * k1, h2, s2, k2)
        _slope(p, t + 0.5 * step, y + 0.5 * step * k2, h2, s2, k3)
        h4, s4 = _ceiling(p, t + step, height, start, travel)
        _slope(p, t + step, y + step * k3, h4, s4, k4)
        before = x
        y += step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        t += step
        if t >= begin:
            x, v = _container(p, y)
            low, high = min(low, x), max(high, x)
            floor = max(floor, _force(x - y[2 * n], v - y[2 * n + 1], p.contact, p.loss))
            ceiling = max(ceiling, _force(p.diameter + y[2 * n] - x - h4, y[2 * n + 1] - v - s4, p.contact, p.loss))
            number = int((t - begin) / period)
            if math.floor((t - step - begin) / period) != number and number < window:
                strobe[number] = x - (x - before) * (t - begin - number * period) / step
    return low, high, ceiling, floor, strobe


@kernel
def rebound(mass: float, contact: float, loss: float, speed: float) -> tuple[float, float]:
    """Return restitution and duration [s] of one impact of a reduced mass [kg] at a speed [m/s]."""
    step = 2.94 * (1.25 * mass * speed * speed / contact) ** 0.4 / speed / 2000.0
    x, v, t = 1e-12, speed, 0.0
    while True:
        a = -_force(x, v, contact, loss) / mass
        middle, mid_v = x + 0.5 * step * v, v + 0.5 * step * a
        b = -_force(middle, mid_v, contact, loss) / mass
        x, v, t = x + step * mid_v, v + step * b, t + step
        if x <= 0.0 or (v < 0.0 and contact * x**1.5 + loss * v * x**0.25 <= 0.0):
            return -v / speed, t


def physics(problem: Problem, fraction: float, amplitude: float, off: Deviation, frequency: float | None) -> Physics:
    """Return the system of a deviation; amplitude: of the drive, as identified; frequency: None is resonance."""
    grain = problem.mass * fraction / (1.0 - fraction)
    modes = [(problem.mass, 2.0 * math.pi * problem.frequency, problem.damping, math.nan)]
    modes += [
        (one.mass, math.sqrt(one.stiffness / one.mass), 0.5 * one.damping / math.sqrt(one.stiffness * one.mass),
         one.drive_factor)
        for one in problem.further_modes
    ]  # fmt: skip
    offs = np.array([(off.mass, off.frequency, off.damping), *(off.further or [(0.0,) * 3] * (len(modes) - 1))])
    mass, own, ratio, factor = np.array(modes).T
    mass, own, ratio = np.array([mass, own, ratio]) * (1.0 + offs.T)
    stiffness, damping = mass * own**2, 2.0 * ratio * mass * own
    factor[0] = 1.0 if problem.drive == "force" else 1.0 - factor[1:].sum()
    forced = problem.drive == "force"
    direct, rate = (factor, np.zeros_like(factor)) if forced else (factor * stiffness, factor * damping)
    radius = grain_radius(problem, fraction)
    effective = problem.young_modulus * (1.0 + off.young_modulus) / (2.0 * (1.0 - _POISSON**2))
    contact = 4.0 / 3.0 * effective * math.sqrt(radius)
    squares, shapes = eigh(np.diag(stiffness), np.diag(mass) + grain)
    closed = math.sqrt(squares[np.argmax(np.abs(shapes[0]))])
    omega = (closed if frequency is None else 2.0 * math.pi * frequency) * (1.0 + off.detuning)
    p = Physics(
        mass, stiffness, damping, direct, rate, grain, problem.gravity, 2.0 * radius, contact, 0.0,
        amplitude * (1.0 + off.amplitude), omega,
    )  # fmt: skip
    restitution = min(problem.restitution * (1.0 + off.restitution), 0.99)
    low, high = 0.0, 20.0 * math.sqrt(contact * p.reduced)
    for _ in range(60):
        loss = 0.5 * (low + high)
        low, high = (loss, high) if rebound(p.reduced, contact, loss, 1.0)[0] > restitution else (low, loss)
    return p._replace(loss=0.5 * (low + high))


def steady(p: Physics, grain: float) -> NDArray[np.complex128]:
    """Return the phasors of the modes (modes,) with a mass [kg] held at the container, against the drive's sine [m]."""
    resistance = np.diag(p.stiffness - p.mass * p.omega**2 + 1j * p.omega * p.damping) - grain * p.omega**2
    force = p.amplitude * (p.direct + 1j * p.omega * p.rate)
    return np.asarray(np.linalg.solve(resistance, force), dtype=np.complex128)


def linear(p: Physics, grain: float) -> float:
    """Return the container's amplitude with a mass [kg] held there [m]."""
    return float(abs(steady(p, grain).sum()))


def motion(p: Physics, height: float, phase: float = 0.0, travel: float = 1e-6) -> Motion:
    """Return the motion after the ceiling of the closed damper, in its steady state, has opened to a height [m].

    phase: of the drive when it begins to open [periods]; travel: duration [s]. The run lasts twelve time constants.
    """
    period = 2.0 * math.pi / p.omega
    closed, rest = steady(p, p.grain), (p.grain + p.mass * (np.arange(len(p.mass)) == 0)) * p.gravity / p.stiffness
    q, rates = closed.imag - rest, p.omega * closed.real
    fine = rebound(p.reduced, p.contact, p.loss, p.omega * abs(closed.sum()))[1] / _IMPACT_STEPS
    settled = min(max(12.0 * decay(p) / period, 40.0), 500.0) + WINDOW
    end = (phase + settled) * period + travel
    state = np.array([*q, *rates, q.sum(), rates.sum()])
    low, high, ceiling, floor, strobe = integrate(p, state, height, phase * period, travel, end, fine, WINDOW)
    size = 0.5 * (high - low)
    change = max(float(np.ptp(strobe[parity::2])) for parity in (0, 1)) / size
    return Motion(size, ceiling, floor, change <= _REGULAR)


def decay(p: Physics) -> float:
    """Return the time constant of the closed damper [s], by mode 1 and the grain."""
    return float(2.0 * (p.mass[0] + p.grain) / p.damping[0])


def integrated_bare(p: Physics) -> float:
    """Return the structure's amplitude without a damper, integrated: a grain of no weight far from both walls."""
    alone = p._replace(grain=1.0, gravity=0.0, diameter=0.0)
    period = 2.0 * math.pi / p.omega
    settled = 30.0 * float(np.max(p.mass / p.damping)) / period + WINDOW
    far, count = 1e3, len(p.mass)
    state = np.array([*np.zeros(2 * count), far, 0.0])
    low, high, *_ = integrate(alone, state, 3.0 * far, -1.0, 1e-6, settled * period, 1e-6 * period, WINDOW)
    return float(0.5 * (high - low))
