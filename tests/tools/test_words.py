"""The check of words: it finds a planted one, and leaves names alone."""

import re

from checks.words import left, rules

WORDS = [(re.compile(r"\bbeside\b", re.IGNORECASE), "next to")]

SOURCE = '''"""The sum stands beside its parts."""

beside = told["beside"]  # ``beside`` is a name, as is that of the key


def f() -> str:
    # That is beside the point.
    return f"{beside} stands next to it, {'; '.join(f'{beside} it' for beside in told)}"
'''


def found(path: str, text: str) -> list[str]:
    return list(left(path, text, WORDS))


def test_a_word_is_found_in_strings_and_comments_and_not_in_names() -> None:
    assert found("src/a.py", SOURCE) == [
        "src/a.py:1: 'beside': write next to",
        "src/a.py:7: 'beside': write next to",
    ]


def test_pages_are_read_whole_and_toml_by_its_strings() -> None:
    assert found("README.md", "One\nBeside `beside`.\n") == ["README.md:2: 'Beside': write next to"]
    assert found("a.toml", 'beside = "the line beside it"\n') == [
        "a.toml:1: 'beside': write next to"
    ]


def test_a_phrase_is_found_over_the_end_of_a_line() -> None:
    text = "# What\n# came of\n# it.\n"

    (one,) = left("a.py", text, rules())

    assert one.startswith("a.py:1: 'What # came of # it'")
