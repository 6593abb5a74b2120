# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Modes from data sets 55 of a universal file, real or nearly so, read by pyuff; shapes in the global axes.

A set has no participation factor. It follows from masses at the nodes, the smallest with which the shapes are
orthogonal and have their modal masses.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_common.files import Document, check
from atpid_lab.modes.structure import AT_REST, Mode, ModesError, Structure

_LARGEST = 100_000_000  # [bytes]
_NORMAL, _COMPLEX, _MODES, _UNITS = 2, 3, 55, 164
#: Largest part out of phase that is taken for none, of a shape or a modal mass, and of its product with another [-].
_SLIGHT = 0.1
#: Modes from which masses at the nodes are found, and singular values that count: shapes have six digits.
_MOST_MODES, _LEAST = 20, 1e-4


class Place(NamedTuple):
    """A direction at a node."""

    node: int
    axis: int  # 0 to 2: x to z
    sign: float  # -1.0 or 1.0


class _Shape(NamedTuple):
    frequency: float  # [Hz]
    mass: float  # modal mass [kg]
    damping_ratio: float
    nodes: NDArray[np.int64]  # (nodes,)
    values: NDArray[np.float64]  # (nodes, 3)

    def at(self, place: Place) -> float:
        found = np.flatnonzero(self.nodes == place.node)
        if len(found) == 0:
            some = ", ".join(map(str, self.nodes[:5]))
            raise ModesError(f"given node {place.node}; allowed: one of the file's {len(self.nodes)}: {some}, ...")
        return float(place.sign * self.values[found[0], place.axis])


def modes_of(path: Path, container: Place, force: Place | None = None) -> Structure:
    """Return the modes of a file that move the container. Raises ModesError, FileError.

    They are driven by the base, which moves in the container's direction, or by a force.
    """
    shapes = sorted(_shapes(path), key=lambda shape: shape.frequency)
    if any(not np.array_equal(shape.nodes, shapes[0].nodes) for shape in shapes):
        raise ModesError(f"{path}: its modes have different nodes; give a file whose modes have the same")
    masses = np.full(len(shapes[0].nodes), math.nan) if force else _masses(path, shapes[:_MOST_MODES])
    modes, still = [], []
    for shape in shapes:
        here, there = shape.at(container), shape.at(force or container)
        if abs(here) < AT_REST * np.abs(shape.values).max():
            still.append(f"{shape.frequency:.4g} Hz")
            continue
        base = here * float(container.sign * (shape.values[:, container.axis] @ masses) / shape.mass)
        modes.append(Mode(shape.frequency, shape.mass / here**2, shape.damping_ratio, base, there / here, math.nan))
    if not modes:
        raise ModesError(f"{path}: all its modes are at rest at the container; give another --container")
    notes = [] if force else [f"masses at the nodes, found from the shapes: {masses.sum():.4g} kg together"]
    notes += [f"left out, at rest at the container: modes at {', '.join(still)}"] if still else []
    return Structure(tuple(modes), sum(1.0 / mode.stiffness for mode in modes), tuple(notes))


def _masses(path: Path, shapes: list[_Shape]) -> NDArray[np.float64]:
    """Return masses at the nodes (nodes,) [kg]. Raises ModesError: there are none that fit."""
    values = np.array([shape.values / math.sqrt(shape.mass) for shape in shapes])
    first, second = np.triu_indices(len(shapes))
    products, wanted = np.einsum("pnd,pnd->pn", values[first], values[second]), (first == second).astype(float)
    masses: NDArray[np.float64] = np.linalg.lstsq(products, wanted, rcond=_LEAST)[0]
    if (off := np.abs(products @ masses - wanted).max()) > _SLIGHT:
        raise ModesError(
            f"{path}: no masses at its nodes make the shapes orthogonal (off by {100 * off:.0f} %), so how the base "
            "drives them is not known; give a file with more nodes, or --force-at"
        )
    return masses


def _shapes(path: Path) -> list[_Shape]:
    check(path, _LARGEST)
    import pyuff  # here, so that other commands start without it

    try:
        file = pyuff.UFF(str(path))
        kinds = np.asarray(file.get_set_types(), int)
        sets, units = ([file.read_sets(int(n)) for n in np.flatnonzero(kinds == kind)] for kind in (_MODES, _UNITS))
        scale = float(units[0]["length"] / units[0]["force"]) if units else 1.0  # of the file's unit of mass [kg]
    except Exception as error:  # noqa: BLE001 - pyuff raises no narrower one
        raise ModesError(f"{path}: is no universal file with readable data sets 55 and 164 ({error})") from None
    normal = [one for one in sets if one["analysis_type"] == _NORMAL]
    modes = normal + [one for one in sets if one["analysis_type"] == _COMPLEX and one["eig"].imag > 0.0]
    if not modes:
        raise ModesError(f"{path}: {len(sets)} data sets 55, none of them a mode (analysis type 2 or 3)")
    try:
        with np.errstate(over="raise", invalid="raise"):
            return [_shape(f"{path}: mode {one['mode_n']}", one, scale) for one in modes]
    except ArithmeticError as error:
        raise ModesError(f"{path}: its numbers are no modes ({error})") from None


def _shape(name: str, one: Document, scale: float) -> _Shape:
    given = np.stack([one["r1"], one["r2"], one["r3"]], axis=1).astype(complex)
    turn = np.exp(0.5j * np.angle(np.sum(given**2)))  # the phase at which a shape is most nearly real
    values = given / turn
    if one["analysis_type"] == _COMPLEX:
        frequency, ratio = abs(one["eig"]) / (2.0 * math.pi), -one["eig"].real / abs(one["eig"])
        mass = one["modal_a"] / turn**2 / (2j * one["eig"].imag) * scale  # modal A of a real shape is 2 i m omega_d
    else:
        frequency, ratio = one["freq"], one["modal_damp_vis"] or 0.5 * one["modal_damp_his"]
        mass = complex(one["modal_m"]) * scale
    largest = float(np.abs(values).max())
    if not all(1e-30 < number < 1e30 for number in (frequency, abs(mass), largest)) or not math.isfinite(ratio):
        shown = f"{frequency:g} Hz, modal mass {abs(mass):g} kg, largest shape {largest:g}, damping {ratio:g}"
        raise ModesError(f"{name}: {shown}; allowed: all finite, the first three above 0")
    apart = max(float(np.linalg.norm(values.imag) / np.linalg.norm(values)), abs(mass.imag / mass))
    if apart > _SLIGHT or mass.real < 0.0:
        allowed = f"at most {100 * _SLIGHT:.0f} %, since a scene's modes are real"
        raise ModesError(f"{name}: complex, {100 * apart:.0f} % of it out of phase; allowed: {allowed}")
    return _Shape(float(frequency), mass.real, float(ratio), one["node_nums"].astype(np.int64), values.real)
