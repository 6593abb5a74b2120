# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with the processes of a run."""

from atpid_common.errors import InputError, NumericalError


class BenchError(InputError):
    """The bench cannot run as asked; the message is one line: why, and what to do."""


class NodeDiedError(BenchError):
    """A node ended before the run did."""


class PlantFailedError(NumericalError):
    """The simulated plant failed numerically; the message is the plant's own."""
