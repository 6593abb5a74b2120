# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The files of a bag: one, or several where the recorder has split it, as rosbag2 numbers them."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from atpid_common.files import Document, FileError, parse_yaml, read_text
from atpid_control.runs import metadata
from atpid_control.runs.errors import BagError

MAGIC = b"\x89MCAP0\r\n"
#: What a database begins with, and what rosbag2's ends with.
SQLITE, SQLITE_ENDING = b"SQLite format 3\0", ".db3"
#: Longest metadata.yaml [bytes]; one of 30 topics has 10 kB, each file of a split bag adds 0.2 kB.
_MOST_METADATA = 2_000_000
_NUMBER = re.compile(r"_(\d{1,9})\.(?:mcap|db3)$")


def find_parts(path: Path, *, damaged: bool = False) -> list[Path]:
    """Return the files of the bag `path` (its folder, or one file) in their order; raise BagError: no bag.

    Each begins as MCAP or sqlite3 does; where it may be `damaged`, one of them nearly.
    """
    try:
        found = path.exists()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BagError(f"{path}: cannot be opened ({reason}); give a bag's folder") from None
    if not found:
        raise BagError(f"{path}: no such bag; give a bag's folder, or that of the run with it")
    named = (sorted(path.glob(f"*{ending}"), key=_place) for ending in (".mcap", SQLITE_ENDING))
    files = [path] if path.is_file() else next(filter(None, named), [])
    if not files and (packed := sorted(path.glob("*.zstd"))):
        convert = f"`rosbags-convert --src {path} --dst NEW` writes a bag that is not"
        raise BagError(f"{packed[0]}: compressed as a file by rosbag2; {convert}")
    if not files:
        what = "not a bag, there is no .mcap or .db3 file in this folder"
        raise BagError(f"{path}: {what}; give a bag's folder, or that of the run with it")
    begins = {file: _begin(file) for file in files}
    for file, begin in begins.items():
        if not (begin in (MAGIC, SQLITE[: len(MAGIC)]) or (damaged and any(map(_nearly, begins.values())))):
            why = "it does not begin as a file of one does" if begin else "it is empty"
            raise BagError(f"{file}: not a bag ({why}); give a bag's folder, or that of the run with it")
    return files


def bag_in(path: Path) -> Path:
    """Return the bag in the folder of a run; of another path the path itself."""
    inside = path / "bag"
    return inside if inside.is_dir() and not any(path.glob("*.mcap")) else path


def _place(file: Path) -> tuple[int, str]:
    number = _NUMBER.search(file.name)
    return int(number[1]) if number else -1, file.name


def _begin(file: Path) -> bytes:
    """Return the first bytes of a file. Raises BagError."""
    try:
        if not file.is_file():  # opening a pipe would wait for ever
            raise BagError(f"{file}: not a file; take it out of the bag's folder")
        with file.open("rb") as stream:
            return stream.read(len(MAGIC))
    except OSError as error:
        raise BagError(f"{file}: cannot be read ({error.strerror}); give a bag that can") from None


def _nearly(begin: bytes) -> bool:
    """Whether at least half of the first bytes are those of an MCAP file."""
    return 2 * sum(one == other for one, other in zip(begin, MAGIC, strict=False)) >= len(MAGIC)


class Listed(NamedTuple):
    """What metadata.yaml lists."""

    files: set[str]
    counts: dict[str, int]  # messages by topic
    custom: object  # `custom_data`, which a recorder may fill


def read_metadata(folder: Path) -> Listed:
    """Return what metadata.yaml lists; raise BagError where it is missing or not what rosbag2 writes."""
    path = folder / metadata.FILE_NAME
    recover = f"`atpid bag recover {folder}` writes it anew"
    if not path.is_file():
        raise BagError(f"{folder}: {metadata.FILE_NAME} is missing, so the recording was not closed; {recover}")
    try:
        information: Document = parse_yaml(read_text(path, _MOST_METADATA))["rosbag2_bagfile_information"]
        files = {Path(str(name)).name for name in information["relative_file_paths"]}
        topics = information["topics_with_message_count"]
        counts = {str(entry["topic_metadata"]["name"]): int(entry["message_count"]) for entry in topics}
        return Listed(files, counts, information.get("custom_data"))
    except (FileError, LookupError, TypeError, ValueError, OverflowError):
        raise BagError(f"{path}: not what rosbag2 writes; {recover}") from None


def check_listed(folder: Path, files: Iterable[Path], listed: Listed) -> None:
    """Raise BagError unless metadata.yaml lists the files that are there: none missing, none of another recording."""
    there = {file.name for file in files}
    if missing := sorted(listed.files - there):
        what = "which metadata.yaml lists, is missing; put it back, or `atpid bag recover`"
        raise BagError(f"{folder}: {missing[0]}, {what}")
    if others := sorted(there - listed.files):
        raise BagError(f"{folder}: {others[0]} is not listed in metadata.yaml; take it out, or `atpid bag recover`")
