# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a campaign to a model of its stand: beam, contact, their uncertainties, and the model beside every point."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from atpid_campaign.campaign.folder import MEASURED, CampaignFolder, Record
from atpid_campaign.campaign.plan import Campaign, CampaignError
from atpid_control.analysis.orders import FEWEST, orders
from atpid_control.analysis.signals import Signals, signals_of
from atpid_control.runs.run import Run, open_run
from atpid_lab.beam.fit import BeamFit, BeamParameters, from_added_mass, from_known_mass
from atpid_lab.contact.estimate import ContactError
from atpid_lab.contact.in_run import fit_part
from atpid_sim.robust import restitution, with_restitution
from atpid_sim.scene import Scene
from atpid_sim.system import Array

#: From the half width of a 95 % interval to a standard deviation.
_NORMAL = 1.96
#: A grain that is held is not rigid: by so much it lowers k/m, which no point shows [-].
_GIVES_WAY = 1e-4
#: Points whose flights are fitted at most: each takes some ten seconds.
_CONTACTS = 8


@dataclass(frozen=True)
class StandModel:
    """What the bags of a campaign determine."""

    beam: BeamParameters
    fit: BeamFit  # it was made of, with the lightest grain
    restitution: float | None  # None: no point determines it
    restitution_std: float
    taken: tuple[str, ...]  # what was not measured but taken as known, and what was left out, a line each

    def scene(self, given: Scene) -> Scene:
        """Return the stand's scene with what was found, the grain's mass as it was."""
        beam = {"mass": self.beam.mass, "stiffness": self.beam.stiffness, "damping": self.beam.damping}
        fraction = given.grain_mass / (given.grain_mass + self.beam.mass)
        found = given.with_(beam=beam, mass_fraction=fraction)
        if self.restitution is None:
            return found
        return with_restitution(found, self.restitution / restitution(found)) or found

    @property
    def uncertainty(self) -> dict[str, float]:
        """Two standard deviations, relative, by the names of `atpid design --uncertainty`."""
        beam, fit = self.beam, self.fit
        mass, (stiffness, damping) = beam.mass_std / beam.mass, np.sqrt(np.diag(fit.covariance))
        # an error of the mass is in stiffness and damping too: of frequency and ratio only the grain's share is left
        grain = 0.5 * (1.0 - beam.mass * fit.stiffness / beam.stiffness) * mass
        frequency, ratio = (math.hypot(one, grain) for one in (0.5 * stiffness / fit.stiffness, damping / fit.damping))
        found = {"mass": mass, "frequency": frequency, "damping": ratio}
        if self.restitution is not None:
            found["restitution"] = self.restitution_std / self.restitution
        return {name: 2.0 * value for name, value in found.items()}


def model_of(campaign: Campaign, scene: Scene, folder: CampaignFolder, moving_mass: float | None = None) -> StandModel:
    """Return the model by the points that are done: the beam by closed ones, restitution by regular ones.

    Points with two grains determine the mass; with one grain the moving mass [kg] is taken as known, the scene's where
    none is given. Raises CampaignError where no point with a closed damper was measured.
    """
    records = [record for record in folder.records().values() if record["status"] == MEASURED]
    closed = [record for record in records if record["wanted_ceiling"] == "closed"]
    if scene.drive == "force" or scene.modes is not None:
        raise CampaignError("a model is made of a structure of one mode whose support moves; use `atpid modes fit BAG`")
    if not closed:
        raise CampaignError(f"{folder.path}: no point with a closed damper is there, which shows the beam; measure one")
    grains = sorted({record["wanted_grain_mass"] for record in closed})
    lightest, heaviest = (
        _beam(folder, [record for record in closed if record["wanted_grain_mass"] == grain])
        for grain in (grains[0], grains[-1])
    )
    taken: list[str] = []
    if len(grains) > 1 and moving_mass is None:
        beam = from_added_mass(lightest, heaviest, grains[-1] - grains[0], grains[0])
    else:
        mass = moving_mass or scene.beam.mass + grains[0]
        taken.append(f"the moving mass with a grain of {1e3 * grains[0]:.4g} g: {mass:.5g} kg")
        beam = from_known_mass(lightest, mass, grain_mass=grains[0])
    opened = [record for record in records if record["regular"] and record["wanted_ceiling"] not in ("closed", "none")]
    values, variances = [], []
    for record in opened[:: -(-len(opened) // _CONTACTS) or 1]:
        run, signals = _part(folder, record)
        try:
            found = fit_part(run, signals, campaign.height_std).restitution
        except ContactError as error:
            taken.append(f"point {record['number']} shows no restitution: {error}")
            continue
        values.append([found.value])
        variances.append([[((found.high - found.low) / (2.0 * _NORMAL)) ** 2]])
    if not values:
        taken.append(f"the restitution: {restitution(scene):.4g}, the scene's")
        return StandModel(beam, lightest, None, math.nan, tuple(taken))
    (value,), ((variance,),) = _mean(np.array(values), np.array(variances))
    if with_restitution(scene, value / restitution(scene)) is None:
        taken.append("the scene's contact, whose law cannot be given the restitution found")
    return StandModel(beam, lightest, float(value), math.sqrt(variance), tuple(taken))


def _part(folder: CampaignFolder, record: Record) -> tuple[Run, Signals]:
    """Return a point's bag, and its signals while it was measured."""
    run = open_run(folder.place(record["number"]) / "bag")
    return run, signals_of(run)[0].between(record["begin"], record["end"])


def _beam(folder: CampaignFolder, records: Sequence[Record]) -> BeamFit:
    """Return what steady tones determine.

    A fit of the motion itself, as `calibrate beam` makes, would take a tone for the beam's own free one.
    """
    found = [by_steady_tone(_part(folder, record)[1]) for record in records]
    values, covariances = (np.array(each) for each in zip(*found, strict=True))
    (stiffness, damping), covariance = _mean(values, covariances)
    covariance[0, 0] += (_GIVES_WAY * stiffness) ** 2
    unknown = math.nan  # of residuals in time
    return BeamFit(float(stiffness), float(damping), covariance, unknown, unknown, unknown, True, 0)


def by_steady_tone(signals: Signals) -> tuple[Array, Array]:
    """Return k/m [1/s^2] and c/m [1/s] by a part with a steady tone, and their covariance (2, 2).

    What is left of the motion before is no noise. It decays, so the halves of the part differ by more than noise makes
    them; what they do is added.
    """
    found, error, omega = _resistance(signals)
    half = max(0.5 * signals.duration, 1.02 * FEWEST * 2.0 * math.pi / omega)
    end = signals.start + signals.duration
    parts = signals.between(signals.start, signals.start + half), signals.between(end - half, math.inf)
    early, late = (_resistance(part)[0] for part in parts)
    apart = np.array([(late - early).real, (late - early).imag])
    variances = error**2 + np.maximum(0.0, apart**2 - 4.0 * error**2)  # by noise halves are two errors apart
    return np.array([found.real, found.imag / omega]), np.diag(variances / [1.0, omega**2])


def _resistance(signals: Signals) -> tuple[complex, float, float]:
    """Return k/m + i w c/m [1/s^2] by a steady tone, w^2 H / (H - 1) with H = X / U, its error, and w [rad/s]."""
    beam, drive = (orders(replace(signals, response=one), 1) for one in (signals.response, signals.excitation))
    ratio, omega = beam.excitation_ratio * cmath.exp(1j * beam.phase[0]), 2.0 * math.pi * beam.frequency
    error = math.hypot(beam.amplitude_std[0], abs(ratio) * drive.amplitude_std[0]) / beam.excitation
    return omega**2 * ratio / (ratio - 1.0), error * omega**2 / abs(ratio - 1.0) ** 2, omega


def _mean(values: Array, covariances: Array) -> tuple[Array, Array]:
    """Return the mean of (n, k) by their covariances (n, k, k), and its own, widened where they scatter by more."""
    weights = np.linalg.inv(covariances)
    covariance = np.linalg.inv(weights.sum(axis=0))
    mean = covariance @ np.einsum("nij,nj->i", weights, values)
    off = float(np.einsum("ni,nij,nj", values - mean, weights, values - mean))
    return mean, covariance * max(1.0, off / max(1, values.size - mean.size))


def written(model: StandModel, scene: Scene, folder: Path) -> Path:
    """Write model.yaml into a folder: the stand's scene with what was found; return its path."""
    path, beam = folder / "model.yaml", model.beam
    lines = [
        f"# mass {beam.mass:.6g} ± {beam.mass_std:.2g} kg, stiffness {beam.stiffness:.6g} ± {beam.stiffness_std:.2g} "
        f"N/m, damping {beam.damping:.4g} ± {beam.damping_std:.2g} N s/m",
    ]
    if model.restitution is not None:
        lines.append(f"# restitution {model.restitution:.4f} ± {model.restitution_std:.2g}")
    lines += [f"# taken as known, or left out: {line}" for line in model.taken]
    path.write_text("\n".join([*lines, model.scene(scene).to_yaml()]), encoding="utf-8")
    return path
