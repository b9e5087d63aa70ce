"""Takes pictures of Rerun with a recording, of the report, and of the page of ``yawid serve``.

    python -m pictures.screenshots [rerun] [report] [serve]

Without a name all are taken. It needs no screen, but chromium, and for the picture of Rerun
Debian's mesa-vulkan-drivers (the viewer draws by Vulkan, in software). Look at every picture before
you keep it. Each has the cases and the answers that it shows in its text "yawid", which a test
compares with the answers of today.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
from pathlib import Path

import rerun as rr
from checks.children import flights_page
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from playwright.sync_api import FloatRect
from rerun.experimental import ViewerClient

from pictures.browser import chromium, opened
from yawid.cli.main import main as yawid
from yawid.sinks.mcap.reader import open_run

ROOT = Path(__file__).resolve().parents[2]
# The program itself: the rerun command next to the interpreter is a script that runs it.
VIEWER = Path(rr.__file__).parents[1] / "rerun_cli" / "rerun"
COLOURS = 256  # with so many, 99.9 % of the pixels are at most 11 of 255 off
SETTLE_S = 6.0
# The report shows the answer, the list of manoeuvres, the flight, and two manoeuvres as fitted.
THIRD = "document.querySelector('.pictures figure:nth-child(5)').getBoundingClientRect().top"


def log_of(case: str, folder: Path) -> Path:
    """Copy the log of a case of replay_logs/ into a folder, under the case's name."""
    return Path(shutil.copy(ROOT / "replay_logs" / case / "log.tlog", folder / f"{case}.tlog"))


def replayed(case: str, folder: Path) -> Path:
    """Replay a case; return the MCAP, next to which its recording is."""
    log = log_of(case, folder)
    yawid(["replay", str(log), "--out", str(folder), "--rerun", "save"])
    return log.with_suffix(".mcap")


def small(picture: Path, width: int, *runs: Path) -> None:
    """Make a picture one of a README: at most ``width`` wide, with few colours.

    Its text has a line for each run that has an answer: the case, its options, and the answer.
    """
    with Image.open(picture) as image:
        whole = image.convert("RGB")
    whole.thumbnail((width, whole.height), Image.Resampling.LANCZOS)
    few = whole.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    flights = {mcap.name.split(".")[0]: open_run(mcap).summary.flight for mcap in runs}
    told = PngInfo()
    told.add_text("yawid", "\n".join(
        json.dumps({"case": case, "options": {}, "dutch_roll": flight.to_json()["dutch_roll"]})
        for case, flight in flights.items() if flight is not None
    ))  # fmt: skip
    few.save(picture, optimize=True, pnginfo=told)
    print(f"{picture}: {few.width} x {few.height}, {picture.stat().st_size / 1e3:.0f} kB")


def rerun(picture: Path, folder: Path) -> None:
    """Open the recording of a manoeuvre in the native viewer, without a screen."""
    mcap = replayed("c172p_3211", folder)
    client = ViewerClient.spawn(
        headless=True, executable_path=str(VIEWER), hide_welcome_screen=True
    )
    try:
        client.open([str(mcap.with_suffix(".rrd"))])
        time.sleep(SETTLE_S)  # the viewer does not report when it has drawn
        client.save_screenshot(str(picture))
    finally:
        client.quit()
    small(picture, 1440, mcap)


def report(picture: Path, folder: Path) -> None:
    """Open the report of twelve manoeuvres at three speeds, down to its second manoeuvre."""
    mcap = replayed("c172p_three_speeds", folder)
    yawid(["report", str(mcap)])
    with chromium() as browser:
        page, _, complaints = opened(browser, mcap.with_suffix(".html").as_uri())
        seen = FloatRect(x=0, y=0, width=1280, height=page.evaluate(THIRD) - 20)
        page.screenshot(path=picture, full_page=True, clip=seen)
        print(*complaints, sep="\n", file=sys.stderr)
    small(picture, 1000, mcap)


DROPPED = "c172p_3211", "c172p_damper", "sitl_bare", "turns_calm"
LAST = "c172p_three_speeds"
"""What is dropped on the page: logs that are read, and then one that is being read."""


def serve(picture: Path, folder: Path) -> None:
    """Drop logs on the page of ``yawid serve``; below its list are a flight's pictures, zoomed."""
    logs, zoomed = folder / "flights", folder / "zoomed.png"
    logs.mkdir()
    with flights_page(logs) as (address, _), chromium() as browser:
        page, _, complaints = opened(browser, address, height=100)
        page.set_input_files("#choose", [log_of(case, folder) for case in DROPPED])
        page.locator(".good, .bad").nth(len(DROPPED) - 1).wait_for(timeout=120_000.0)
        page.set_input_files("#choose", log_of(LAST, folder))
        page.get_by_text("being read").wait_for()
        page.locator(".origin").evaluate("it => (it.textContent = 'flights')")  # no path from here
        page.screenshot(path=picture, full_page=True)
        flight, _, more = opened(browser, f"{address}flights/{DROPPED[0]}.tlog")
        over = flight.locator("#whole .u-over").last
        over.drag_to(over, source_position={"x": 90, "y": 40}, target_position={"x": 210, "y": 40})
        over.hover(position={"x": 300, "y": 40})
        flight.locator(".pictures", has=flight.locator("#whole")).screenshot(path=zoomed)
        print(*complaints, *more, sep="\n", file=sys.stderr)
    with Image.open(picture) as above, Image.open(zoomed) as below:
        both = Image.new("RGB", (above.width, above.height + below.height), "white")
        both.paste(above)
        both.paste(below, ((above.width - below.width) // 2, above.height))
    both.save(picture)
    small(picture, 1000, *(logs / "yawid-out" / f"{case}.tlog.mcap" for case in DROPPED))


PICTURES = {each.__name__: each for each in (rerun, report, serve)}


def main(*names: str) -> None:
    """Take the pictures of these names, or all."""
    for name in names or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            PICTURES[name](ROOT / "tools" / "pictures" / f"{name}.png", Path(folder))


if __name__ == "__main__":
    main(*sys.argv[1:])
