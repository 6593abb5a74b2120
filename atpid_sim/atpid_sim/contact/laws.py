# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contact laws: one module each, of this folder or an installed package. A law's number is its place in the list.

Who adds a law writes a module with `Spec`, a `ContactSpec` whose `law` is the law's name, and the kernels `force`,
`detachment_velocity`, `energy` and `restitution` (`dispatch.py` has their arguments and results), of a hysteretic law
`HYSTERETIC = True` and `residual_overlap` too, and names the module in the entry-point group `atpid.contact_laws`.
Scenes, integrator and maps take the law from there; `atpid_sim.contact_contract` has the tests that every law passes
(docs/extend.md).
"""

from importlib import import_module
from types import ModuleType

from atpid_common.entry_points import CONTACT_LAWS, installed, loaded

_BUILT_IN = (
    "impact",
    "linear",
    "hertz",
    "lee_herrmann",
    "kuwabara_kono",
    "tsuji",
    "walton_braun",
)


_NEEDED = ("Spec", "force", "detachment_velocity", "energy", "restitution")
_INSTALLED = installed(CONTACT_LAWS, _BUILT_IN)
NAMES = (*_BUILT_IN, *_INSTALLED)
LAWS: tuple[ModuleType, ...] = (
    *(import_module(f"atpid_sim.contact.{name}") for name in _BUILT_IN),
    *(loaded(point, _NEEDED) for point in _INSTALLED.values()),
)
IMPACT = NAMES.index("impact")
#: By number: whether the force depends on the deepest overlap of the contact.
HYSTERETIC: tuple[bool, ...] = tuple(getattr(law, "HYSTERETIC", False) for law in LAWS)
