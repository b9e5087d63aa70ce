"""A record's airspeed: the equivalent one, converted from the kind that its unit or name gives."""

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from yawid.blocks import Floats
from yawid.errors import ConfigError, SourceError
from yawid.quantities.airspeed import (
    Kind,
    density_ratio,
    equivalent_of_calibrated,
    equivalent_of_true,
    known,
    name_of,
)
from yawid.quantities.table import BY_GROUND
from yawid.quantities.units import KIND_WORDS
from yawid.sources.records.column_values import place_of
from yawid.sources.records.find_columns import Found
from yawid.sources.records.rows import newest, same
from yawid.sources.records.tables import Table

_WORD: Final = re.compile(r"[a-z]+")
_NAMES: Final = KIND_WORDS | {"true": Kind.TRUE}
FAST_M_S: Final = 100.0
"""Below this, calibrated and equivalent airspeed differ by less than 1 % up to 3000 m."""


def airspeed_of(
    table: Table, found: Mapping[str, Found], have: Mapping[str, Floats], *, has_held: bool
) -> dict[str, Floats]:
    """Return the columns of airspeed, (n,): see :class:`yawid.blocks.RecordBlock`.

    The ground speed is used if the file has no airspeed, and in a run's export where that says so.
    A column of zeros, from a missing sensor, is no airspeed.

    Raises:
        ConfigError: the conversion needs the air's density, which is unknown.
        SourceError: a cell is not understood.
    """
    nothing = same(np.nan, table.rows)
    air, ground = have.get("airspeed", nothing), have.get("ground_speed", nothing)
    if not np.isfinite(known(air)).any():
        air = nothing
    has_airspeed, kind = air is not nothing, nothing
    if has_airspeed:
        given = _kind(found["airspeed"])
        air = _equivalent(table, found["airspeed"], given, air, have)
        kind = same(float(given), table.rows)
    if air is nothing and ground is nothing and "airspeed_kind" not in found:
        none = dict.fromkeys(("airspeed", "ground_speed", "airspeed_kind"), nothing)
        return none | {"by_ground": same(0.0, table.rows)}
    stands_in = np.isnan(air) & np.isfinite(ground) & (has_held or not has_airspeed)
    if "airspeed_kind" in found:
        kind, by_ground = _named(table, found["airspeed_kind"])
        stands_in &= by_ground | ~np.full(table.rows, has_held)
    kind = np.where(stands_in, np.nan, kind)
    speed = np.where(stands_in, ground, air)
    return {
        "airspeed": speed, "by_ground": stands_in.astype(float), "ground_speed": ground,
        "airspeed_kind": kind,
    }  # fmt: skip


def _kind(found: Found) -> Kind:
    """Return the kind of airspeed that the unit gives, else the column's name, else equivalent."""
    if found.unit is not None and found.unit.airspeed is not None:
        return found.unit.airspeed
    said = (_NAMES[word] for word in _WORD.findall(found.header.name.lower()) if word in _NAMES)
    return next(said, Kind.EQUIVALENT)


def _equivalent(
    table: Table, found: Found, kind: Kind, air: Floats, have: Mapping[str, Floats]
) -> Floats:
    """Return an airspeed (n,) of this kind as the equivalent airspeed."""
    nothing = same(np.nan, len(air))
    height = newest(have.get("altitude", nothing))
    if kind is Kind.TRUE:
        ratio = density_ratio(height, newest(have.get("air_density", nothing)))
        if not np.isfinite(ratio).any():
            raise ConfigError(
                f"{place_of(table, found)}: it is a true airspeed, and neither altitude nor air "
                "density is known, which are needed to convert it: name a column by --columns "
                "'altitude=COLUMN[m]' or 'air_density=COLUMN[kg/m^3]'"
            )
        return equivalent_of_true(air, ratio)
    if kind is Kind.EQUIVALENT:
        return air
    converted = equivalent_of_calibrated(air, height)
    fast = known(air) > FAST_M_S
    if (fast & np.isnan(converted)).any():
        raise ConfigError(
            f"{place_of(table, found)}: it is a {name_of(kind)} airspeed of up to "
            f"{np.nanmax(known(air)):.0f} m/s, where the air's compression matters, and the "
            "altitude is not known: name a column by --columns 'altitude=COLUMN[m]'"
        )
    return np.where(np.isfinite(converted), converted, air)


def _named(
    table: Table, found: Found
) -> tuple[Floats, "np.ndarray[tuple[int], np.dtype[np.bool_]]"]:
    """Return the kinds (n,) that a run's export names, and where they name the ground speed."""
    texts, row_has = table.words(found.place) or ([""], np.zeros(table.rows, np.int64))
    codes = {str(name_of(kind)): float(kind) for kind in Kind} | {"": np.nan, BY_GROUND: np.nan}
    if strange := set(texts) - codes.keys():
        raise SourceError(
            f"{place_of(table, found)}: {min(strange)!r} is not a kind of airspeed that yawid "
            "export writes: leave the column out"
        )
    kinds, are_ground = [codes[text] for text in texts], [t == BY_GROUND for t in texts]
    return np.array(kinds)[row_has], np.array(are_ground)[row_has]
