# SPDX-License-Identifier: Apache-2.0
"""The number of each contact law: the one place that gives it."""

from __future__ import annotations

IMPACT = 0
LINEAR = 1
HERTZ = 2
LEE_HERRMANN = 3
KUWABARA_KONO = 4
TSUJI = 5
WALTON_BRAUN = 6

#: Numbers by the name a scene gives.
BY_NAME = {
    "impact": IMPACT,
    "linear": LINEAR,
    "hertz": HERTZ,
    "lee_herrmann": LEE_HERRMANN,
    "kuwabara_kono": KUWABARA_KONO,
    "tsuji": TSUJI,
    "walton_braun": WALTON_BRAUN,
}
