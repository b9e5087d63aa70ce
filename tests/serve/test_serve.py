"""``yawid serve`` by a real server and real requests: answers, files, hostile requests, its end."""

from __future__ import annotations

import errno
import json
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import pytest
from places import C172P, REPLAY_LOGS
from serving import Served, commanded, served

from yawid.cli.main import main
from yawid.dataset.schema import ANALYSIS_VERSION
from yawid.fleet.spec import Spec
from yawid.report.write import write_report
from yawid.serve import app, server
from yawid.serve.flights import INDEX, OUT, Row, safe_name, typed_settings

JUNK = bytes(range(7, 256)) * 40
OWN_CSV = "time_s,del_r,yawrate\n" + "".join(
    f"{i * 0.02:.2f},{3 * (i // 50 % 2)},{i % 50 * 0.01}\n" for i in range(2000)
)
QUICK = ("c172p_3211", "no_rudder", "px4_outputs")
CASES = [
    pytest.param(path.name, marks=() if path.name in QUICK else pytest.mark.long)
    for path in sorted(REPLAY_LOGS.glob("*/")) if path.is_dir()
]  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A server of a folder that has no flight yet."""
    folder = tmp_path_factory.mktemp("flights")
    with served(folder) as found:
        yield found


def replayed(log: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """Return what ``yawid replay --json`` prints of a log."""
    main(["replay", str(log), "--out", str(folder), "--json", "--force"])
    return dict(json.loads(capsys.readouterr().out))


def row_of(page: Served, name: str) -> str:
    """Return the text of a flight's row."""
    rows = re.findall(r"<tr.*?</tr>", page.client.get("/").text, re.DOTALL)
    (row,) = (each for each in rows if f'href="/flights/{name}"' in each)
    return unescape(re.sub(r"<[^>]+>|\s+", " ", row))


@pytest.mark.parametrize("case", CASES)
def test_the_summary_is_what_replay_prints_but_for_paths(
    case: str, page: Served, tmp_path: Path, capsys
) -> None:
    log = next(each for each in (REPLAY_LOGS / case).iterdir() if each.stem == "log")
    name = page.put(f"{case}{log.suffix}", log.read_bytes())
    page.read()

    found = page.client.get(f"/flights/{name}/summary.json")

    expected = replayed(log, tmp_path, capsys)
    assert found.headers["content-type"] == "application/json"
    assert list(found.json()) == list(expected)
    assert found.json() | {"log": 0, "files": 0} == expected | {"log": 0, "files": 0}


def test_three_logs_dropped_at_once_are_answered_and_the_junk_among_them_says_why(
    page: Served,
) -> None:
    logs = {
        "one.tlog": C172P.read_bytes(),
        "junk.tlog": JUNK,
        "two.tlog": (REPLAY_LOGS / "no_rudder" / "log.tlog").read_bytes(),
    }
    with ThreadPoolExecutor(3) as pool:
        assert sorted(pool.map(page.put, logs, logs.values())) == sorted(logs)
    page.read()

    assert "usable 2.400 ± 0.054 0.236 ± 0.029 50.9 m/s 2023-11-14 22:13:24" in " ".join(
        row_of(page, "one.tlog").split()
    )
    assert "not read junk.tlog holds no intact MAVLink record" in " ".join(
        row_of(page, "junk.tlog").split()
    )
    assert "not usable" in row_of(page, "two.tlog")
    answer = page.client.get("/flights/junk.tlog")
    assert (answer.status_code, "no intact MAVLink" in answer.text) == (404, True)


def test_a_refused_flight_shows_no_number_but_what_else_can_be_used(page: Served) -> None:
    """The answer as flown, which no report trusts, would be 19.3 ± 3.5 rad/s."""
    name = page.put("turns.tlog", (REPLAY_LOGS / "turns_calm" / "log.tlog").read_bytes())
    page.read()

    row = " ".join(row_of(page, name).split())
    ordinary = "ωn 2.284 ± 0.058 rad/s, ζ 0.151 ± 0.020, from ordinary flight: the aircraft"
    assert f"not usable By itself this can be used: {ordinary}" in row
    assert ("– – " in row, "19.3" in row) == (True, False)


def test_a_log_of_the_same_name_gets_a_number_and_the_first_one_stays(page: Served) -> None:
    names = [page.put("same.tlog", JUNK + bytes([i])) for i in range(3)]

    assert names == ["same.tlog", "same-2.tlog", "same-3.tlog"]
    page.read()
    assert page.client.get("/flights/same-3.tlog").status_code == 404


def test_unclear_columns_are_asked_for_in_a_field_and_read_as_typed(page: Served) -> None:
    name = page.put("own.csv", OWN_CSV.encode())
    page.read()
    form = Form()
    form.feed(page.client.get("/").text)
    asked = form.fields["/flights/own.csv"]
    assert asked == (
        "--columns 't=time_s,rudder=COLUMN,r=yawrate' --rudder-unit half-travel/rad/deg "
        "--rudder-sign nose-right/nose-left --units deg/rad"
    )

    for line, status in (("--columns", 400), ("--config=/etc/passwd", 400), ("x" * 5000, 413)):
        answer = page.client.post(f"/flights/{name}", data={"options": line})
        assert answer.status_code == status, line
    typed = "--columns=t=time_s,rudder=del_r,r=yawrate --rudder-unit deg --rudder-sign nose-right"
    answer = page.client.post(f"/flights/{name}", data={"options": f"{typed} --units rad"})
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    page.read()

    found = page.client.get(f"/flights/{name}/summary.json").json()
    assert found["channels"]["rudder"]["source"] == "del_r [deg]"
    assert "not read" not in row_of(page, name)


class Form(HTMLParser):
    """The value of the field of each form, by the address that it is sent to."""

    def __init__(self) -> None:
        super().__init__()
        self.fields: dict[str, str] = {}
        self._to = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        of = dict(attrs)
        if tag == "form":
            self._to = of["action"] or ""
        if tag == "input" and of.get("name") == "options":
            self.fields[self._to] = of["value"] or ""


def test_the_report_is_that_of_the_command_and_the_exports_are_files(
    page: Served, tmp_path: Path, capsys
) -> None:
    name = page.put("whole.tlog", C172P.read_bytes())
    page.read()
    of = f"/flights/{name}"
    mcap = tmp_path / f"{name}.mcap"
    mcap.write_bytes(page.client.get(f"{of}/mcap").content)

    report = page.client.get(of)
    written = write_report(mcap).read_text(encoding="utf-8")
    assert report.text == written
    assert "frame-ancestors 'none'" in report.headers["content-security-policy"]
    (made,) = Path(page.client.get(f"{of}/summary.json").json()["files"]["mcap"]).parent.glob(
        f"{name}.report.html"
    )
    made.unlink()
    assert page.client.get(of).text == written
    assert """Content-Security-Policy" content="default-src 'none'; """ in written

    main(["inspect", str(C172P), "--card"])
    card = page.client.get(f"{of}/card").text
    lines = [each for each in capsys.readouterr().out.splitlines() if "log.tlog" not in each]
    assert [each for each in card.splitlines() if "whole.tlog" not in each] == lines

    listed = re.findall(rf'href="{of}/(\S+)"', page.client.get(f"{of}/files").text)
    assert {"summary.json", "mcap", "samples.csv", "modes.parquet", "model.mat"} < {*listed}
    main(["export", str(mcap), "-o", str(tmp_path / "own.csv")])
    assert page.client.get(f"{of}/samples.csv").content == (tmp_path / "own.csv").read_bytes()
    assert page.client.get(f"{of}/model.json").json()["usable"] is True


def test_a_folder_of_a_thousand_flights_is_listed_within_a_second_without_reading_any(
    tmp_path: Path,
) -> None:
    (tmp_path / OUT).mkdir()
    rows = []
    for i in range(1000):
        log = tmp_path / f"f{i:04}.tlog"
        log.write_bytes(JUNK)
        about = log.stat()
        date = f"20{i % 100:02}-01-01T00:00:00Z"
        key = f"{about.st_size} {about.st_mtime_ns}"
        rows.append(Row(log.name, key, about.st_mtime, "", "usable", "", True, "2.4", date=date))
    kept = f"{Spec().config_hash} {ANALYSIS_VERSION}", rows
    (tmp_path / OUT / INDEX).write_bytes(msgspec.json.encode(kept))
    with served(tmp_path) as page:
        page.client.get("/serve.css")
        began_s = time.monotonic()
        text = page.client.get("/").text
        took_s = time.monotonic() - began_s
        assert page.client.get("/progress").json()["logs"] == {}

    assert text.count('<td class="good">usable') == 1000
    dates = re.findall(r'data-of="date">(\S+)', text)
    assert dates == sorted(dates, reverse=True)
    assert took_s < 1.0


HOST = b"Host: 127.0.0.1\r\n"
BODY = b"Content-Length: 3\r\n\r\nabc"
REFUSED = [
    *(
        b"GET " + path + b" HTTP/1.1\r\n" + HOST + b"\r\n"
        for path in (
            b"/flights/../secret.tlog", b"/flights/..%2fsecret.tlog", b"/../secret.tlog",
            b"/flights/%2e%2e%2fsecret.tlog", b"/flights/..%5csecret.tlog", b"//etc/passwd",
            b"/flights/%2fetc%2fpasswd", b"/flights/..%252fsecret.tlog", b"/flights/..%c0%afx",
            b"/flights/a.tlog/..%2f..%2fsecret.tlog", b"/flights/a.tlog/%2e%2e", b"/etc/passwd",
            b"/flights/a.tlog/report.html%00", b"/flights/%00.tlog", b"/serve.js/../../app.py",
            b"/flights/yawid-out/serve.json", b"/flights/" + b"a" * 60_000, b"/%ff%fe",
        )
    ),
    *(
        b"GET / HTTP/1.1\r\nHost: " + host + b"\r\n\r\n"
        for host in (
            b"evil.example", b"127.0.0.1.evil.example", b"evil.example:8040", b"localhost.evil",
            b"", b"127.0.0.1:8040@evil", b"0.0.0.0", b"192.168.0.1:8040", b"[::1]:8040",
        )
    ),
    *(
        method + b" /flights/x.tlog HTTP/1.1\r\n" + HOST + b"Origin: " + origin + b"\r\n" + BODY
        for method in (b"PUT", b"POST")
        for origin in (
            b"http://evil.example", b"null", b"https://127.0.0.1", b"http://127.0.0.1:1", b"file://",
        )
    ),
    *(
        method + b" /flights/x.tlog HTTP/1.1\r\n" + HOST + BODY
        for method in (b"DELETE", b"PATCH", b"OPTIONS", b"TRACE", b"CONNECT", b"PROPFIND")
    ),
    *(
        b"PUT /flights/" + name + b" HTTP/1.1\r\n" + HOST + BODY
        for name in (b"x.exe", b"..", b"%2e%2e%2fx.tlog", b".tlog", b"x.tlog%2f..", b"x.html", b"")
    ),
    b"PUT /flights/x.tlog HTTP/1.1\r\n" + HOST + b"Content-Length: 99999999999\r\n\r\nabc",
    b"PUT /flights/x.tlog HTTP/1.1\r\n" + HOST + b"Content-Length: -1\r\n\r\nabc",
    b"PUT /flights/x.tlog HTTP/1.1\r\n" + HOST + b"Content-Length: 3\r\nContent-Length: 9\r\n\r\n",
    b"GET / HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + HOST + b"Host: evil.example\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + HOST + b"X: " + b"a" * 1_000_000 + b"\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(500),
    b"GET / HTTP/1.1\r\n" + HOST + b"\tX\r\n\x00\r\n\r\n",
]  # fmt: skip


def test_hostile_requests_are_refused_touch_no_file_and_the_next_one_is_answered(
    tmp_path: Path,
) -> None:
    assert len(REFUSED) >= 50
    (tmp_path / "secret.tlog").write_bytes(b"secret")
    folder = tmp_path / "flights"
    folder.mkdir()
    (folder / "a.tlog").write_bytes(JUNK)
    with served(folder) as page:
        page.read()
        before = files_of(tmp_path)
        for raw in REFUSED:
            found = page.answer(raw)
            status = int(found.split(b" ", 2)[1]) if found else 400
            assert 400 <= status < 500, (raw[:100], found[:200])
            assert b"secret" not in found.partition(b"\r\n\r\n")[2], raw
            assert page.client.get("/").status_code == 200, raw[:100]
        assert files_of(tmp_path) == before


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(each): each.read_bytes() for each in folder.rglob("*") if each.is_file()}


def test_a_name_with_markup_is_shown_as_text_and_one_of_a_path_stays_in_the_folder(
    page: Served,
) -> None:
    name = page.put("..%5C..%5C%3Cimg%20src%3Dx%20onerror%3Dalert%281%29%3E.tlog", JUNK)
    page.read()

    assert name == "_img src=x onerror=alert(1)_.tlog"
    text = page.client.get("/").text
    assert "<img" not in text
    assert (
        page.client.get("/")
        .headers["content-security-policy"]
        .startswith("default-src 'none'; script-src 'self'; style-src 'self'")
    )


def test_a_name_of_an_upload_is_one_component_of_bounded_length() -> None:
    assert safe_name("/etc/..\\..\\flight 1.BIN") == "flight 1.BIN"
    assert safe_name("\u202egolt.\x1b[2J.tlog") == "_golt.__2J.tlog"
    assert safe_name(". .x.csv") == "x.csv"
    assert len(safe_name("ä" * 500 + ".tlog").encode()) <= 130
    assert typed_settings("--units=deg --columns 'rudder=delta r'")["columns"] == (
        "rudder=delta r",
    )


def test_slow_and_torn_requests_are_ended_and_leave_nothing(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(app, "MOST_SILENT_S", 0.4)
    monkeypatch.setattr(server, "MOST_SILENT_S", 0.4)
    (tmp_path / "a.tlog").write_bytes(JUNK)
    begun = b"PUT /flights/x.tlog HTTP/1.1\r\n" + HOST + b"Content-Length: 900000\r\n\r\n" + JUNK
    typed = b"POST /flights/a.tlog HTTP/1.1\r\n" + HOST + b"Content-Length: 90\r\n\r\noptions="
    with served(tmp_path) as page:
        page.read()
        for raw in (begun, typed, begun[:40], b"", b"GET / HT"):
            began_s = time.monotonic()
            found = page.answer(raw, within_s=20.0)
            assert time.monotonic() - began_s < 10.0, raw[:40]
            assert found[:13] in (b"HTTP/1.1 408 ", b""), found
        for raw in (begun, typed):
            with closing(socket.create_connection((server.HERE, page.port), timeout=5.0)) as torn:
                torn.sendall(raw)
        wait_until(lambda: not [*tmp_path.glob("x*")])
        assert page.client.get("/").status_code == 200
    assert capsys.readouterr().err == ""


def wait_until(holds: Any, within_s: float = 20.0) -> None:
    end_s = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_too_large_a_log_is_refused_while_it_comes(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(app, "MOST_BYTES", 100_000)
    pieces = b"".join(b"2000\r\n" + bytes(0x2000) + b"\r\n" for _ in range(40))
    chunked = b"PUT /flights/x.tlog HTTP/1.1\r\n" + HOST + b"Transfer-Encoding: chunked\r\n\r\n"
    with served(tmp_path) as page:
        page.answer(chunked + pieces + b"0\r\n\r\n")
        assert page.client.get("/").status_code == 200
    assert not [*tmp_path.glob("x*")]


def test_two_hundred_uploads_at_once_are_taken_or_refused_in_little_memory(tmp_path: Path) -> None:
    size = 1_000_000
    raw = b"PUT /flights/many.tlog HTTP/1.1\r\n" + HOST + b"Content-Length: %d\r\n\r\n" % size
    with commanded(tmp_path) as (page, process):
        page.read()
        before = memory_mb(process.pid)
        start = threading.Barrier(200)
        statuses: list[bytes] = []

        def upload() -> None:
            start.wait(30.0)
            with suppress(OSError):
                statuses.append(page.answer(raw + bytes(size), 30.0)[9:12])

        threads = [threading.Thread(target=upload, daemon=True) for _ in range(200)]
        for each in threads:
            each.start()
        for each in threads:
            each.join(60.0)
        assert page.client.get("/").status_code == 200
        assert memory_mb(process.pid) - before < 100
        taken = statuses.count(b"201")
        assert 1 <= taken == len([*tmp_path.glob("many*.tlog")])
        assert {*statuses} <= {b"201", b"503", b""}
        assert not [*tmp_path.glob("*.upload")]
        process.terminate()
        assert process.wait(20.0) == 0


def memory_mb(process: int) -> int:
    """Return the peak memory of a process."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    found = re.search(r"VmHWM:\s+(\d+)", lines)
    assert found is not None
    return int(found[1]) // 1024


def test_a_killed_server_leaves_no_half_log_after_the_next_start_and_ctrl_c_ends_it(
    tmp_path: Path,
) -> None:
    (tmp_path / "live.tlog.part").write_bytes(b"of a session that goes on")
    begun = b"PUT /flights/x.tlog HTTP/1.1\r\n" + HOST + b"Content-Length: 900000\r\n\r\n" + JUNK
    with (
        commanded(tmp_path) as (page, process),
        closing(socket.create_connection((server.HERE, page.port), timeout=5.0)) as torn,
    ):
        torn.sendall(begun)
        wait_until(lambda: [*tmp_path.glob("x.tlog.upload")])
        process.kill()
        process.wait(10.0)
    assert [*tmp_path.glob("x.tlog.upload")]

    with commanded(tmp_path) as (page, process):
        assert page.client.get("/").status_code == 200
        assert not [*tmp_path.glob("x.tlog*")]
        with closing(socket.create_connection((server.HERE, page.port), timeout=5.0)) as torn:
            torn.sendall(begun)
            wait_until(lambda: [*tmp_path.glob("x.tlog.upload")])
            process.send_signal(signal.SIGINT)
            assert process.wait(20.0) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
    assert {each.name for each in tmp_path.iterdir()} == {"live.tlog.part", OUT}


def test_files_that_are_not_its_own_stay_and_a_name_that_is_no_text_is_left_out(
    tmp_path: Path,
) -> None:
    own = {"notes.txt": b"precious", "notes.upload": b"of another program"}
    for name, data in own.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "x.tlog.upload").symlink_to(tmp_path / "notes.txt")
    (tmp_path / "log\udcff.tlog").write_bytes(JUNK)
    (tmp_path / "new\nline '\"&%2F.tlog").write_bytes(JUNK)
    with served(tmp_path) as page:
        page.read()
        (link,) = re.findall(r'class="name"><a href="(.+?)"', page.client.get("/").text)
        assert "no intact MAVLink" in page.client.get(link).text
    assert {name: (tmp_path / name).read_bytes() for name in own} == own


def test_a_folder_that_vanishes_is_a_line_and_the_pages_are_back_when_it_is(
    tmp_path: Path, capsys
) -> None:
    folder, away = tmp_path / "flights", tmp_path / "away"
    folder.mkdir()
    (folder / "a.tlog").write_bytes(JUNK)
    with served(folder) as page:
        page.read()
        folder.rename(away)
        asked = [page.client.get("/"), page.client.get("/progress")]
        asked += [page.client.put("/flights/x.tlog", content=JUNK)]
        asked += [page.client.post("/flights/a.tlog", data={"options": "--rate 5"})]
        for answer in asked:
            assert answer.status_code == 507
            assert "No such file or directory" in answer.text
        away.rename(folder)
        assert page.client.get("/").text.count('<td class="name">') == 1
    assert capsys.readouterr().err == ""


def test_a_port_or_a_folder_in_use_and_a_folder_that_is_not_there_are_a_line_each(
    tmp_path: Path, capsys
) -> None:
    with closing(server.opened(0)) as other:
        port = other.getsockname()[1]
        assert main(["serve", str(tmp_path), "--no-browser", f"--port={port}"]) == 6
    said = f"cannot serve at 127.0.0.1:{port}: {os.strerror(errno.EADDRINUSE)}: choose another"
    assert said in capsys.readouterr().err
    assert main(["serve", str(tmp_path / "x")]) == 6
    assert "is no folder" in capsys.readouterr().err
    with served(tmp_path):
        assert main(["serve", str(tmp_path), "--no-browser", "--port=0"]) == 6
    assert "another run is writing" in capsys.readouterr().err
    assert [each.name for each in tmp_path.rglob("*") if each.is_file()] == []
