# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How every kernel is compiled and kept: with its own error model, by the contents of all that is compiled into it."""

import ast
import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from numba.core.dispatcher import Dispatcher

import atpid_sim.contact
import atpid_sim.engine
import studies.baselines
from atpid_sim.contact import dispatch, law_kernel
from atpid_sim.kernel import KERNEL_SOURCES
from studies.baselines.rhs import slope

PACKAGES = [atpid_sim.engine, atpid_sim.contact, studies.baselines]
ROOT = Path(str(atpid_sim.engine.__file__)).parents[2]


def modules_of(package: ModuleType) -> list[ModuleType]:
    return [
        importlib.import_module(f"{package.__name__}.{found.name}") for found in pkgutil.iter_modules(package.__path__)
    ]


def kernels_of(module: ModuleType) -> set[Dispatcher]:
    named = (value.compiled if isinstance(value, law_kernel.kernel) else value for value in vars(module).values())
    return {kernel for kernel in named if isinstance(kernel, Dispatcher)}


def sources_imported_by(module: ModuleType) -> Iterator[Path]:
    """Files of the project from which a module takes names."""
    for node in ast.walk(ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("atpid_"):
            place = ROOT.joinpath(*node.module.split("."))
            taken = [place / f"{alias.name}.py" for alias in node.names] if place.is_dir() else [place]
            yield from (path.with_suffix(".py") for path in taken)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.__name__)
def test_every_kernel_names_its_error_model(package: ModuleType) -> None:
    kernels = set().union(*map(kernels_of, modules_of(package)))
    assert len(kernels) > 5
    for kernel in kernels:
        options = kernel.targetoptions
        assert options.get("error_model") == "numpy", kernel
        assert bool(options.get("nogil")) == (kernel is not slope), kernel


def test_all_kernels_of_a_package_are_kept_in_one_folder() -> None:
    kernels = set().union(*(kernels_of(module) for package in PACKAGES for module in modules_of(package)))
    # parts of the dispatch are kept with the kernels they are compiled into
    parts = {part for name, part in vars(dispatch).items() if isinstance(part, Dispatcher) and name.startswith("_")}
    folders = {Path(str(kernel.stats.cache_path)).parent.name for kernel in kernels if kernel not in parts}
    assert sorted(folder.partition("-")[0] for folder in folders) == ["baselines", "kernels"]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda p: p.__name__)
def test_what_kernels_import_counts_for_their_cache(package: ModuleType) -> None:
    imported = {
        path
        for module in modules_of(package)
        if any(kernel.__module__ == module.__name__ for kernel in kernels_of(module))
        for path in sources_imported_by(module)
        if path.exists()
    }
    assert len(imported) > 3
    assert imported <= KERNEL_SOURCES
