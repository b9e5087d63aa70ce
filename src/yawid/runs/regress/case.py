"""One case: its folder, the settings in its case.toml, and a replay of its log."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from yawid.config.run import RunConfig, check_settings
from yawid.errors import ConfigError, did_you_mean
from yawid.runs.job import open_log, run
from yawid.runs.regress.compare import NOT_COMPARED
from yawid.runs.regress.table import TableSink
from yawid.sinks.base import Done
from yawid.sources.formats import FORMATS

_KEYS = {
    "origin": str,
    "licence": str,
    "sha256": str,
    "floor": int,
    "options": dict,
    "flight": dict,
    "tolerances": dict,
    "updates": list,
}

ANSWERS = ("exit_code", "verdict", "manoeuvres", "flight", "flights", "bare", "ordinary")
"""The keys of ``flight.json``."""


def _compared(found: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in found.items() if key not in NOT_COMPARED}


@dataclass(frozen=True, slots=True)
class Case:
    """A case as its case.toml describes it; ``floor`` is the least number of updates.

    The log is replayed twice: with ``config``, and with ``flight``, which has the default options
    where ``[flight]`` has no other.
    """

    folder: Path
    sha256: str
    floor: int
    config: RunConfig
    flight: RunConfig
    tolerances: Mapping[str, float]

    @property
    def name(self) -> str:
        """The name of the case's folder."""
        return self.folder.absolute().name

    @property
    def log(self) -> Path:
        """The path of the log: the first of log.tlog, log.bin, ... that exists, else log.tlog."""
        found = (self.folder / f"log{each.suffix}" for each in FORMATS)
        return next((log for log in found if log.is_file()), self.folder / "log.tlog")

    @staticmethod
    def read(folder: Path) -> "Case":
        """Read a case from its folder.

        Raises:
            ConfigError: the folder has no case.toml, or one that does not describe a case.
        """
        path = folder / "case.toml"
        try:
            loaded = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise ConfigError(f"{path}: not a readable case: {error}") from error
        for key, value in loaded.items():
            if key not in _KEYS or not isinstance(value, _KEYS[key]):
                raise ConfigError(f"{path}: {key} is not a key of a case, or of the wrong type")
        if missing := {"origin", "licence", "sha256"} - loaded.keys():
            raise ConfigError(f"{path}: {', '.join(sorted(missing))} missing")
        config, flight = (
            RunConfig(**check_settings(loaded.get(key, {}), str(path)))
            for key in ("options", "flight")
        )
        tolerances = loaded.get("tolerances", {})
        for name, value in tolerances.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0.0:
                raise ConfigError(f"{path}: the tolerance of {name} must be >= 0, got {value!r}")
        return Case(folder, loaded["sha256"], loaded.get("floor", 1), config, flight, tolerances)

    def replay(self) -> "Replayed":
        """Replay the log with the options of the case.

        Raises:
            SourceError: the log cannot be read.
            ConfigError: the options do not fit the log.
        """
        rows = TableSink()
        source = open_log(self.log)
        config = source.settled(asdict(self.config))
        summary = run(source, config, [rows]).conclude()
        rows.take(Done(summary, {}))
        kept = _compared(summary.to_json())
        return Replayed(rows.columns, rows.rows, json.loads(json.dumps(kept)))

    def flown(self) -> dict[str, Any]:
        """Return what a replay of the log with the options ``flight`` answers, from JSON.

        This is ``flight.json``: the exit code, the verdicts, the manoeuvres, the flight, the bare
        airframe and what ordinary flight shows.

        Raises:
            SourceError: the log cannot be read.
            ConfigError: the options do not fit the log.
        """
        source = open_log(self.log)
        summary = run(source, source.settled(asdict(self.flight))).conclude()
        whole = {"exit_code": summary.exit_code} | summary.to_json()
        kept = {key: whole[key] for key in ANSWERS if key in whole}
        return dict(json.loads(json.dumps(kept), object_hook=_compared))

    def unsound(self, replayed: "Replayed") -> list[str]:
        """Return why a replay cannot be one of this case: another log, too few updates."""
        wrong = []
        if replayed.summary["sha256"] != self.sha256:
            wrong.append(
                f"{self.log.name} is not the log of the case: its sha256 is "
                f"{replayed.summary['sha256']}"
            )
        if replayed.updates < self.floor:
            wrong.append(f"{replayed.updates} updates, below the floor of {self.floor}")
        return wrong


@dataclass(frozen=True, slots=True)
class Replayed:
    """The result of a replay: a row for each second and the last, and the summary from JSON."""

    columns: list[str]
    rows: list[list[float]]
    summary: dict[str, Any]

    @property
    def updates(self) -> int:
        """The largest number of updates of any estimator, 0 where there is none."""
        estimates = self.summary.get("estimates", {}).values()
        return max((int(e["updates"]) for e in estimates), default=0)


def find_cases(folder: Path, names: Sequence[str]) -> list[Case]:
    """Return the cases given by folder, or by name below ``folder``; without names all of them.

    Raises:
        ConfigError: a case does not exist, or there is no case at all.
    """
    known = {path.parent.name: path.parent for path in sorted(folder.glob("*/case.toml"))}
    if not known and not names:
        raise ConfigError(
            f"{folder} holds no case: a case is a folder with a case.toml; --folder names another"
        )
    paths = [Path(n) if (Path(n) / "case.toml").exists() else folder / n for n in names]
    for name, path in zip(names, paths, strict=True):
        if not (path / "case.toml").exists():
            has = f"the cases there are {', '.join(known)}" if known else "there are none"
            raise ConfigError(
                f"no case {name} in {folder}{did_you_mean(name, known) or f': {has}'}"
            )
    return [Case.read(path) for path in paths or known.values()]
