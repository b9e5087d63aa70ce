"""Real pictures: Rerun on a recording, on a plain MCAP and in a browser, and the report.

    python -m pictures.screenshots [--log LOG.tlog] [--out DIR] [OPTIONS OF yawid replay ...]

Needs no screen, but Debian's mesa-vulkan-drivers (the viewer draws by Vulkan, in software) and
chromium; what is missing is said and left out. Look at every picture before you keep it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from PIL import Image
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping
from rerun.experimental import ViewerClient

from pictures.browser import Browser
from yawid.cli.main import main as yawid
from yawid.sinks.rerun.blueprint import blueprint

ROOT = Path(__file__).resolve().parents[2]
MANY = ROOT / "replay_logs/c172p_three_speeds/log.tlog"
"""The report's log: twelve manoeuvres at three speeds."""
# The command beside the interpreter is a script that waits for this one.
VIEWER = Path(rr.__file__).parents[1] / "rerun_cli" / "rerun"
COLOURS = 256  # 99.9 % of the pixels are no more than 11 of 255 off
WIDTH = 1440
SETTLE_S = 6.0
WEB_SETTLE_S = 15.0


def free_port() -> int:
    """Return a port nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


def small(source: Path, target: Path, width: int, most_height: int | None = None) -> None:
    """Save a picture narrower and cut to a height, its colours kept: for a README."""
    with Image.open(source) as image:
        whole = image.convert("RGB")
    if most_height is not None and whole.height > most_height:
        whole = whole.crop((0, 0, whole.width, most_height))
    if whole.width > width:
        whole = whole.resize(
            (width, round(whole.height * width / whole.width)), Image.Resampling.LANCZOS
        )
    few = whole.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    few.save(target, optimize=True)
    print(f"{target.name}: {whole.width} x {whole.height}, {target.stat().st_size / 1e3:.0f} kB")


def viewer_picture(file: Path, target: Path) -> None:
    """Open a file in the native viewer, without a screen, and picture it."""
    client = ViewerClient.spawn(
        headless=True, port=free_port(), executable_path=str(VIEWER), hide_welcome_screen=True
    )
    try:
        client.open([str(file)])
        time.sleep(SETTLE_S)  # the viewer gives no sign of having drawn
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "picture.png"
            client.save_screenshot(str(picture))
            small(picture, target, WIDTH)
    finally:
        client.quit()


def plain_mcap(mcap: Path, rrd: Path) -> None:
    """Let Rerun itself read an MCAP file, and say which of its columns to draw as lines."""

    def lines(name: str, topic: str, schema: str, *fields: str) -> rrb.TimeSeriesView:
        mapping = [
            rr.SeriesLines(names=field).visualizer(
                mappings=[
                    VisualizerComponentMapping(
                        target="Scalars:scalars",
                        source_kind=ComponentSourceKind.SourceComponent,
                        source_component=f"{schema}:message",
                        selector=f".{field}",
                    )
                ]
            )
            for field in fields
        ]
        own = "$origin"  # not the topics below it as well
        return rrb.TimeSeriesView(name=name, origin=topic, contents=own, overrides={topic: mapping})

    views = rrb.Vertical(
        lines("rudder", "/yawid/sample", "yawid.Sample", "rudder"),
        lines("yaw rate", "/yawid/sample", "yawid.Sample", "yaw_rate"),
        lines("innovation", "/yawid/estimate", "yawid.Estimate", "innovation"),
        lines("Dutch roll wn", "/yawid/modes", "yawid.Modes", "dutch_roll_wn"),
        lines(
            "parameters",
            "/yawid/estimate",
            "yawid.Estimate",
            *(f"parameters.{name}" for name in ("a1", "a2", "a3")),
        ),
    )
    recording = rr.RecordingStream("yawid-mcap")
    panel = rrb.TimePanel(timeline="message_log_time")
    recording.save(rrd, default_blueprint=rrb.Blueprint(views, panel))
    recording.log_file_from_path(mcap)
    recording.flush()
    recording.disconnect()


def web_picture(rrd: Path, target: Path) -> None:
    """Serve a recording to the web viewer in a browser, and picture it."""
    recording = rr.RecordingStream("yawid")
    grpc, web = free_port(), free_port()
    url = recording.serve_grpc(grpc_port=grpc, default_blueprint=blueprint())
    rr.serve_web_viewer(web_port=web, open_browser=False)
    recording.log_file_from_path(rrd)
    with Browser() as browser:
        browser.open(
            f"http://127.0.0.1:{web}/?url={url}&renderer=webgl&hide_welcome_screen", 1440, 810
        )
        browser.listen(WEB_SETTLE_S)
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "picture.png"
            browser.screenshot(picture)
            small(picture, target, WIDTH)
    recording.disconnect()


def report_pictures(report: Path, out: Path) -> None:
    """Picture the report's first screen at 1280 pixels and on a phone, and the whole page."""
    with Browser() as browser, tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.png"
        browser.open(report.as_uri(), 1280, 800)
        browser.screenshot(picture, whole=True)
        # The answer, its manoeuvres, the flight, and two of them as fitted.
        top = "document.querySelector('.pictures figure:nth-child(5)').getBoundingClientRect().top"
        small(picture, out / "report.png", 1000, round(browser.evaluate(top)) - 20)
        browser.open(report.as_uri(), 390, 844, phone=True)
        browser.screenshot(picture, whole=True)
        small(picture, out / "report_phone.png", 390, 1600)
        if browser.complaints:
            print(f"the browser complains: {browser.complaints}", file=sys.stderr)


def attempt(what: str, act: Callable[[], None]) -> bool:
    """Take one picture, or say why it cannot be had."""
    try:
        act()
    except (RuntimeError, OSError, ValueError, AttributeError) as error:
        print(f"{what}: {str(error).partition(chr(10))[0]}", file=sys.stderr)
        return False
    return True


def main() -> int:
    """Make a run and take every picture of it; return 1 if one is missing."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--log", type=Path, default=ROOT / "replay_logs/c172p_3211/log.tlog")
    parser.add_argument("--out", type=Path, default=ROOT / "tools/pictures")
    options, replay_options = parser.parse_known_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        run = ["replay", str(options.log), "--out", folder, "--rerun", "save", "--json"]
        with contextlib.redirect_stdout(io.StringIO()):
            yawid([*run, *(replay_options or ["--rate", "10", "--forgetting", "1"])])
            mcap = Path(folder) / f"{options.log.stem}.mcap"
            told = Path(folder) / "told"
            yawid(["replay", str(MANY), "--out", str(told), "--json"])
            yawid(["report", str(told / "log.mcap")])
        rrd, plain = mcap.with_suffix(".rrd"), mcap.with_name("plain.rrd")
        out: Path = options.out
        done = [
            attempt("viewer", lambda: viewer_picture(rrd, out / "rerun.png")),
            attempt("MCAP in the viewer", lambda: plain_mcap(mcap, plain))
            and attempt(
                "MCAP in the viewer", lambda: viewer_picture(plain, out / "rerun_mcap.png")
            ),
            attempt("web viewer", lambda: web_picture(rrd, out / "rerun_web.png")),
            attempt("report", lambda: report_pictures(told / "log.html", out)),
        ]
    return 0 if all(done) else 1


if __name__ == "__main__":
    sys.exit(main())
