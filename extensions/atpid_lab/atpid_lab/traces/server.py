# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Serves records to Foxglove and PlotJuggler, on this machine and for reading only."""

import foxglove

from atpid_common.errors import InputError
from atpid_control.runs.decode import message_type
from atpid_lab.traces.records import PREFIX, TraceRecord, definition

#: The only address: a viewer on another machine comes through a tunnel (docs/foxglove.md).
HOST = "127.0.0.1"


class ServerError(InputError):
    """A port that cannot be served; one line."""


class Server:
    """A WebSocket server in the protocol of Foxglove; it takes no messages, parameters or calls from its clients."""

    def __init__(self, port: int) -> None:
        """Serve on `port` of this machine, 0: any free one. Raises ServerError."""
        # a viewer that leaves is no error of a node
        foxglove.set_log_level("CRITICAL")
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(name="ATPID", host=HOST, port=port, context=self._context)
        except RuntimeError as error:
            raise ServerError(f"port {port}: cannot be served ({error}); give another port, or 0 for any") from None
        self._channels: dict[str, foxglove.Channel] = {}

    @property
    def port(self) -> int:
        """The port it serves on."""
        return int(self._server.port)

    def offer(self, topic: str, kind: str) -> None:
        """Announce a topic of message type `kind`; raise TypeUnknownError for a type that is not installed."""
        own = topic.startswith(PREFIX)  # standard types, whose packages need not be here
        text = definition(kind) if own else message_type(kind).definition.encode()
        schema = foxglove.Schema(name=kind, encoding="ros2msg", data=text)
        self._channels[topic] = foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=self._context)

    def send(self, record: TraceRecord) -> None:
        """Send one message to the clients that subscribe to its topic."""
        if record.topic not in self._channels:
            self.offer(record.topic, record.type)
        self._channels[record.topic].log(record.data, log_time=record.time_ns)

    def close(self) -> None:
        """Disconnect the clients."""
        self._server.stop()
