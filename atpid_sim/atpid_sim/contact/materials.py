# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Materials of grain and walls by name: elasticity and density at room temperature.

Sources: C, W. D. Callister and D. G. Rethwisch, Materials Science and Engineering, tables of appendix B; A, M. F.
Ashby, Materials Selection in Mechanical Design, appendix of material properties, the middle of its range. A polymer's
or a rubber's modulus depends on grade, temperature and rate by a factor of two: measure it where the forces matter.
Restitution is no property of one material: it depends on both, on speed and on size, and is measured
(`atpid calibrate contact`, docs/contact.md).
"""

from typing import NamedTuple


class Material(NamedTuple):
    """Elasticity and density of a solid."""

    young_modulus: float  # [Pa]
    poisson_ratio: float  # [-]
    density: float  # [kg/m^3]
    source: str


MATERIALS = {
    "steel": Material(2.07e11, 0.30, 7850.0, "C, plain carbon steel"),
    "stainless_steel": Material(1.93e11, 0.30, 8000.0, "C, type 304"),
    "brass": Material(1.10e11, 0.35, 8530.0, "C, cartridge brass C26000"),
    "aluminium": Material(6.9e10, 0.33, 2700.0, "C, alloy 6061"),
    "tungsten": Material(4.00e11, 0.28, 19300.0, "C, commercial"),
    "glass": Material(6.9e10, 0.23, 2500.0, "C, soda-lime"),
    "alumina": Material(3.80e11, 0.22, 3980.0, "C, 99.9 % dense"),
    "pom": Material(3.0e9, 0.35, 1410.0, "A, polyoxymethylene"),
    "nylon": Material(2.7e9, 0.39, 1140.0, "C, nylon 6,6"),
    "ptfe": Material(4.7e8, 0.46, 2170.0, "C, polytetrafluoroethylene"),
    "rubber": Material(2.0e6, 0.499, 925.0, "A, natural rubber"),
    "silicone": Material(1.0e7, 0.48, 1500.0, "A, silicone elastomers"),
}
#: The thesis's contact (Table 3.1): of no material that it names; a thousandth of steel's modulus.
THESIS_MODULUS = 2.1e8
#: Densities this close are taken for the same material, and moduli this many times apart for others [-].
_SAME_DENSITY, _OTHER_MODULUS = 0.03, 2.5


def mismatch(density: float, young_modulus: float) -> str:
    """Return a line where the density [kg/m^3] is a material's and the Young's modulus [Pa] another's; else ""."""
    like = [name for name, one in MATERIALS.items() if abs(density / one.density - 1.0) < _SAME_DENSITY]
    moduli = [MATERIALS[name].young_modulus for name in like]
    if not like or any(1.0 / _OTHER_MODULUS < young_modulus / own < _OTHER_MODULUS for own in moduli):
        return ""
    whose = "the thesis's contact, not that of " if young_modulus == THESIS_MODULUS else "not that of "
    force = (moduli[0] / young_modulus) ** 0.4
    return (
        f"{young_modulus:g} Pa is {whose}{like[0]} ({moduli[0]:g} Pa), whose density the grain has: contacts of "
        f"{like[0]} have forces about {force:.2g} times as large"
    )
