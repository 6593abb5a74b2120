# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Units as programs spell them, and their factors to SI."""

import re

#: Units by their own spelling: SI unit and factor. With a prefix: those of `_PREFIXED`.
_UNITS = {
    "": ("", 1.0), "-": ("", 1.0), "1": ("", 1.0), "%": ("", 0.01), "in": ("m", 0.0254), "inch": ("m", 0.0254),
    "ft": ("m", 0.3048), "mil": ("m", 2.54e-5), "g": ("m/s^2", 9.80665), "gn": ("m/s^2", 9.80665),
    "mg": ("m/s^2", 9.80665e-3), "gal": ("m/s^2", 0.01), "lbf": ("N", 4.4482216152605), "psi": ("Pa", 6894.757293168),
    "bar": ("Pa", 1e5), "mbar": ("Pa", 100.0), "rpm": ("Hz", 1.0 / 60.0), "1/s": ("Hz", 1.0), "min": ("s", 60.0),
    "h": ("s", 3600.0), "deg": ("rad", 0.017453292519943295), "rad": ("rad", 1.0), "°c": ("degC", 1.0),
    "degc": ("degC", 1.0),
}  # fmt: skip
_PREFIXED = {
    "m": "m", "meter": "m", "metre": "m", "meters": "m", "N": "N", "newton": "N", "newtons": "N", "V": "V",
    "volt": "V", "volts": "V", "A": "A", "Pa": "Pa", "s": "s", "sec": "s", "second": "s", "seconds": "s", "Hz": "Hz",
    "K": "K", "Nm": "N m", "strain": "", "rad/s": "rad/s",
}  # fmt: skip
_PREFIXES = {"": 1.0, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "micro": 1e-6,
             "milli": 1e-3, "kilo": 1e3, "nano": 1e-9}  # fmt: skip
_OVER_TIME = re.compile(r"(.+?)(?:/s(?:ec)?(?:\^?([23]))?|s\^?-([123]))")


def si_of(given: str) -> tuple[str, float] | None:
    """Return the SI unit that a unit is converted to, and its factor; None: the unit is not known.

    `g` is the standard acceleration of free fall, `mg` a thousandth of it: sensors measure no grams.
    """
    text = given.strip().strip("[]()").strip().replace("²", "^2").replace("³", "^3").replace("**", "^")
    text = re.sub(r"[\sµμ·*]", lambda sign: "u" if sign[0] in "µμ" else "", text.replace("⁻", "-"))
    if text.lower() in _UNITS and text not in ("G", "MG", "Mg"):
        return _UNITS[text.lower()]
    for prefix, factor in _PREFIXES.items():
        rest = text.removeprefix(prefix)
        known = _PREFIXED.get(rest, _PREFIXED.get(rest.lower()) if len(rest) > 2 else None)
        if text.startswith(prefix) and known is not None:
            return known, factor
    if found := _OVER_TIME.fullmatch(text):
        power, length = found[2] or found[3] or "1", si_of(found[1])
        if length and length[0] == "m":
            return f"m/s{'' if power == '1' else f'^{power}'}", length[1]
    return None
