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
from pictures.browser import Browser, find_chromium
from places import C172P, REPLAY_LOGS
from report_page import Page, first_screen

from yawid.blocks import Noted
from yawid.cli.main import main
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
    """A rudder that never moved, in a log whose name and parameters are markup."""
    folder = tmp_path_factory.mktemp("still")
    rng = np.random.default_rng(7)
    log = FlightLog()
    log.heartbeat(9.0)
    log.parameter(9.1, "<b>&$x_{1}$</b>", 1.0)
    flown = fly(lambda t: 0.05 * float(rng.normal()), lambda t: 1500, 30.0)
    path = folder / "<img src=x onerror=alert(1)>.tlog"
    path.write_bytes(log.data + flown.data)
    return replayed(path, folder)


@pytest.fixture(scope="module")
def still_html(still: Path) -> str:
    return report(open_run(still))


def test_the_first_screen_answers_the_four_questions(good: Path, html: str) -> None:
    run = open_run(good)
    mode = run.summary.dutch_roll
    text = first_screen(html)
    assert f"Natural frequency ωn {mode.wn_rad_s:.3f} rad/s ± {mode.wn_std:.3f}" in text
    assert f"Damping ratio ζ {mode.zeta:.3f} ± {mode.zeta_std:.3f}" in text
    assert "Can I use it? Not judged no manoeuvres were looked for" in text
    assert "± is one sigma of noise alone." in text


def test_a_log_that_cannot_answer_says_no_and_why_on_the_first_screen(
    still: Path, still_html: str
) -> None:
    run = open_run(still)
    text = first_screen(still_html)
    decisive = run.summary.verdict.reasons[0].text
    assert f"This log cannot say how the yaw answers the rudder: {decisive}." in text
    assert "Can I use it? No" in text
    assert "not excited" in text
    assert "MIL-F-8785C" not in text
    assert "Fly rudder doublets" in text


def test_the_page_counts_the_samples_of_each_note(good: Path, html: str) -> None:
    noted = np.concatenate([samples.noted for samples in open_run(good).samples()])
    count = int(np.sum(noted & Noted.NOT_EXCITED != 0))
    assert count > 40
    assert re.search(rf"not excited\W+{count} samples", Page(html).text)


def test_the_page_stands_alone(html: str) -> None:
    page = Page(html)
    assert "script" not in page.tags
    assert all(address.startswith(("#", "data:,")) for address in page.addresses)
    outside = set(re.findall(r"https?://[^\s\"'<>)]+", html))
    assert outside <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert not re.search(r"url\((?!#)", html)


def test_every_picture_is_drawn_says_what_to_look_for_and_shares_no_id(html: str) -> None:
    page = Page(html)
    assert len(page.ids) == len(set(page.ids))
    for key in PICTURES:
        figure = html[html.index(f'<figure id="{key}">') :].partition("</figure>")[0]
        assert figure.count("<svg") == 1
        assert figure.count("<path") > 5
        [look] = re.findall("<figcaption>(.*?)</figcaption>", figure)
        assert len(look) > 60
    assert page.tags.count("svg") == len(PICTURES)


def test_hostile_names_are_shown_and_never_obeyed(still_html: str) -> None:
    page = Page(still_html)
    assert "img" not in page.tags
    assert "<img src=x onerror=alert(1)>.tlog" in page.text
    assert "b" not in page.tags or "onerror" not in "".join(page.addresses)
    assert "&lt;b&gt;&amp;$x_{1}$&lt;/b&gt;" in still_html


def test_a_run_without_a_rudder_has_a_first_screen_and_no_pictures(tmp_path: Path) -> None:
    log = FlightLog()
    log.heartbeat(1.0, kind=2)
    path = tmp_path / "copter.tlog"
    path.write_bytes(log.data)
    html = report(open_run(replayed(path, tmp_path)))
    assert "Can I use it? No" in first_screen(html)
    assert "svg" not in Page(html).tags


def test_it_is_written_beside_the_run_with_the_same_bytes_and_never_over_a_file(
    good: Path, html: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = good.with_suffix(".html")
    path.write_bytes(b"earlier")
    assert main(["report", str(good)]) == 6
    assert "--force" in capsys.readouterr().err
    assert path.read_bytes() == b"earlier"
    assert main(["report", str(good), "--force"]) == 0
    assert capsys.readouterr().out == f"{path}\n"
    assert path.read_bytes() == html.encode()
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
@pytest.mark.parametrize("name", ["html", "still_html"])
def test_a_real_browser_has_nothing_to_complain_of_and_nothing_to_fetch(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    path = tmp_path / "report.html"
    path.write_text(request.getfixturevalue(name), encoding="utf-8")
    with Browser() as browser:
        for width, phone in ((1280, False), (390, True)):
            browser.open(path.as_uri(), width, 800, phone=phone)
            browser.listen(0.2)
            overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            assert browser.evaluate(overflow) == 0
            sizes = browser.evaluate(
                "[...document.querySelectorAll('figure svg')].map(svg => Math.min("
                "svg.getBoundingClientRect().width, svg.getBoundingClientRect().height))"
            )
            assert all(size > 100 for size in sizes)
            assert len(sizes) == (len(PICTURES) if name == "html" else len(sizes))
        bottom = browser.evaluate("document.querySelector('header').getBoundingClientRect().bottom")
        assert bottom < 1200
        assert browser.complaints == []
        assert set(browser.requests) <= {path.as_uri(), "about:blank"}


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
def test_the_browser_would_notice_a_script_error_and_a_request(tmp_path: Path) -> None:
    path = tmp_path / "bad.html"
    path.write_text("<img src='http://127.0.0.1:9/x.png'><script>boom()</script>", encoding="utf-8")
    with Browser() as browser:
        browser.open(path.as_uri())
        browser.listen(0.5)
        assert "http://127.0.0.1:9/x.png" in browser.requests
        assert browser.complaints


def test_the_two_other_flights_make_reports_too(tmp_path: Path) -> None:
    log = REPLAY_LOGS / "c172p_gcs_rates" / "log.tlog"
    html = report(open_run(replayed(log, tmp_path, "--memory", 10, *STREAM)))
    assert "Can I use it? Not judged" in first_screen(html)
    assert Page(html).tags.count("svg") == len(PICTURES)
