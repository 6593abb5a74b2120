# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Names and units of what studies measure, and symbols of what they sweep."""

from typing import NamedTuple


class Quantity(NamedTuple):
    """A quantity as rows name it."""

    text: str
    unit: str = ""
    digits: int = 3  # significant ones shown


#: By the name a measure gives it.
QUANTITIES: dict[str, Quantity] = {
    "decrement": Quantity("largest decrement"),
    "at_period": Quantity("period of the largest decrement"),
    "amplitude": Quantity("amplitude of the beam", "m"),
    "undamped": Quantity("amplitude, damper closed", "m"),
    "largest": Quantity("largest displacement from rest", "m"),
    "reduction": Quantity("reduction of the amplitude", "%"),
    "motion": Quantity("motion type"),
    "sticks_to": Quantity("the grain sticks to"),
    "natural": Quantity("natural frequency, beam and grain", "Hz", 4),
    "natural_bare": Quantity("natural frequency, beam alone", "Hz", 4),
    "stiffness": Quantity("contact stiffness k_c", "N/m^1.5", 4),
    "contact_damping": Quantity("contact damping c_c", "N s/m^1.25", 5),
    "frequency": Quantity("frequency of the decay", "Hz"),
    "periodic": Quantity("cycles floor, ceiling, floor at first"),
    "work": Quantity("work of the first floor impact on the grain", "J"),
    "energy_closed": Quantity("largest energy of the beam, damper closed", "J"),
    "energy_open": Quantity("largest energy of the beam, steady", "J"),
    "upper_share": Quantity("change of energy in a ceiling impact", "% of the largest"),
    "lower_share": Quantity("change of energy in a floor impact", "% of the largest"),
    "impact_share": Quantity("change of energy in an impact, mean", "% of the largest"),
    "work_on_grain": Quantity("work on the grain, whole run", "J"),
    "work_steady": Quantity("work on the grain, last 2 s", "J"),
    "work_excitation": Quantity("work of the excitation, last 2 s", "J"),
    "least_work": Quantity("least work on the grain in any period", "J"),
    "work_swing": Quantity("swing of the excitation's work within a period", "J"),
    "residual": Quantity("residual of the energy balance", "-", 1),
    "loss_ratio": Quantity("work on the grain less its gain over the loss in contacts, last 2 s", "-", 5),
    "final_energy": Quantity("energy of the beam after 2 s, share of the start", "%"),
    "growth": Quantity("largest rise of the beam's energy over its start", "%"),
    "floor_speed": Quantity("largest rate of the floor overlap", "m/s"),
    "ceiling_speed": Quantity("largest rate of the ceiling overlap", "m/s"),
    "floor_force": Quantity("largest floor force", "N"),
    "ceiling_force": Quantity("largest ceiling force", "N"),
    "floor_overlap": Quantity("largest floor overlap", "m"),
    "ceiling_overlap": Quantity("largest ceiling overlap", "m"),
    "largest_damping": Quantity("largest specific damping", "-"),
    "least_damping": Quantity("least specific damping", "-"),
    "damping_at": Quantity("time of the largest specific damping", "s"),
    "best_height": Quantity("best height", "m"),
    "best_reduction": Quantity("reduction at the best height", "%"),
    "best_amplitude": Quantity("amplitude at the best height", "m"),
    "at_limit": Quantity("best height at the end of the range"),
    "search_height": Quantity("height the search ends at", "m"),
    "search_steps": Quantity("heights tried by the search"),
    "search_last": Quantity("the search ends by"),
    "height_over_best": Quantity("height over the best height", "-"),
    "stage_height": Quantity("height of the ceiling", "m"),
    "stage_amplitude": Quantity("amplitude of the beam", "m"),
    "stage_closed": Quantity("amplitude, damper closed", "m"),
    "stage_reduction": Quantity("reduction of the amplitude", "%"),
    "a_pred": Quantity("A_pred", "m", 4),
    "f": Quantity("f", "Hz", 4),
    "f0": Quantity("f_0", "Hz", 4),
    "top_speed": Quantity("V_k0", "m/s", 4),
    "first_height": Quantity("first guess h_pred", "m"),
    "return_beam": Quantity("X_beam at the first return", "m"),
    "return_grain": Quantity("X_grain at the first return", "m"),
    "return_beam_velocity": Quantity("V_beam at the first return", "m/s", 4),
    "return_grain_velocity": Quantity("V_grain at the first return", "m/s", 4),
    "impact_beam": Quantity("X_beam after the first impact of CM1", "m"),
    "impact_grain": Quantity("X_grain after the first impact of CM1", "m", 4),
    "impact_beam_velocity": Quantity("V_beam after the first impact of CM1", "m/s", 4),
    "impact_grain_velocity": Quantity("V_grain after the first impact of CM1", "m/s", 4),
    "second_height": Quantity("second guess h_pred", "m"),
    "pca_height": Quantity("height of the PCA before tuning", "m"),
    "pca_motion": Quantity("motion type at that height"),
    "tuned_height": Quantity("height after tuning", "m"),
    "tunings": Quantity("heights tried in tuning"),
    "pca_error": Quantity("height of the PCA off the tuned one by", "%"),
    "sm_agreement": Quantity("amplitude of the Simplified Model over that of the Complex Model", "-", 4),
    "first_motion": Quantity("motion type at the first guess"),
    "peak": Quantity("peak of the primary mass", "A", 12),
    "over_gap": Quantity("amplitude over half the clearance", "-", 4),
    "multiplier": Quantity("largest multiplier of the return map", "-", 6),
    "force": Quantity("largest force", "N", 10),
    "overlap": Quantity("largest overlap", "m", 10),
    "duration": Quantity("duration", "s", 10),
    "impact_time": Quantity("time of the fourth or tenth impact", "s", 10),
    "rest_time": Quantity("time at which the ball rests", "s", 10),
    "closing_speed": Quantity("closing speed of every impact", "m/s", 10),
    "modulus": Quantity("modulus of the larger multiplier of the return map", "-", 9),
    "onset": Quantity("Γ from which there is a motion of one impact a period", "-", 9),
    "doubling": Quantity("Γ at which its period doubles", "-", 9),
    "restitution": Quantity("rebound speed over approach speed", "-", 10),
    "rebound": Quantity("rebound speed over approach speed", "-", 6),
}

#: Symbol and unit of each key of a sweep.
SYMBOLS: dict[str, tuple[str, str]] = {
    "mass_fraction": ("φ", ""),
    "height": ("h", "m"),
    "amplitude": ("A", "m"),
    "deflection": ("released from", "m"),
    "frequency_ratio": ("f/f_0", ""),
    "gravity": ("g", "m/s²"),
    "radius": ("r", "m"),
    "case": ("", ""),
    "scene_file": ("", ""),
}


def named(quantity: str) -> Quantity:
    """Return a quantity by name; `NAME_K` is that of stage K."""
    if quantity in QUANTITIES:
        return QUANTITIES[quantity]
    stem, _, number = quantity.rpartition("_")
    found = QUANTITIES[stem]
    return found._replace(text=f"{found.text}, stage {number}")


def described(point: dict[str, float | str]) -> str:
    """Return a point of a sweep in words: φ = 0.1, h = 0.2 m."""
    parts = []
    for key, value in point.items():
        symbol, unit = SYMBOLS[key]
        text = f"{value:g}" if isinstance(value, float | int) else str(value).removesuffix(".yaml").replace("_", " ")
        gap = " " if key == "deflection" else " = "
        parts.append(f"{symbol}{gap}{text} {unit}".strip() if symbol else text)
    return ", ".join(parts)
