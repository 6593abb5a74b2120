# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contact laws side by side: one impact of each, and restitution against speed (docs/contact.md).

python -m studies figures contact --out docs/figures
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from atpid_common import output
from atpid_sim.contact import dispatch
from atpid_sim.figure_style import WIDTH, drawn
from atpid_sim.kernel_inputs import Contact, contact_of, restitution_of, system_of
from atpid_sim.scene import Scene, standard_bench
from atpid_sim.system import Array, reduced_mass

#: Approach speed at which all laws are made to agree [m/s].
SPEED = 1.0
#: Speeds of the table [m/s].
TABLE_SPEEDS = (0.01, 0.1, 1.0, 10.0)
_ELASTIC: dict[str, object] = {"young_modulus": 2.1e8, "poisson_ratio": 0.2}
_LABELS = {
    "impact": "impact (hard)",
    "linear": "linear",
    "hertz": "Hertz",
    "lee_herrmann": "Lee-Herrmann",
    "kuwabara_kono": "Kuwabara-Kono",
    "tsuji": "Tsuji, β = 1 (the thesis)",
    "walton_braun": "Walton-Braun",
}
#: Laws of the same constant restitution, and the marker of each.
_CONSTANT = {"impact": "o", "linear": "s", "tsuji": "D", "walton_braun": "^"}


class Impact(NamedTuple):
    """One impact: times [s], overlaps [m] and forces [N], (n,), until the force vanishes."""

    time: Array
    overlap: Array
    force: Array


def laws_that_agree() -> dict[str, Contact]:
    """Return one contact per law, all but Hertz with the thesis's restitution at SPEED."""
    scene = standard_bench()
    mass = reduced_mass(system_of(scene))
    target = restitution_of(contact_of(scene), SPEED, mass)
    stiffness = _stiffness_of_equal_depth(scene, mass)
    specs: dict[str, dict[str, object]] = {
        "impact": {"restitution": target},
        "linear": {"stiffness": stiffness, "restitution": target},
        "hertz": _ELASTIC,
        "tsuji": {"damping_ratio": 1.0, **_ELASTIC},
        "walton_braun": {"stiffness": stiffness, "restitution": target},
    }
    for law in ("lee_herrmann", "kuwabara_kono"):
        specs[law] = {"damping": _damping_for(scene, law, target, mass), **_ELASTIC}
    return {law: contact_of(scene.with_(contact={"law": law, **specs[law]})) for law in _LABELS}


def impact_of(contact: Contact, mass: float, speed: float) -> Impact:
    """Return one impact of the reduced `mass` [kg] at `speed` [m/s], for a law that has a force."""
    law, p = contact
    scale = (mass / p[0]) ** 0.4 * speed**-0.2 if p[0] > 1e6 else (mass / p[0]) ** 0.5

    def course(memory: float, start: tuple[float, float], first: float) -> tuple[Array, Array, Array]:
        """Follow the contact until it turns (memory 0) or the force vanishes, in s with t = scale s^4."""

        def rate(s: float, y: Array) -> list[float]:
            stretch = 4.0 * s**3 * scale
            return [y[1] * stretch, -dispatch.force(law, y[0], y[1], memory, p) / mass * stretch]

        def turned(_: float, y: Array) -> float:
            return float(y[1])

        def detached(_: float, y: Array) -> float:
            return float(dispatch.force(law, y[0], y[1], memory, p)) if memory else 1.0

        for event in (turned, detached):
            event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
        events = [detached] if memory else [turned]
        solved = solve_ivp(rate, (first, 10.0), start, rtol=1e-9, atol=1e-13, events=events, max_step=0.01)
        return solved.t, solved.y[0], solved.y[1]

    s1, x1, v1 = course(0.0, (0.0, speed), 0.0)
    s2, x2, v2 = course(float(x1[-1]), (float(x1[-1]), -1e-12), float(s1[-1]))
    s, x, v = np.concatenate([s1, s2]), np.concatenate([x1, x2]), np.concatenate([v1, v2])
    memory = np.concatenate([np.zeros_like(s1), np.full_like(s2, x1[-1])])
    forces = [dispatch.force(law, *values, p) for values in zip(x, v, memory, strict=True)]
    return Impact(scale * s**4, x, np.maximum(forces, 0.0))


def table() -> str:
    """Return restitution against speed as a Markdown table."""
    mass = reduced_mass(system_of(standard_bench()))
    lines = [
        "| law | " + " | ".join(f"{speed:g} m/s" for speed in TABLE_SPEEDS) + " |",
        "|---|" + "---|" * len(TABLE_SPEEDS),
    ]
    for name, contact in laws_that_agree().items():
        values = (f"{restitution_of(contact, speed, mass):.4f}" for speed in TABLE_SPEEDS)
        lines.append(f"| `{name}` | " + " | ".join(values) + " |")
    return "\n".join(lines)


def draw(out: Path) -> list[Path]:
    """Draw the figure into the folder `out`; return the files written."""
    mass = reduced_mass(system_of(standard_bench()))
    speeds = np.geomspace(1e-3, 20.0, 120)
    file = output.folder(out) / "contact_laws.png"
    with drawn(file, nrows=1, ncols=2, figsize=(WIDTH, 4.6)) as (_, (left, right)):
        for index, (name, contact) in enumerate(laws_that_agree().items()):
            style: dict[str, Any] = {"color": f"C{index}", "label": _LABELS[name]}
            style["linewidth"] = 2.4 if name == "tsuji" else 1.4
            curve = [restitution_of(contact, speed, mass) for speed in speeds]
            right.semilogx(speeds, curve, **style, **_marked(name))
            if name != "impact":
                impact = impact_of(contact, mass, SPEED)
                left.plot(1e6 * impact.overlap, impact.force, **style)
        title = f"One impact at {SPEED:g} m/s"
        left.set(xlabel="overlap [µm]", ylabel="contact force [N]", title=title)
        title = "Restitution against speed"
        right.set(xlabel="approach speed [m/s]", ylabel="restitution [-]", title=title, ylim=(0.0, 1.05))
        right.legend(loc="center left", bbox_to_anchor=(0.0, 0.7))
    return [file]


def _marked(name: str) -> dict[str, Any]:
    """Return markers in turn for the laws whose restitution is the same at every speed: their curves coincide."""
    if name not in _CONSTANT:
        return {}
    place = list(_CONSTANT).index(name)
    return {"marker": _CONSTANT[name], "markersize": 7, "markevery": (6 * place, 6 * len(_CONSTANT))}


def _damping_for(scene: Scene, law: str, restitution: float, mass: float) -> float:
    """Return the damping with which a law has this restitution at SPEED."""

    def excess(log_damping: float) -> float:
        spec = {"law": law, "damping": float(10.0**log_damping), **_ELASTIC}
        return restitution_of(contact_of(scene.with_(contact=spec)), SPEED, mass) - restitution

    return float(10.0 ** brentq(excess, -1.0, 6.0, xtol=1e-12))


def _stiffness_of_equal_depth(scene: Scene, mass: float) -> float:
    """Return the stiffness with which an elastic linear contact goes as deep at SPEED as Hertz's."""
    k = contact_of(scene.with_(contact={"law": "hertz", **_ELASTIC})).parameters[0]
    depth = (1.25 * mass * SPEED**2 / k) ** 0.4
    return float(mass * SPEED**2 / depth**2)
