# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The root finder takes the steps of scipy's."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from atpid_sim.root import root

FUNCTIONS: list[Callable[[float, float], float]] = [
    lambda x, a: math.exp(x) - math.exp(a),
    lambda x, a: (x - a) ** 3 + 0.1 * (x - a),
    lambda x, a: math.copysign(abs(x - a) ** 0.3, x - a),
    lambda x, a: 1.0 if x > a else -1.0,
]


@given(
    st.sampled_from(FUNCTIONS), st.floats(-3.0, 3.0), st.floats(-60.0, -4.0), st.floats(4.0, 12.0),
    st.sampled_from([1e-3, 1e-6, 2e-12]),
)  # fmt: skip
def test_a_root_is_that_of_scipy_to_the_last_digit(
    function: Callable[[float, float], float], at: float, low: float, high: float, xtol: float
) -> None:
    ours = root(lambda x: function(x, at), low, high, xtol)
    assert ours == brentq(lambda x: function(x, at), low, high, xtol=xtol)


def test_without_a_change_of_sign_there_is_no_root() -> None:
    with pytest.raises(ValueError, match="same sign"):
        root(lambda x: x * x + 1.0, -1.0, 1.0)
