"""``yawid simulate``: simulate a reference plant of the paper and write its record to a file."""

import csv
import io
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from yawid.blocks import Floats
from yawid.channels.stage import WANTED
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.pipeline import Pipeline
from yawid.plant.excitation import Excitation, Kind
from yawid.plant.simulate import SPEED_M_S, PlantName, Simulation, simulate_plant
from yawid.quantities.units import HALF_TRAVEL
from yawid.results.summary import summarise
from yawid.runs.job import feed_all
from yawid.runs.outputs import Outputs, finish, open_mcap, parameters_of, whole_or_none
from yawid.sinks.door import print_text
from yawid.sources.open_log import in_memory
from yawid.sources.simulated_tlog import tlog_of
from yawid.system.part_file import check_free, write_whole

FULL_RUDDER_RAD = np.deg2rad(25.0)
"""The deflection that a simulated tlog holds as full travel; a replay with --rudder-max-deg 25
gives it in radians again."""
COLUMNS = {
    "t": ("t", "s"),
    "rudder": ("u", "rad nose-right held"),
    "r": ("y", "rad/s"),
    "yaw": ("yaw", "rad"),
    "roll": ("roll", "rad"),
}
"""A record's columns: name of each, with the field of :class:`Simulation` and the unit.

A record with these units needs no option to be replayed."""
OF_LATERAL = {"p": ("p", "rad/s"), "ay": ("ay", "m/s^2")}
"""The further columns of the lateral plant, whose aileron and pitch rest."""
STDOUT = Path("-")
UNIT_S = 0.7
"""The length of the 1 of a 3-2-1-1, of half a doublet and of a PRBS bit."""
MOST_SAMPLES = 5_000_000
"""The largest number of samples: about a day at 50 Hz, which fits into a small machine's memory."""


def simulate_to_file(
    plant: PlantName,
    kind: Kind,
    out: Path,
    *,
    amplitude: float,
    seconds: float,
    rate_hz: float,
    noise_std: float,
    force: bool,
) -> None:
    """Simulate and write to ``out``, whose suffix is the format: csv, tlog or mcap.

    ``-`` is a CSV on stdout. ``kind`` and ``amplitude`` (rad) describe the input.

    Raises:
        ConfigError: another suffix, or a value outside its limits.
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """
    if not 1.0 <= rate_hz <= 1000.0:
        raise ConfigError(f"--rate must lie in 1 to 1000 Hz, got {rate_hz!r}")
    least, most = 1.0 / rate_hz, MOST_SAMPLES / rate_hz
    if not least <= seconds <= most:
        text = f"in {least:g} to {most:.0f} at {rate_hz:g} Hz, got {seconds!r}"
        raise ConfigError(f"--seconds must lie {text}")
    start_s = 5.0 if seconds > 20.0 else 0.0
    excitation = Excitation(kind=kind, amplitude=amplitude, start_s=start_s, unit_s=UNIT_S)
    writers = {".csv": _csv, ".tlog": _tlog}
    if out.suffix not in (*writers, ".mcap") and out != STDOUT:
        raise ConfigError(f"--out must end in .csv, .tlog or .mcap, or be -, got {out}")
    simulation = simulate_plant(
        plant,
        excitation,
        duration_s=seconds,
        sample_time_s=1.0 / rate_hz,
        noise_std=noise_std,
    )
    if out.suffix == ".mcap":
        _mcap(simulation, out, rate_hz, force)
    elif out == STDOUT:
        print_text(_csv(simulation).decode())
    else:
        check_free(out, force=force)
        write_whole({out: writers[out.suffix](simulation)}, force=force)


def _columns(simulation: Simulation) -> dict[str, tuple[Floats, str]]:
    """Return values (n,) and unit of each column of a record."""
    wanted = COLUMNS | ({} if simulation.p is None else OF_LATERAL)
    found = {name: (getattr(simulation, field), unit) for name, (field, unit) in wanted.items()}
    if simulation.p is not None:
        rest = np.zeros(len(simulation.t))
        found |= {
            "aileron": (rest, HALF_TRAVEL), "airspeed": (rest + SPEED_M_S, "m/s"),
            "pitch": (rest, "rad"), "q": (rest, "rad/s"),
        }  # fmt: skip
    return found


def _csv(simulation: Simulation) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    columns = _columns(simulation)
    writer.writerow(columns)
    writer.writerow([unit for _, unit in columns.values()])
    rows = zip(*(values.tolist() for values, _ in columns.values()), strict=True)
    writer.writerows([f"{value:.12g}" for value in row] for row in rows)
    return text.getvalue().encode()


def _tlog(simulation: Simulation) -> bytes:
    share = simulation.u / FULL_RUDDER_RAD
    if np.abs(share).max() > 1.0:
        raise ConfigError(
            "the rudder exceeds 25 degrees, its full travel in a tlog: choose a smaller --amplitude"
        )
    y, yaw, roll = simulation.y, simulation.yaw, simulation.roll
    return tlog_of(simulation.t, share, y, yaw, roll, SPEED_M_S, simulation.p)


def _mcap(simulation: Simulation, out: Path, rate_hz: float, force: bool) -> None:
    """Write what a replay of the simulated tlog would write."""
    config = replace(RunConfig(), rate=min(rate_hz, 20.0), memory=math.inf)
    outputs = Outputs(out.parent, out.stem, force=force)
    source = in_memory([_tlog(simulation)], WANTED)
    sinks = [open_mcap(config, outputs)]
    with whole_or_none(sinks):
        pipeline = Pipeline(config, sinks)
        feed_all(source, pipeline)
        summary = summarise(pipeline, source.link, str(out), "")
        finish(pipeline, summary, outputs.files(), parameters_of(pipeline))
