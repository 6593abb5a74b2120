# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The curve over the amplitudes of a map is scipy's monotone cubic."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import PchipInterpolator

from atpid_sim.maps.curves import monotone

_VALUES = st.sampled_from([0.0, 1.0, -1.0]) | st.floats(-10.0, 10.0, allow_subnormal=False).filter(
    lambda value: value == 0.0 or abs(value) > 1e-6
)


@given(
    st.integers(2, 9).flatmap(
        lambda n: st.tuples(arrays(float, n, elements=st.floats(0.01, 5.0)), arrays(float, (n, 3), elements=_VALUES))
    ),
    st.floats(0.0, 1.0),
)
def test_the_curve_is_scipy_s(points: tuple[np.ndarray, np.ndarray], share: float) -> None:
    x, y = np.cumsum(points[0]), points[1]
    place = x[0] + share * (x[-1] - x[0])
    for at in (place, *x):
        np.testing.assert_allclose(monotone(x, y)(at), PchipInterpolator(x, y)(at), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        monotone(x, y[:, 0])(place), PchipInterpolator(x, y[:, 0])(place), rtol=1e-12, atol=1e-12
    )
