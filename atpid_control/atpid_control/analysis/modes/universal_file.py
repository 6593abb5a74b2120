# SPDX-License-Identifier: Apache-2.0
"""Modes from a universal file: data sets 55, normal modes and complex ones that are nearly real, read by pyuff.

Shapes are taken for those of the global axes. A set has no participation factor: masses at the nodes are found with
which the shapes are orthogonal and have their modal masses (the smallest that do), and give it.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from atpid_common.files import check
from atpid_control.analysis.modes.structure import AT_REST, Mode, ModesError, Structure

_LARGEST = 100_000_000  # [bytes]
_NORMAL, _COMPLEX, _MODES, _UNITS = 2, 3, 55, 164
#: Largest imaginary part of a shape or a modal mass that is taken for real, of the whole [-].
_REAL = 0.1
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
        """Return the shape at a place. Raises ModesError: there is no such node."""
        (found,) = np.nonzero(self.nodes == place.node)
        if len(found) == 0:
            some = ", ".join(map(str, self.nodes[:5]))
            raise ModesError(f"given node {place.node}; allowed: one of the file's {len(self.nodes)}: {some}, ...")
        return float(place.sign * self.values[found[0], place.axis])


def modes_of(path: Path, container: Place, base: Place, force: Place | None = None) -> Structure:
    """Return the modes of a file that move the container; base: of whose node only the direction counts.

    Raises ModesError, FileError.
    """
    shapes = sorted(_shapes(path), key=lambda shape: shape.frequency)
    if any(not np.array_equal(shape.nodes, shapes[0].nodes) for shape in shapes):
        raise ModesError(f"{path}: its modes have different nodes; give a file whose modes have the same")
    factors, notes = ([math.nan] * len(shapes), []) if force else _participation(path, shapes, base)
    modes, still = [], []
    for shape, factor in zip(shapes, factors, strict=True):
        here = shape.at(container)
        if abs(here) < AT_REST * np.abs(shape.values).max():
            still.append(f"{shape.frequency:.4g} Hz")
            continue
        there = shape.at(force) / here if force else 1.0
        modes.append(Mode(shape.frequency, shape.mass / here**2, shape.damping_ratio, factor * here, there, math.nan))
    if not modes:
        raise ModesError(f"{path}: all its modes are at rest at the container; give another --container")
    notes += [f"left out, at rest at the container: modes at {', '.join(still)}"] if still else []
    return Structure(tuple(modes), sum(1.0 / mode.stiffness for mode in modes), tuple(notes))


def _participation(path: Path, shapes: list[_Shape], base: Place) -> tuple[list[float], list[str]]:
    """Return the participation factor of each mode, and what they rest on."""
    used = shapes[:_MOST_MODES]
    values = np.array([shape.values / math.sqrt(shape.mass) for shape in used])
    first, second = np.triu_indices(len(used))
    products = np.einsum("pnd,pnd->pn", values[first], values[second])
    wanted = (first == second).astype(float)
    masses = np.linalg.lstsq(products, wanted, rcond=_LEAST)[0]
    open_by = float(np.linalg.norm(products @ masses - wanted) / np.linalg.norm(wanted))
    if open_by > _REAL:
        raise ModesError(
            f"{path}: no masses at its nodes make the shapes orthogonal (off by {100 * open_by:.0f} %), so the base's "
            "share in the modes is not known; give more nodes, or --force-at"
        )
    factors = [float(base.sign * (shape.values[:, base.axis] @ masses) / shape.mass) for shape in shapes]
    return factors, [f"masses at the nodes, found from {len(used)} modes, are {masses.sum():.4g} kg together"]


def _shapes(path: Path) -> list[_Shape]:
    check(path, _LARGEST)
    import pyuff  # here, so that modes of dimensions need no reader

    try:
        file = pyuff.UFF(str(path))
        kinds = np.asarray(file.get_set_types(), int)
        sets, units = ([file.read_sets(int(n)) for n in np.flatnonzero(kinds == kind)] for kind in (_MODES, _UNITS))
        scale = float(units[0]["length"] / units[0]["force"]) if units else 1.0
    except Exception as error:  # noqa: BLE001 - pyuff raises no narrower one
        raise ModesError(f"{path}: is no universal file with readable data sets 55 and 164 ({error})") from None
    modes = [one for one in sets if one["analysis_type"] in (_NORMAL, _COMPLEX)]
    modes = [one for one in modes if one["analysis_type"] == _NORMAL or one["eig"].imag > 0.0]
    if not modes:
        raise ModesError(
            f"{path}: {len(sets)} data sets 55, none a mode; needed: analysis type 2, or 3 with eigenvalues"
        )
    return [_shape(f"{path}: mode {one['mode_n']}", one, scale) for one in modes]


def _shape(name: str, one: dict[str, Any], scale: float) -> _Shape:
    """Return a data set's mode; scale: of its unit of mass [kg]. Raises ModesError."""
    given = np.stack([one["r1"], one["r2"], one["r3"]], axis=1).astype(complex)
    turn = np.exp(0.5j * np.angle(np.sum(given**2)))  # the phase at which a shape is most nearly real
    values, mass = given / turn, complex(one.get("modal_m", 0.0))
    if one["analysis_type"] == _COMPLEX:
        root = one["eig"]
        frequency, ratio = abs(root) / (2.0 * math.pi), -root.real / abs(root)
        mass = one["modal_a"] / turn**2 / (2j * root.imag)  # modal A of a real shape: 2 i m omega_d
    else:
        frequency, ratio = one["freq"], one["modal_damp_vis"] or 0.5 * one["modal_damp_his"]
    if not (np.isfinite(values).all() and np.isfinite([frequency, ratio, mass]).all() and values.any()):
        raise ModesError(f"{name}: its numbers are not all finite, or its shape is 0")
    if not frequency > 0.0:
        raise ModesError(f"{name}: {frequency:g} Hz; allowed: above 0, of a structure that is supported")
    if mass == 0.0:
        raise ModesError(f"{name}: the file has no modal mass; write it with shapes scaled to it")
    apart = max(float(np.linalg.norm(values.imag) / np.linalg.norm(values)), abs(mass.imag / mass))
    if apart > _REAL or mass.real < 0.0:
        raise ModesError(
            f"{name}: complex, {100 * apart:.0f} % of it out of phase; allowed: at most {100 * _REAL:.0f} %, since a "
            "scene's modes are real"
        )
    return _Shape(float(frequency), mass.real * scale, float(ratio), one["node_nums"].astype(np.int64), values.real)
