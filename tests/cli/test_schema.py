"""What ``--json`` prints is what ``yawid schema`` says: see also ``support/printed.py``."""

from __future__ import annotations

import copy
import json

import pytest
from places import C172P, REPLAY_LOGS
from printed import WHOLE, why_invalid

from yawid.cli.json_schema import document
from yawid.cli.main import main
from yawid.cli.program import PRINTING
from yawid.errors import EXIT_CODES

CASES = sorted(REPLAY_LOGS.glob("*/expected.json"))


def test_every_key_has_words_and_a_number_with_a_unit_in_its_name_has_that_unit():
    ends = {"_rad_s": "rad/s", "_m_s": "m/s", "_hz": "Hz", "_s": "s", "_m": "m", "_deg": "deg"}
    for name, each in WHOLE["$defs"].items():
        for key, schema in each.get("properties", {}).items() if name[0].isupper() else ():
            assert schema["description"], (name, key)
            end = next((e for e in (*ends, "_rad_m") if key.endswith(e)), None)
            if schema.get("type") == "number" and end in ends and not key.startswith("slope"):
                assert schema["x-unit"] == ends[end], (name, key)


def test_the_schema_of_each_command_and_of_all_is_a_json_schema_with_reasons_and_codes(capsys):
    import jsonschema

    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == WHOLE
    assert [f"#/$defs/{command}" for command in PRINTING] == [e["$ref"] for e in WHOLE["anyOf"]]
    for command in PRINTING:
        told = document(command)
        jsonschema.Draft202012Validator.check_schema(told)
        assert set(told["x-exit-codes"]) == {*map(str, EXIT_CODES)}
        assert told["x-reasons"]["poor_fit"]["exit_code"] == 5
    assert "Trend" not in document("replay")["$defs"]


@pytest.mark.parametrize("case", CASES, ids=lambda p: p.parent.name)
def test_the_summary_of_every_case_is_of_the_schema(case):
    summary = json.loads(case.read_text(encoding="utf-8"))

    assert why_invalid("replay", {"log": str(case)} | summary) == ""


def test_a_key_that_nobody_described_and_a_null_are_refused():
    summary = {"log": ""} | json.loads((C172P.parent / "expected.json").read_text(encoding="utf-8"))
    for change in ({"new": 1}, {"vehicle": None}, {"estimates": {"arx": {}}}):
        assert why_invalid("replay", summary | change) != ""
    deep = copy.deepcopy(summary)
    deep["estimates"]["els"]["theta"]["d1"] = 0.0

    assert "'d1' does not match" in why_invalid("replay", deep)


@pytest.mark.parametrize("name", ["Manoeuvre", "Flight", "flights_row", "manoeuvres_row"])
def test_an_airspeed_that_may_be_a_ground_speed_is_not_called_equivalent(name: str):
    properties = WHOLE["$defs"][name]["properties"]

    assert "equivalent" not in properties["airspeed_m_s"]["description"]
    assert "airspeed_source" in properties["airspeed_m_s"]["description"]
    kinds = properties["airspeed_kind"]
    assert "airspeed the source gives" in kinds["description"]
