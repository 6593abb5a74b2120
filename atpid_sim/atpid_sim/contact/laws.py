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

from atpid_common.errors import AtpidError, one_line
from atpid_sim.installed_laws import GROUP, installed

_BUILT_IN = (
    "impact",
    "linear",
    "hertz",
    "lee_herrmann",
    "kuwabara_kono",
    "tsuji",
    "walton_braun",
)


def _load(name: str, module: str) -> ModuleType:
    """Return the module of an installed law; raise AtpidError where it cannot be loaded, or has not what is needed."""
    where = f"contact law {name} of {module}, an entry point of {GROUP}"
    try:
        law = import_module(module)
    except Exception as error:  # whatever the package's own code raises
        raise AtpidError(f"{where}: cannot be loaded: {type(error).__name__}: {one_line(str(error))}") from error
    needed = ("Spec", "force", "detachment_velocity", "energy", "restitution")
    missing = [needs for needs in needed if not hasattr(law, needs)]
    if missing or name in _BUILT_IN:
        raise AtpidError(f"{where}: {'lacks ' + ', '.join(missing) if missing else 'a built-in law has this name'}")
    return law


_INSTALLED = installed()
NAMES = (*_BUILT_IN, *_INSTALLED)
LAWS: tuple[ModuleType, ...] = (
    *(import_module(f"atpid_sim.contact.{name}") for name in _BUILT_IN),
    *(_load(name, module) for name, module in _INSTALLED.items()),
)
IMPACT = NAMES.index("impact")
#: By number: whether the force depends on the deepest overlap of the contact.
HYSTERETIC: tuple[bool, ...] = tuple(getattr(law, "HYSTERETIC", False) for law in LAWS)
