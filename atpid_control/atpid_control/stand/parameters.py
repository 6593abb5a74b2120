# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files: read for the nodes they are for, combined with what a run sets itself, and written for it."""

import re
from collections.abc import Collection, Mapping
from pathlib import Path

import yaml

from atpid_common import files
from atpid_common.errors import InputError, NumericalError, did_you_mean
from atpid_sim.scene.yaml12 import read_yaml


class BenchError(InputError):
    """The bench cannot run as asked; the message is one line: why, and what to do."""


class NodeDiedError(BenchError):
    """A node ended before the run did."""


class PlantFailedError(NumericalError):
    """The simulated plant failed numerically; the message is the plant's own."""


Parameters = dict[str, files.Document]

#: Largest parameter file that is read [bytes]; ours have some thousand.
_LARGEST = 1_000_000
_BLOCK = "ros__parameters"


def parameters_in(document: files.Document, name: str) -> files.Document:
    """Return the parameters of node `name` in a ROS parameter file already read, whatever its namespace."""
    found: files.Document = {}
    for key, block in document.items():
        if key.rsplit("/", 1)[-1] in (name, "**"):
            found.update(block[_BLOCK])
    return found


def read_parameters(path: Path, names: Collection[str], namespace: str = "") -> Parameters:
    """Return the values that a ROS parameter file has for the nodes `names` in `namespace`, as rcl matches them.

    Raises FileError, SceneError or BenchError, in one line: no such file, no parameter file, or values for none of
    the nodes.
    """
    document = read_yaml(files.read_text(path, _LARGEST), str(path))
    found: Parameters = {}
    for key, values in _blocks(path, document or {}, ""):
        pattern = "".join(_PATTERN.get(token, f"/{re.escape(token)}") for token in key.split("/") if token)
        matching = [name for name in names if re.fullmatch(pattern, f"{namespace}/{name}")]
        if not matching:
            hint = did_you_mean(key.rpartition("/")[2], names)
            where = f" in {namespace}" if namespace else ""
            raise BenchError(f"{path}: values for {key}: no node{where} has this name{hint}; write /**/NODE")
        for name in matching:
            found.setdefault(name, {}).update(values)
    return found


#: Regular expressions of what stands for any namespace, and for any one name.
_PATTERN = {"**": "(?:/[^/]+)*", "*": "/[^/]+"}


def _blocks(path: Path, document: object, key: str) -> list[tuple[str, files.Document]]:
    """Return (name, values) of each block of a parameter file; namespaces may be blocks of their own."""
    if not isinstance(document, Mapping):
        raise BenchError(f"{path}: {key or 'the file'}: is no block; needed: NODE: {_BLOCK}: NAME: VALUE")
    found = []
    for name, block in document.items():
        if name == _BLOCK and isinstance(block, Mapping):
            found.append((key, _flat(block)))
        else:
            found += _blocks(path, block, f"{key}/{str(name).strip('/')}")
    return found


def _flat(values: Mapping[str, object], prefix: str = "") -> files.Document:
    """Return values by their full names: `a: {b: 1}` is parameter a.b."""
    found: files.Document = {}
    for name, value in values.items():
        found |= _flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return found


def combined(usual: Parameters, own: Parameters, given: Parameters) -> Parameters:
    """Return what each node of a run starts with.

    usual: of the package's files; own: what the run itself sets; given: of the user's file, over the usual ones.
    Raises BenchError where a value given is one that the run sets otherwise.
    """
    for node, values in given.items():
        for name, value in values.items():
            if (sets := own.get(node, {}).get(name, value)) != value:
                where = f"--params-file: {name} of {node}: given {value!r}"
                raise BenchError(f"{where}; this run sets it to {sets!r}: take it out of the file")
    return {node: values | given.get(node, {}) | own.get(node, {}) for node, values in usual.items()}


class _WithoutAnchors(yaml.SafeDumper):
    """Writes a list again where it stands twice: rcl reads no anchors."""

    def ignore_aliases(self, _data: object) -> bool:
        return True


def write_parameters(parameters: Parameters, path: Path) -> None:
    """Write the parameter file of the run: read by the nodes, and the record of how they were started."""
    document = {f"/**/{name}": {_BLOCK: values} for name, values in parameters.items()}
    path.write_text(yaml.dump(document, Dumper=_WithoutAnchors, sort_keys=False), encoding="utf-8")
