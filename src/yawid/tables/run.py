"""A run in Python: tables, answers, models; ``yawid.load`` reads it from its file."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, wraps
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, Literal, ParamSpec, Self, TypeVar

import msgspec
import numpy as np

from yawid.answers.heard import PARAMETERS, parameters_in
from yawid.answers.ordinary import ORDINARY, OrdinaryAnswer
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Bare, Flight
from yawid.blocks import ModesBlock, SampleBlock
from yawid.errors import YawidError
from yawid.quantities.airspeed import SEA_LEVEL_DENSITY, density_ratio
from yawid.sinks.base import Grid, RunRows
from yawid.sinks.door import plain
from yawid.sinks.mcap.messages import joined
from yawid.sinks.mcap.reader import open_answered
from yawid.sinks.pages import Note, Part, Said, to_html, to_text
from yawid.sinks.run_page import summary_page
from yawid.system.part_file import os_errors_as_sink_error, write_whole
from yawid.system.stores import Place, brought, place_of
from yawid.tables.columns import (
    Units,
    estimate_columns,
    further_columns,
    manoeuvre_columns,
    mode_columns,
    motion_columns,
    record_columns,
    sample_columns,
)
from yawid.tables.table import Column, Table

if TYPE_CHECKING:
    from yawid.damper.identified import Facts
    from yawid.damper.study import Study
    from yawid.models.linear import LinearModel


P = ParamSpec("P")
T = TypeVar("T")
_OTHERS: Final = {"from": "from_s", "to": "to_s", "param": "parameters"}
"""The keywords that are not the option's name with underscores."""
_OPTION: Final = re.compile(r"(?<![\w-])--([a-z]+(?:-[a-z]+)*)")


def in_keywords(text: str) -> str:
    """Return a text with the keyword of Python instead of each option of the command line."""
    return _OPTION.sub(lambda found: _OTHERS.get(found[1], found[1].replace("-", "_")), text)


def with_keywords(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function whose errors name keywords, where the library's texts name options."""

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except YawidError as error:
            error.args = tuple(in_keywords(str(each)) for each in error.args)
            raise

    return called


class Run:
    """A run as tables: columns are NumPy arrays with units, rows are samples or manoeuvres.

    ``summary`` is what ``--json`` prints, ``config`` the configuration, ``path`` the file that was
    read, ``parameters`` the vehicle's by name. Each table is made when it is first used.
    """

    def __init__(self, path: Place, mcap: Path, *, is_replay: bool = False) -> None:
        """Read the run from ``mcap``; ``path`` is its place, or the log of a replay.

        Raises:
            SourceError: it cannot be read, is damaged, was never finished or is not yawid's.
        """
        run = open_answered(mcap)
        parts = list(run.blocks())
        self.path: Place = path
        self.summary, self.config = run.summary, run.config
        self.parameters = parameters_in(run.attachments.get(PARAMETERS, b""))
        self._file = mcap.read_bytes() if is_replay else None
        self._rows, self._motion = joined(parts) if parts else no_rows(), run.motion()
        grid = run.grid or Grid((), run.config.inputs, (), math.nan, run.config.unit_of_rudder)
        self._known = Units(grid, run.config)

    def named(self, name: str) -> Self:
        """Return it with another name for what it was made from."""
        self.path, self.summary = Path(name), msgspec.structs.replace(self.summary, log=name)
        return self

    @property
    def usable(self) -> bool:
        """Whether the answer may be used; ``flight.verdict`` says why not."""
        return self.summary.deciding.usable

    @property
    def flight(self) -> Flight:
        """The flight's answer, the headline, which is false where it is not usable.

        Its ``verdict`` says why not, or, without a manoeuvre, why there is none.
        """
        verdict = self.summary.deciding
        if verdict.method == ORDINARY:  # that says nothing of manoeuvres, which were not looked for
            verdict = Verdict(usable=False, reasons=[])
        return self.summary.flight or Flight(used=[], disagree=[], verdict=verdict)

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
        return Table.of("samples", [*columns, *motion_columns(samples, self._motion, known)])

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
        return Table.of("manoeuvres", [*manoeuvre_columns(self.summary, self._known)])

    @property
    def bare(self) -> Bare:
        """The bare airframe of the flight, which is false where it is not known.

        Its ``verdict`` says why not.
        """
        if (bare := self.summary.bare) is not None:
            return bare
        return Bare(used=[], verdict=self._unknown("bare_unknown", "lateral"))

    @property
    def ordinary(self) -> OrdinaryAnswer:
        """The answer of ordinary flight, of the aircraft without its autopilot and its mode only.

        It is false where it is not known; its ``verdict`` says why not.
        """
        if (found := self.summary.ordinary) is not None:
            return found
        return OrdinaryAnswer(verdict=self._unknown("ordinary_unknown", "ordinary"))

    def _unknown(self, why: str, option: str) -> Verdict:
        """Return why there is no answer of what an option asks for."""
        asked = getattr(self.config, option) == "auto"
        text = "nothing was flown that shows it" if asked else "it was not looked for"
        step = None if asked else f'Replay the log with {option}="auto".'
        return Verdict(usable=False, reasons=[Reason(why, text, step)], next=step)

    @cached_property
    def record(self) -> Table:
        """The samples with the primary method's results, as ``yawid export`` writes them."""
        columns = record_columns(self._rows, self._known, self._motion)
        return self._made_of("samples and results", columns)

    def _made_of(self, title: str, columns: Iterable[Column]) -> Table:
        """Return a table of results, whose title marks a run that is not usable."""
        mark = " (of a run that is NOT USABLE)" if self.summary.deciding.fatal else ""
        return Table.of(title + mark, [*columns])

    @with_keywords
    def model(self, which: int | Literal["flight", "bare"] = "flight") -> "LinearModel":
        """Return the identified model of manoeuvre n, of the flight, or of the bare airframe.

        It has ``tf()``, ``ss()``, ``frequency_response(w)``, ``simulate(u)``, ``to_control()``.

        Raises:
            ConfigError: there is no such manoeuvre, or the model's output is no yaw rate.
            NotIdentifiable: there is no answer of it.
        """
        from yawid.models.identify import model_of

        return model_of(self.facts, which)

    @property
    def air_density(self) -> float | None:
        """The standard atmosphere's density in kg/m^3 at the altitude flown, None if unknown."""
        found = self.summary.manoeuvres or ()
        known = [each.altitude_m for each in found if each.altitude_m is not None]
        ratio = density_ratio(np.array(known)).mean() if known else np.nan
        return float(SEA_LEVEL_DENSITY * ratio) if np.isfinite(ratio) else None

    @with_keywords
    def damper(
        self,
        *,
        aim: float | None = None,
        autopilot: Literal["ardupilot", "px4"] | None = None,
        airspeed: tuple[float, float] | None = None,
        parameters: Mapping[str, float] | None = None,
        gains: Sequence[float] = (),
    ) -> "Study":
        """Return which gain of the autopilot's yaw damper gives which damping.

        ``aim`` is the damping ratio aimed at, ``airspeed`` the lowest and highest in
        m/s; ``parameters`` stand in for those of the log, and ``gains`` are
        shown. ``.report`` is what ``yawid damper --json`` prints; where nothing can be said, its
        verdict says why.

        Raises:
            ConfigError: a value is outside its limits, or the run has no samples.
        """
        from yawid.damper.study import Asked, study

        asked = Asked(aim, autopilot, airspeed, parameters or {}, gains)
        return study(self.facts, asked)

    @property
    def facts(self) -> "Facts":
        """The run as its models and the study of its damper are made from it."""
        from yawid.damper.identified import Facts

        sample_time_s, samples = self._known.grid.sample_time_s, [self._rows.samples]
        return Facts(
            self.summary, self.config, sample_time_s, samples, self.parameters, self._motion
        )

    @with_keywords
    def report(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the report of the run, one HTML file, and return its absolute path.

        Raises:
            SinkError: the file exists and ``force`` is not set, or it cannot be written.
        """
        from yawid.report.write import write_report

        with TemporaryDirectory() as folder:
            return write_report(self.mcap(folder), Path(path), force=force)

    def mcap(self, folder: str | PathLike[str]) -> Path:
        """Return the run's MCAP; that of a replay is written into ``folder``.

        Raises:
            SinkError: the file exists, or it cannot be written.
        """
        copy = Path(folder).absolute() / f"{self.path.stem}.mcap"
        with os_errors_as_sink_error(copy):
            copy.parent.mkdir(parents=True, exist_ok=True)
        if self._file is not None:
            write_whole({copy: self._file}, force=False)
        elif isinstance(self.path, Path):
            return self.path
        else:
            self.path.copy_to(copy)
        return copy

    def _page(self) -> Iterator[Part]:
        """Yield the page of the terminal, whether it is usable first, with Python's words."""
        verdict, whether = self.summary.deciding, self.summary.deciding.word
        if verdict.fatal:
            only = ", the numbers are for study only" if self.summary.estimates else ""
            whether = f"NOT USABLE{only}"
        yield Note(f"{plain(str(self.path))}: {whether}", "bold", wraps=False)
        for part in summary_page(self.summary):
            yield part._replace(text=in_keywords(part.text)) if isinstance(part, Said) else part
        tables = [self.samples, *self.estimates.values(), self.modes, self.manoeuvres]
        yield Note(f"    rows  {', '.join(f'{each.title} ({len(each)})' for each in tables)}")

    def __repr__(self) -> str:
        return to_text(self._page()).rstrip()

    def _repr_html_(self) -> str:
        return f"<div>{to_html(self._page())}</div>"


def load(path: str | PathLike[str]) -> Run:
    """Return the run in one of yawid's MCAP files, read into memory as a whole; it may be a URL.

    Raises:
        SourceError: it cannot be read, is damaged, was never finished or is not yawid's.
    """
    place = place_of(fspath(path))
    with brought(place) as local:
        return Run(place, local)


def no_rows() -> RunRows:
    """Return empty rows, for a run in which rudder and yaw rate never came together."""
    columns: dict[str, Any] = dict.fromkeys(SampleBlock.__slots__, np.empty(0))
    whole = ("k", "boot_us", "unix_ns", "received_us", "noted", "held", "epoch")
    columns |= dict.fromkeys(whole, np.empty(0, np.int64))
    samples = SampleBlock(**columns | {"sample_time_s": math.nan, "u": np.empty((0, 1))})
    empty: Any = np.empty((0, 0))
    return RunRows(
        samples, {}, ModesBlock(empty, empty, empty, empty, empty, np.empty((0, 4)), empty, empty)
    )
