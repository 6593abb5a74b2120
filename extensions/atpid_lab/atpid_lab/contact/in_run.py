# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restitution and contact time from the flights of a recorded run: no force is measured, three laws replace it.

Of each flight the instants of both impacts and the beam's position there are known, so gravity gives the grain's
velocities at its two ends; of each impact the jump of the beam's velocity, so the exchange of momentum gives the
approach speed. Restitution joins the two. A contact that lasts lets the grain overlap floor and ceiling: a flight is
longer by what both gave way until the centroid of the force, from which the contact time follows. Height and mass
fraction are known to their standard deviations only, and restitution may change with speed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from atpid_control.analysis.signals import Signals
from atpid_control.runs.run import Run
from atpid_lab.contact.drop import ContactFit, with_modulus
from atpid_lab.contact.estimate import ContactError, mixture, pressed, pulse
from atpid_lab.contact.flights import Flights, Indices, flights_of
from atpid_sim.kernel_inputs import system_of
from atpid_sim.scene import Scene
from atpid_sim.system import Array, System

#: Standard deviations of the restitution's exponent of speed, the mass ratio's logarithm and the share by which Tsuji's
#: law is wrong in what an acceleration changes, before the run.
_EXPONENT, _MASS, _LAW = 0.15, 0.005, 0.25
#: Standard deviations with which restitution may scatter from impact to impact, each as likely as the others.
_SCATTER = np.concatenate(([0.0], np.geomspace(3e-4, 0.3, 13)))
#: What the measurement's errors may be in units of white noise: that of the support reaches the beam through resonance.
_SIZE = (1.3, 1.8, 2.5, 3.6, 5.0)
#: Flights further off than so many standard deviations have an impact in them that was not seen, or a grain that stuck.
_FAR = 4.5
#: Times the fit starts again from where it was.
_ROUNDS = 12
#: Standard deviation of what other laws than Tsuji's, and higher orders, add to the restitution, by what is corrected.
_SECOND = 0.25
#: And in any case: none is the same in every impact; share by which another law shifts the force's centroid.
_CONSTANT, _SHAPE = 1e-4, 0.03
#: Least flights, of the impacts that were found, for a motion whose impacts are seen.
_FEWEST, _OF_IMPACTS = 10, 0.55
#: A contact time is determined where the low end of its interval is this share of it at least.
_DETERMINED = 0.5
#: Around a flight the ceiling has to be at rest [s], within [m] or two standard deviations of the height.
_ASIDE, _STILL = 0.1, 1e-6
#: What is known of the unknowns before, in units of their scale.
_KNOWN = np.array([0.0, 1.0, 0.0, 1.0, 1.0, 1.0])
#: Flights used at most: the last ones.
_MOST = 150
#: Degrees of freedom of the noise, which thousands of samples show.
_MANY = 1e6
#: Overlap at the force's centroid, of stiff contacts, as an exponent of the approach speed (Hertz).
_DEEPER = 0.8


class _Posterior(NamedTuple):
    """Unknowns for each scatter of the restitution and size of the errors (k,), in units of `_Model.scale`."""

    middle: Array  # (k, 6)
    error: Array  # (k, 6)
    likelihood: Array  # (k,) its logarithm
    off: Array  # (2, n) standardised misfits of the likeliest


class _Model(NamedTuple):
    """Flights (n,) and their unknowns: restitution at a speed, its exponent, the time to the force's centroid at that
    speed [s], what the height is off [m], the mass ratio's logarithm, and what Tsuji's law is wrong."""

    ends: Array  # (2, 5, n) what the beam did at both impacts
    errors: Array  # (2, 5, p, n) what independent errors do to it
    clearance: Array  # (n,) of the ceiling above a grain on the floor [m]
    number: Indices  # (n,) of the impact each begins with
    system: System
    scale: Array  # (6,) of the unknowns
    speed: float = 1.0  # [m/s]
    pressed: tuple[float, float] = (0.0, 0.0)  # see `pulse.pressed`

    def approach(self, unknowns: Array, ends: Array, more: Array | float = 0.0) -> tuple[Array, Array, Array, Array]:
        """Return side (+1: floor), approach and rebound speed and overlap (2, ..., n) at the centroid of the force.

        The exchange of momentum gives the sum of both speeds.
        """
        restitution, exponent, centroid, _, mass, law = self.scale * unknowns
        ratio = self.system.grain_mass / self.system.beam_mass * math.exp(mass)
        side, both = -np.sign(ends[:, 3] - ends[:, 2]), np.abs(ends[:, 3] - ends[:, 2]) * (1.0 + ratio) / ratio
        scaled, push = both / (1.0 + restitution) / self.speed, self.push(unknowns, ends)
        each = restitution * scaled**exponent + self.pressed[0] * (1.0 + law) * push + more
        closing = both / (1.0 + np.maximum(each, -0.5))
        overlap = centroid * self.speed * (closing / self.speed) ** _DEEPER * (1.0 + self.pressed[1] * push)
        return side, closing, both - closing, overlap

    def push(self, unknowns: Array, ends: Array) -> Array:
        """Return the relative acceleration that presses grain and wall together, by speed over time to the centroid."""
        ratio = self.system.grain_mass / self.system.beam_mass
        closing = (ends[:, 3] - ends[:, 2]) * (1.0 + ratio) / ratio / (1.0 + unknowns[0]) / self.speed
        time = self.scale[2] * unknowns[2] * np.abs(closing) ** (_DEEPER - 1.0)
        return np.asarray(-(ends[:, 4] + self.system.gravity) * time / (closing * self.speed))

    def misfit(self, unknowns: Array, ends: Array, more: Array | float = 0.0) -> Array:
        """Return velocities at both ends by momentum and restitution, less those by the flight (2, ..., n) [m/s].

        ends: (2, 5, ..., n); more: restitution of each impact beside the others' (2, 1).
        """
        side, closing, rebound, overlap = self.approach(unknowns, ends, more)
        off = self.scale[3] * unknowns[3]
        grain = ends[:, 1] - side * overlap + np.where(side < 0.0, self.clearance + off, 0.0)
        duration = ends[1, 0] - ends[0, 0]
        mean, change = (grain[1] - grain[0]) / duration, 0.5 * self.system.gravity * duration
        start, arrival = ends[0, 3] + side[0] * rebound[0], ends[1, 2] - side[1] * closing[1]
        return np.array([start - mean - change, arrival - mean + change])

    def posterior(self, unknowns: Array) -> _Posterior:
        """Return the linear solution from `unknowns` for each scatter and size."""
        step, rows = 1e-6, 2 * len(self.number)
        misfit = self.misfit(unknowns, self.ends)
        slope = np.array([self.misfit(unknowns + step * one, self.ends) - misfit for one in np.eye(6)]) / step
        noise = self.misfit(unknowns, self.ends[:, :, None] + self.errors) - misfit[:, None]
        noise = np.moveaxis(noise, 1, 2).reshape(rows, -1)
        own = np.zeros((2, len(self.number), int(self.number.max()) + 2))
        for end, more in enumerate(np.eye(2)[:, :, None]):
            own[:, np.arange(len(self.number)), self.number + end] += (
                self.misfit(unknowns, self.ends, step * more) - misfit
            ) / step
        measured, scattered = noise @ noise.T, own.reshape(rows, -1) @ own.reshape(rows, -1).T
        flat, columns = misfit.ravel(), slope.reshape(6, -1).T
        found = [
            self._given(unknowns, flat, columns, size**2 * measured + scatter**2 * scattered)
            for scatter, size in product(_SCATTER, _SIZE)
        ]
        middle, error, likelihood, off = (np.array(column) for column in zip(*found, strict=True))
        return _Posterior(middle, error, likelihood, off[np.argmax(likelihood)].reshape(2, -1))

    @staticmethod
    def _given(unknowns: Array, misfit: Array, slope: Array, covariance: Array) -> tuple[Array, Array, float, Array]:
        covariance = covariance + 1e-12 * np.diag(np.diag(covariance).mean() * np.ones(misfit.size))
        root = np.linalg.cholesky(covariance)
        white, columns = solve_triangular(root, misfit, lower=True), solve_triangular(root, slope, lower=True)
        precision = columns.T @ columns + np.diag(_KNOWN)
        gradient = columns.T @ white + _KNOWN * unknowns
        spread = np.linalg.inv(precision)
        move = -spread @ gradient
        square = float(white @ white + _KNOWN @ unknowns**2 + gradient @ move)
        determinants = 2.0 * float(np.log(np.diag(root)).sum()) + float(np.linalg.slogdet(precision)[1])
        off = (misfit + slope @ move) / np.sqrt(np.diag(covariance))
        return unknowns + move, np.sqrt(np.diag(spread)), -0.5 * (square + determinants), off

    def part(self, kept: Indices) -> _Model:
        """Return the model of some of the flights."""
        ends, errors = self.ends[..., kept], self.errors[..., kept]
        return self._replace(ends=ends, errors=errors, clearance=self.clearance[kept], number=self.number[kept])


def fit_part(run: Run, signals: Signals, height_std: float) -> ContactFit:
    """Return what a part of a run's signals determines, by the scene in its bag. Raises ContactError."""
    if run.scene is None:
        raise ContactError(f"{run.path}: its scene is needed: {run.scene_problem}")
    system = system_of(run.scene)
    flights = flights_of(signals, system)
    return fit_run(flights, clearance(run, flights, run.scene, height_std), system, height_std)


def clearance(run: Run, flights: Flights, scene: Scene, height_std: float) -> Array:
    """Return the ceiling's clearance (n,) above a grain on the floor [m]; NaN: it moves in that flight, or is unknown.

    Heights are those reported in the run, else the scene's own.
    """
    time, height = run.ceiling.time, run.ceiling.height
    if not len(time) and not scene.ceiling.controlled:
        time, height = np.array(scene.ceiling.heights).T
    found = np.full(len(flights.number), math.nan)
    for i, (begin, end) in enumerate(zip(flights.begins.time, flights.ends.time, strict=True)) if len(time) else ():
        inside = height[(time > begin - _ASIDE) & (time < end + _ASIDE)]
        these = np.concatenate([np.interp([begin - _ASIDE, end + _ASIDE], time, height), inside])
        if np.ptp(these) <= max(2.0 * height_std, _STILL):  # false with NaN
            found[i] = these.mean() - 2.0 * scene.grain.radius
    return found


def fit_run(flights: Flights, above: Array, system: System, height_std: float) -> ContactFit:
    """Return what flights (n,) determine, given the ceiling's `clearance` (n,) [m] and its standard deviation [m].

    Raises ContactError: too few flights, or a motion that is not flights from one impact to the next.
    """
    errors = np.moveaxis(np.stack(np.split(flights.errors, 2, axis=1)), 1, 2)
    scale = np.array([1.0, _EXPONENT, 1e-3, height_std, _MASS, _LAW])
    model = _Model(np.array([flights.begins, flights.ends]), errors, above, flights.number, system, scale)
    unknowns = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    usable = np.flatnonzero(np.isfinite(model.misfit(unknowns, model.ends)).all(axis=0))
    clean = len(flights.number) >= _OF_IMPACTS * flights.impacts
    if not clean or len(usable) < _FEWEST:
        raise _refused(flights, len(usable))
    model = model.part(usable[-_MOST:])
    given = len(model.number)
    for _ in range(_ROUNDS):
        speed = float(np.exp(np.log(model.approach(unknowns, model.ends)[1]).mean()))
        likely = round(min(max(float(unknowns[0]), 0.05), 1.0), 2)
        model = model._replace(speed=speed, pressed=pressed(likely))
        found = model.posterior(unknowns)
        before, unknowns = unknowns, found.middle[np.argmax(found.likelihood)].copy()
        unknowns[0] = min(max(unknowns[0], 0.0), 1.5)
        far = np.abs(found.off).max(axis=0)
        limit = _FAR * max(1.4826 * float(np.median(np.abs(found.off))), 1e-3)
        if far.max() > limit and len(model.number) > _FEWEST:
            model = model.part(np.flatnonzero(far <= max(limit, 0.7 * far.max())))
        elif np.abs(unknowns - before).max() < 1e-3:
            break
    if len(model.number) < max(_FEWEST, 0.5 * given):
        raise _refused(flights, len(model.number))
    return _fit(model, found, unknowns)


def _refused(flights: Flights, usable: int) -> ContactError:
    return ContactError(
        f"given {flights.impacts} impacts, {len(flights.number)} flights from one straight to the next, {usable} of "
        f"use with the ceiling at rest; needed: at least {_FEWEST}, and {_OF_IMPACTS:.0%} of the impacts: choose a "
        "part in which the grain neither sticks nor bounces on the spot with --from and --to, or open the ceiling"
    )


def _fit(model: _Model, found: _Posterior, unknowns: Array) -> ContactFit:
    """Return restitution, contact time and modulus of the solution."""
    _, speeds, *_ = model.approach(unknowns, model.ends)
    law = _SECOND * abs(model.pressed[0] * float(model.push(unknowns, model.ends).mean()))
    doubts, flights = ((0, math.hypot(law, _CONSTANT)), (2, _SHAPE * abs(unknowns[2]))), len(model.number)
    middles, scale = found.middle * model.scale, model.scale
    restitution, centroid = (
        mixture(middles[:, one], np.hypot(found.error[:, one], doubt) * scale[one], found.likelihood, _MANY, flights)
        for one, doubt in doubts
    )
    if centroid.high < 0.0 and centroid.value < -2.0 * (centroid.high - centroid.low):
        deep = 2e3 * model.speed * abs(centroid.value)
        raise ContactError(
            f"flights fit a ceiling about {deep:.2g} mm lower than stated: the height is wrong, or impacts are hidden "
            "where the grain bounces or sticks; choose a part without them with --from and --to"
        )
    restitution = restitution._replace(low=max(restitution.low, 0.0), value=max(restitution.value, 0.0))
    mass = model.system.beam_mass * model.system.grain_mass / (model.system.beam_mass + model.system.grain_mass)
    impact = pulse(max(restitution.value, 1e-3))
    beta = 0.5 * math.sqrt(5.0 * mass / model.system.grain_mass) * impact.damping_ratio
    fit = ContactFit(restitution, (float(speeds.min()), float(speeds.max())), at_speed=model.speed, damping_ratio=beta)
    if centroid.low < _DETERMINED * centroid.value or centroid.value <= 0.0:
        longest = max(centroid.high, 0.0) * impact.duration / impact.centre
        short = f"contacts are too short for the sensors, at most {longest:.2g} s at {model.speed:.3g} m/s"
        return replace(fit, missing=(f"contact time and modulus: {short}",))
    return with_modulus(fit, centroid, "centre", mass, model.system.radius)
