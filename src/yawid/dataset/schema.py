"""The tables of a data set: every column with its type, its unit and what it says.

What does not apply is NULL, never NaN. A unit stands at the end of a column's name; without one a
number has none. ``*_std`` is the total sigma of what stands before it, in the same unit;
``*_std_noise`` the part of it that noise alone explains. Times are UTC. Rows without a date lie in
``month=unknown``.

A glob over a table's folder never reads a row twice. After a fleet was killed it may read short,
until the next ``yawid fleet`` on the data set completes its files; ``manifest.json`` names those
that count, and one that is missing from its place lies below ``_new`` meanwhile.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa

ANALYSIS_VERSION: Final = "3"
"""Raised where the same log gives other numbers than before: a fleet's logs are then run again."""
FORMAT: Final = 1
"""Of the data set's folders and manifest."""
OUTCOMES: Final = ("ok", "unusable", "crashed", "timeout", "unreadable", "failed")
"""Results of a log; ``failed``: a reason that may pass kept it from being read."""

ID: Final = pa.dictionary(pa.int32(), pa.string())
TIME: Final = pa.timestamp("us", tz="UTC")
TEXT, FLAG, NUMBER, COUNT = pa.string(), pa.bool_(), pa.float64(), pa.int64()
NUMBERS, COUNTS, IDS = pa.list_(pa.float64()), pa.list_(pa.int64()), pa.list_(pa.string())

Column = tuple[str, Any, str]
"""Name, type, what it says."""

_MADE_BY: Final[tuple[Column, ...]] = (
    ("yawid_version", ID, "version of yawid that made the row"),
    ("analysis_version", ID, "raised where the same log gives other numbers"),
    ("config_hash", ID, "of the options, and of a key's content: equal where they were equal"),
)
_KEYS: Final[tuple[Column, ...]] = (("log_sha256", ID, "of the log's bytes: see logs"), *_MADE_BY)
_WHOSE: Final[tuple[Column, ...]] = (
    ("vehicle", ID, "uuid:… or serial:… where the log tells one, else sysid:N"),
    ("sysid", COUNT, "MAVLink system id; NULL where no vehicle was heard"),
    ("boot", COUNT, "of the vehicle in the log, from 1"),
)
_JUDGED: Final[tuple[Column, ...]] = (
    ("usable", FLAG, "whether the answer may be used"),
    ("reasons", IDS, "ids of what forbids it, the first decides"),
    ("warnings", IDS, "ids of what it is warned of"),
    ("text", TEXT, "reasons and warnings in words"),
)
_ORDERS: Final[tuple[Column, ...]] = (
    ("method", ID, "els or rml"),
    ("na", COUNT, "order of A"),
    ("nb", COUNT, "order of each B"),
    ("nc", COUNT, "order of C"),
    ("nk", COUNT, "delay in samples"),
)
_DUTCH_ROLL: Final[tuple[Column, ...]] = (
    ("wn_rad_s", NUMBER, "Dutch roll, natural frequency"),
    ("wn_std", NUMBER, "rad/s"),
    ("wn_std_noise", NUMBER, "rad/s"),
    ("zeta", NUMBER, "Dutch roll, damping ratio"),
    ("zeta_std", NUMBER, "total sigma"),
    ("zeta_std_noise", NUMBER, "sigma of noise alone"),
    ("level", COUNT, "of MIL-F-8785C, 1 to 3; of the bare airframe alone"),
)
_OVER_SPEED: Final[tuple[Column, ...]] = (
    ("kappa_rad_m", NUMBER, "wn / V, V the equivalent airspeed; NULL without an airspeed"),
    ("kappa_std", NUMBER, "rad/m"),
    ("kappa_std_noise", NUMBER, "rad/m"),
    ("K_per_V", NUMBER, "K / V, rad/m per unit of rudder (half its travel, or rad)"),
    ("K_per_V_std", NUMBER, "as K_per_V"),
    ("K_per_V_std_noise", NUMBER, "as K_per_V"),
)
_CONDITION: Final[tuple[Column, ...]] = (
    ("loop", ID, "airframe, with_roll_loop or unknown: whose number it is"),
    ("airspeed_m_s", NUMBER, "airspeed, or what airspeed_source says: a ground speed"),
    ("airspeed_source", ID, "airspeed, or ground speed, which gives no kappa"),
    ("airspeed_kind", ID, "which airspeed the source gives; of a true one the equivalent stands"),
    ("altitude_m", NUMBER, "altitude"),
)
PHYSICS: Final = (
    ("K", "rad/s per unit of rudder"),
    ("T_theta_s", "s"),
    ("omega_beta", "rad/s"),
    ("xi_beta", "damping ratio"),
    ("a_z_beta", "1/s"),
    ("a_my_omega_y", "1/s"),
    ("a_my_beta", "1/s²"),
    ("a_my_delta_h", "1/s² per unit of rudder"),
    ("servo_tau_s", "s"),
)
"""Of eq. 22-23: name in the summary and unit; each has its total sigma beside it."""
FIT: Final = (
    "one_step_pct",
    "simulation_pct",
    "simulation_held_back_pct",
    "innovation_std",
    "residual_std",
    "whiteness_p",
    "spr_margin",
)
_MODEL: Final[tuple[Column, ...]] = (
    ("sample_time_s", NUMBER, "of the grid"),
    ("forgetting_factor", NUMBER, "per sample"),
    ("updates", COUNT, "samples that moved theta"),
    ("held", COUNT, "samples that did not"),
    ("theta_names", IDS, "names of theta's entries"),
    ("theta", NUMBERS, "the ARMAX model's parameters, in the order of theta_names"),
    ("theta_std", NUMBERS, "their sigmas, of noise"),
    *(
        column
        for name, unit in PHYSICS
        for column in ((name, NUMBER, unit), (f"{name}_std", NUMBER, f"sigma, {unit}"))
    ),
    *((name, NUMBER, "how well the model tells what was measured") for name in FIT),
)


@dataclass(frozen=True, slots=True)
class Table:
    """One table: its columns, what one row is, by what rows are sorted, if split by month.

    ``keys`` are the columns that no two rows have in common.
    """

    name: str
    row: str
    columns: Sequence[Column]
    keys: tuple[str, ...]
    order: tuple[str, ...]
    by_month: bool = True

    @property
    def schema(self) -> pa.Schema:
        """As it is written and read."""
        said = {"yawid": f"{self.name} {FORMAT}"}
        return pa.schema(
            [pa.field(name, kind, metadata={"says": says}) for name, kind, says in self.columns],
            metadata=said,
        )


LOGS: Final = Table(
    "logs",
    "a path: what came of it",
    (
        ("path", TEXT, "absolute path or URL"),
        ("size_bytes", COUNT, "size of the file"),
        ("modified", TEXT, "ETag where the store has one, else the file's time in ns since 1970"),
        ("log_sha256", ID, "of the log; NULL where nobody read it to its end"),
        ("file_sha256", TEXT, "of the file: another only of an MCAP, which was made from the log"),
        *_MADE_BY,
        ("outcome", ID, " | ".join(OUTCOMES)),
        ("reasons", IDS, "ids of what forbids an answer, or the outcome where that is none"),
        ("warnings", IDS, "ids of what the answers are warned of"),
        ("text", TEXT, "both in words, or the error"),
        ("kind", ID, "tlog, bin, ulg, csv, parquet or mcap"),
        ("date", TIME, "first record; NULL where the log does not know"),
        ("duration_s", NUMBER, "last record less first"),
        *(
            (name, COUNT, f"of the link: {says}")
            for name, says in (
                ("frames", "intact frames"),
                ("skipped_bytes", "bytes outside of frames"),
                ("bad_crc", "frames with a wrong CRC"),
                ("unknown", "frames of unknown messages"),
                ("lost", "lost by sequence number"),
                ("reboots", "reboots of the vehicle"),
                ("clock_steps", "steps of its clock"),
                ("gaps", "gaps"),
            )
        ),
        ("flights", COUNT, "rows of it in flights"),
        ("manoeuvres", COUNT, "rows of it in manoeuvres"),
    ),
    ("path",),
    ("path",),
    by_month=False,
)
FLIGHTS: Final = Table(
    "flights",
    "a boot of a vehicle in a log: its answer",
    (
        *_KEYS,
        *_WHOSE,
        ("compid", COUNT, "MAVLink component id"),
        ("vehicle_type", COUNT, "MAV_TYPE"),
        ("autopilot", COUNT, "MAV_AUTOPILOT"),
        ("date", TIME, "of the first manoeuvre used, else of the boot's first record"),
        ("duration_s", NUMBER, "of the boot"),
        ("answer", ID, "manoeuvres, or stream where there was none; NULL: nothing estimated"),
        *_ORDERS,
        *_CONDITION,
        *_DUTCH_ROLL,
        *_OVER_SPEED,
        ("between_wn_rad_s", NUMBER, "scatter of wn between manoeuvres"),
        ("between_zeta", NUMBER, "scatter of zeta between manoeuvres"),
        ("manoeuvres", COUNT, "found"),
        ("used", COUNTS, "numbers n of those the answer rests on"),
        ("disagree", COUNTS, "numbers n of those left out because they disagree"),
        ("rudder_source", ID, "channel of the rudder"),
        ("yaw_source", ID, "channel of the yaw rate"),
        ("rate_hz", NUMBER, "of the grid"),
        *_JUDGED,
    ),
    ("log_sha256", "sysid", "boot"),
    ("vehicle", "date", "log_sha256", "sysid", "boot"),
)
RUNS: Final = Table(
    "runs",
    "a flight and method: the stream's estimate at its end",
    (
        *_KEYS,
        *_WHOSE,
        ("date", TIME, "of the flight"),
        *_ORDERS,
        ("is_answer", FLAG, "whether the stream's verdict is of this method"),
        *_DUTCH_ROLL,
        *_MODEL,
        *_JUDGED,
    ),
    ("log_sha256", "sysid", "boot", "method"),
    ("vehicle", "date", "log_sha256", "sysid", "boot", "method"),
)
MANOEUVRES: Final = Table(
    "manoeuvres",
    "a manoeuvre: its conditions and its answer",
    (
        *_KEYS,
        *_WHOSE,
        ("n", COUNT, "number in the flight, from 1"),
        ("date", TIME, "of its first sample"),
        ("from_s", NUMBER, "since boot"),
        ("to_s", NUMBER, "since boot"),
        ("duration_s", NUMBER, "of the manoeuvre"),
        ("mode", ID, "flight mode"),
        ("airspeed_std_m_s", NUMBER, "scatter of the airspeed during it"),
        *_CONDITION,
        ("inputs", IDS, "of the model"),
        ("turn_removed", FLAG, "whether the turn was removed"),
        *_ORDERS,
        *_DUTCH_ROLL,
        *_OVER_SPEED,
        ("check_wn_rad_s", NUMBER, "wn by the method that checks"),
        ("check_zeta", NUMBER, "zeta by the method that checks"),
        *_MODEL,
        ("used", FLAG, "whether the flight's answer rests on it"),
        *_JUDGED,
    ),
    ("log_sha256", "sysid", "boot", "n"),
    ("vehicle", "date", "log_sha256", "sysid", "boot", "n"),
)
MODES: Final = Table(
    "modes",
    "a second of a flight: the stream's Dutch roll (with --modes alone)",
    (
        *_KEYS,
        *_WHOSE,
        ("date", TIME, "of the sample"),
        ("boot_s", NUMBER, "since boot"),
        ("method", ID, "els or rml"),
        ("held", FLAG, "whether the sample moved nothing"),
        ("wn_rad_s", NUMBER, "natural frequency"),
        ("wn_std_noise", NUMBER, "rad/s"),
        ("zeta", NUMBER, "damping ratio"),
        ("zeta_std_noise", NUMBER, "sigma of noise alone"),
    ),
    ("log_sha256", "sysid", "boot", "boot_s"),
    ("vehicle", "date", "log_sha256", "sysid", "boot", "boot_s"),
)
TABLES: Final = {table.name: table for table in (LOGS, FLIGHTS, RUNS, MANOEUVRES, MODES)}


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a row of each table, as duckdb or pandas turn it into JSON."""
    tables = {
        table.name: {
            "description": f"one row is {table.row}; unique: {', '.join(table.keys)}",
            "type": "object",
            "additionalProperties": False,
            "required": [name for name, *_ in table.columns],
            "properties": {
                name: {"description": says, **_json_type(kind)}
                for name, kind, says in table.columns
            },
        }
        for table in TABLES.values()
    }
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$defs": tables}


def schema_page() -> str:
    """Return the tables as a page of Markdown."""
    parts = [f"# Tables of a data set, format {FORMAT}\n\n{__doc__}"]
    for table in TABLES.values():
        sorted_by = f"unique: {', '.join(table.keys)}; sorted by {', '.join(table.order)}"
        lines = [f"## {table.name}", f"One row is {table.row}; {sorted_by}.", ""]
        lines += ["| column | type | what it says |", "|---|---|---|"]
        lines += [
            f"| {name} | {_type_name(kind)} | {says.replace('|', 'or')} |"
            for name, kind, says in table.columns
        ]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


_NAMES: Final = {
    ID: "id (dictionary)", TIME: "timestamp[us, UTC]", TEXT: "text", FLAG: "bool",
    NUMBER: "double", COUNT: "int64", NUMBERS: "list of double", COUNTS: "list of int64",
    IDS: "list of id",
}  # fmt: skip
_JSON: Final = {
    ID: "string", TEXT: "string", FLAG: "boolean", NUMBER: "number", COUNT: "integer",
    NUMBERS: "number", COUNTS: "integer", IDS: "string",
}  # fmt: skip


def _type_name(kind: Any) -> str:
    return _NAMES[kind]


def _json_type(kind: Any) -> dict[str, Any]:
    if kind == TIME:
        return {"type": ["string", "null"], "format": "date-time"}
    if kind in (NUMBERS, COUNTS, IDS):
        return {"type": ["array", "null"], "items": {"type": [_JSON[kind], "null"]}}
    return {"type": [_JSON[kind], "null"]}
