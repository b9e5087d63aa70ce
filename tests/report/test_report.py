"""``yawid report``: what its first screen says, that it stands alone, and that it holds its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from finished_runs import replayed
from flightlog import FlightLog, fly
from pictures.browser import chromium, find_chromium, opened
from places import C172P
from report_page import Page, assert_runs_only_its_own, first_screen

from yawid.blocks import Noted
from yawid.cli.main import main
from yawid.report.html import SCRIPTS, note
from yawid.report.write import report
from yawid.sinks.mcap.reader import open_run

PICTURES = ("whole", "modes")
STREAM = ("--manoeuvres", "off")
"""These tests are of the stream alone; tests of a flight's page are in test_flight_page.py."""


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    return replayed(C172P, folder, "--rate", 10, "--memory", "inf", *STREAM)


@pytest.fixture(scope="module")
def html(good: Path) -> str:
    return report(open_run(good))


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rudder that never moved, and a parameter whose name would be mathematics in a picture."""
    folder, rng, log = tmp_path_factory.mktemp("still"), np.random.default_rng(7), FlightLog()
    log.parameter(9.1, "<b>&$x_{1}$</b>", 1.0)
    flown = fly(lambda t: 0.05 * float(rng.normal()), lambda t: 1500, 30.0)
    (folder / "still.tlog").write_bytes(log.data + flown.data)
    return replayed(folder / "still.tlog", folder)


def test_the_page_of_a_stream_answers_the_four_questions_and_counts_its_notes(
    good: Path, html: str
) -> None:
    run = open_run(good)
    mode, text = run.summary.dutch_roll, first_screen(html)
    noted = np.concatenate([samples.noted for samples in run.samples()])
    count = int(np.sum(noted & Noted.NOT_EXCITED != 0))

    assert f"Natural frequency ωn {mode.wn_rad_s:.3f} rad/s ± {mode.wn_std:.3f}" in text
    assert f"Damping ratio ζ {mode.zeta:.3f} ± {mode.zeta_std:.3f}" in text
    assert "Can I use it? Not judged no manoeuvres were looked for" in text
    assert "± is one sigma of noise alone." in text
    assert count > 40
    assert re.search(rf"not excited\W+{count} samples", Page(html).text)
    assert "rad/s per half-travel" in Page(html).text
    assert "per rad" not in Page(html).text


def test_a_log_that_cannot_answer_says_no_and_why(still: Path) -> None:
    run = open_run(still)
    html, decisive = report(run), run.summary.verdict.reasons[0].text
    text = first_screen(html)

    assert f"This log cannot say how the yaw answers the rudder: {decisive}." in text
    assert "Can I use it? No" in text
    assert "Fly rudder doublets" in text
    assert "MIL-F-8785C" not in text
    assert "&lt;b&gt;&amp;$x_{1}$&lt;/b&gt;" in html


def test_the_page_stands_alone_and_each_picture_is_drawn_and_says_what_to_look_for(
    html: str,
) -> None:
    page = Page(html)
    outside = set(re.findall(r"https?://[^\s\"'<>)]+", html))
    figures = re.findall(r'<figure id="([^"]+)">(.*?)</figure>', html, re.DOTALL)

    assert_runs_only_its_own(page, SCRIPTS)
    assert page.scripts
    assert all(address.startswith(("#", "data:,")) for address in page.addresses)
    assert outside <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert not re.search(r"url\((?!#)", html)
    assert len(page.ids) == len(set(page.ids))
    assert [key for key, _ in figures] == list(PICTURES)
    assert all((x.count("<svg"), x.count("<path") > 5) == (1, True) for _, x in figures)
    assert all(len(re.findall("<figcaption>(.*?)</f", x)[0]) > 60 for _, x in figures)


def test_a_run_without_a_rudder_has_a_first_screen_and_no_pictures(tmp_path: Path) -> None:
    log = FlightLog()
    log.heartbeat(1.0, kind=2)
    (tmp_path / "copter.tlog").write_bytes(log.data)
    html = report(open_run(replayed(tmp_path / "copter.tlog", tmp_path)))

    assert "Can I use it? No" in first_screen(html)
    assert {"svg", "script"} & set(Page(html).tags) == set()


def test_the_command_writes_the_same_bytes_next_to_the_run(good: Path, html: str) -> None:
    assert main(["report", str(good), "--force"]) == 0
    assert good.with_suffix(".html").read_bytes() == html.encode()
    assert not list(good.parent.glob("*.part"))


@pytest.mark.long  # matplotlib lists all fonts anew where it has no cache
def test_without_a_folder_for_the_cache_of_matplotlib_stderr_has_no_line(
    good: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    environment = os.environ | {"MPLCONFIGDIR": str(tmp_path / "file" / "below")}
    order = [sys.executable, "-m", "yawid", "report", str(good), "-o", str(tmp_path / "a.html")]
    told = subprocess.run(
        order, env=environment, capture_output=True, text=True, timeout=120, check=True
    )
    assert told.stderr == ""


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
def test_the_browser_would_notice_a_script_error_and_a_request(tmp_path: Path) -> None:
    path = tmp_path / "bad.html"
    path.write_text("<img src='http://127.0.0.1:9/x.png'><script>boom()</script>", encoding="utf-8")
    with chromium() as browser:
        _, requests, complaints = opened(browser, path.as_uri())
        assert "http://127.0.0.1:9/x.png" in requests
        assert complaints


def test_characters_that_html_does_not_allow_are_replaced_in_texts_and_in_sentences() -> None:
    shown = note("a\x1b", "--b \x00 \ud800 \x85")

    assert shown.count("\ufffd") == 4
    assert not any(ord(each) < 32 and each != "\n" for each in shown)
    shown.encode("utf-8")
