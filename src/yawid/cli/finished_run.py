"""The commands on a finished run: ``yawid view``, ``report``, ``damper`` and ``export``."""

import sys
from collections import ChainMap
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

from msgspec import Meta

from yawid.cli.options import AsJson, Force, command, numbers, said
from yawid.config.fields import like
from yawid.damper.autopilots import READ
from yawid.errors import ConfigError
from yawid.sinks.door import print_answer, print_line, say

OF_AIRCRAFT = (
    "mass", "ixx", "izz", "ixz", "area", "span", "rudder-max-deg", "aileron-max-deg", "density",
)  # fmt: skip
"""What JSBSim's coefficients need to know of the aircraft, in kg, m and deg."""
_AIRCRAFT = (
    f"for .xml: {', '.join(OF_AIRCRAFT)} in kg, m and deg; ixz is the integral of x z "
    "(density: the standard atmosphere's at the altitude flown)"
)
_MODEL = "whose model: the flight's, the bare airframe's, or manoeuvre N's (default: flight)"
_NEXT_TO = "(default: next to RUN or LOG, Parquet or JSON); a model: .json, .mat, .xml (JSBSim)"
Mcap = Annotated[Path, said("RUN.mcap", "the file of a finished run")]
RunOrLog = Annotated[Path, said("RUN|LOG", "the MCAP of a finished run, or a log to replay")]
Airspeeds = Annotated[tuple[float, float], Meta(description="be LO,HI in m/s")]


@command(
    "RUN.mcap",
    "yawid view yawid-out/flight.mcap\nyawid view yawid-out/flight.mcap --web\n"
    "yawid view yawid-out/flight.mcap -o flight.rrd",
)
def view(
    mcap: Mcap,
    *,
    out: Annotated[Path | None, said("X.rrd", "write a recording instead", "-o", "--out")] = None,
    force: Force = False,
    to: Annotated[
        str | None,
        like(r"rerun\+http.*", "be rerun+http://HOST:PORT/proxy"),
        said("URL", "send it to a viewer: rerun+http://HOST:PORT/proxy"),
    ] = None,
    web: Annotated[bool, said("", "show it in the browser, until Ctrl-C", "--web")] = False,
) -> int:
    """Show a run in Rerun."""
    from yawid.runs.view import view as view_run
    from yawid.runs.view import view_in_browser

    if (out is not None) + (to is not None) + web > 1:
        raise ConfigError("give one of --out, --to and --web")
    if web:
        view_in_browser(mcap)
        return 0
    view_run(mcap, out, to or "spawn", force=force)
    if out is not None:
        print_line(str(out.absolute()))
    return 0


@command(
    "RUN.mcap",
    "yawid report yawid-out/flight.mcap\nyawid report flight.mcap -o flight.html --force",
)
def report(
    mcap: Mcap,
    *,
    out: Annotated[
        Path | None, said("R.html", "(default: next to the MCAP, with its name)", "-o", "--out")
    ] = None,
    force: Force = False,
) -> int:
    """Write the report of a run."""
    from yawid.report.write import write_report
    from yawid.sinks.terminal.progress import progress

    with progress(sys.stderr, f"report of {mcap.name}"):
        path = write_report(mcap, out, force=force)
    print_line(str(path))
    return 0


@command(
    "RUN|LOG",
    "yawid damper flight.mcap\nyawid damper flight.tlog --airspeed 15,25 -o page.html",
)
def damper(
    log: RunOrLog,
    *,
    aim: Annotated[
        float | None, said("ZETA", "the damping ratio aimed at (default: 0.3 to 0.4)")
    ] = None,
    airspeed: Annotated[
        Airspeeds | None, said("LO,HI", "airspeeds in m/s (default: those flown)")
    ] = None,
    autopilot: Annotated[
        Literal["ardupilot", "px4"] | None, said("", "whose damper (default: the log's)")
    ] = None,
    param: Annotated[
        Sequence[dict[str, float]],
        said(
            "NAME=VALUE",
            "a parameter of the autopilot that is not in the log; may be repeated",
            type=partial(numbers, READ),
        ),
    ] = (),
    as_json: AsJson = False,
    out: Annotated[Path | None, said("PAGE.html", "write a page as well", "-o", "--out")] = None,
    force: Force = False,
) -> int:
    """Print which gain of the yaw damper gives which damping."""
    from yawid.damper.study import Asked, study
    from yawid.sinks.run_page import damper_page
    from yawid.tables.replay import run_of

    given = dict(ChainMap(*reversed(param)))  # of a parameter the last one counts
    found = study(run_of(log).facts, Asked(aim, autopilot, airspeed, given))
    print_answer(found.report, damper_page, as_json=as_json)
    if out is not None and found.predicted is None:
        say(f"{out} was not written, as there is nothing to draw")
    elif out is not None:
        from yawid.report.damper_page import write_damper_page

        write_damper_page(found, out, force=force)
    return found.exit_code


@command(
    "RUN|LOG",
    "yawid export yawid-out/flight.mcap\nyawid export flight.mcap -o flight.csv --force\n"
    "yawid export flight.tlog --what model --of 2 -o model.mat",
)
def export(
    log: RunOrLog,
    *,
    what: Annotated[
        Literal["samples", "manoeuvres", "modes", "model"],
        said("", "what is written (default: samples)"),
    ] = "samples",
    of: Annotated[
        str,
        like(r"flight|bare|\d+", "be flight, bare or the number of a manoeuvre"),
        said("flight|bare|N", _MODEL),
    ] = "flight",
    out: Annotated[
        Path | None, said("OUT.parquet|.csv|.npz|.json|.mat|.xml", _NEXT_TO, "-o", "--out")
    ] = None,
    force: Force = False,
    aircraft: Annotated[
        dict[str, float] | None,
        said("NAME=VALUE,...", _AIRCRAFT, type=partial(numbers, OF_AIRCRAFT), rare=True),
    ] = None,
) -> int:
    """Write a run, or its model, for other programs."""
    from yawid.sources.formats import RUN, format_of
    from yawid.tables.export import check_name
    from yawid.tables.export import export as write
    from yawid.tables.replay import run_of

    if what == "model":
        print_line(str(_model(log, of, out, aircraft or {}, force=force)))
        return 0
    check_name(out := out or log.with_suffix(".parquet"))  # a replay takes long
    with TemporaryDirectory() as folder:
        mcap = log if format_of(log) is RUN else run_of(log).mcap(Path(folder))
        print_line(str(write(mcap, out, what, force=force)))
    return 0


def _model(
    log: Path, which: str, out: Path | None, aircraft: dict[str, float], *, force: bool
) -> Path:
    from yawid.tables.model_file import MODEL_FORMATS, write_model
    from yawid.tables.replay import run_of

    out = log.with_suffix(".json") if out is None else out
    if out.suffix not in MODEL_FORMATS:
        raise ConfigError(
            f"--out {out}: the name of a model must end in {', '.join(MODEL_FORMATS)}"
        )
    run = run_of(log, **({"lateral": "auto"} if which == "bare" else {}))
    given = {name.replace("-", "_"): aircraft.get(name) for name in OF_AIRCRAFT}
    path, model = write_model(
        run, int(which) if which.isdigit() else which, out, given, force=force
    )
    for reason in model.reasons:
        say(f"{'warning' if model.usable else 'not usable'} {reason}")
    return path
