# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a vibration laboratory computes from two signals: frequency response, spectra, decrement, orders."""

from atpid_control.analysis.analyse import Analysis, analyse
from atpid_control.analysis.decrement import Decay, free_decay
from atpid_control.analysis.frequency_response import FrequencyResponse, frequency_response
from atpid_control.analysis.orders import Orders, orders
from atpid_control.analysis.signals import AnalysisError, Signals
from atpid_control.analysis.spectra import Spectrum, spectrum

__all__ = ["Analysis", "AnalysisError", "Decay", "FrequencyResponse", "Orders", "Signals", "Spectrum"]
__all__ += ["analyse", "free_decay", "frequency_response", "orders", "spectrum"]
