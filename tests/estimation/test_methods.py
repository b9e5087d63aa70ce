"""The table of methods: nothing else knows a method by its name."""

import re

from places import SRC

NAMED = {SRC / "config/names.py", SRC / "dataset/schema.py"}
"""Where they are named: the options, and the columns of a data set, which have their names."""


def test_no_other_file_compares_the_names_of_methods():
    for path in set(SRC.rglob("*.py")) - NAMED:
        assert not re.search(r"""["'](els|rml)["']""", path.read_text(encoding="utf-8")), path
