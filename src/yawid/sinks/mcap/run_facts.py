"""What a run's file says of itself, and its rows: checked, so that nobody need ask again.

Anybody may have written the file: what is of another type or size is one line here, not an error
far below. Keys of the summary that are not named here may hold anything; they are only ever shown.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from yawid.blocks import Status
from yawid.config.run import RunConfig, check_settings
from yawid.estimation.polynomials import parameter_names
from yawid.sinks.base import Grid, rudder_unit
from yawid.sinks.mcap.messages import Rows

LARGEST: Final = 1e300
"""Of a number in a summary: an estimate that diverged is still shown, infinity is not."""
LARGEST_SAMPLE: Final = 9e9
"""Of a value in a sample; seconds of Unix time are such values, and go into integers of ns."""


def read_config(data: bytes | None) -> RunConfig:
    """Return the configuration that a file holds as TOML.

    Raises:
        ValueError: there is none, or this version cannot use it.
    """
    if data is None:
        raise ValueError("it holds no configuration")
    try:
        settings = tomllib.loads(data.decode())
        return RunConfig(**check_settings(settings, "configuration.toml"))
    except (ValueError, OverflowError, RecursionError) as error:
        raise ValueError(f"its configuration cannot be used: {error}") from error


def read_grid(record: Mapping[str, str] | None, config: RunConfig) -> Grid | None:
    """Return the grid that a file's metadata tell, None where the run never came to one.

    Files of 0.1.0 do not say whose modes the flight modes are: those keep their numbers.

    Raises:
        ValueError: it makes no sense, or is not of the configuration.
    """
    if record is None:
        return None
    try:
        parameters, inputs, methods = (
            tuple(record[name].split()) for name in ("parameters", "inputs", "methods")
        )
        autopilot, kind = (int(record.get(name, "0")) for name in ("autopilot", "vehicle_type"))
        unit, sample_time_s = rudder_unit(config.rudder_max_deg), float(record["sample_time_s"])
        grid = Grid(parameters, inputs, methods, sample_time_s, unit, autopilot, kind)
    except (KeyError, ValueError) as error:
        raise ValueError(f"its grid cannot be read: {error!r}") from error
    names = parameter_names(config.armax_orders(), config.inputs, bias=True)
    if (parameters, inputs, methods) != (names, config.inputs, config.bank_methods()):
        raise ValueError("its grid is not that of its configuration")
    if not 1e-6 < grid.sample_time_s < math.inf:
        raise ValueError(f"a sample time of {grid.sample_time_s!r} s makes no sense")
    return grid


def checked(found: list[Rows], grid: Grid) -> list[Rows]:
    """Return rows (n,) of several topics, the samples first.

    Raises:
        ValueError: they have other columns than the grid says, or hold what no run writes.
    """
    p = len(grid.parameters)
    widths = {"u": len(grid.inputs), "theta": p, "theta_std": p}
    for rows in found:
        names = set(rows.dtype.names or ())
        if any(rows[name].shape[1] != widths[name] for name in widths.keys() & names):
            raise ValueError("a message has other columns than the grid says")
        if "status" in names and rows["status"].max() > max(Status):
            raise ValueError("an estimator has a status that there is not")
    samples = found[0]
    for name in samples.dtype.names or ():
        if samples[name].dtype.kind == "f":
            sound = np.abs(samples[name]) < LARGEST_SAMPLE
            if not np.all(sound if name.endswith("_time") else sound | np.isnan(samples[name])):
                raise ValueError(f"{name} of a sample is absurd")
    return found


def read_summary(data: bytes) -> dict[str, Any]:
    """Return the summary that a file holds as JSON.

    Raises:
        ValueError: it is no JSON, or a key that is read from it is not as yawid writes it.
    """
    try:
        # Half a surrogate pair can stand in JSON and in no file: it becomes a question mark.
        text = json.dumps(json.loads(data), ensure_ascii=False).encode("utf-8", "replace")
        summary = json.loads(text)
        _check(summary, _SUMMARY, "")
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    assert isinstance(summary, dict)  # or the check had refused it
    return summary


def _number(value: Any) -> bool:
    is_one = isinstance(value, int | float) and not isinstance(value, bool)
    return is_one and abs(value) <= LARGEST


def _positive(value: Any) -> bool:
    return _number(value) and value > 0


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _truth(value: Any) -> bool:
    return isinstance(value, bool)


Shape = Callable[[Any], bool] | Mapping[str, Any] | list[Any]
_WORDS: Final[dict[Callable[[Any], bool], str]] = {
    _number: "a number",
    _positive: "a number above 0",
    _text: "a text",
    _truth: "true or false",
}
_SIGMAS: Final = {"wn_std?": _number, "zeta_std?": _number}
_NUMBERS: Final = {"*": _number}
# A name with "?" may be absent; "*" is every name there is.
_ESTIMATE: Final = {
    "method": _text,
    "orders": dict.fromkeys(("na", "nb", "nc", "nk"), _number),
    "sample_time_s": _positive,
    "updates": _number,
    "held": _number,
    "theta": _NUMBERS,
    "theta_std?": _NUMBERS,
    "modes?": [{"kind": _text, "wn_rad_s?": _number, "zeta?": _number, **_SIGMAS}],
    "dutch_roll?": {"wn_rad_s": _positive, "zeta": _number, "level?": _number, **_SIGMAS},
    "physics?": {"*": {"value?": _number, "std?": _number}},
    "fit": _NUMBERS,
}
_SUMMARY: Final = {
    "log?": _text,
    "sha256?": _text,
    "bytes_read?": _number,
    "duration_s?": _number,
    "source?": {},
    "vehicle?": {},
    "link": {"clock_leap_s?": _number},
    "channels": {"*": {"source": _text, "rate_hz?": _positive, "first_rate_hz?": _positive}},
    "estimates?": {"*": _ESTIMATE},
    "verdict": {
        "method?": _text,
        "usable": _truth,
        "reasons": [{"id": _text, "weight": _text, "text": _text}],
    },
}


def _check(value: Any, shape: Shape, where: str) -> None:
    if isinstance(shape, Mapping):
        _check_keys(value, shape, where)
    elif isinstance(shape, list):
        if not isinstance(value, list):
            raise _wrong(where, "a list", value)
        for i, entry in enumerate(value):
            _check(entry, shape[0], f"{where}[{i}]")
    elif not shape(value):
        raise _wrong(where, _WORDS[shape], value)


def _check_keys(value: Any, shape: Mapping[str, Any], where: str) -> None:
    if not isinstance(value, dict):
        raise _wrong(where, "an object", value)
    named = {name.removesuffix("?"): inner for name, inner in shape.items() if name != "*"}
    for name, inner in named.items():
        if name in value:
            _check(value[name], inner, f"{where}.{name}" if where else name)
        elif f"{name}?" not in shape:
            raise ValueError(f"{where or 'it'} lacks {name}")
    for name in value.keys() - named.keys() if "*" in shape else ():
        _check(value[name], shape["*"], f"{where}.{name}" if where else name)


def _wrong(where: str, wanted: str, value: Any) -> ValueError:
    shown = repr(value)[:60] if isinstance(value, str | int | float | None) else "something else"
    return ValueError(f"{where or 'it'} must be {wanted}, not {shown}")
