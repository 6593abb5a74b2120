# SPDX-License-Identifier: Apache-2.0
"""The node graph from outside: its parts, their parameters and processes, and a ROS domain of its own."""

from atpid_common.errors import InputError, NumericalError


class BenchError(InputError):
    """The bench cannot run as asked; the message is one line: why, and what to do."""


class NodeDiedError(BenchError):
    """A node ended before the run did."""


class PlantFailedError(NumericalError):
    """The simulated plant failed numerically; the message is the plant's own."""
