"""``yawid.load`` and ``yawid.replay``, which give a run in Python from its file or from a log."""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from yawid.answers.run_summary import Bare, Flight, RunSummary
from yawid.blocks import EstimateBlock, ModesBlock, SampleBlock
from yawid.config.run import RunConfig
from yawid.sinks.base import Grid, Sink, rudder_unit
from yawid.sinks.mcap.messages import RunRows, joined
from yawid.tables.columns import (
    Units,
    estimate_columns,
    further_columns,
    manoeuvre_columns,
    mode_columns,
    record_columns,
    sample_columns,
)
from yawid.tables.table import Column, Table

if TYPE_CHECKING:
    from yawid.damper.study import Study

PARAMETERS: Final = "parameters.txt"
OF_FILES: Final = ("out", "force", "json", "rerun")
"""Options of the output files that a TOML file may hold for the command line: ignored here."""


class Run:
    """A run as tables: columns are NumPy arrays with units, rows are samples or manoeuvres.

    ``summary`` is what ``--json`` prints, ``config`` the configuration, ``path`` the file that was
    read, ``parameters`` the vehicle's by name. Each table is made when it is first used.
    """

    def __init__(
        self,
        path: Path,
        summary: RunSummary,
        config: RunConfig,
        grid: Grid | None,
        rows: RunRows | None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.path, self.summary, self.config = path, summary, config
        self.parameters = {} if parameters is None else parameters
        self._rows = no_rows() if rows is None else rows
        if grid is None:
            grid = Grid((), config.inputs, (), math.nan, rudder_unit(in_rad=config.in_rad))
        self._known = Units(grid, config)

    @property
    def flight(self) -> Flight | None:
        """The flight's answer, the headline; None where there was no manoeuvre."""
        return self.summary.flight

    @property
    def flights(self) -> list[Flight]:
        """The flight's answers, one for each loop (airframe, with roll loop), the headline first.

        Without a usable manoeuvre there is only the one that says why, if any.
        """
        return self.summary.by_loop

    @cached_property
    def samples(self) -> Table:
        """The measured channels, a row for each sample, also for held ones."""
        samples, known = self._rows.samples, self._known
        columns = [*sample_columns(samples, known), *further_columns(samples, known)]
        return Table("samples", columns)

    @cached_property
    def estimates(self) -> Mapping[str, Table]:
        """The estimates by method, the primary one first: theta, sigmas, prediction, per sample."""
        return {
            method: self._made_of(
                f"estimates by {method}",
                estimate_columns(self._rows.samples, estimate, self._known),
            )
            for method, estimate in self._rows.estimates.items()
        }

    @cached_property
    def modes(self) -> Table:
        """The primary method's Dutch roll, poles and numbers of eq. 22-23, a row per sample."""
        return self._made_of("modes", mode_columns(self._rows, self._known))

    @cached_property
    def manoeuvres(self) -> Table:
        """The manoeuvres with their conditions, answers and theta; no row where none was found."""
        return Table("manoeuvres", [*manoeuvre_columns(self.summary, self._known)])

    @property
    def bare(self) -> Bare | None:
        """The bare airframe of the flight; None without ``lateral="auto"`` or a manoeuvre."""
        return self.summary.bare

    @cached_property
    def record(self) -> Table:
        """The samples with the primary method's results, as ``yawid export`` writes them."""
        return self._made_of("samples and results", record_columns(self._rows, self._known))

    def _made_of(self, title: str, columns: Iterable[Column]) -> Table:
        """Return a table of results, whose title marks a run that is not usable."""
        mark = "" if self.summary.deciding.usable else " (of a run that is NOT USABLE)"
        return Table(title + mark, [*columns])

    def to_pandas(self) -> Any:
        """Return ``record`` as a pandas.DataFrame; see :meth:`Table.to_pandas`."""
        return self.record.to_pandas()

    def to_polars(self) -> Any:
        """Return ``record`` as a polars.DataFrame; see :meth:`Table.to_polars`."""
        return self.record.to_polars()

    def to_xarray(self) -> Any:
        """Return ``record`` as an xarray.Dataset; see :meth:`Table.to_xarray`."""
        return self.record.to_xarray()

    def damper(
        self,
        *,
        aim: float | None = None,
        autopilot: str | None = None,
        loop_rate: float | None = None,
        airspeed: tuple[float, float] | None = None,
        parameters: Mapping[str, float] | None = None,
        gains: Sequence[float] = (),
    ) -> "Study":
        """Return which gain of the autopilot's yaw damper gives which damping.

        ``aim`` is the damping ratio aimed at, ``loop_rate`` the autopilot's in Hz, ``airspeed`` the
        lowest and highest in m/s; ``parameters`` stand in for those of the log, and ``gains`` are
        shown. ``.report`` is what ``yawid damper --json`` prints; where nothing can be said, its
        verdict says why.

        Raises:
            ConfigError: a value is outside its limits, or the run has no samples.
        """
        from yawid.damper.study import Asked, Facts, study

        asked = Asked(aim, autopilot, loop_rate, airspeed, parameters or {}, gains)
        samples = self._rows.samples
        sample_time_s = self._known.grid.sample_time_s
        facts = Facts(self.summary, self.config, sample_time_s, [samples], self.parameters)
        return study(facts, asked)

    def _tables(self) -> list[Table]:
        return [self.samples, *self.estimates.values(), self.modes, self.manoeuvres]

    def __repr__(self) -> str:
        from yawid.tables.page import told

        return told(self.path, self.summary, self._tables())

    def _repr_html_(self) -> str:
        from yawid.tables.page import page

        return page(self.path, self.summary, self._tables())


def load(path: str | PathLike[str]) -> Run:
    """Return the run in one of yawid's MCAP files, read into memory as a whole.

    Raises:
        SourceError: it cannot be read, is damaged, was never finished or is not yawid's.
    """
    from yawid.sinks.mcap.reader import open_run

    run = open_run(Path(path))
    parts = list(run.blocks())
    rows = joined(parts) if parts else None
    known = _values(run.attachments.get(PARAMETERS, b""))
    return Run(run.path, run.summary, run.config, run.grid, rows, known)


def replay(path: str | PathLike[str], **options: Any) -> Run:
    """Replay a log or a run's MCAP and return the run that ``yawid replay`` would write to files.

    ``options`` are those of the command line with underscores: ``rate=10, orders="auto"``, the
    stretch as ``from_s`` and ``to_s``. ``config`` names a TOML file, ``format`` is ``raw`` for
    frames without stamps, ``signing_key_file`` names the file with the key of signed frames.

    Raises:
        ConfigError: an option is unknown, outside its limits, or does not fit the log.
        SourceError: the log cannot be read.
    """
    from yawid.config.run import check_settings, overruled, read_toml
    from yawid.runs.outputs import Outputs
    from yawid.runs.replay import replay as replay_log
    from yawid.runs.stop import StopFlag
    from yawid.sources.open_log import ReadOptions

    log, toml = Path(path), options.pop("config", None)
    loaded = {} if toml is None else read_toml(Path(toml))
    loaded = {name.replace("-", "_"): loaded[name] for name in loaded}
    for name in OF_FILES:
        loaded.pop(name, None)
    form, key_file = (
        options.pop(name, loaded.pop(name, None)) for name in ("format", "signing_key_file")
    )
    read_options = ReadOptions.asked(form or "auto", None if key_file is None else Path(key_file))
    settings = check_settings(loaded, str(toml))
    settings = overruled(settings, check_settings(options, "yawid.replay"))
    kept = Kept()
    outputs = Outputs(Path(), log.stem, sink=kept)
    replay_log(log, settings, outputs, StopFlag(), read_options)
    return kept.run(log)


@dataclass(slots=True)
class Kept(Sink):
    """A sink that keeps a run in memory, with the content that its file would have."""

    grid: Grid | None = None
    parts: list[RunRows] = field(default_factory=list)
    summary: RunSummary | None = None
    configuration: bytes = b""
    parameters: bytes = b""

    def run(self, path: Path) -> Run:
        """Return the run of the log at ``path``; the sink must be finished and is then empty."""
        from yawid.sinks.mcap.reader import read_config

        assert self.summary is not None, "the run is not finished"
        rows = joined(self.parts) if self.parts else None
        self.parts = []
        config, known = read_config(self.configuration), _values(self.parameters)
        return Run(path, self.summary, config, self.grid, rows, known)

    def start(self, grid: Grid) -> None:
        """See :class:`yawid.sinks.base.Sink`."""
        self.grid = grid

    def write(
        self, samples: SampleBlock, estimates: Mapping[str, EstimateBlock], modes: ModesBlock
    ) -> None:
        """See :class:`yawid.sinks.base.Sink`; covariances are dropped, since no file has them."""
        kept = {
            method: EstimateBlock(estimate.without_covariance.copy(), estimate.p)
            for method, estimate in estimates.items()
        }
        self.parts.append(RunRows(samples, kept, modes))

    def finish(self, summary: RunSummary, attachments: Mapping[str, bytes]) -> None:
        """See :class:`yawid.sinks.base.Sink`."""
        self.summary, self.configuration = summary, attachments["configuration.toml"]
        self.parameters = attachments.get(PARAMETERS, b"")


def _values(attached: bytes) -> dict[str, float]:
    """Return the vehicle's parameters by name from the text attached to a run."""
    lines = (line.rpartition(" ") for line in attached.decode("utf-8", "replace").splitlines())
    known = {}
    for name, _, value in lines:
        with suppress(ValueError):
            known[name] = float(value)
    return known


def no_rows() -> RunRows:
    """Return empty rows, for a run in which rudder and yaw rate never came together."""
    columns: dict[str, Any] = dict.fromkeys(SampleBlock.__slots__, np.empty(0))
    whole = ("k", "boot_us", "unix_ns", "received_us", "noted", "held", "epoch")
    columns |= dict.fromkeys(whole, np.empty(0, np.int64))
    samples = SampleBlock(**columns | {"sample_time_s": math.nan, "u": np.empty((0, 1))})
    poles = np.empty((0, 0), complex)
    empty = np.empty((0, 0))
    return RunRows(
        samples, {}, ModesBlock(poles, empty, empty, empty, empty, np.empty((0, 4)), empty, empty)
    )
