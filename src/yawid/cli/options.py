"""The options that several commands share, and what they become."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from yawid.errors import ConfigError

if TYPE_CHECKING:
    from yawid.config.run import RunConfig
    from yawid.runs.outputs import Outputs
    from yawid.sources.open_log import ReadOptions

DEFAULT_OUT = "yawid-out"


class OneLineParser(argparse.ArgumentParser):
    """A parser that says in one line what is wrong, and where the options stand."""

    def _print_message(self, message: str, file: Any = None) -> None:
        """Write help: argparse would pass over a stdout that is full, as if all were well."""
        if file is not sys.stdout:
            super()._print_message(message, file)
            return
        file.write(message)
        file.flush()

    def error(self, message: str) -> NoReturn:
        """Write the line to stderr and exit with 2."""
        self.exit(2, f"yawid: {message}; {self.prog} --help lists what there is\n")


def _sysid(text: str) -> int | str:
    try:
        return text if text == "all" else int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be 1 to 255 (live: or all), got {text!r}") from None


ESTIMATOR_OPTIONS: tuple[tuple[str, Callable[[str], Any], str, str], ...] = (
    (
        "--orders",
        str,
        "NA,NB,NC,NK",
        "orders, nb and nk for every input; replay: or auto (3,3,2,1)",
    ),
    ("--method", str, "els|rml", "the estimator asked for (els)"),
    ("--also", str, "METHOD|none", "a second estimator beside it (rml)"),
    ("--engine", str, "numba|filterpy", "what computes the recursion (numba)"),
    ("--memory", float, "SECONDS", "forgetting by a memory of so many seconds (60)"),
    ("--forgetting", float, "LAMBDA", "forgetting factor instead of a memory; 1 keeps everything"),
    ("--rate", float, "HZ", "rate of the grid (20, or the slower channel's where that is lower)"),
    ("--inputs", str, "rudder[,aileron]", "inputs of the model (rudder)"),
    ("--output", str, "yaw-rate|heading-rate|yaw", "what the model's output is (yaw-rate)"),
    ("--band", str, "LO,HI", "band-pass rudder and yaw rate alike, in Hz (off)"),
    ("--turn", str, "keep|remove", "subtract the turn rate that bank and airspeed imply (keep)"),
    ("--manoeuvres", str, "auto|off", "find manoeuvres and answer each of them (auto)"),
    ("--rudder", str, "CHANNEL", "auto, servo:N, vtail:L,R, control:K or rc:N (auto)"),
    ("--aileron", str, "CHANNEL", "the same for the aileron, without vtail (auto)"),
    (
        "--rudder-sign",
        str,
        "nose-right|nose-left",
        "where positive rudder turns the nose (nose-right)",
    ),
    ("--rudder-max-deg", float, "DEG", "rudder at full travel, to have gains per radian"),
    ("--servo-tau", float, "SECONDS", "the servo's lag, to know its pole (the fastest real one)"),
    ("--from", float, "S", "first second since boot to estimate from"),
    ("--to", float, "S", "last second since boot to estimate from"),
    ("--boot", int, "N", "only the vehicle's Nth boot in the log, from 1 (all)"),
    ("--sysid", _sysid, "N", "system id of the vehicle, where there are several (live: or all)"),
)


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command that writes results, the estimator's among them."""
    parser.add_argument(
        "--out", type=Path, default=Path(DEFAULT_OUT), metavar="DIR",
        help=f"folder of what is written ({DEFAULT_OUT})",
    )  # fmt: skip
    parser.add_argument("--force", action="store_true", help="overwrite files that exist")
    parser.add_argument("--json", action="store_true", help="print one JSON object per log")
    parser.add_argument(
        "--rerun",
        default="off",
        metavar="off|save|spawn|URL",
        help="a Rerun recording or viewer (off)",
    )
    add_signing(parser)
    add_estimator_options(parser)


def add_signing(parser: argparse.ArgumentParser) -> None:
    """Add the option of a command that may read signed frames only."""
    parser.add_argument(
        "--signing-key-file", type=Path, metavar="FILE", help="read only frames signed by this key"
    )


def add_format(parser: argparse.ArgumentParser) -> None:
    """Add the option that says what kind of file a log is."""
    parser.add_argument(
        "--format",
        default="auto",
        metavar="auto|tlog|raw",
        help="raw: frames without stamps (auto)",
    )


def add_estimator_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what is estimated, and from which channels."""
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="these options from a TOML file"
    )
    for name, kind, metavar, text in ESTIMATOR_OPTIONS:
        parser.add_argument(name, type=kind, metavar=metavar, help=text)


def auto_orders(arguments: argparse.Namespace) -> bool:
    """Tell whether the orders are to be chosen by the log; the option is then out of the way."""
    auto: bool = arguments.orders == "auto"
    if auto:
        arguments.orders = None
    return auto


def config_of(arguments: argparse.Namespace) -> "RunConfig":
    """Return the configuration: the TOML file's settings, overruled by the options given."""
    from yawid.config.run import RunConfig

    return RunConfig(**settings_of(arguments))


def settings_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return what the TOML file and the options say, the options overruling."""
    from yawid.config.run import check_settings, overruled, settings_from_toml

    settings = {} if arguments.config is None else settings_from_toml(arguments.config)
    return overruled(settings, check_settings(given_options(arguments), "the command line"))


def given_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the estimator options that were given, by their names without dashes."""
    return {
        name[2:]: value
        for name, *_ in ESTIMATOR_OPTIONS
        if (value := getattr(arguments, name[2:].replace("-", "_"))) is not None
    }


def outputs_of(arguments: argparse.Namespace, name: str) -> "Outputs":
    """Return where the results go, in files of this name."""
    from yawid.runs.outputs import Outputs

    rerun = arguments.rerun
    if rerun not in ("off", "save", "spawn") and not rerun.startswith("rerun+http"):
        raise ConfigError(f"--rerun must be off, save, spawn or rerun+http://..., got {rerun!r}")
    record = not getattr(arguments, "no_record", False)
    return Outputs(arguments.out, name, rerun, arguments.force, record)


def read_options_of(arguments: argparse.Namespace) -> "ReadOptions":
    """Return how the bytes are read: their form, and the key that signs them."""
    from yawid.sources.logs.tlog import FORMS
    from yawid.sources.mavlink.signing import SigningKey
    from yawid.sources.open_log import ReadOptions

    form = getattr(arguments, "format", "auto")
    if form not in FORMS:
        raise ConfigError(f"--format must be one of {', '.join(FORMS)}, got {form!r}")
    path = arguments.signing_key_file
    return ReadOptions(form, None if path is None else SigningKey.from_file(path), path)
