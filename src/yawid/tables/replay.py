"""``yawid.replay``: the run of a log, or of a DataFrame, a table or a dict of arrays, in Python."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from yawid.config.names import RecursiveName
from yawid.errors import ConfigError, YawidError
from yawid.system.stores import Place, place_of
from yawid.tables.run import Run, load, with_keywords

if TYPE_CHECKING:
    import pyarrow as pa

OF_FILES: Final = ("out", "force", "json", "rerun")
"""Options of the output files that a TOML file may hold for the command line: ignored here."""
_NOT_SETTINGS: Final = ("log", "config", "signing_key_file")
Surface = Literal["rudder", "aileron"]


@with_keywords
def replay(
    log: str | PathLike[str] | Any,
    *,
    rate: float | None = None,
    orders: Sequence[int] | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    rudder: str | None = None,
    rudder_sign: Literal["nose-right", "nose-left"] | None = None,
    rudder_max_deg: float | None = None,
    rudder_unit: Literal["half-travel", "rad", "deg"] | None = None,
    rudder_is: Literal["measured", "commanded"] | None = None,
    aileron: str | None = None,
    columns: Mapping[str, str] | Sequence[str] | str | None = None,
    units: Literal["rad", "deg"] | None = None,
    inputs: Surface | Sequence[Surface] | None = None,
    output: Literal["yaw-rate", "yaw"] | None = None,
    turn: Literal["keep", "remove"] | None = None,
    band: tuple[float, float] | None = None,
    manoeuvres: Literal["auto", "off"] | None = None,
    lateral: Literal["auto", "off"] | None = None,
    servo_lag: float | None = None,
    ordinary: Literal["auto", "only", "off"] | None = None,
    method: RecursiveName | None = None,
    also: RecursiveName | Literal["none"] | None = None,
    engine: Literal["numba", "filterpy"] | None = None,
    memory: float | None = None,
    forgetting: float | None = None,
    airborne: Literal["auto", "all"] | None = None,
    boot: int | None = None,
    sysid: int | None = None,
    config: str | PathLike[str] | None = None,
    signing_key_file: str | PathLike[str] | None = None,
) -> Run:
    """Replay a log or a run's MCAP and return the run that ``yawid replay`` would write to files.

    ``log`` is a path, or a record in memory with the columns of a CSV (``t`` in s, ``rudder``,
    ``r``, ...): a DataFrame of pandas or polars, a table of pyarrow, a dict of arrays (n,), or a
    table of another run. The keywords are the options of the command line, None where not given:
    the stretch is ``from_s`` and ``to_s`` in s since boot, ``rate`` is in Hz, ``band`` in Hz,
    ``memory`` and ``servo_lag`` in s, and ``columns`` may be a dict of the table's
    names to those of the record. ``config`` names a TOML file, ``signing_key_file``
    the file with the key of signed frames.

    Raises:
        ConfigError: a value is outside its limits, or does not fit the log.
        ChannelError: the record has no time, rudder or yaw rate.
        SourceError: the log cannot be read.
    """
    settings = {k: v for k, v in locals().items() if v is not None and k not in _NOT_SETTINGS}
    if isinstance(columns, Mapping):
        settings["columns"] = tuple(f"{name}={column}" for name, column in columns.items())
    if isinstance(log, str | PathLike):
        return _of_file(place_of(fspath(log)), settings, config, signing_key_file)
    with _as_file(log) as path:
        return _of_file(path, settings, config, signing_key_file).named(type(log).__name__)


def run_of(log: Path, **settings: Any) -> Run:
    """Return a finished run, or the replay of a log.

    Raises:
        ConfigError, ChannelError, SourceError: as :func:`replay`.
    """
    from yawid.sources.formats import RUN, format_of

    if format_of(log) is RUN:
        return load(log)
    return _of_file(log, settings, None, None)


def _of_file(
    log: Place,
    given: dict[str, Any],
    toml: str | PathLike[str] | None,
    key_file: str | PathLike[str] | None,
) -> Run:
    from yawid.config.settings import check_settings, overruled, read_toml
    from yawid.runs.outputs import Outputs
    from yawid.runs.replay import replay as replay_log
    from yawid.runs.stop import StopFlag
    from yawid.sources.open_log import ReadOptions

    loaded = {} if toml is None else read_toml(Path(toml))
    loaded = {n.replace("-", "_"): value for n, value in loaded.items() if n not in OF_FILES}
    key = key_file or loaded.pop("signing_key_file", None)
    read_options = ReadOptions.asked(None if key is None else Path(key))
    settings = check_settings(loaded, str(toml))
    settings = overruled(settings, check_settings(given, "yawid.replay"))
    with TemporaryDirectory() as folder:
        outputs = Outputs(Path(folder), log.stem, kept=False)
        replay_log(log, settings, outputs, StopFlag(), read_options)
        return Run(log, outputs.path(".mcap"), is_replay=True)


@contextmanager
def _as_file(data: Any) -> Iterator[Path]:
    """Yield the path of a Parquet file with a record; errors name the record, not this file."""
    import pyarrow.parquet as pq

    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{type(data).__name__}.parquet"
        pq.write_table(_arrow_of(data), path)
        try:
            yield path
        except YawidError as error:
            error.args = (str(error).replace(str(path), f"the {type(data).__name__}"),)
            raise


def _arrow_of(data: Any) -> "pa.Table":
    """Return a record in memory as an Arrow table with the units that it has.

    Raises:
        ConfigError: it is no table, or its columns do not fit together.
    """
    import pyarrow as pa

    if not (hasattr(data, "__arrow_c_stream__") or isinstance(data, Mapping)):
        raise ConfigError(
            "yawid.replay takes a path, a DataFrame of pandas or polars, a table of pyarrow or a "
            f"dict of arrays, got {type(data).__name__}"
        )
    try:
        if isinstance(data, Mapping):
            data = {
                # Arrow makes nulls of what a mask hides.
                str(name): pa.array(values) if np.ma.isMaskedArray(values) else np.asarray(values)
                for name, values in data.items()
            }
        table = pa.table(data)
    except (pa.ArrowException, ValueError, TypeError) as error:
        raise ConfigError(f"the {type(data).__name__} is no table: {error}") from error
    units = getattr(data, "attrs", {}).get("units", {})  # as to_pandas() of a run has them
    for i, each in enumerate(table.schema):
        if each.name.startswith("__index_level_") and pa.types.is_timestamp(each.type):
            table = table.rename_columns({each.name: "time"})  # the index of a DataFrame
        if pa.types.is_string_view(each.type):  # of polars
            table = table.set_column(i, each.name, table.column(i).cast(pa.string()))
        if each.name in units:
            said = table.schema.field(i).with_metadata({"unit": units[each.name]})
            table = table.set_column(i, said, table.column(i))
    return table
