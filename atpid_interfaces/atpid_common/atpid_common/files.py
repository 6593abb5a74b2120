# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that a user gives: regular ones only, and none larger than stated, before memory is taken for them."""

import stat
import zipfile
import zlib
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import yaml
from numpy.typing import NDArray

from atpid_common.errors import InputError

#: What a YAML or JSON file holds by name, as its parser returns it: each reader checks the values that it takes.
Document: TypeAlias = dict[str, Any]
#: What zipfile and numpy raise for an archive that is torn, empty, locked, of Python objects, or something else.
_OF_NUMPY = (EOFError, ValueError, KeyError, TypeError, RuntimeError, MemoryError, OverflowError, SyntaxError)
_UNREADABLE = (*_OF_NUMPY, zipfile.BadZipFile, zlib.error)
#: What PyYAML raises for a text that is no YAML, or whose tags promise another kind of value: `!!bool maybe`.
_NOT_YAML = (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError)


class FileError(InputError):
    """A file that cannot be read; one line: which, why, what to do."""


def check(path: Path, most: int) -> None:
    """Raise FileError unless `path` is a regular file of at most `most` bytes: a pipe or a device may never end."""
    try:
        about = path.stat()
    except FileNotFoundError:
        raise FileError(f"{path}: no such file") from None
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}; give the path of a file") from None
    except ValueError as error:  # a NUL in the path
        raise FileError(f"{str(path)!r}: is no path ({error})") from None
    if not stat.S_ISREG(about.st_mode):
        kind = "a folder" if stat.S_ISDIR(about.st_mode) else "a pipe or a device"
        raise FileError(f"{path}: is {kind}; give the path of a file")
    if about.st_size > most:
        raise FileError(f"{path}: {about.st_size / 1e6:.1f} MB; allowed: at most {most / 1e6:g} MB")


def read_text(path: Path, most: int) -> str:
    """Return the text of a file in UTF-8 of at most `most` bytes. Raises FileError."""
    check(path, most)
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}; give the path of a file") from None
    except UnicodeDecodeError:
        raise FileError(f"{path}: is not text in UTF-8") from None


def parse_yaml(text: str | bytes) -> Any:
    """Return what a YAML text holds, plain types only. Raises FileError with the reason."""
    try:
        return yaml.safe_load(text)
    except _NOT_YAML as error:
        raise FileError(f"not YAML: {next(iter(str(error).splitlines()), type(error).__name__)}") from None


def read_arrays(path: Path, most: int) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of an NPZ archive by name, at most `most` bytes unpacked, never Python objects.

    Raises FileError.
    """
    check(path, most)
    try:
        with path.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > most:
                raise FileError(f"{path}: {size / 1e6:.1f} MB unpacked; allowed: at most {most / 1e6:g} MB")
            return {member.filename.removesuffix(".npy"): _array(archive, member) for member in archive.infolist()}
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}; give the path of a file") from None
    except _UNREADABLE as error:
        text = " ".join(str(error).split())[:80] or type(error).__name__
        raise FileError(f"{path}: is no NPZ archive of arrays ({text})") from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[np.generic]:
    """Return one array whose header states no more than the member holds: numpy takes the memory it states."""
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    stated = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if dtype.hasobject or stated > member.file_size:
        reason = "Python objects" if dtype.hasobject else f"{stated} bytes stated, {member.file_size} there"
        raise ValueError(f"{member.filename}: {reason}")
    with archive.open(member) as stream:
        array: NDArray[np.generic] = np.lib.format.read_array(stream, allow_pickle=False)
        return array
