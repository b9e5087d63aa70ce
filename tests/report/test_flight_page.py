"""The report of a flight: its verdict first, its manoeuvres as a table, over airspeed, over time.

The pages are of a real run whose summary was given the manoeuvres of flights made by hand.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from functools import cache
from itertools import product
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
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from models.answers_by_hand import response
from msgspec.structs import replace
from pictures.browser import chromium, find_chromium, opened
from places import REPLAY_LOGS
from report_page import Page, first_screen

from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Flight, Manoeuvre, RunSummary
from yawid.report.airspeed_picture import airspeed_picture
from yawid.report.data import Events, to_draw
from yawid.report.picture import mark_events, traced
from yawid.report.write import report
from yawid.sinks.mcap.reader import open_run

LOG = REPLAY_LOGS / "sitl_fbwa_50hz" / "log.tlog"
Made = Callable[[], RunSummary]
Drawn = Callable[[Made], str]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """Return a function that draws the page of a real run with the flight of a summary, once."""
    run = open_run(replayed(LOG, tmp_path_factory.mktemp("run"), "--manoeuvres", "off"))

    @cache
    def of(made: Made) -> str:
        hand = made()
        told = replace(
            run.summary, verdict=hand.verdict, manoeuvres=hand.manoeuvres, flight=hand.flight,
            flights=hand.flights,
        )  # fmt: skip
        return report(dataclasses.replace(run, summary=told))

    return of


def not_looked_for() -> RunSummary:
    return summary(None, None)


def none_found() -> RunSummary:
    return summary([], None)


MARKUP = "<img src=x onerror=alert(1)>"


def with_markup() -> RunSummary:
    odd = manoeuvre(
        1, mode=MARKUP, loop=MARKUP, date=MARKUP, airspeed_source=MARKUP, inputs=[MARKUP]
    )
    return summary([odd, manoeuvre(2)], flight(date=MARKUP, loop=MARKUP))


SAID = [
    (four_of_a_flight, "", "2026-03-05 12:14:37 UTC · a continuous-time fit at 20 Hz"),
    (four_of_a_flight, "", "It holds for the aircraft with its roll loop, at 22.0 m/s (airspeed)"),
    (four_of_a_flight, "", "Natural frequency ωn 10.21 rad/s ± 0.16 "),
    (four_of_a_flight, "", "Can I use it? Yes there is no reason against it"),
    (four_of_a_flight, "Manoeuvres", "n ωn, rad/s ζ from–to, s mode "),  # what a phone shows
    (four_of_a_flight, "Manoeuvres",
     "3 11.92 ± 0.11 (0.03) 0.410 ± 0.012 (0.004) 155.0–187.4 2026-03-05 12:16:37 UTC "
     "FBWA with roll loop 22.30 ± 0.30 airspeed 102 rudder turn removed "
     "0.3080 ± 0.0060 (0.002) 91 disagrees 4 12.40 ± 0.11"),
    (four_of_a_flight, "Manoeuvres", "4: not converged the natural frequency went from 9.1"),
    (four_of_a_flight, "Manoeuvres",
     "± is one sigma: noise, structure, scatter of manoeuvres; in brackets of noise alone."),
    (four_of_a_flight, "Numbers of the answer", "κ = ωn / V, rad/m 0.4634 ± 0.0077 (0.0012)"),
    (four_of_a_flight, "Numbers of the answer",
     "K / V, rad/m per half-travel 0.01400 ± 0.00040 (0.0001) overshoot after a step of the "
     "rudder, % 8.1 ± 1.2 (0.3) settling time after it, s 0.462 ± 0.031 (0.008)"),
    (four_of_a_flight, "Numbers of the answer",
     "manoeuvres used 1, 2 left out, as they disagree 3"),
    (four_of_a_flight, "The stream, sample by sample",
     "not about the flight's answer above. They are not judged"),
    (none_usable, "", "Can I use it? No there is no answer not converged"),
    (mixed_loops, "Manoeuvres", "MANUAL airframe 22.00 ± 0.30 airspeed 102 rudder, aileron"),
    (mixed_loops, "Manoeuvres", "FBWA with roll loop 22.00 ± 0.30 ground speed"),
    (mixed_loops, "Manoeuvres", "– not known"),
    (mixed_loops, "Numbers of the answer",
     "The flight, the airframe, ± one σ ωn, rad/s 10.40 ± 0.30"),
    (mixed_loops, "Numbers of the answer", "with roll loop at 22.0 m/s airframe at 22.0 m/s"),
    (mixed_loops, "Numbers of the answer", "101.0 ± 3.0 (1) 104.0 ± 6.0 (2)"),
    (mixed_loops, "Numbers of the answer",
     "Derivatives of the aircraft as flown (the flight mode is not known) are absent: in each "
     "manoeuvre used the model has no yaw mode"),
    (none_found, "Manoeuvres", "no manoeuvre was found: the rudder never moved"),
    (with_markup, "Manoeuvres", f"22.00 ± 0.30 {MARKUP} 102 {MARKUP}"),
]  # fmt: skip
"""A flight, the heading of a section of its page ("": the first screen), and what that says."""


@pytest.mark.parametrize(("of", "heading", "words"), SAID)
def test_a_section_says(of: Made, heading: str, words: str, drawn: Drawn) -> None:
    html = drawn(of)
    part = html.partition(f"<h2>{heading}</h2>")[2].partition("<h2>")[0]

    assert words in (Page(part).text if heading else first_screen(html))


def test_a_page_claims_nothing_that_its_flight_has_not(drawn: Drawn) -> None:
    four, refused, none = (drawn(of) for of in (four_of_a_flight, none_usable, none_found))

    assert '<header class="unusable">' in refused
    assert "continuous-time fit" not in first_screen(refused)
    assert ["215.0–247.4" in row for row in re.findall(r'<tr class="pale">.*', four)] == [True]
    assert re.findall("<h2>(.*?)</h2>", four)[-3:] == [
        "Configuration and provenance",
        "The stream, sample by sample",
        "Numbers of the stream, at its end",
    ]
    assert 'id="modes"' not in four
    assert "hatched" not in Page(none).text
    assert "Manoeuvres" not in Page(drawn(not_looked_for)).text
    assert "img" not in Page(drawn(with_markup)).tags


@pytest.mark.parametrize(
    "name",
    [
        "four_of_a_flight", "none_usable",
        *(pytest.param(name, marks=pytest.mark.long) for name in list(EVERY)[2:]),
    ],
)  # fmt: skip
def test_the_picture_over_airspeed_stands_where_there_are_airspeeds(
    name: str, drawn: Drawn
) -> None:
    keys = re.findall(r'<figure id="([^"]+)">', drawn(EVERY[name]))

    assert len(keys) == len(set(keys)) > 0
    # Of none_usable one alone has a Dutch roll.
    assert ("airspeed" in keys) == (name not in ("without_airspeed", "none_usable"))


def texts_of(manoeuvres: list[Manoeuvre], flights: list[Flight]) -> list[str]:
    """Return the texts of the picture over airspeed, none where there is no picture."""
    picture = airspeed_picture(manoeuvres, flights)
    return [] if picture is None else re.findall(r"<text[^>]*>([^<]*)</text>", picture.svg)


def test_the_picture_over_airspeed_has_the_points_their_numbers_and_kappas_line() -> None:
    texts = texts_of(four(), [flight()])

    assert {"ωn = 0.463 V", "used", "disagrees", "not usable", "the flight"} <= set(texts)
    assert [texts.count(n) for n in "1234"] == [2, 2, 2, 2]
    assert "airspeed [m/s]" in texts
    assert "40" not in texts_of(forty().manoeuvres or [], [flight()])
    told = mixed_loops()
    apart = zip(told.manoeuvres or [], (18, 22, 26), strict=True)
    whose = texts_of([replace(each, airspeed_m_s=v) for each, v in apart], told.by_loop)
    assert {"used, with roll loop", "used, airframe", "used, not known"} <= {*whose} - {"used"}
    assert texts_of([manoeuvre(1), manoeuvre(2, speed=None), manoeuvre(3, None)], [flight()]) == []
    assert texts_of([manoeuvre(n, speed=0.0) for n in (1, 2)], [flight(kappa_rad_m=None)])


def test_of_refused_ones_the_first_drawn_is_the_one_whose_reasons_the_flight_gives() -> None:
    poor, undriven = (Reason(id_, "", weight="fatal") for id_ in ("poor_fit", "mode_not_driven"))
    several = Verdict(method="ct", usable=False, reasons=[undriven, poor])
    short = manoeuvre(1, reason=poor)
    long = replace(manoeuvre(2, reason=undriven), duration_s=60.0)
    longest = replace(manoeuvre(3, reason=poor), duration_s=90.0, verdict=several)

    def with_model(each: Manoeuvre) -> Manoeuvre:
        of = response([complex(-1.0, 4.0)], {"rudder": [complex(2.0, 0.1)]})
        return replace(each, estimates={"ct": replace(each.estimates["ct"], response=of)})

    every = [with_model(each) for each in (short, longest, long, manoeuvre(4))]
    assert [each.n for each in to_draw([*every, manoeuvre(5)], ())] == [4, 2, 1, 3]
    assert min((short, long, longest), key=lambda each: each.standing) is long


def test_numbers_at_one_airspeed_do_not_lie_on_one_another() -> None:
    """Three at 22 m/s with nearly one Dutch roll, and two at 30 m/s with the same one."""
    at_22 = [manoeuvre(n, 10.2 + 0.02 * n, 0.62, speed=22.0 + 0.03 * n) for n in (8, 9, 10)]
    at_30 = [manoeuvre(n, 13.9, 0.62, speed=30.0) for n in (11, 12)]
    picture = airspeed_picture([*at_22, *at_30], [flight(used=[8, 9, 10, 11, 12], disagree=[])])
    drawing = Figure(figsize=picture.size_in, layout="constrained")
    picture.draw(drawing)
    drawing.draw_without_rendering()

    for axes in drawing.axes:
        boxes = [text.get_window_extent() for text in axes.texts]
        bars = [each.lines[0] for each in axes.containers if each.get_label() == "used"]
        markers = axes.transData.transform([xy for each in bars for xy in each.get_xydata()])
        assert (len(boxes), len(markers)) == (5, 5)
        assert [(a, b) for i, a in enumerate(boxes) for b in boxes[:i] if a.overlaps(b)] == []
        assert not any(box.contains(*marker) for box in boxes for marker in markers)


def test_a_refused_one_far_off_takes_no_axis_with_it() -> None:
    """A warning of the drawing is an error in these tests."""
    wild = four()[3]
    far = replace(roll_of(1e200, -1e200), wn_std=1e299, zeta_std=1e299)
    estimates = {"ct": replace(wild.estimates["ct"], dutch_roll=far)}
    picture = airspeed_picture([*four()[:3], replace(wild, estimates=estimates)], [flight()])

    assert "Off the picture: 1 that cannot be used." in picture.look
    assert not re.findall(r"[0-9]{5,}\.[0-9]", picture.svg)


def marked(manoeuvres: list[Manoeuvre], low: float, high: float) -> Axes:
    """Return axes from ``low`` to ``high`` s on which these manoeuvres are marked."""
    axes = Figure().subplots()
    axes.set_xlim(low, high)
    mark_events(axes, Events(np.empty((0, 2)), np.empty(0), manoeuvres))
    return axes


def test_manoeuvres_are_shaded_where_they_were_flown_and_numbered() -> None:
    axes = marked(four(), 100.0, 230.0)

    spans = [patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches]
    found = [(round(box.x0, 1), round(box.x1, 1)) for box in spans]
    assert found == [(100.0, 127.4), (155.0, 187.4), (215.0, 230.0)]
    assert [patch.get_hatch() for patch in axes.patches] == [None, None, "////"]
    assert [text.get_text() for text in axes.texts] == ["2", "3", "4"]
    assert axes.get_xlim() == (100.0, 230.0)
    many = marked(forty().manoeuvres or [], 0.0, 2500.0)
    assert len(many.patches) == 40
    assert min(np.diff([text.xy[0] for text in many.texts])) > 0.035 * 2500.0


@pytest.mark.parametrize("every", [1, 50, 200])
def test_no_line_is_drawn_over_a_gap_of_the_log_or_back_through_time(every: int) -> None:
    """The gap lies before 60 s, a reboot after 90 s."""
    t = np.r_[0.0:40.0:0.002, 60.0:90.0:0.002, 10.0:50.0:0.002][::every]
    axes = Figure().subplots()
    traced(axes, t, np.sin(t), "#000000")

    seen = [np.asarray(line.get_xdata()) for line in axes.lines]
    seen += [path.vertices[:, 0] for each in axes.collections for path in each.get_paths()]
    # Where it is shaded, the line itself is there to zoom, and not drawn.
    shaded = every < 200
    assert [each.get_visible() for each in axes.lines] == [not shaded] * 3
    assert [each.max() - each.min() for each in seen] == pytest.approx(
        [40.0, 30.0, 40.0] * (1 + shaded), abs=1.0
    )


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
SMALLEST = """kind => Math.min(...[...document.querySelectorAll(`figure ${kind}`)].map(
  picture => picture.getBoundingClientRect()).flatMap(box => [box.width, box.height]))"""
PAPER_PX = round((210.0 - 2 * 13.0) / 25.4 * 96.0)
"""The width of A4 between the margins that the page asks for."""


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
@pytest.mark.parametrize(
    "of", [four_of_a_flight, with_markup, pytest.param(forty, marks=pytest.mark.long)]
)
def test_a_browser_shows_it_within_its_width_fetches_nothing_and_has_no_legend_on_a_line(
    of: Made, drawn: Drawn, tmp_path: Path
) -> None:
    path = tmp_path / "page.html"
    path.write_text(drawn(of), encoding="utf-8")
    with chromium() as browser:
        for (width, phone), script in product(((1280, False), (360, True)), (False, True)):
            page, requests, complaints = opened(
                browser, path.as_uri(), width, phone=phone, script=script
            )
            assert page.evaluate(OVERFLOW) == 0
            assert page.evaluate(ON_AXES) == page.evaluate(SPLIT) == []
            assert page.evaluate(SMALLEST, "canvas" if script else "svg") > (50 if script else 100)
            # On a wide screen the whole table of few manoeuvres is seen.
            assert phone or of is not four_of_a_flight or page.evaluate(HIDDEN) == 0
            assert complaints == []
            assert requests == [path.as_uri()]
        assert page.evaluate("document.querySelector('header').getBoundingClientRect().bottom"
                             ) < 1200  # fmt: skip


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
def test_printed_every_number_is_on_the_paper(drawn: Drawn, tmp_path: Path) -> None:
    html = drawn(four_of_a_flight)
    path, printed = tmp_path / "page.html", tmp_path / "page.pdf"
    path.write_text(html, encoding="utf-8")
    with chromium() as browser:
        page, _, _ = opened(browser, path.as_uri(), PAPER_PX, 1000)
        page.emulate_media(media="print")
        assert page.evaluate(CUT) == []
        page.pdf(path=printed, format="A4", prefer_css_page_size=True)

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
    html = re.sub("<svg.*?</svg>", "", drawn(four_of_a_flight), flags=re.DOTALL)
    path, printed = tmp_path / "page.html", tmp_path / "page.pdf"
    headings = {Page(each).text for each in re.findall("<(?:h[23]|summary)>(.*?)</", html)}
    last = []
    with chromium() as browser:
        for height_px in heights_px:
            shift = f'<div style="height: {height_px}px"></div>'
            path.write_text(html.replace("<header", f"{shift}<header", 1), encoding="utf-8")
            page, _, _ = opened(browser, path.as_uri(), PAPER_PX, 1000)
            page.pdf(path=printed, format="A4", prefer_css_page_size=True)
            sheets = [sheet.extract_text() for sheet in pypdf.PdfReader(printed).pages]
            last += [sheet.strip().splitlines()[-1] for sheet in sheets[:-1] if sheet.strip()]

    assert len(headings) > 15
    assert [line for line in last if line.strip() in headings or "By themselves" in line] == []
