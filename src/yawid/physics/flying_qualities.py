"""Dutch-roll level of MIL-F-8785C 3.3.1.1: indicative, no standard binds an unmanned aircraft.

Each level asks for a least zeta, a least zeta*wn (rad/s) and a least wn (rad/s), all three at once.
"""

from __future__ import annotations

LEVEL_1 = {
    ("A", "I"): (0.19, 0.35, 1.0),
    ("A", "II"): (0.19, 0.35, 0.4),
    ("A", "III"): (0.19, 0.35, 0.4),
    ("A", "IV"): (0.19, 0.35, 1.0),
    ("B", "I"): (0.08, 0.15, 0.4),
    ("B", "II"): (0.08, 0.15, 0.4),
    ("B", "III"): (0.08, 0.15, 0.4),
    ("B", "IV"): (0.08, 0.15, 0.4),
    ("C", "I"): (0.08, 0.15, 1.0),
    ("C", "II"): (0.08, 0.10, 0.4),
    ("C", "III"): (0.08, 0.10, 0.4),
    ("C", "IV"): (0.08, 0.15, 1.0),
}
LEVEL_2 = (0.02, 0.05, 0.4)
LEVEL_3 = (0.0, 0.0, 0.4)


def dutch_roll_level(
    wn_rad_s: float, zeta: float, category: str = "B", aircraft_class: str = "I"
) -> int | None:
    """Return the level 1, 2 or 3 that a Dutch roll meets, or None where it meets none.

    >>> dutch_roll_level(2.4, 0.23)
    1
    >>> dutch_roll_level(2.4, 0.05)
    2
    """
    for level, limits in enumerate((LEVEL_1[category, aircraft_class], LEVEL_2, LEVEL_3), start=1):
        if all(
            v >= limit for v, limit in zip((zeta, zeta * wn_rad_s, wn_rad_s), limits, strict=True)
        ):
            return level
    return None
