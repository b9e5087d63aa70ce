"""A URL where a path is needed is refused before anything is read or written."""

from __future__ import annotations

from pathlib import Path

import pytest
from places import C172P

from yawid.cli.main import main

REFUSED = (
    "replay LOG --out URL",
    "replay LOG --config CONFIG",
    "replay LOG --config URL",
    "live udpin:127.0.0.1:14560 --out URL",
    "inspect URL",
    "orders URL",
    "view URL",
    "view RUN --out URL",
    "report URL",
    "report RUN -o URL",
    "export RUN --out URL",
    "simulate yaw --input step --out URL",
    "step URL",
    "trend . -o URL",
)


@pytest.mark.parametrize("command", REFUSED)
@pytest.mark.parametrize("url", ["s3://bucket/day", "file:///tmp/day"])
def test_a_url_where_a_path_is_needed_is_one_line_with_what_to_do(
    command: str,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("options.toml").write_text(f'out = "{url}"\n', encoding="utf-8")
    meant = {"URL": url, "LOG": str(C172P), "RUN": "run.mcap", "CONFIG": "options.toml"}

    with pytest.raises(SystemExit) as ended:
        main([meant.get(word, word) for word in command.split()])

    said = capsys.readouterr()
    assert (ended.value.code, said.out, said.err.count("\n")) == (2, "", 1)
    assert f"{url!r} is a URL, but a path on this machine is needed: copy" in said.err
    assert [path.name for path in tmp_path.iterdir()] == ["options.toml"]
