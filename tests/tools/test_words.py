"""The check of words: it finds a planted one, and leaves names and allowed places alone."""

import re

from checks.words import Allowed, Word, left, rules

WORDS = [Word(re.compile(r"\bbeside\b", re.IGNORECASE), "next to")]
PLACE = Allowed("src/a.py", "beside the point", "an idiom")

SOURCE = '''"""The sum stands beside its parts."""

beside = told["beside"]  # ``beside`` is a name, as is that of the key


def f() -> str:
    # That is beside the point.
    return f"{beside} stands next to it, {'; '.join(f'{beside} it' for beside in told)}"
'''


def found(path: str, text: str, *allowed: Allowed) -> list[str]:
    return [str(each) for each in left(path, text, WORDS, list(allowed))]


def test_a_word_is_found_in_strings_and_comments_and_not_in_names() -> None:
    assert found("src/a.py", SOURCE) == [
        "src/a.py:1: 'beside': write next to",
        "src/a.py:7: 'beside': write next to",
    ]


def test_an_allowed_place_is_reported_as_such_in_its_own_file_only() -> None:
    assert list(left("src/a.py", SOURCE, WORDS, [PLACE]))[1:] == [PLACE]
    assert len(found("src/b.py", SOURCE, PLACE)) == 2
    assert all("write" in line for line in found("src/b.py", SOURCE, PLACE))


def test_pages_are_read_whole_and_toml_by_its_strings() -> None:
    assert found("README.md", "One\nBeside `beside`.\n") == ["README.md:2: 'Beside': write next to"]
    assert found("a.toml", 'beside = "the line beside it"\n') == [
        "a.toml:1: 'beside': write next to"
    ]


def test_a_phrase_is_found_over_the_end_of_a_line() -> None:
    words, allowed = rules()
    text = "# What\n# came of\n# it.\n"

    (one,) = left("a.py", text, words, allowed)

    assert str(one).startswith("a.py:1: 'What # came of # it'")
