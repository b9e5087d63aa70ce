"""Takes pictures of Rerun with a recording, and of the report.

    python -m pictures.screenshots [FOLDER]

It needs no screen, but Debian's mesa-vulkan-drivers (the viewer draws by Vulkan, in software) and
chromium. Look at every picture before you keep it. Each has the case and the answer that it shows
in its text "yawid", which a test compares with the answer of today.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import rerun as rr
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from playwright.sync_api import FloatRect
from rerun.experimental import ViewerClient

from pictures.browser import chromium, opened
from yawid.cli.main import main as yawid
from yawid.sinks.mcap.reader import open_run

ROOT = Path(__file__).resolve().parents[2]
SHOWN = {"rerun": "c172p_3211", "report": "c172p_three_speeds"}
"""The case of each picture: a single manoeuvre, and twelve at three speeds."""
# The program itself: the rerun command next to the interpreter is a script that runs it.
VIEWER = Path(rr.__file__).parents[1] / "rerun_cli" / "rerun"
COLOURS = 256  # with so many, 99.9 % of the pixels are at most 11 of 255 off
SETTLE_S = 6.0
# The report shows the answer, the list of manoeuvres, the flight, and two manoeuvres as fitted.
THIRD = "document.querySelector('.pictures figure:nth-child(5)').getBoundingClientRect().top"


def small(picture: Path, mcap: Path, width: int) -> None:
    """Make a picture one of a README: at most ``width`` wide, with few colours.

    Its text has the case, the options of its replay, and the answer.
    """
    with Image.open(picture) as image:
        whole = image.convert("RGB")
    whole.thumbnail((width, whole.height), Image.Resampling.LANCZOS)
    few = whole.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    roll = open_run(mcap).summary.to_json()["flight"]["dutch_roll"]
    told = PngInfo()
    told.add_text(
        "yawid", json.dumps({"case": SHOWN[picture.stem], "options": {}, "dutch_roll": roll})
    )
    few.save(picture, optimize=True, pnginfo=told)
    print(f"{picture}: {few.width} x {few.height}, {picture.stat().st_size / 1e3:.0f} kB")


def viewer_picture(picture: Path, mcap: Path) -> None:
    """Open a recording in the native viewer without a screen, and take a picture."""
    client = ViewerClient.spawn(
        headless=True, executable_path=str(VIEWER), hide_welcome_screen=True
    )
    try:
        client.open([str(mcap.with_suffix(".rrd"))])
        time.sleep(SETTLE_S)  # the viewer does not report when it has drawn
        client.save_screenshot(str(picture))
    finally:
        client.quit()
    small(picture, mcap, 1440)


def report_picture(picture: Path, mcap: Path) -> None:
    """Take a picture of the report at a width of 1280 pixels, down to its second manoeuvre."""
    yawid(["report", str(mcap)])
    with chromium() as browser:
        page, _, complaints = opened(browser, mcap.with_suffix(".html").as_uri())
        seen = FloatRect(x=0, y=0, width=1280, height=page.evaluate(THIRD) - 20)
        page.screenshot(path=picture, full_page=True, clip=seen)
        print(*complaints, sep="\n", file=sys.stderr)
    small(picture, mcap, 1000)


def main(out: Path = ROOT / "tools/pictures") -> None:
    """Make the runs and take both pictures."""
    for name, take in (("report", report_picture), ("rerun", viewer_picture)):
        log = ROOT / "replay_logs" / SHOWN[name] / "log.tlog"
        with tempfile.TemporaryDirectory() as folder:
            yawid(["replay", str(log), "--out", folder, "--rerun", "save", "--force"])
            take(out / f"{name}.png", Path(folder) / "log.mcap")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
