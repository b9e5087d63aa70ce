"""The search for the table's columns in a file, and for their units where these are given."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from yawid.errors import ChannelError, ConfigError, SourceError
from yawid.quantities.table import CHANNELS, TEXTS
from yawid.quantities.units import HALF_TRAVEL, UNITS, Unit, unit_of
from yawid.sources.records.headers import ANGLES, Header, by_suffix, fits, header_of, is_column

if TYPE_CHECKING:
    from yawid.sources.records.tables import Table  # pyarrow is for those who read one

LIKELY: Final = {
    "t": "time timestamp sec",
    "rudder": "rud deltar dr",
    "r": "yawrate yawspeed gyroz wz ratez",
    "aileron": "ail deltaa da",
    "roll": "phi bank",
    "pitch": "theta",
    "yaw": "psi heading hdg",
    "q": "pitchrate",
}
"""The beginnings of other names for the columns: they are only suggested in errors, never used."""
WITHOUT_UNIT: Final = TEXTS | {
    name for name, row in CHANNELS.items() if row.unit == "1" or not (row.kind or row.kept)
}
"""The columns whose units do not matter: p may be a pressure where no bare airframe is asked."""
LATERAL: Final = ("p", "ay")
"""The columns that only the bare airframe needs."""
_WITH_UNIT: Final = re.compile(r"(.+?)\s*\[([^\[\]]+)\]", re.DOTALL)
RUDDER_UNIT: Final = {"--rudder-unit": "half-travel/rad/deg"}
SIGN: Final = {"--rudder-sign": "nose-right/nose-left"}
UNITS_OPTION: Final = {"--units": "deg/rad"}
"""Options that give a fact, with the values of which the user chooses one."""


@dataclass(frozen=True, slots=True)
class Asked:
    """The options about a record, None where not given; ``needs`` has further columns needed."""

    columns: tuple[str, ...] = ()
    units: str | None = None
    rudder_unit: str | None = None
    rudder_sign: str | None = None
    rudder_max_deg: float | None = None
    needs: tuple[str, ...] = ()
    rudder_is: str | None = None
    lateral: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """A file's column that is one of the table's, and its unit, None where it is not given."""

    place: int
    header: Header
    unit: Unit | None = None
    spelt: str = ""

    @property
    def label(self) -> str:
        """The column's name in words, with its unit."""
        return f"{self.header.name} [{self.spelt}]" if self.spelt else self.header.name


def find_columns(table: "Table", asked: Asked) -> dict[str, Found]:
    """Return a file's columns by the table's names: those of options, else by their own names.

    Raises:
        ConfigError: an option names a column that is missing, or an unknown unit.
        ChannelError: time, rudder, yaw rate, or another column that is needed, is missing.
        SourceError: two columns have one name, or a column has a unit that does not fit.
    """
    pairs = zip(table.names, table.units, strict=True)
    headers = [header_of(*each) for each in pairs]
    found: dict[str, Found] = {}
    for said in asked.columns:
        name, place, spelt = _mapped(table, headers, said)
        found[name] = _with_unit(table, name, place, headers[place], spelt, asked)
    mapped, taken = set(found), {each.place for each in found.values()}
    for place, header in enumerate(headers):
        own = is_column(header.name)
        if own is None or own in mapped or place in taken:
            continue
        if own in found:
            raise SourceError(
                f"{table.path}: two columns are {own}: {found[own].header.name} and "
                f"{header.name}; name one by --columns {own}=COLUMN"
            )
        found[own] = _with_unit(table, own, place, header, None, asked)
    if "t" not in found and "time" in found and table.dates_ns(found["time"].place) is not None:
        found["t"] = found["time"]
    missing = [name for name in ("t", "rudder", "r", *asked.needs) if name not in found]
    if missing:
        raise ChannelError(_missing(table, missing, headers, found, asked))
    return found


def _mapped(table: "Table", headers: list[Header], said: str) -> tuple[str, int, str | None]:
    """Return name, place and unit from an option ``NAME=COLUMN`` or ``NAME=COLUMN[unit]``."""
    name, _, wanted = (part.strip() for part in said.partition("="))
    if name not in CHANNELS or not wanted:
        names = ", ".join(CHANNELS)
        raise ConfigError(f"--columns takes NAME=COLUMN, NAME one of {names}; got {said!r}")
    spelt, places = None, _called(table, headers, wanted)
    if not places and (parts := _WITH_UNIT.fullmatch(wanted)):
        wanted, spelt = parts.groups()
        places = _called(table, headers, wanted)
        if unit_of(spelt) is None:
            raise ConfigError(f"--columns {said}: {spelt!r} is not a known unit")
    if len(places) != 1:
        what = f"{len(places)} columns are" if places else "no column is"
        raise ConfigError(
            f"--columns {said}: {what} called {wanted} in {table.path}, which has "
            f"{', '.join(table.names)}"
        )
    return name, places[0], spelt


def _called(table: "Table", headers: list[Header], name: str) -> list[int]:
    both = zip(table.names, headers, strict=True)
    return [i for i, (whole, header) in enumerate(both) if name in (whole, header.name)]


def _with_unit(
    table: "Table", name: str, place: int, header: Header, spelt: str | None, asked: Asked
) -> Found:
    """Return a column with its unit: that of an option, the header, its name, or ``--units``."""
    units = asked.units
    if name in WITHOUT_UNIT and not (asked.lateral and name in LATERAL):
        return Found(place, header)
    own = CHANNELS[name].unit
    said = spelt or header.unit or by_suffix(header.name, name)
    if said is None and units is not None and own in ANGLES:
        said = own.replace("rad", units)
    if said is None:
        return Found(place, header)
    unit = unit_of(said)
    if unit is None or not fits(unit, name):
        likely = [each for each, unit in UNITS.items() if unit.symbol == own][:4]
        wanted = ["half-travel", "rad", "deg"] if own == HALF_TRAVEL else likely
        raise SourceError(
            f"{table.path}, column {header.name}: its unit is {said!r}, and {name} needs one of "
            f"{', '.join(wanted)}: give it by --columns '{name}={header.name}[{own}]'"
        )
    return Found(place, header, unit, said)


def _missing(
    table: "Table", missing: list[str], headers: list[Header], found: dict[str, Found], asked: Asked
) -> str:
    """Return in words which columns are missing, which others may be meant, and what to type."""
    taken = {found[said.partition("=")[0].strip()].place for said in asked.columns}
    plain = {
        place: re.sub(r"[^a-z0-9]", "", header.name.lower())
        for place, header in enumerate(headers)
        if place not in taken
    }
    near: dict[str, Header] = {}
    for name in missing:
        begins = tuple(LIKELY.get(name, name).split())
        place = next((i for i, text in plain.items() if text.startswith(begins)), None)
        near[name] = Header("COLUMN", None) if place is None else headers[place]
    columns = [*asked.columns, *(f"{name}={header.name}" for name, header in near.items())]
    means = ", ".join(f"{name} ({CHANNELS[name].words})" for name in missing)
    return (
        f"{table.path}: no column is {means}: name it by "
        f"{line_of(columns, _also_lacking(near, found, asked))}; there are {', '.join(table.names)}"
    )


def _also_lacking(near: dict[str, Header], found: dict[str, Found], asked: Asked) -> dict[str, str]:
    """Return the options for units and sign that will be asked for once the columns are named."""
    units = {name: header.unit or by_suffix(header.name, name) for name, header in near.items()}
    rudder = near["rudder"] if "rudder" in near else found["rudder"].header
    unit = (units | {name: each.spelt for name, each in found.items()})["rudder"]
    unit = unit or asked.rudder_unit
    options = {} if unit else dict(RUDDER_UNIT)
    if unit != HALF_TRAVEL and not (rudder.sign or asked.rudder_sign):
        options |= SIGN
    angles = [name for name in near if CHANNELS[name].unit in ANGLES]
    if asked.units is None and not all(units[name] for name in angles):
        options |= UNITS_OPTION
    return options


class LackingError(ConfigError):
    """A fact that neither the file nor an option gives.

    ``what`` says it in a few words; ``options`` give it; ``columns`` are parts of ``--columns``.
    """

    def __init__(
        self, said: str, what: str, options: Mapping[str, str], columns: tuple[str, ...] = ()
    ) -> None:
        super().__init__(said)
        self.what, self.options, self.columns = what, options, columns


@contextmanager
def gathered(lacking: list[LackingError]) -> Iterator[None]:
    """Keep an error about a lacking fact in a list, so that the next fact is looked at too."""
    try:
        yield
    except LackingError as error:
        lacking.append(error)


def raise_all(path: Path, lacking: list[LackingError], given: tuple[str, ...]) -> None:
    """Raise one error that asks for all lacking facts; ``given`` is what ``--columns`` has now.

    Raises:
        ConfigError: there is a lacking fact.
    """
    if len(lacking) == 1:
        raise lacking[0]
    if lacking:
        options = {name: said for each in lacking for name, said in each.options.items()}
        columns = [part for each in lacking for part in each.columns]
        named = {part.partition("=")[0]: part for part in (*given, *columns)} if columns else {}
        raise ConfigError(
            f"{path}: not given are {'; '.join(each.what for each in lacking)}: add "
            f"{line_of(list(named.values()), options)}"
        )


def line_of(columns: list[str], options: Mapping[str, str]) -> str:
    """Return options as they are typed, and what to do where one offers several values."""
    typed = [f"--columns '{','.join(columns)}'"] if columns else []
    typed += [" ".join(each) for each in options.items()]
    return " ".join(typed) + (", with one of the values at each /" if options else "")
