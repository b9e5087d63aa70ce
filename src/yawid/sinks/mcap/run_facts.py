"""What a run's file says of itself, and its rows: checked, so that nobody need ask again.

Anybody may have written the file: what is of another type or size is one line here, not an error
far below. Its summary is checked in :mod:`yawid.results.run_summary`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from typing import Final

import numpy as np

from yawid.blocks import Status
from yawid.config.run import RunConfig, check_settings
from yawid.estimation.polynomials import parameter_names
from yawid.sinks.base import Grid, rudder_unit
from yawid.sinks.mcap.messages import Rows

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
