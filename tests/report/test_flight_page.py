"""The report of a flight: its verdict first, its manoeuvres as a table, over airspeed, over time.

The pages are of a real run whose summary was given the manoeuvres of flights made by hand.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from finished_runs import replayed
from hand_flights import (
    EVERY,
    NOT_CONVERGED,
    flight,
    forty,
    four,
    four_of_a_flight,
    manoeuvre,
    mixed_loops,
    none_usable,
    roll_of,
    summary,
    without_airspeed,
)
from matplotlib.figure import Figure
from models.answers_by_hand import response
from msgspec.structs import replace
from pictures.browser import Browser, find_chromium
from places import C172P, REPLAY_LOGS
from report_page import Page, first_screen

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Manoeuvre, RunSummary
from yawid.report.airspeed_picture import airspeed_picture
from yawid.report.data import gather, to_draw
from yawid.report.manoeuvres import flight_section
from yawid.report.picture import mark_events, traced
from yawid.report.write import report
from yawid.sinks.mcap.reader import McapRun, open_run

LOG = REPLAY_LOGS / "sitl_fbwa_50hz" / "log.tlog"
Paged = Callable[[RunSummary], McapRun]
Drawn = Callable[[RunSummary], str]


@pytest.fixture(scope="module")
def paged(tmp_path_factory: pytest.TempPathFactory) -> Paged:
    """Return a function that gives a real run the manoeuvres and flight of a summary."""
    run = open_run(replayed(LOG, tmp_path_factory.mktemp("run"), "--manoeuvres", "off"))

    def of(hand: RunSummary) -> McapRun:
        told = replace(
            run.summary, verdict=hand.verdict, manoeuvres=hand.manoeuvres, flight=hand.flight,
            flights=hand.flights,
        )  # fmt: skip
        return dataclasses.replace(run, summary=told)

    return of


@pytest.fixture(scope="module")
def drawn(paged: Paged) -> Callable[[RunSummary], str]:
    """Return a function that gives the page of such a run, which takes seconds to draw, once."""
    pages: dict[str, str] = {}

    def of(hand: RunSummary) -> str:
        key = json.dumps(hand.to_json())
        if key not in pages:
            pages[key] = report(paged(hand))
        return pages[key]

    return of


def section(html: str, heading: str) -> str:
    """Return the text between a heading and the next one."""
    return Page(html.partition(f"<h2>{heading}</h2>")[2].partition("<h2>")[0]).text


def test_the_first_screen_is_the_flights(drawn: Drawn) -> None:
    text = first_screen(drawn(four_of_a_flight()))

    assert "2026-03-05 12:14:37 UTC · a continuous-time fit at 20 Hz" in text
    assert "It holds for the aircraft with its roll loop, at 22.0 m/s (airspeed)" in text
    assert "Natural frequency ωn 10.21 rad/s ± 0.16 " in text
    assert "Can I use it? Yes there is no reason against it" in text


def test_a_refused_flight_is_refused(drawn: Drawn) -> None:
    html = drawn(none_usable())

    assert '<header class="unusable">' in html
    assert "Can I use it? No there is no answer not converged" in first_screen(html)
    assert "continuous-time fit" not in first_screen(html)


def test_the_numbers_of_a_fitted_flight_have_their_names_and_their_source(
    tmp_path: Path,
) -> None:
    html = report(open_run(replayed(C172P, tmp_path)))

    page = Page(html)
    assert len(page.ids) == len(set(page.ids))
    assert "N β = a my β weathercock stability, 1/s²" in page.text
    assert "M. T. Vu" in page.text


def test_each_manoeuvre_stands_with_all_its_conditions(drawn: Drawn) -> None:
    html = drawn(four_of_a_flight())
    text = section(html, "Manoeuvres")

    assert text.startswith("n ωn, rad/s ζ from–to, s mode ")  # what a phone shows
    assert (
        "3 11.92 ± 0.11 (0.03) 0.410 ± 0.012 (0.004) 155.0–187.4 2026-03-05 12:16:37 UTC "
        "FBWA with roll loop 22.30 ± 0.30 airspeed 102 rudder turn removed "
        "0.3080 ± 0.0060 (0.002) 91 disagrees 4 12.40 ± 0.11"
    ) in text
    assert "4: not converged the natural frequency went from 9.1" in text
    told = section(html, "Numbers of the answer")
    assert "κ = ωn / V, rad/m 0.4634 ± 0.0077 (0.0012)" in told
    assert "K / V, rad/m per half-travel 0.01400 ± 0.00040 (0.0001)" in told
    assert "manoeuvres used 1, 2 left out, as they disagree 3" in told
    pale = re.findall(r'<tr class="pale">.*', html)
    assert ["215.0–247.4" in row for row in pale] == [True]


def test_the_section_says_what_sigma_is_of() -> None:
    text = Page("".join(flight_section(four_of_a_flight(), "half-travel"))).text

    total = "± is one sigma: noise, structure, scatter of manoeuvres; in brackets of noise alone."
    assert total in text


def test_what_was_flown_otherwise_is_said_row_by_row(drawn: Drawn) -> None:
    html = "".join(flight_section(mixed_loops(), "half-travel"))
    text = section(html, "Manoeuvres")

    assert "MANUAL airframe 22.00 ± 0.30 airspeed 102 rudder, aileron" in text
    assert "FBWA with roll loop 22.00 ± 0.30 ground speed" in text
    assert "– not known" in text
    assert "another loop" not in text
    numbers = section(drawn(mixed_loops()), "Numbers of the answer")
    assert "The flight, the airframe, ± one σ ωn, rad/s 10.40 ± 0.30" in numbers
    assert "with roll loop at 22.0 m/s airframe at 22.0 m/s" in numbers
    assert "101.0 ± 3.0 (1) 104.0 ± 6.0 (2)" in numbers
    assert (
        "Derivatives of the aircraft as flown (the flight mode is not known) are absent: in each "
        "manoeuvre used the model has no yaw mode"
    ) in numbers


def test_what_is_the_streams_is_called_so(drawn: Drawn) -> None:
    text = Page(drawn(four_of_a_flight())).text

    assert "not about the flight's answer above. They are not judged" in text
    assert "answers" not in text.partition("Parameters, ± σ")[2].partition("a1")[0]
    headings = re.findall("<h2>(.*?)</h2>", drawn(four_of_a_flight()))
    assert headings[-3:] == [
        "Configuration and provenance",
        "The stream, sample by sample",
        "Numbers of the stream, at its end",
    ]
    assert 'id="modes"' not in drawn(four_of_a_flight())
    alone = Page(drawn(summary(None, None))).text
    assert "The stream, sample by sample" not in alone
    assert "Manoeuvres" not in alone


def test_a_run_in_which_none_was_found_says_so_on_the_page(drawn: Drawn) -> None:
    html = drawn(summary([], None))

    assert section(html, "Manoeuvres").startswith("no manoeuvre was found: the rudder never moved")
    assert "hatched" not in Page(html).text


@pytest.mark.parametrize(
    "name",
    [
        "four_of_a_flight", "none_usable",
        *(pytest.param(name, marks=pytest.mark.long) for name in list(EVERY)[2:]),
    ],
)  # fmt: skip
def test_the_picture_over_airspeed_stands_where_there_are_airspeeds(
    name: str, paged: Paged
) -> None:
    keys = re.findall(r'<figure id="([^"]+)">', report(paged(EVERY[name]())))

    assert len(keys) == len(set(keys)) > 0
    # Of none_usable one alone has a Dutch roll.
    assert ("airspeed" in keys) == (name not in ("without_airspeed", "none_usable"))


def test_the_picture_has_the_points_their_numbers_and_kappas_line() -> None:
    picture = airspeed_picture(four(), [flight()])
    assert picture is not None
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", picture.svg)

    assert {"ωn = 0.463 V", "used", "disagrees", "not usable", "the flight"} <= set(texts)
    assert [texts.count(n) for n in "1234"] == [2, 2, 2, 2]
    assert "airspeed [m/s]" in texts
    many = airspeed_picture(forty().manoeuvres or [], [flight()])
    assert many is not None
    assert ">40</text>" not in many.svg


def test_the_picture_of_two_loops_says_whose_each_point_is() -> None:
    told = mixed_loops()
    picture = airspeed_picture(
        [
            replace(each, airspeed_m_s=v)
            for each, v in zip(told.manoeuvres or [], (18, 22, 26), strict=True)
        ],
        told.by_loop,
    )
    assert picture is not None
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", picture.svg)

    assert {"used, with roll loop", "used, airframe"} <= set(texts)
    assert "used" not in texts


def test_of_refused_ones_the_first_drawn_is_the_one_whose_reasons_the_flight_gives() -> None:
    poor, undriven = (Reason(id_, "", weight="fatal") for id_ in ("poor_fit", "mode_not_driven"))
    several = Verdict(method="ct", usable=False, reasons=[undriven, poor])
    short = manoeuvre(1, reason=poor)
    long = replace(manoeuvre(2, reason=undriven), duration_s=60.0)
    longest = replace(manoeuvre(3, reason=poor), duration_s=90.0, verdict=several)
    usable = manoeuvre(4)

    def with_model(each: Manoeuvre) -> Manoeuvre:
        of = response([complex(-1.0, 4.0)], {"rudder": [complex(2.0, 0.1)]})
        return replace(each, estimates={"ct": replace(each.estimates["ct"], response=of)})

    every = [with_model(each) for each in (short, longest, long, usable)]
    assert [each.n for each in to_draw([*every, manoeuvre(5)], ())] == [4, 2, 1, 3]
    assert min((short, long, longest), key=lambda each: each.standing) is long


def test_numbers_at_one_airspeed_do_not_lie_on_one_another() -> None:
    """Three at 22 m/s with nearly one Dutch roll, and two at 30 m/s with the same one."""
    at_22 = [manoeuvre(n, 10.2 + 0.02 * n, 0.62, speed=22.0 + 0.03 * n) for n in (8, 9, 10)]
    at_30 = [manoeuvre(n, 13.9, 0.62, speed=30.0) for n in (11, 12)]
    of_all = flight(used=[8, 9, 10, 11, 12], disagree=[])
    picture = airspeed_picture([*at_22, *at_30], [of_all])
    assert picture is not None
    drawing = Figure(figsize=picture.size_in, layout="constrained")
    picture.draw(drawing)
    drawing.draw_without_rendering()

    for axes in drawing.axes:
        boxes = [text.get_window_extent() for text in axes.texts]
        assert len(boxes) == 5
        hidden = [(a, b) for i, a in enumerate(boxes) for b in boxes[:i] if a.overlaps(b)]
        assert hidden == []
        markers = axes.transData.transform(
            [xy for bars in axes.containers if bars.get_label() == "used"
             for xy in bars.lines[0].get_xydata()]
        )  # fmt: skip
        assert len(markers) == 5
        assert not any(box.contains(*marker) for box in boxes for marker in markers)


def test_one_manoeuvre_with_an_airspeed_makes_no_picture() -> None:
    alone = [manoeuvre(1), manoeuvre(2, speed=None), manoeuvre(3, None)]

    assert airspeed_picture(alone, [flight()]) is None
    assert airspeed_picture(without_airspeed().manoeuvres or [], [flight()]) is None


def test_a_refused_one_far_off_takes_no_axis_with_it() -> None:
    """A warning of the drawing is an error in these tests."""
    wild = four()[3]
    far = replace(roll_of(1e200, -1e200), wn_std=1e299, zeta_std=1e299)
    estimates = {"ct": replace(wild.estimates["ct"], dutch_roll=far)}
    picture = airspeed_picture([*four()[:3], replace(wild, estimates=estimates)], [flight()])
    assert picture is not None

    assert "Off the picture: 1 that cannot be used." in picture.look
    assert not re.findall(r"[0-9]{5,}\.[0-9]", picture.svg)
    no_speed = [manoeuvre(n, speed=0.0) for n in (1, 2)]
    assert airspeed_picture(no_speed, [flight(kappa_rad_m=None)]) is not None


def test_manoeuvres_are_shaded_where_they_were_flown_and_numbered(paged: Paged) -> None:
    data = gather(paged(four_of_a_flight()))
    assert data is not None
    axes = Figure().subplots()
    axes.set_xlim(100.0, 230.0)
    events = dataclasses.replace(data.events, held=np.empty((0, 2)), mode_changes=np.empty(0))
    mark_events(axes, events)

    spans = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches]
    found = [(round(box.x0, 1), round(box.x1, 1)) for box in spans]
    assert found == [(100.0, 127.4), (155.0, 187.4), (215.0, 230.0)]
    assert [patch.get_hatch() for patch in axes.patches] == [None, None, "////"]
    assert [text.get_text() for text in axes.texts] == ["2", "3", "4"]
    assert axes.get_xlim() == (100.0, 230.0)


@pytest.mark.parametrize("rows", [400, 40_000])
def test_no_line_is_drawn_over_a_gap_of_the_log(rows: int) -> None:
    t = 0.05 * np.arange(rows)
    t = t[(t < 0.4 * t[-1]) | (t > 0.6 * t[-1])]
    axes = Figure().subplots()
    traced(axes, t, np.sin(t), "#000000")
    ends = [line.get_xdata() for line in axes.lines]
    ends += [path.vertices[:, 0] for each in axes.collections for path in each.get_paths()]
    assert len(ends) == 2
    assert all(np.ptp(each) < 0.41 * t[-1] for each in ends)


def test_no_line_is_drawn_back_through_time_after_a_reboot() -> None:
    t = np.concatenate([np.arange(400.0, 450.0, 0.01), np.arange(10.0, 60.0, 0.01)])
    axes = Figure().subplots()
    for rows in (slice(None), slice(None, None, 50)):
        traced(axes, t[rows], np.sin(t[rows]), "#000000")

    assert len(axes.collections) == len(axes.lines) == 2
    seen = [np.asarray(line.get_xdata()) for line in axes.lines]
    assert all((np.diff(x) > 0.0).all() and np.ptp(x) < 51.0 for x in seen)


def test_numbers_of_many_manoeuvres_do_not_hide_one_another(paged: Paged) -> None:
    data = gather(paged(forty()))
    assert data is not None
    axes = Figure().subplots()
    axes.set_xlim(0.0, 2500.0)
    mark_events(axes, data.events)

    places = [text.xy[0] for text in axes.texts]  # type: ignore[attr-defined] # Annotations
    assert len(axes.patches) >= 40
    assert min(np.diff(places)) > 0.035 * 2500.0


def test_hostile_words_of_a_manoeuvre_are_shown_and_never_obeyed(drawn: Drawn) -> None:
    bad = "<img src=x onerror=alert(1)>"
    odd = manoeuvre(1, mode=bad, loop=bad, date=bad, airspeed_source=bad, inputs=[bad])
    page = Page(drawn(summary([odd, manoeuvre(2)], flight(date=bad, loop=bad))))

    assert "img" not in page.tags
    assert bad in page.text


OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
HIDDEN = "(sheet => sheet.scrollWidth - sheet.clientWidth)(document.querySelector('.sheet'))"
ON_AXES = """[...document.querySelectorAll('figure')].flatMap(f => {
  const box = e => e.getBoundingClientRect();
  const axes = [...f.querySelectorAll('[id*="-axes_"] > [id*="-patch_"]:first-child')].map(box);
  return [...f.querySelectorAll('[id*="-legend_"]')].map(box).flatMap(l => axes.filter(a =>
    l.left < a.right && a.left < l.right && l.top < a.bottom - 1 && a.top < l.bottom - 1)
    .map(() => f.id)); })"""
SPLIT = """[...document.querySelectorAll('td.number, .option, .card .answer')].filter(e => {
  const range = document.createRange(); range.selectNodeContents(e);
  const lines = new Set([...range.getClientRects()].map(r => Math.round(r.top))).size;
  return lines > e.textContent.split(' ').length; }).map(e => e.textContent)"""
CUT = """[...document.querySelectorAll('td, th, figure, p, .card')].filter(
  e => e.getBoundingClientRect().right > document.documentElement.clientWidth + 0.5)
  .map(e => e.textContent.slice(0, 40))"""
PAPER_PX = round((210.0 - 2 * 13.0) / 25.4 * 96.0)
"""The width of A4 between the margins that the page asks for."""


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
@pytest.mark.parametrize(
    "name", ["four_of_a_flight", pytest.param("forty", marks=pytest.mark.long)]
)
def test_a_browser_shows_it_within_its_width_and_no_legend_on_a_line(
    name: str, drawn: Drawn, tmp_path: Path
) -> None:
    path = tmp_path / "page.html"
    path.write_text(drawn(EVERY[name]()), encoding="utf-8")
    with Browser() as browser:
        for width, phone in ((1280, False), (360, True)):
            browser.open(path.as_uri(), width, 800, phone=phone)
            browser.listen(0.2)
            assert browser.evaluate(OVERFLOW) == 0
            assert browser.evaluate(ON_AXES) == []
            assert browser.evaluate(SPLIT) == []
            # On a wide screen the whole table of few manoeuvres is seen.
            assert phone or name == "forty" or browser.evaluate(HIDDEN) == 0
        assert browser.complaints == []


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
def test_printed_every_number_is_on_the_paper(drawn: Drawn, tmp_path: Path) -> None:
    html = drawn(four_of_a_flight())
    path, printed = tmp_path / "page.html", tmp_path / "page.pdf"
    path.write_text(html, encoding="utf-8")
    with Browser() as browser:
        browser.call("Emulation.setEmulatedMedia", media="print")
        browser.open(path.as_uri(), PAPER_PX, 1000)
        browser.listen(0.2)
        assert browser.evaluate(CUT) == []
        browser.pdf(printed)

    pypdf = pytest.importorskip("pypdf")
    sheets = [page.extract_text() for page in pypdf.PdfReader(printed).pages]
    words = "".join("".join(sheets).split())
    cells = re.findall(r'<td(?: class="number")?>(.*?)</td>', html)
    numbers = {number for cell in cells for number in re.findall(r"[-\d.]*\d", Page(cell).text)}
    assert len(numbers) > 80
    assert [number for number in numbers if number not in words] == []
    assert NOT_CONVERGED.text.replace(" ", "") in words  # of the folded reasons


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
@pytest.mark.parametrize(
    "heights_px",
    [range(150, 300, 50), pytest.param(range(0, 1000, 25), marks=pytest.mark.long)],
    ids=["few", "many"],
)
def test_printed_no_heading_stands_alone_at_the_foot_of_a_sheet(
    heights_px: range, drawn: Drawn, tmp_path: Path
) -> None:
    """The page without its pictures, moved down by these heights; a note belongs to its heading."""
    pypdf = pytest.importorskip("pypdf")
    html = re.sub("<svg.*?</svg>", "", drawn(four_of_a_flight()), flags=re.DOTALL)
    path, printed = tmp_path / "page.html", tmp_path / "page.pdf"
    headings = {Page(each).text for each in re.findall("<(?:h[23]|summary)>(.*?)</", html)}
    last = []
    with Browser() as browser:
        for height_px in heights_px:
            shift = f'<div style="height: {height_px}px"></div>'
            path.write_text(html.replace("<header", f"{shift}<header", 1), encoding="utf-8")
            browser.open(path.as_uri(), PAPER_PX, 1000)
            browser.pdf(printed)
            sheets = [sheet.extract_text() for sheet in pypdf.PdfReader(printed).pages]
            last += [sheet.strip().splitlines()[-1] for sheet in sheets[:-1] if sheet.strip()]

    assert len(headings) > 15
    assert [line for line in last if line.strip() in headings or "By themselves" in line] == []
