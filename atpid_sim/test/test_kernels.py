# SPDX-License-Identifier: Apache-2.0
"""How every kernel is compiled: a function without an error model takes it from whoever compiles it first."""

import importlib
import pkgutil

import pytest
from numba.core.dispatcher import Dispatcher

import atpid_sim.baselines
import atpid_sim.contact
import atpid_sim.engine


@pytest.mark.parametrize(
    "package", [atpid_sim.engine, atpid_sim.contact, atpid_sim.baselines], ids=lambda p: p.__name__
)
def test_every_kernel_names_its_error_model(package):
    modules = [
        importlib.import_module(f"{package.__name__}.{found.name}") for found in pkgutil.iter_modules(package.__path__)
    ]
    kernels = {kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)}
    assert len(kernels) > 5
    for kernel in kernels:
        options = kernel.targetoptions
        assert (options.get("error_model"), options.get("nogil")) == ("numpy", True), kernel
