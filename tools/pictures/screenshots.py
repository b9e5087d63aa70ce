"""Takes pictures of Rerun with a recording, and of the report.

    python -m pictures.screenshots [--out DIR]

It needs no screen, but Debian's mesa-vulkan-drivers (the viewer draws by Vulkan, in software) and
chromium. Look at every picture before you keep it. Each has the case and the answer that it shows
in its text "yawid", which a test compares with the answer of today.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import socket
import sys
import tempfile
import time
from pathlib import Path

import rerun as rr
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from rerun.experimental import ViewerClient

from pictures.browser import Browser
from yawid.cli.main import main as yawid
from yawid.sinks.mcap.reader import open_run

ROOT = Path(__file__).resolve().parents[2]
SHOWN = {"rerun": "c172p_3211", "report": "c172p_three_speeds"}
"""The case of each picture: a single manoeuvre, and twelve at three speeds."""
# The program itself: the rerun command next to the interpreter is a script that runs it.
VIEWER = Path(rr.__file__).parents[1] / "rerun_cli" / "rerun"
COLOURS = 256  # with so many, 99.9 % of the pixels are at most 11 of 255 off
WIDTH = 1440
SETTLE_S = 6.0


def free_port() -> int:
    """Return a free TCP port."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


def source_of(name: str, mcap: Path) -> PngInfo:
    """Return the text in a picture: its case, the options of its replay, and the answer."""
    flight = open_run(mcap).summary.flight
    assert flight is not None
    roll = flight.to_json()["dutch_roll"]
    told = PngInfo()
    told.add_text("yawid", json.dumps({"case": SHOWN[name], "options": {}, "dutch_roll": roll}))
    return told


def small(source: Path, target: Path, width: int, told: PngInfo, most: int | None = None) -> None:
    """Save a picture for a README: at most ``width`` wide and ``most`` high, with few colours."""
    with Image.open(source) as image:
        whole = image.convert("RGB")
    if most is not None and whole.height > most:
        whole = whole.crop((0, 0, whole.width, most))
    if whole.width > width:
        whole = whole.resize(
            (width, round(whole.height * width / whole.width)), Image.Resampling.LANCZOS
        )
    few = whole.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    few.save(target, optimize=True, pnginfo=told)
    print(f"{target.name}: {whole.width} x {whole.height}, {target.stat().st_size / 1e3:.0f} kB")


def viewer_picture(file: Path, target: Path, told: PngInfo) -> None:
    """Open a file in the native viewer without a screen, and take a picture."""
    client = ViewerClient.spawn(
        headless=True, port=free_port(), executable_path=str(VIEWER), hide_welcome_screen=True
    )
    try:
        client.open([str(file)])
        time.sleep(SETTLE_S)  # the viewer does not report when it has drawn
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "picture.png"
            client.save_screenshot(str(picture))
            small(picture, target, WIDTH, told)
    finally:
        client.quit()


def report_picture(report: Path, target: Path, told: PngInfo) -> None:
    """Take a picture of the report at a width of 1280 pixels, down to its second manoeuvre."""
    with Browser() as browser, tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.png"
        browser.open(report.as_uri(), 1280, 800)
        browser.screenshot(picture, whole=True)
        # It shows the answer, the list of manoeuvres, the flight, and two manoeuvres as fitted.
        top = "document.querySelector('.pictures figure:nth-child(5)').getBoundingClientRect().top"
        small(picture, target, 1000, told, round(browser.evaluate(top)) - 20)
        if browser.complaints:
            print(f"the browser complains: {browser.complaints}", file=sys.stderr)


def main() -> None:
    """Make the runs and take both pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "tools/pictures")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        made = {name: Path(folder) / name / "log.mcap" for name in SHOWN}
        with contextlib.redirect_stdout(io.StringIO()):
            for name, mcap in made.items():
                log = ROOT / "replay_logs" / SHOWN[name] / "log.tlog"
                yawid(["replay", str(log), "--out", str(mcap.parent), "--rerun", "save", "--json"])
            yawid(["report", str(made["report"])])
        told = {name: source_of(name, mcap) for name, mcap in made.items()}
        report_picture(made["report"].with_suffix(".html"), out / "report.png", told["report"])
        viewer_picture(made["rerun"].with_suffix(".rrd"), out / "rerun.png", told["rerun"])


if __name__ == "__main__":
    main()
