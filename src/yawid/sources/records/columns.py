"""The columns of a record: THE table of their names, units and meaning.

What reads records and ``yawid export`` agree by it: a run that is exported with these names and
units, its units in a second row (CSV) or with the fields (Parquet, key ``unit``), gives the same
samples when it is replayed. For that the exporter must write all that is ``kept`` here; on the
run's own grid, ``t`` being the instant's time, so that ``rudder`` is the mean over ``[t, t + Ts)``.
In Parquet the file's metadata say under ``configuration`` the run's TOML and under ``autopilot``
who flew.
"""

from typing import Final, NamedTuple

from yawid.blocks import Held

HALF_TRAVEL: Final = "half-travel"
"""The unit of a surface of which nobody says how far it moves: half its travel is 1."""


class RecordColumn(NamedTuple):
    """A column's unit where nobody says another one, what it is, and if a run's samples need it."""

    unit: str
    says: str
    kept: bool = True


COLUMNS: Final = {
    "t": RecordColumn("s", "time since boot, or since 1970: then the date is known"),
    "rudder": RecordColumn(HALF_TRAVEL, "deflection from now on, positive nose right"),
    "r": RecordColumn("rad/s", "yaw rate now, positive nose right"),
    "roll": RecordColumn("rad", "bank, right wing down positive"),
    "aileron": RecordColumn(HALF_TRAVEL, "deflection, positive rolls right"),
    "airspeed": RecordColumn(
        "m/s", "equivalent airspeed; by its unit another: ktas, kcas, m/s tas"
    ),
    "ground_speed": RecordColumn("m/s", "what the airspeed is held against; stands in for none"),
    "airspeed_kind": RecordColumn("", "what the log gave, or ground; the number is equivalent"),
    "yaw": RecordColumn("rad", "heading"),
    "turn_rate": RecordColumn("rad/s", "what bank and airspeed imply; made of them without it"),
    "altitude": RecordColumn("m", "above the sea"),
    "on_ground": RecordColumn("1", "1 on the ground, 0 in the air"),
    "mode": RecordColumn("", "flight mode: its name, or HEARTBEAT.custom_mode"),
    "held": RecordColumn("", "why not to learn from the row: names of Held, by spaces; or empty"),
    "time": RecordColumn("UTC", "date and time, ISO 8601"),
    "pitch": RecordColumn("rad", "nose up positive", kept=False),
    "q": RecordColumn("rad/s", "pitch rate", kept=False),
    "air_density": RecordColumn("kg/m^3", "of the air flown in: for a true airspeed", kept=False),
    "p": RecordColumn("rad/s", "roll rate; not used", kept=False),
    "ay": RecordColumn("m/s^2", "lateral acceleration; not used", kept=False),
}
TEXTS: Final = frozenset({"mode", "held", "time", "airspeed_kind"})
"""Columns that may hold texts; ``t`` may hold dates too."""
BY_GROUND: Final = "ground"
"""A run's ``airspeed_kind`` where its airspeed is the ground speed."""


def held_text(bits: int) -> str:
    """Return reasons as the column ``held`` spells them: ``on_ground steep``."""
    return " ".join(str(flag.name).lower() for flag in Held if flag.value & bits)


def held_bits(text: str) -> int:
    """Return the bits of :class:`yawid.blocks.Held` of such a text.

    Raises:
        KeyError: a word is no reason.
    """
    return sum(Held[word.upper()].value for word in set(text.split()))
