"""The Dutch-roll level of MIL-F-8785C 3.3.1.1, an indication only: it is for manned aircraft.

Each level needs a least zeta, a least zeta*wn (rad/s) and a least wn (rad/s), all three at once.
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
