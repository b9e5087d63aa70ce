"""``yawid explain``: the part of the manual on a word, below what the code's own tables say of it.

A part of the manual is what stands below a heading, up to the next one; its words are those that
the heading has in backticks, or else the heading itself. Of an option it is the comment above its
line in the settings file. Weights, remedies, defaults, units and exit codes are not written there a
second time: they come from the tables that the program itself reads.
"""

import re
import textwrap
from collections import defaultdict
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Final

from yawid.cli.options import Command
from yawid.errors import EXIT_CODES, ConfigError
from yawid.sinks.door import WIDTH
from yawid.trend import SEVERAL

MANUAL: Final = Path(__file__).parents[1] / "manual"
_HEADING: Final = re.compile(r"^##+ (.+)$", re.MULTILINE)
_SETTING: Final = re.compile(r"((?:^# .*\n)*)^(?:# )?(([a-z-]+) = .+)$", re.MULTILINE)

Parts = dict[tuple[str, str], str]
"""By kind, in the plural, and word: what there is to say."""


def listed(parts: Parts) -> str:
    """Return every word that there is a part on, by kind."""
    words = defaultdict(list)
    for kind, word in parts:
        words[kind].append(word.replace(" ", "\0"))  # no line ends within a word
    lines = [f"{kind}:\n{_filled(', '.join(found), '  ')}\n" for kind, found in words.items()]
    said = "yawid explain WORD prints the part on one of them.\n"
    return "\n".join([*lines, said]).replace("\0", " ")


def explained(parts: Parts, asked: str) -> str:
    """Return all parts on a word.

    Raises:
        ConfigError: there is none; the message names the nearest words.
    """
    names = defaultdict(list)
    for kind, word in parts:
        names[_plain(word)].append((kind, word))
    if not (found := names.get(_plain(asked))):
        near = [names[each][0][1] for each in get_close_matches(_plain(asked), names, n=4)]
        said = f"the nearest words are {', '.join(near)}" if near else "no word is similar"
        raise ConfigError(f"nothing explains {asked!r}: {said}; yawid explain lists all words")
    return "\n".join(f"{word} ({kind})\n\n{parts[kind, word].strip()}\n" for kind, word in found)


def parts_of(every: Mapping[str, Command]) -> Parts:
    """Return all parts; the commands and options are those of ``every`` command."""
    facts = {
        "reasons": _reasons(), "exit codes": _exit_codes(), "commands": _commands(every),
        "options": _options(every), "quantities": _keys(quantities=True),
        "keys of --json": _keys(quantities=False),
    }  # fmt: skip
    manual = {path.name: path.read_text(encoding="utf-8") for path in sorted(MANUAL.glob("*.md"))}
    sections = dict(_settings(manual["settings.md"]))
    for text in manual.values():
        sections |= _sections(text)
    parts = {
        (kind, word): "\n\n".join(filter(None, [before, sections.get(word), after]))
        for kind, found in facts.items()
        for word, before, after in found
    }
    parts |= {
        ("reasons of yawid damper", word): f"{before}\n\n{sections['What it needs']}"
        for word, before in _of_damper()
    }
    parts["reasons of yawid trend", SEVERAL] = sections[SEVERAL]
    parts |= {("terms", word): text for word, text in _sections(manual["glossary.md"])}
    return parts | {("pages of the manual", name): text for name, text in manual.items()}


def _sections(page: str) -> Iterator[tuple[str, str]]:
    """Yield the text below each heading of a page, by each of the heading's words."""
    _, *rest = _HEADING.split(page)
    for heading, text in zip(rest[::2], rest[1::2], strict=True):
        for word in re.findall(r"`(.+?)`", heading) or [heading]:
            yield word, text.strip()


def _settings(page: str) -> Iterator[tuple[str, str]]:
    """Yield what the settings file says of each option, by the option."""
    for comment, setting, name in _SETTING.findall(page):
        said = re.sub("^# ", "", comment, flags=re.MULTILINE)
        yield f"--{name}", f"{said}\nIn a settings file: {setting}"


def _reasons() -> Iterator[tuple[str, str, str]]:
    from yawid.answers.reasons import KINDS

    for kind in KINDS.values():
        code = f"exit code {kind.exit_code}" if kind.exit_code else "the answer may be used"
        to_record = dict.fromkeys([kind.record, *kind.record_on.values()])
        said = [kind.now, *(f"Next time: {text}." for text in to_record if text)]
        to_do = "\n".join(_filled(text, "- ") for text in said)
        yield kind.id, f"Weight: {kind.weight} ({code}).", f"What to do:\n{to_do}"


def _of_damper() -> Iterator[tuple[str, str]]:
    from yawid.damper import refusals

    for word in refusals.OF_DAMPER:
        code = refusals.EXIT_CODES.get(word)
        yield word, f"Exit code {code}." if code else "A warning."


def _exit_codes() -> Iterator[tuple[str, str, str]]:
    from yawid.answers.reasons import KINDS

    for code, says in EXIT_CODES.items():
        ids = ", ".join(kind.id for kind in KINDS.values() if code and kind.exit_code == code)
        reasons = _filled(f"Reasons: {ids}") if ids else ""
        yield f"exit code {code}", _filled(says[0].upper() + says[1:] + "."), reasons


def _commands(every: Mapping[str, Command]) -> Iterator[tuple[str, str, str]]:
    for name, command in every.items():
        usage = command.format_usage()[1:].strip()
        yield f"yawid {name}", f"U{usage}", f"All options: yawid {name} --help"


def _options(every: Mapping[str, Command]) -> Iterator[tuple[str, str, str]]:
    of = defaultdict[str, dict[str, list[str]]](dict)
    for name, command in every.items():
        for action in command.arguments:
            for option in [each for each in action.option_strings if each[2:]][:1]:
                said = f"{option} {action.metavar or ''}".strip()
                of[option].setdefault(f"{said}: {action.help}", []).append(name)
    for option, found in sorted(of.items()):
        lines = (f"{_filled(form)}\n  of yawid {', '.join(names)}" for form, names in found.items())
        yield option, "\n".join(lines), ""


def _keys(*, quantities: bool) -> Iterator[tuple[str, str, str]]:
    from yawid.cli.json_schema import key_words
    from yawid.quantities.table import QUANTITIES

    for name, said in key_words():
        if (name in QUANTITIES) is quantities:
            yield name, "\n".join(_filled(each) for each in said), ""


def _plain(word: str) -> str:
    """Return a word as it is compared: however it is written."""
    word = re.sub(r"^(yawid|exit code) ", "", word.strip().lower().lstrip("-"))
    return re.sub("[ -]", "_", word)


def _filled(text: str, indent: str = "") -> str:
    after = " " * len(indent)
    return textwrap.fill(
        text, WIDTH, initial_indent=indent, subsequent_indent=after, break_on_hyphens=False
    )
