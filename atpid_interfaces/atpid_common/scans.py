# SPDX-License-Identifier: Apache-2.0
"""The scans of a stream of samples: which rates and indices have a place in time."""

_LARGEST_INDEX = 2**62
_RATES = 1e-3, 1e7  # lowest, highest [Hz]


def misplaced(last_index: int, rate: float) -> str:
    """Return why scans up to `last_index` at `rate` [Hz] have no place in time, in a few words; empty: they have."""
    if not _RATES[0] <= rate <= _RATES[1]:
        return f"its rate is {rate} Hz; {_RATES[0]:g} to {_RATES[1]:g}"
    return "" if last_index <= _LARGEST_INDEX else f"its last index is {last_index}; at most 2^62"
