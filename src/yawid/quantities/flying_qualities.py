"""How an aircraft flies: the level of its Dutch roll, and surfaces that work the wrong way.

The level is that of MIL-F-8785C 3.3.1.1, an indication only: it is for manned aircraft. Each needs
a least zeta, a least zeta*wn (rad/s) and a least wn (rad/s), all three at once.
"""

LEVELS = ((0.08, 0.15, 0.4), (0.02, 0.05, 0.4), (0.0, 0.0, 0.4))
"""The limits of levels 1 to 3 for category B (gradual manoeuvres), the same for all classes."""


def dutch_roll_level(wn_rad_s: float, zeta: float) -> int | None:
    """Return the level 1, 2 or 3 that a Dutch roll meets, or None where it meets none.

    >>> dutch_roll_level(2.4, 0.23)
    1
    >>> dutch_roll_level(2.4, 0.05)
    2
    """
    found = zeta, zeta * wn_rad_s, wn_rad_s
    for level, limits in enumerate(LEVELS, start=1):
        if all(value >= limit for value, limit in zip(found, limits, strict=True)):
            return level
    return None


WRONG_SIGMAS = 3.0
_WRONG = {
    "L_delta_a": "a positive aileron rolls the aircraft left: its servo is reversed or the log's "
    "SERVOn_REVERSED is wrong",
    "N_delta_r": "a positive rudder turns the nose left: its servo is reversed or --rudder-sign is "
    "wrong",
}
"""The main effect of each surface, and what it says where it is negative."""


def wrong_sign(name: str, value: float | None, std: float | None) -> str:
    """Return what a surface does in words if this is its effect, negative by three sigmas; else "".

    What is computed from such an effect, as a rudder mix, has the wrong sign.
    """
    if name not in _WRONG or value is None or not std or not value < -WRONG_SIGMAS * std:
        return ""
    return f"{_WRONG[name]} ({name} is {value:.3g} ± {std:.2g})"
