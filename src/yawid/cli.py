"""The command line: arguments to a configuration, errors to one line and an exit code.

Exit codes: 0 good, 1 regression mismatch, 2 usage or configuration, 3 no vehicle, rudder or yaw, 4
rate too low for an answer, 5 not excited or not identifiable, 6 input or output failed. Results go
to stdout, everything else to stderr. Heavy imports wait until a command needs them.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from yawid import __version__
from yawid.cli_live import add_live, add_recover, run_live, run_recover
from yawid.cli_paper import add_commands
from yawid.cli_view import add_view_and_report
from yawid.errors import (
    ChannelError,
    ConfigError,
    NotIdentifiable,
    SinkError,
    SourceError,
    YawidError,
)
from yawid.regress.command import add_regress
from yawid.regress.command import run as run_regress

if TYPE_CHECKING:
    from yawid.outputs import Outputs
    from yawid.run_config import RunConfig
    from yawid.session import StopFlag
    from yawid.sources.reading import Reading

DEFAULT_OUT = "yawid-out"
_ERROR_CODES: tuple[tuple[type[YawidError], int], ...] = (
    (ConfigError, 2),
    (ChannelError, 3),
    (NotIdentifiable, 5),
    (SourceError, 6),
    (SinkError, 6),
)


def _sysid(text: str) -> int | str:
    return text if text == "all" else int(text)


_ESTIMATOR_OPTIONS: tuple[tuple[str, Callable[[str], Any], str, str], ...] = (
    ("--orders", str, "NA,NB,NC,NK", "orders, nb and nk for every input; auto in replay (3,3,2,1)"),
    ("--method", str, "els|rml", "the estimator asked for (els)"),
    ("--also", str, "METHOD|none", "a second estimator beside it (rml)"),
    ("--engine", str, "numba|filterpy", "what computes the recursion (numba)"),
    ("--memory", float, "SECONDS", "forgetting by a memory of so many seconds (60)"),
    ("--forgetting", float, "LAMBDA", "forgetting factor instead of a memory; 1 keeps everything"),
    ("--rate", float, "HZ", "rate of the grid (20, or the slower channel's where that is lower)"),
    ("--inputs", str, "rudder[,aileron]", "inputs of the model (rudder)"),
    ("--output", str, "yaw-rate|heading-rate|yaw", "what is taken as the answer (yaw-rate)"),
    ("--band", str, "LO,HI", "band-pass rudder and yaw rate alike, in Hz (off)"),
    ("--turn", str, "keep|remove", "subtract the turn rate that bank and airspeed imply (keep)"),
    ("--rudder", str, "CHANNEL", "auto, servo:N, control:K or rc:N (auto)"),
    ("--aileron", str, "CHANNEL", "the same for the aileron (auto)"),
    ("--rudder-sign", str, "nose-right|nose-left", "where positive rudder turns the nose"),
    ("--rudder-max-deg", float, "DEG", "rudder at full travel, to have gains per radian"),
    ("--from", float, "S", "first second since boot to estimate from"),
    ("--to", float, "S", "last second since boot to estimate from"),
    ("--sysid", _sysid, "N", "system id of the vehicle, where several are heard (live: or all)"),
)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="yawid", description="How does this aircraft's yaw answer its rudder, right now?"
    )
    parser.add_argument("--version", action="version", version=f"yawid {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    replay = commands.add_parser("replay", help="estimate from recorded tlogs")
    replay.add_argument("logs", nargs="+", metavar="LOG", type=Path)
    replay.add_argument(
        "--format", default="auto", metavar="auto|tlog|raw", help="raw: frames without stamps"
    )
    _add_outputs(replay)
    replay.set_defaults(run=_replay)
    add_live(commands, _add_outputs).set_defaults(run=_live)
    add_recover(commands).set_defaults(run=run_recover)
    inspect = commands.add_parser("inspect", help="say what a log can answer, and how to ask")
    inspect.add_argument("log", metavar="LOG", type=Path)
    inspect.add_argument("--json", action="store_true", help="print one JSON object")
    _add_estimator_options(inspect)
    inspect.set_defaults(run=_inspect)
    orders = commands.add_parser("orders", help="compare orders and delays on a log")
    orders.add_argument("log", metavar="LOG", type=Path)
    orders.add_argument("--json", action="store_true", help="print one JSON object")
    _add_estimator_options(orders)
    orders.set_defaults(run=_orders)
    add_commands(commands)
    add_view_and_report(commands)
    add_regress(commands, _add_estimator_options).set_defaults(run=_regress)
    return parser


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path(DEFAULT_OUT), metavar="DIR")
    parser.add_argument("--force", action="store_true", help="overwrite files that exist")
    parser.add_argument("--json", action="store_true", help="print one JSON object per log")
    parser.add_argument(
        "--rerun", default="off", metavar="off|save|spawn|URL", help="a Rerun recording or viewer"
    )
    parser.add_argument(
        "--signing-key-file", type=Path, metavar="FILE", help="read only frames signed by this key"
    )
    _add_estimator_options(parser)


def _add_estimator_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, metavar="FILE", help="options from a TOML file")
    for name, kind, metavar, text in _ESTIMATOR_OPTIONS:
        parser.add_argument(name, type=kind, metavar=metavar, help=text)


def _auto_orders(arguments: argparse.Namespace) -> bool:
    """Tell whether the orders are to be chosen by the log; the option is then out of the way."""
    auto: bool = arguments.orders == "auto"
    if auto:
        arguments.orders = None
    return auto


def _config(arguments: argparse.Namespace) -> RunConfig:
    """Return the configuration: the TOML file's settings, overruled by the options given."""
    from yawid.run_config import RunConfig

    return RunConfig(**_settings(arguments))


def _settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what the TOML file and the options say, the options overruling."""
    from yawid.run_config import check_settings, settings_from_toml

    settings = {} if arguments.config is None else settings_from_toml(arguments.config)
    return settings | check_settings(_given(arguments), "the command line")


def _given(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the estimator options that were given, by their names without dashes."""
    return {
        name[2:]: value
        for name, *_ in _ESTIMATOR_OPTIONS
        if (value := getattr(arguments, name[2:].replace("-", "_"))) is not None
    }


def _outputs(arguments: argparse.Namespace, name: str) -> Outputs:
    from yawid.outputs import Outputs

    rerun = arguments.rerun
    if rerun not in ("off", "save", "spawn") and not rerun.startswith("rerun+http"):
        raise ConfigError(f"--rerun must be off, save, spawn or rerun+http://..., got {rerun!r}")
    record = not getattr(arguments, "no_record", False)
    return Outputs(arguments.out, name, rerun, arguments.force, record)


def _reading(arguments: argparse.Namespace) -> Reading:
    from yawid.sources.reading import Reading
    from yawid.sources.signing import SigningKey
    from yawid.sources.tlog import FORMS

    form = getattr(arguments, "format", "auto")
    if form not in FORMS:
        raise ConfigError(f"--format must be one of {', '.join(FORMS)}, got {form!r}")
    path = arguments.signing_key_file
    return Reading(form, None if path is None else SigningKey.from_file(path))


def _replay(arguments: argparse.Namespace) -> int:
    from yawid.again import replay_run
    from yawid.outputs import output_names
    from yawid.session import StopFlag
    from yawid.sinks.mcap_run import is_mcap

    automatic, config = _auto_orders(arguments), _config(arguments)
    reading = _reading(arguments)
    codes = []
    with StopFlag().installed() as stop:
        for log, name in zip(arguments.logs, output_names(arguments.logs), strict=True):
            if stop.is_set:
                break
            outputs = _outputs(arguments, name)
            run = partial(_replay_one, log, config, outputs, stop, reading, automatic)
            if is_mcap(log):
                run = partial(replay_run, log, _settings(arguments), outputs, stop, automatic)
            codes.append(_told(run, arguments.json, "print_summary"))
    return max(codes, default=0)


def _replay_one(
    log: Path,
    config: RunConfig,
    outputs: Outputs,
    stop: StopFlag,
    reading: Reading,
    automatic: bool,
) -> tuple[dict[str, Any], Any]:
    from yawid.session import replay

    if automatic:
        from yawid.collect import with_orders

        config = with_orders(log, config, reading)
    return replay(log, config, outputs, stop, reading)


def _orders(arguments: argparse.Namespace) -> int:
    from yawid.collect import orders_report
    from yawid.sinks.terminal import print_orders

    report = orders_report(arguments.log, _config(arguments))
    if arguments.json:
        print(json.dumps(report), flush=True)
    else:
        print_orders(report, sys.stdout)
    return 0


def _live(arguments: argparse.Namespace) -> int:
    from yawid.live import session_name

    every_vehicle = arguments.sysid == "all"
    if every_vehicle:
        arguments.sysid = None
    config, outputs = _config(arguments), _outputs(arguments, session_name())
    reading = _reading(arguments)
    return run_live(arguments, config, outputs, reading, every_vehicle=every_vehicle)


def _inspect(arguments: argparse.Namespace) -> int:
    from yawid.inspect import inspect

    run = partial(inspect, arguments.log, _config(arguments))
    return _told(run, arguments.json, "print_inspection")


def _regress(arguments: argparse.Namespace) -> int:
    from yawid.run_config import settings_from_toml

    settings = {} if arguments.config is None else settings_from_toml(arguments.config)
    return run_regress(arguments, settings | _given(arguments), partial(print, flush=True))


def _told(run: Callable[[], tuple[dict[str, Any], Any]], as_json: bool, printer: str) -> int:
    """Do one run and print what came of it, by a function of the terminal; return its code."""
    try:
        summary, verdict = run()
    except YawidError as error:
        return _explained(error)
    if as_json:
        print(json.dumps(summary), flush=True)
    else:
        from yawid.sinks import terminal

        getattr(terminal, printer)(summary, sys.stdout)
    code: int = verdict.exit_code
    return code


def _say(text: str) -> None:
    print(f"yawid: {text}", file=sys.stderr, flush=True)


def _explained(error: YawidError) -> int:
    _say(" ".join(str(error).split()))
    return next((code for kind, code in _ERROR_CODES if isinstance(error, kind)), 6)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
    except YawidError as error:
        return _explained(error)
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # The reader of our stdout has gone; nothing more can be said there.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 6
    return code
