# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Amplitude, frequency and phase of the excitation, with error bars, from a sliding window of samples."""

from atpid_common.vocabulary import Origin, Quality
from atpid_control.identification.estimate import Estimate, IdentificationError, Settings
from atpid_control.identification.identifier import Identifier, warm_up

__all__ = ["Estimate", "IdentificationError", "Identifier", "Origin", "Quality", "Settings", "warm_up"]
