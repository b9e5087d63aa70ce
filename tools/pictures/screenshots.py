"""Takes pictures of Rerun with a recording, and of the report.

    python -m pictures.screenshots [--log LOG.tlog] [--out DIR] [OPTIONS OF yawid replay ...]

It needs no screen, but Debian's mesa-vulkan-drivers (the viewer draws by Vulkan, in software) and
chromium. Look at every picture before you keep it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import socket
import sys
import tempfile
import time
from pathlib import Path

import rerun as rr
from PIL import Image
from rerun.experimental import ViewerClient

from pictures.browser import Browser
from yawid.cli.main import main as yawid

ROOT = Path(__file__).resolve().parents[2]
MANY = ROOT / "replay_logs/c172p_three_speeds/log.tlog"
"""The log of the report's picture: twelve manoeuvres at three speeds."""
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


def small(source: Path, target: Path, width: int, most_height: int | None = None) -> None:
    """Save a picture for a README: at most ``width`` wide, cut to a height, with few colours."""
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
            small(picture, target, WIDTH)
    finally:
        client.quit()


def report_picture(report: Path, target: Path) -> None:
    """Take a picture of the report at a width of 1280 pixels, down to its second manoeuvre."""
    with Browser() as browser, tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.png"
        browser.open(report.as_uri(), 1280, 800)
        browser.screenshot(picture, whole=True)
        # It shows the answer, the list of manoeuvres, the flight, and two manoeuvres as fitted.
        top = "document.querySelector('.pictures figure:nth-child(5)').getBoundingClientRect().top"
        small(picture, target, 1000, round(browser.evaluate(top)) - 20)
        if browser.complaints:
            print(f"the browser complains: {browser.complaints}", file=sys.stderr)


def main() -> None:
    """Make the runs and take both pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--log", type=Path, default=ROOT / "replay_logs/c172p_3211/log.tlog")
    parser.add_argument("--out", type=Path, default=ROOT / "tools/pictures")
    options, replay_options = parser.parse_known_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        run = ["replay", str(options.log), "--out", folder, "--rerun", "save", "--json"]
        with contextlib.redirect_stdout(io.StringIO()):
            yawid([*run, *(replay_options or ["--rate", "10", "--memory", "inf"])])
            mcap = Path(folder) / f"{options.log.stem}.mcap"
            made = Path(folder) / "run"
            yawid(["replay", str(MANY), "--out", str(made), "--json"])
            yawid(["report", str(made / "log.mcap")])
        report_picture(made / "log.html", options.out / "report.png")
        viewer_picture(mcap.with_suffix(".rrd"), options.out / "rerun.png")


if __name__ == "__main__":
    main()
