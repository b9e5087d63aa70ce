"""The table of methods: nothing else knows a method by its name."""

import re

from places import SRC

from yawid.config.names import RECURSIVE
from yawid.estimation.methods import METHODS, of_a_record

NAMED = {SRC / "config/names.py"}


def test_no_other_file_compares_the_names_of_methods():
    for path in set(SRC.rglob("*.py")) - NAMED:
        assert not re.search(r"""["'](els|rml)["']""", path.read_text(encoding="utf-8")), path


def test_every_row_is_named_and_checked_by_methods_that_there_are():
    assert set(RECURSIVE) <= METHODS.keys()
    for row in METHODS.values():
        assert METHODS[row.name] is row
        assert row.name not in row.checked_by
        assert set(row.checked_by) <= METHODS.keys()


def test_rml_answers_a_record_and_els_alone_where_it_alone_is_asked():
    assert of_a_record(("els", "rml")) == of_a_record(("rml",)) == ("rml", "els")
    assert of_a_record(("els",)) == ("els",)
