"""The tables of a data set: every column with its type, its unit and its meaning.

A value that does not apply is NULL, never NaN. A column's name ends in its unit; a number without
one has no unit. ``*_std`` is the total sigma of the number named before it, in the same unit;
``*_std_noise`` is the part of it that noise alone explains. Times are UTC.

Each table is one file, ``logs.parquet`` and so on, which the end of a fleet replaces as a whole.
After a fleet was killed they are those of the fleet before, until the next one ends. Only
``yawid fleet`` itself opens ``fleet.sqlite``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa

from yawid.quantities.table import YAW_CHANNEL, quantity

ANALYSIS_VERSION: Final = "6"
"""Version of the numbers: when the same log gives other numbers it is raised, and a fleet runs all
logs again."""
FORMAT: Final = 3
"""Version of the data set's files and columns: a data set of another one is refused."""

ID: Final = pa.dictionary(pa.int32(), pa.string())
TIME: Final = pa.timestamp("us", tz="UTC")
TEXT, FLAG, NUMBER, COUNT = pa.string(), pa.bool_(), pa.float64(), pa.int64()
NUMBERS, COUNTS, IDS = pa.list_(pa.float64()), pa.list_(pa.int64()), pa.list_(pa.string())

Column = tuple[str, Any, str]
"""A column's name, type and meaning."""


def _columns(kind: Any, *names: str) -> tuple[Column, ...]:
    """Return columns of one type, with the unit and words of the quantity of their name."""
    rows = [(name, quantity(name)) for name in names]
    return tuple(
        (name, kind, ", ".join(filter(None, (row.words, row.unit_for())))) for name, row in rows
    )


_MADE_BY: Final[tuple[Column, ...]] = (
    ("yawid_version", ID, "version of yawid that made the row"),
    ("analysis_version", ID, "raised whenever the same log would give other numbers"),
    ("config_hash", ID, "of the options, and of a key's content: equal where these were equal"),
)
_KEYS: Final[tuple[Column, ...]] = (("log_sha256", ID, "of the log's bytes: see logs"), *_MADE_BY)
_WHOSE: Final[tuple[Column, ...]] = (
    ("vehicle", ID, "by fleet --vehicle or --vehicle-from; else uuid:… or serial:…, else sysid:N"),
    *_columns(COUNT, "sysid", "boot"),
)
_JUDGED: Final[tuple[Column, ...]] = (
    *_columns(FLAG, "usable"),
    ("reasons", IDS, "ids of the fatal reasons; the first decides"),
    ("warnings", IDS, "ids of its warnings"),
    ("text", TEXT, "reasons and warnings in words"),
)
ORDERS: Final = _columns(COUNT, "na", "nb", "nc", "nk")
DUTCH_ROLL: Final = (
    *_columns(NUMBER, "wn_rad_s", "wn_std", "wn_std_noise", "zeta", "zeta_std", "zeta_std_noise"),
    *_columns(COUNT, "level"),
)
_OVER_SPEED: Final = _columns(
    NUMBER, "kappa_rad_m", "kappa_std", "kappa_std_noise",
    "K_per_V", "K_per_V_std", "K_per_V_std_noise",
)  # fmt: skip
RUNNING: Final = ("els", "rml")
"""The recursive methods whose numbers at the end of a manoeuvre are shown with its answer."""
BARE: Final = (
    ("bare_wn_rad_s", NUMBER, "wn of the bare airframe, rad/s; NULL where it is not known"),
    ("bare_wn_std", NUMBER, "total sigma"),
    ("bare_zeta", NUMBER, "zeta of the bare airframe"),
    ("bare_zeta_std", NUMBER, "total sigma"),
    ("bare_level", COUNT, "of MIL-F-8785C, 1 to 3, 4 is worse"),
    ("bare_roll_mode_s", NUMBER, "time constant of the bare airframe's roll mode, s"),
    ("bare_roll_mode_std", NUMBER, "total sigma"),
    ("bare_airspeed_m_s", NUMBER, "true airspeed of the bare airframe's numbers, m/s"),
)
"""The bare airframe."""
ORDINARY: Final = (
    ("ordinary_wn_rad_s", NUMBER, "wn from ordinary flight, rad/s; NULL where it is not known"),
    ("ordinary_wn_std", NUMBER, "total sigma"),
    ("ordinary_zeta", NUMBER, "zeta from ordinary flight"),
    ("ordinary_zeta_std", NUMBER, "total sigma"),
    ("ordinary_kappa_rad_m", NUMBER, "wn / V, V the equivalent airspeed; NULL of a ground speed"),
    ("ordinary_kappa_std", NUMBER, "total sigma"),
    ("ordinary_airspeed_m_s", NUMBER, "true airspeed of ordinary flight's numbers, m/s"),
    ("ordinary_altitude_m", NUMBER, "mean altitude of it; NULL of a ground speed"),
    ("ordinary_sums", TEXT, "sums of a flight that is too short, which add up; NULL of others"),
    ("ordinary_why", ID, "why it is not known: the first reason"),
)
"""The bare airframe's mode from ordinary flight."""
CONDITION: Final = (
    *_columns(ID, "loop"),
    *_columns(NUMBER, "airspeed_m_s"),
    *_columns(ID, "airspeed_source", "airspeed_kind"),
    *_columns(NUMBER, "altitude_m"),
)
OF_MANOEUVRE: Final = (
    *_columns(COUNT, "n"),
    *_columns(TIME, "date"),
    *_columns(NUMBER, "from_s", "to_s", "duration_s"),
    *_columns(ID, "mode"),
    *_columns(NUMBER, "airspeed_std_m_s"),
    *CONDITION,
    *_columns(IDS, "inputs"),
    *_columns(FLAG, "turn_removed"),
)
_MODEL: Final = (
    *_columns(NUMBER, "sample_time_s", "forgetting_factor"),
    *_columns(COUNT, "updates"),
    ("held", COUNT, "samples that did not move theta"),
    ("theta_names", IDS, "names of theta's entries"),
    ("theta", NUMBERS, "the ARMAX model's parameters, in the order of theta_names"),
    *_columns(NUMBERS, "theta_std"),
    *_columns(NUMBER, *(name + std for name in YAW_CHANNEL for std in ("", "_std"))),
    *_columns(
        NUMBER, "one_step_pct", "simulation_pct", "innovation_std", "residual_std", "whiteness_p",
        "spr_margin",
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Table:
    """One table: its name, what one ``row`` is, and its columns.

    ``keys`` are the columns in whose values any two rows differ; ``order`` are the columns by which
    rows are sorted.
    """

    name: str
    row: str
    columns: Sequence[Column]
    keys: tuple[str, ...]
    order: tuple[str, ...]

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema of the table's files."""
        return pa.schema(
            [pa.field(name, kind, metadata={"says": says}) for name, kind, says in self.columns],
            metadata={"yawid": f"{self.name} {FORMAT}"},
        )


LOGS: Final = Table(
    "logs",
    "a path: its outcome",
    (
        ("path", TEXT, "absolute path or URL"),
        ("size_bytes", COUNT, "size of the file"),
        ("modified", TEXT, "ETag where the store has one, else the file's time in ns since 1970"),
        ("log_sha256", ID, "of the log; NULL where it was not read to its end"),
        (
            "file_sha256",
            TEXT,
            "of the file; it differs only for an MCAP, which was made from the log",
        ),
        *_MADE_BY,
        (
            "outcome",
            ID,
            "ok | unusable | crashed | timeout | unreadable, or failed: not read for a reason that "
            "may pass",
        ),
        ("reasons", IDS, "ids of the fatal reasons, or the outcome where there are none"),
        ("warnings", IDS, "ids of the answers' warnings"),
        ("text", TEXT, "both in words, or the error"),
        ("kind", ID, "tlog, bin, ulg, csv, parquet or mcap"),
        ("date", TIME, "first record; NULL where the log has no date"),
        ("duration_s", NUMBER, "last record minus first"),
        *_columns(
            COUNT,
            "frames",
            "skipped_bytes",
            "bad_crc",
            "unknown",
            "lost",
            "reboots",
            "clock_steps",
            "gaps",
        ),
        ("flights", COUNT, "rows of it in flights"),
        ("manoeuvres", COUNT, "rows of it in manoeuvres"),
    ),
    ("path",),
    ("path",),
)
FLIGHTS: Final = Table(
    "flights",
    "a boot of a vehicle in a log: its answer, the headline",
    (
        *_KEYS,
        *_WHOSE,
        *_columns(COUNT, "compid"),
        ("vehicle_type", COUNT, "MAV_TYPE"),
        ("autopilot", COUNT, "MAV_AUTOPILOT"),
        ("date", TIME, "of the first manoeuvre used, else of the boot's first record"),
        ("duration_s", NUMBER, "of the boot"),
        ("answer", ID, "manoeuvres, or stream where there was none; NULL: nothing estimated"),
        *_columns(ID, "method"),
        *CONDITION,
        *DUTCH_ROLL,
        *_OVER_SPEED,
        ("between_wn_rad_s", NUMBER, "scatter of wn between manoeuvres"),
        ("between_zeta", NUMBER, "scatter of zeta between manoeuvres"),
        *BARE,
        *ORDINARY,
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
FLIGHTS_BY_LOOP: Final = Table(
    "flights_by_loop",
    "a loop (airframe, with roll loop, unknown) of a boot that has a usable manoeuvre: its answer; "
    "without any, the boot's row in flights",
    FLIGHTS.columns,
    (*FLIGHTS.keys, "loop"),
    (*FLIGHTS.order, "loop"),
)
RUNS: Final = Table(
    "runs",
    "a flight and method: the stream's estimate at its end",
    (
        *_KEYS,
        *_WHOSE,
        ("date", TIME, "of the flight"),
        *_columns(ID, "method"),
        *ORDERS,
        ("is_answer", FLAG, "whether the stream's answer is of this method"),
        *DUTCH_ROLL,
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
        *OF_MANOEUVRE,
        *_columns(ID, "method"),
        *DUTCH_ROLL,
        *_OVER_SPEED,
        *(
            (f"{method}_{number}", NUMBER, f"{words} of the running {method.upper()} at its end")
            for method in RUNNING
            for number, words in (("wn_rad_s", "wn, rad/s,"), ("zeta", "zeta"))
        ),
        *BARE,
        *_MODEL,
        ("used", FLAG, "whether the flight's answer for its loop rests on it"),
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
        *_columns(ID, "method"),
        ("held", FLAG, "whether the sample moved nothing"),
        *_columns(NUMBER, "wn_rad_s", "wn_std_noise", "zeta", "zeta_std_noise"),
    ),
    ("log_sha256", "sysid", "boot", "boot_s"),
    ("vehicle", "date", "log_sha256", "sysid", "boot", "boot_s"),
)
TABLES: Final = {
    table.name: table for table in (LOGS, FLIGHTS, FLIGHTS_BY_LOOP, RUNS, MANOEUVRES, MODES)
}


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of a row of each table, in the form that duckdb or pandas write."""
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
        lines += ["| column | type | what it holds |", "|---|---|---|"]
        lines += [
            f"| {name} | {_NAMES[kind]} | {says.replace('|', 'or')} |"
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
    ID: "string", TIME: "string", TEXT: "string", FLAG: "boolean", NUMBER: "number",
    COUNT: "integer", NUMBERS: "number", COUNTS: "integer", IDS: "string",
}  # fmt: skip


def _json_type(kind: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"type": [_JSON[kind], "null"]}
    if kind in (NUMBERS, COUNTS, IDS):
        return {"type": ["array", "null"], "items": found}
    return found | ({"format": "date-time"} if kind == TIME else {})
