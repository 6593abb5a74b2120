# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The response to an excitation that does not repeat, such as one sweep or one shock: local rational models.

In a band of a few lines of the whole record's transform, Y A = B U + I with polynomials A, B and I of the second
degree: B / A is the response, and I / A what the motion before the record and after it adds. One mode under its
support is such a quotient, so that no peak is flattened and no window needed; the residual gives the error bar
(Pintelon, Schoukens, Vandersteen and Barbe, Mech. Syst. Signal Process. 24, 2010; McKelvey and Guerin, 2012).
"""

import numpy as np

from atpid_control.analysis.spectra import transform, window_of
from atpid_sim.system import Array

#: Degree of the polynomials; lines on either side of the middle one; bands that are looked at, at most.
_DEGREE, _SIDE, _MOST = 2, 12, 4000
#: Complex values that a band leaves for its residual.
FREEDOM = 2 * _SIDE + 1 - (3 * _DEGREE + 2)
#: Likeness of the spectra of the strongest quarter and the others, and share of its power they have, below which an
#: excitation passes once [-].
_LIKE, _AT_REST = 0.3, 1e-3


def passes_once(excitation: Array) -> bool:
    """Whether the parts of a signal (n,) without gaps have other spectra, or one alone moves: a sweep, a shock."""
    count = len(excitation) // 4
    if count < 64:
        return False
    quarters = (excitation[: 4 * count] - excitation.mean()).reshape(4, count)
    shape = window_of("hann", count)
    powers = np.array([np.abs(transform(one, shape)) ** 2 for one in quarters])
    strongest = int(np.argmax(powers.sum(axis=1)))
    one, others = powers[strongest], np.delete(powers, strongest, axis=0).mean(axis=0)
    like = float(one @ others) / max(float(np.linalg.norm(one) * np.linalg.norm(others)), 1e-300)
    return like < _LIKE or float(others.sum()) < _AT_REST * float(one.sum())


def local_response(
    excitation: Array, response: Array, rate: float, excited_from: float
) -> tuple[Array, Array, Array, Array, Array]:
    """Return frequencies (k,) [Hz], response, its relative standard deviation, coherence, and density of excitation.

    Of signals (n,) without gaps, at lines from the first to the last with `excited_from` of the largest density.
    """
    given, answer = (np.fft.rfft(one - one.mean()) for one in (excitation, response))
    density = 2.0 * np.abs(given) ** 2 / (rate * len(excitation))
    smooth = np.convolve(density, np.full(2 * _SIDE + 1, 1.0 / (2 * _SIDE + 1)), mode="same")
    lines = np.flatnonzero(smooth >= excited_from * smooth[_SIDE:-_SIDE].max())
    lines = lines[(lines > _SIDE) & (lines < len(given) - _SIDE)]
    lines = lines[:: -(-len(lines) // _MOST)]
    band = lines[:, None] + np.arange(-_SIDE, _SIDE + 1)
    u, y = (one[band] / np.sqrt(np.mean(np.abs(one[band]) ** 2, axis=1, keepdims=True)) for one in (given, answer))
    powers = np.linspace(-1.0, 1.0, 2 * _SIDE + 1) ** np.arange(_DEGREE + 1)[:, None]
    columns = np.concatenate([u[:, None] * powers, np.broadcast_to(powers, (len(lines), *powers.shape)),
                              -y[:, None] * powers[1:]], axis=1).transpose(0, 2, 1)  # fmt: skip
    inverse = np.linalg.pinv(columns, rcond=1e-12)
    found = (inverse @ y[..., None])[..., 0]
    lever = 1.0 - np.einsum("kij,kji->ki", columns, inverse).real
    left = np.abs(y - (columns @ found[..., None])[..., 0]) ** 2 / lever
    size = np.sqrt(np.mean(np.abs(answer[band]) ** 2, axis=1) / np.mean(np.abs(given[band]) ** 2, axis=1))
    # half of a complex value's variance is in its size, half in its phase
    deviation = np.sqrt(0.5 * np.sum(left / lever * np.abs(inverse[:, 0]) ** 2, axis=1))
    return (lines * rate / len(excitation), found[:, 0] * size, deviation / np.maximum(np.abs(found[:, 0]), 1e-300),
            np.clip(1.0 - left.mean(axis=1), 0.0, 1.0), smooth[lines])  # fmt: skip
