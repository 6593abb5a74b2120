# SPDX-License-Identifier: Apache-2.0
"""From a campaign to a model of its stand: beam, contact, their uncertainties, and the model beside every point."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from atpid_control.analysis.beam.fit import BeamFit
from atpid_control.analysis.beam.masses import BeamParameters, from_added_mass, from_known_mass
from atpid_control.analysis.contact.drop import ContactFit
from atpid_control.analysis.contact.estimate import ContactError
from atpid_control.analysis.contact.flights import flights_of
from atpid_control.analysis.contact.in_run import clearance, fit_run
from atpid_control.analysis.signals import Signals, signals_of
from atpid_control.campaign.folder import CampaignFolder, Record
from atpid_control.campaign.plan import Campaign, CampaignError
from atpid_control.runs.run import Run, open_run
from atpid_sim.contact.linear import damping_ratio_for
from atpid_sim.kernel_inputs import system_of
from atpid_sim.robust import restitution
from atpid_sim.scene import Scene
from atpid_sim.system import Array

#: From the half width of a 95 % interval to a standard deviation.
_NORMAL = 1.96
#: Points whose flights are fitted at most: each takes some ten seconds.
_CONTACTS = 8


@dataclass(frozen=True)
class StandModel:
    """What the bags of a campaign determine."""

    beam: BeamParameters
    restitution: float | None  # None: no point determines it
    restitution_std: float
    taken: tuple[str, ...]  # what was not measured but taken as known, and what was left out, a line each

    def scene(self, given: Scene) -> Scene:
        """Return the stand's scene with what was found, the grain's mass as it was."""
        beam = {"mass": self.beam.mass, "stiffness": self.beam.stiffness, "damping": self.beam.damping}
        fraction = given.grain_mass / (given.grain_mass + self.beam.mass)
        contact = given.to_mapping()["contact"]
        if self.restitution is not None:
            key = "restitution" if "restitution" in contact else "damping_ratio"
            value = self.restitution if key == "restitution" else _damping_ratio(given, self.restitution)
            contact = contact | {key: value}
        return given.with_(beam=beam, mass_fraction=fraction, contact=contact)

    @property
    def uncertainty(self) -> dict[str, float]:
        """Two standard deviations, relative, by the names of `atpid design --uncertainty`."""
        beam = self.beam
        frequency = 0.5 * math.hypot(beam.stiffness_std / beam.stiffness, beam.mass_std / beam.mass)
        found = {"mass": beam.mass_std / beam.mass, "frequency": frequency, "damping": beam.damping_std / beam.damping}
        if self.restitution is not None:
            found["restitution"] = self.restitution_std / self.restitution
        return {name: 2.0 * value for name, value in found.items()}


def _damping_ratio(scene: Scene, wanted: float) -> float:
    """Return the damping ratio with which the scene's law has a restitution [-]."""
    contact = scene.to_mapping()["contact"]
    if contact["law"] == "linear":
        return float(damping_ratio_for(wanted))
    low, high = 0.0, 20.0
    for _ in range(60):  # the restitution falls with the ratio
        middle = 0.5 * (low + high)
        above = restitution(scene.with_(contact=contact | {"damping_ratio": middle})) > wanted
        low, high = (middle, high) if above else (low, middle)
    return 0.5 * (low + high)


def model_of(campaign: Campaign, scene: Scene, folder: CampaignFolder, moving_mass: float | None = None) -> StandModel:
    """Return the model by the points that are done: the beam by closed ones, restitution by regular ones.

    Points with two grains determine the mass; with one grain the moving mass [kg] is taken as known, the scene's where
    none is given. Raises CampaignError where no point with a closed damper was measured.
    """
    records = [record for record in folder.records().values() if record["status"] == "measured"]
    closed = [record for record in records if record["wanted_ceiling"] == "closed"]
    if scene.drive == "force" or scene.modes is not None:
        raise CampaignError("a model is made of a structure of one mode whose support moves; use `atpid modes fit BAG`")
    if not closed:
        raise CampaignError(f"{folder.path}: no point with a closed damper is there, which shows the beam; measure one")
    grains = sorted({record["wanted_grain_mass"] for record in closed})
    fits = {mass: _joined([_beam(folder, record) for record in closed if record["wanted_grain_mass"] == mass])
            for mass in (grains[0], grains[-1])}  # fmt: skip
    taken: list[str] = []
    if len(fits) > 1 and moving_mass is None:
        beam = from_added_mass(fits[grains[0]], fits[grains[-1]], grains[-1] - grains[0], grains[0])
    else:
        mass = moving_mass or scene.beam.mass + grains[0]
        taken.append(f"the moving mass with a grain of {1e3 * grains[0]:.4g} g: {mass:.5g} kg")
        beam = from_known_mass(fits[grains[0]], mass, grain_mass=grains[0])
    opened = [record for record in records if record["regular"] and record["wanted_ceiling"] not in ("closed", "none")]
    chosen = [
        opened[place] for place in np.linspace(0, len(opened) - 1, min(_CONTACTS, len(opened))).round().astype(int)
    ]
    contacts = list(_contacts(campaign, folder, chosen, taken.append))
    if not contacts:
        taken.append(f"the restitution: {restitution(scene):.4g}, the scene's")
        return StandModel(beam, None, math.nan, tuple(taken))
    value, std = _mean([(one.restitution.value, (one.restitution.high - one.restitution.low) / (2.0 * _NORMAL))
                        for one in contacts])  # fmt: skip
    return StandModel(beam, value, std, tuple(taken))


def _part(folder: CampaignFolder, record: Record) -> tuple[Run, Signals]:
    """Return a point's bag, and its signals while it was measured."""
    run = open_run(folder.place(record["number"]) / "bag")
    return run, signals_of(run)[0].between(record["begin"], record["end"])


def _beam(folder: CampaignFolder, record: Record) -> BeamFit:
    """Return what a steady tone determines: with H = X / U, k/m + i w c/m = w^2 H / (H - 1).

    A fit of the motion itself, as `calibrate beam` makes, would take a tone for the beam's own free one.
    """
    signals, omega = _part(folder, record)[1], 2.0 * math.pi * record["excitation_frequency"]
    drive, answer = (_phasor(values, signals.rate, omega) for values in (signals.excitation, signals.response))
    ratio = answer[0] / drive[0]
    found = omega**2 * ratio / (ratio - 1.0)
    error = math.hypot(answer[1], abs(ratio) * drive[1]) / abs(drive[0]) * omega**2 / abs(ratio - 1.0) ** 2
    covariance = np.diag([error**2, (error / omega) ** 2])
    return BeamFit(found.real, found.imag / omega, covariance, answer[1], 0.0, abs(answer[0]), True,
                   len(signals.response), signals.origin)  # fmt: skip


def _phasor(values: Array, rate: float, omega: float) -> tuple[complex, float]:
    """Return the complex amplitude of a tone of `omega` [rad/s] in samples (n,), and the standard deviation of it."""
    turn = np.exp(1j * omega / rate * np.arange(len(values)))
    columns = np.stack([np.ones(len(values)), turn.real, turn.imag], axis=1)
    parts, left, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return complex(parts[1], -parts[2]), math.sqrt(2.0 * float(left[0])) / len(values)


def _contacts(
    campaign: Campaign, folder: CampaignFolder, records: Sequence[Record], left_out: Callable[[str], Any]
) -> Iterator[ContactFit]:  # fmt: skip
    for record in records:
        run, signals = _part(folder, record)
        if run.scene is None:
            continue
        system = system_of(run.scene)
        try:
            flights = flights_of(signals, system)
            yield fit_run(flights, clearance(run, flights, run.scene, campaign.height_std), system, campaign.height_std)
        except ContactError as error:
            left_out(f"point {record['number']} shows no restitution: {str(error).partition(':')[0]}")


def _joined(fits: Sequence[BeamFit]) -> BeamFit:
    """Return the mean of fits by their covariances, its own widened where they scatter by more."""
    weights = [np.linalg.inv(fit.covariance) for fit in fits]
    values = [np.array([fit.stiffness, fit.damping]) for fit in fits]
    covariance = np.linalg.inv(sum(weights))
    mean = covariance @ sum(weight @ value for weight, value in zip(weights, values, strict=True))
    off = sum(float((value - mean) @ weight @ (value - mean)) for weight, value in zip(weights, values, strict=True))
    wider = max(1.0, off / max(1, 2 * len(fits) - 2))
    first = fits[0]
    return BeamFit(float(mean[0]), float(mean[1]), covariance * wider, max(fit.residual for fit in fits), first.misfit,
                   first.amplitude, first.driven, sum(fit.samples for fit in fits), first.origin)  # fmt: skip


def _mean(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of (value, standard deviation) and its own, widened where they scatter by more."""
    middle, std = np.array(values).T
    weight = 1.0 / std**2
    mean = float(weight @ middle / weight.sum())
    wider = max(1.0, float(weight @ (middle - mean) ** 2) / max(1, len(middle) - 1))
    return mean, math.sqrt(wider / weight.sum())


def written(model: StandModel, scene: Scene, folder: Path) -> Path:
    """Write model.yaml into a folder: the stand's scene with what was found; return its path."""
    path, beam = folder / "model.yaml", model.beam
    lines = [
        f"# mass {beam.mass:.6g} ± {beam.mass_std:.2g} kg, stiffness {beam.stiffness:.6g} ± {beam.stiffness_std:.2g} "
        f"N/m, damping {beam.damping:.4g} ± {beam.damping_std:.2g} N s/m",
        *(
            []
            if model.restitution is None
            else [f"# restitution {model.restitution:.4f} ± {model.restitution_std:.2g}"]
        ),
        *(f"# taken as known, or left out: {line}" for line in model.taken),
    ]
    path.write_text("\n".join([*lines, model.scene(scene).to_yaml()]), encoding="utf-8")
    return path
