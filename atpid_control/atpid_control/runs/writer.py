# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Writes a bag that `ros2 bag` reads, MCAP files and metadata.yaml, and flushes it to the disk (docs/recording.md)."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import mkstemp
from typing import IO, cast

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from atpid_control.runs import metadata
from atpid_control.runs.decode import message_type
from atpid_control.runs.errors import BagError, in_words
from atpid_control.runs.metadata import RESULT, RUN, BagSummary, Qos, RunInfo, TopicSummary


class Flush:
    """One thread that flushes files one after the other; it is there from the first flush on.

    A killed process loses nothing that it handed to the kernel: only a power cut does, and only for it is flushed.
    """

    def __init__(self) -> None:
        self._thread: ThreadPoolExecutor | None = None
        self._last: Future[None] | None = None
        self._begun = self._took = 0.0  # [s]

    @property
    def seconds(self) -> float:
        """How long the flush under way has taken so far, or the last one took [s]."""
        if self._last is None or self._last.done():
            return self._took
        return time.monotonic() - self._begun

    def start(self, act: Callable[[], None]) -> None:
        """Let `act` flush, unless the flush before has not ended. Raises OSError of that before."""
        if self._last is None or self._last.done():
            self.add(act)

    def add(self, act: Callable[[], None]) -> None:
        """Let `act` flush, after the flush before. Raises OSError of that before, where it has ended."""
        if self._last is not None and self._last.done():
            self._last.result()
        self._thread = self._thread or ThreadPoolExecutor(1, "flush")
        before = self._last
        self._last = self._thread.submit(self._run, before, act)

    def finish(self) -> None:
        """Wait until all is flushed, and end the thread. Raises OSError."""
        last, thread = self._last, self._thread
        self._last = self._thread = None
        if thread is not None:
            thread.shutdown()
        if last is not None:
            last.result()

    def abandon(self) -> None:
        """End the thread once the flush under way has ended, which is not waited for."""
        if self._thread is not None:
            self._thread.shutdown(wait=False, cancel_futures=True)
        self._thread = self._last = None

    def _run(self, before: Future[None] | None, act: Callable[[], None]) -> None:
        if before is not None:
            before.result()  # an error of it is that of all that follow
        self._begun = time.monotonic()
        try:
            act()
        finally:
            self._took = time.monotonic() - self._begun


#: Uncompressed size of a chunk [bytes]: what a crash can lose; 0.3 s of the bench.
CHUNK = 16_384
LIBRARY = "atpid_control"
_PIECE = 2**20  # of the index, read at once [bytes]
COMPRESSIONS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}


def check_new(folder: Path) -> None:
    """Raise BagError unless a bag can be made at `folder`: it must not exist, and its parent must be writable."""
    if folder.exists() or folder.is_symlink():
        raise BagError(f"{folder}: exists already, and a bag is never written over; choose another folder or remove it")
    parent = next(path for path in folder.absolute().parents if path.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        what = f"{parent} is not a folder one may write to; choose another folder"
        raise BagError(f"{folder}: cannot make the bag, {what}")


def _write_all(file: int, data: bytes) -> None:
    """Write all of `data` to an open file; raise OSError where it cannot be written."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(file, rest) :]


class Sink:
    """An unbuffered file: what was written survives the process."""

    def __init__(self, path: Path) -> None:
        """Create the file; raise OSError where that fails, FileExistsError where it is there."""
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self.size = 0

    def write(self, data: bytes) -> int:
        """Append all of `data`; raise OSError where it cannot be written."""
        self._append(data)
        self.size += len(data)
        return len(data)

    def _append(self, data: bytes) -> None:
        _write_all(self._file, data)

    def tell(self) -> int:
        """Return the number of bytes written so far."""
        return self.size

    def flush(self) -> None:
        """Do nothing: the file is unbuffered."""

    def sync(self) -> None:
        """Flush to the disk, against a power cut."""
        os.fdatasync(self._file)

    def close(self) -> None:
        """Close the file; twice does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _end(writer: Writer, sink: Sink) -> None:
    """Write the index of a file, flush it to the disk and close it. Raises OSError."""
    try:
        writer.finish()  # type: ignore[no-untyped-call]
        sink.sync()
    finally:
        sink.close()


class SpooledIndex:
    """The index of the chunks, in a file without a name until it ends the bag: 2 MB an hour of the bench.

    In memory it would grow with the recording, as objects by 1 kB a chunk.
    """

    def __init__(self, folder: Path) -> None:
        """Keep it on the disk of `folder`, as long as this object is used. Raises OSError."""
        self._file = -1
        self._file, name = mkstemp(dir=folder, prefix=".index-")
        os.unlink(name)

    def append(self, index: ChunkIndex) -> None:
        """Take the index of one more chunk. Raises OSError."""
        builder = RecordBuilder()
        index.write(builder)
        _write_all(self._file, builder.end())  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator[SpooledIndex]:
        yield self

    def write(self, builder: RecordBuilder) -> None:
        """Write all of them. Raises OSError."""
        for place in range(0, os.fstat(self._file).st_size, _PIECE):
            builder.write(os.pread(self._file, _PIECE, place))

    def __del__(self) -> None:
        if self._file >= 0:
            os.close(self._file)


@dataclass(frozen=True)
class Split:
    """When a bag goes on in another file; 0: never."""

    size: int = 0  # of a file [bytes]
    seconds: float = 0.0  # between the log times of its first message and the next

    def due(self, size: int, begin_ns: int | None, log_ns: int) -> bool:
        """Whether a file of `size` bytes, whose first message is of `begin_ns`, is full before one of `log_ns`."""
        if begin_ns is None:
            return False
        return bool(0 < self.size <= size or 0.0 < self.seconds * 1e9 <= log_ns - begin_ns)


class BagWriter:
    """One bag, open for writing until `close`."""

    def __init__(
        self,
        folder: Path,
        run: RunInfo,
        *,
        chunk: int = CHUNK,
        compression: str = "zstd",
        sink: Callable[[Path], Sink] = Sink,
        split: Split | None = None,
    ) -> None:
        """Create `folder` with the file in it, opened by `sink`, and write the run's description. Raises BagError."""
        check_new(folder)
        self.folder, self._run = folder, run
        self._chunk, self._compression, self._open_sink = chunk, COMPRESSIONS[compression], sink
        self._split = split or Split()
        self.closed = False
        self._flush = Flush()
        self._files = dict(run.files)  # kept in every file of the bag, each of which can be read alone
        self._types: dict[str, int] = {}
        self._channels: dict[str, tuple[int, str, dict[str, str]]] = {}  # id, message type and metadata
        self._sequences: dict[str, int] = {}
        self.summary = BagSummary(self._file_name(0))
        try:
            folder.mkdir(parents=True)
            self._begin_file()
        except OSError as error:
            raise BagError(f"{folder}: cannot make the bag: {in_words(error)}") from None

    def _file_name(self, number: int) -> str:
        return f"{self.folder.name}_{number}.mcap"

    def _begin_file(self) -> None:
        """Open the file that comes last in the summary and write what it needs to be read alone. Raises OSError."""
        self._sink = self._open_sink(self.folder / self.summary.files[-1].name)
        self._writer = Writer(
            cast(IO[bytes], self._sink),
            chunk_size=self._chunk,
            compression=self._compression,
            enable_crcs=True,
            enable_data_crcs=True,
        )
        # the library has no place for it; a test measures that it is used
        self._writer._Writer__chunk_indices = SpooledIndex(self.folder)  # type: ignore[attr-defined]
        self._writer.start(profile="ros2", library=LIBRARY)
        self._writer.add_metadata(RUN, self._run.record())
        for name, data in self._files.items():
            self._attach(name, data)
        self._types.clear()
        for topic, (_, type_name, own) in self._channels.items():
            self._channels[topic] = self._register(topic, type_name, own), type_name, own

    def _next_file(self) -> None:
        """Go on in another file; the index that ends this one, 0.3 s of work after an hour, is not waited for.

        Raises OSError.
        """
        self._writer.flush()  # type: ignore[no-untyped-call]
        end = partial(_end, self._writer, self._sink)
        self.summary.begin_file(self._file_name(len(self.summary.files)))
        self._begin_file()
        self._flush.add(end)

    def _register(self, topic: str, type_name: str, own: dict[str, str]) -> int:
        if type_name not in self._types:
            definition = message_type(type_name).definition.encode()
            self._types[type_name] = self._writer.register_schema(type_name, "ros2msg", definition)
        return int(self._writer.register_channel(topic, "cdr", self._types[type_name], own))

    def _attach(self, name: str, data: bytes) -> None:
        created = int(self._run.created.timestamp() * 1e9)
        media = "application/yaml" if name.endswith((".yaml", ".yml")) else "application/octet-stream"
        self._writer.add_attachment(created, created, name, media, data)

    def attach(self, name: str, data: bytes) -> None:
        """Keep a file in the bag. Raises BagError where it cannot be written."""
        self._files[name] = data
        with self._writing():
            self._attach(name, data)

    @property
    def size(self) -> int:
        """Bytes in the present file so far."""
        return self._sink.size

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the topics added so far."""
        return tuple(self._channels)

    def add_topic(self, name: str, type_name: str, qos: tuple[Qos, ...] = (Qos(),)) -> None:
        """Add the topic `name` of message type `type_name`, offered with `qos`. Raises TypeUnknownError, BagError."""
        described = message_type(type_name)
        profiles = [profile.mapping() for profile in qos]
        own = {"offered_qos_profiles": yaml.safe_dump(profiles, sort_keys=False), "topic_type_hash": described.hash}
        with self._writing():  # a chunk that is full is written now
            self._channels[name] = self._register(name, type_name, own), type_name, own
        self._sequences[name] = 0
        self.summary.topics[name] = TopicSummary(name, type_name, described.hash, profiles)

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Append one serialised message of a topic added before. Raises BagError where it cannot be written."""
        with self._writing():
            if self._split.due(self._sink.size, self.summary.files[-1].start_ns, log_ns):
                self._next_file()
            self._writer.add_message(self._channels[topic][0], log_ns, data, publish_ns, self._sequences[topic])
        self._sequences[topic] += 1
        self.summary.add(topic, log_ns)

    def end_chunk(self) -> None:
        """End the chunk in progress, against a crash; one without messages is not written. Raises BagError."""
        with self._writing():
            self._writer.flush()  # type: ignore[no-untyped-call]

    def sync(self) -> None:
        """End the chunk in progress and have it flushed to the disk, against a power cut; that is not waited for.

        Raises BagError, of the flush before as well.
        """
        with self._writing():
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._flush.start(self._sink.sync)

    @property
    def flush_seconds(self) -> float:
        """How long the flush to the disk that is under way has taken so far, or the last one took [s]."""
        return self._flush.seconds

    def close(self, result: Mapping[str, str] | None = None) -> None:
        """Write `result` and the index, then metadata.yaml; twice does nothing. Raises BagError."""
        if self.closed:
            self._sink.close()
            return
        try:
            with self._writing():
                self._writer.flush()  # type: ignore[no-untyped-call]
                if result:
                    self._writer.add_metadata(RESULT, dict(result))
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._flush.add(self._sink.sync)
                self._flush.finish()
                metadata.write(self.folder, self.summary, {**self._run.record(), **(result or {})})
        finally:
            self._sink.close()
            self.closed = True

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """End the recording where the disk refuses what is written inside; the file can be repaired."""
        try:
            yield
        except OSError as error:
            self.closed = True
            self._flush.abandon()
            self._sink.close()
            raise BagError(
                f"{self.folder}: recording stopped after {self.summary.whole.count} messages, {in_words(error)}; "
                f"then `atpid bag recover {self.folder}` makes a whole bag of it"
            ) from None
