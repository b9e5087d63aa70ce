"""The check of a configuration's fields by their annotations, which have bounds and words.

msgspec checks the bounds; their ``description`` gives the words of an error.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from msgspec import Meta, ValidationError, convert

from yawid.errors import ConfigError

_LARGEST = sys.float_info.max
_CALLED = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}
Positive = Annotated[float, Meta(gt=0.0, le=_LARGEST, description="be > 0 and finite")]
NotNegative = Annotated[float, Meta(ge=0.0, le=_LARGEST, description="be >= 0")]
Finite = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST, description="be a finite number")]
Share = Annotated[float, Meta(gt=0.0, le=1.0, description="lie in (0, 1]")]
Count = Annotated[int, Meta(ge=0, description="be an int >= 0")]


def like(pattern: str, words: str) -> Meta:
    """Return the bounds of a text that must match a pattern, with the words of an error."""
    return Meta(pattern=rf"\A({pattern})\Z", description=words)


def one_of(*names: str) -> Meta:
    """Return the bounds of a text that must be one of these names."""
    return like("|".join(names), f"be one of {', '.join(names)}")


@dataclass(frozen=True, slots=True)
class Said:
    """An option of the command line: its group, the form of its value, its words.

    ``usual`` ones stand on the short page of help; ``aliases`` are other spellings.
    """

    group: str
    shown: str
    words: str
    usual: bool = False
    aliases: tuple[str, ...] = ()


def option(
    group: str, shown: str, words: str, *, usual: bool = False, aliases: tuple[str, ...] = ()
) -> dict[str, Said]:
    """Return the metadata that make a dataclass's field an option, too; see :class:`Said`."""
    return {"said": Said(group, shown, words, usual, aliases)}


def check_fields(config: Any, called: Callable[[str], str] = str) -> None:
    """Check each field by its annotation; ``called`` returns a field's name for the user.

    Raises:
        ConfigError: a field does not fit; the error names the first.
    """
    made: Any = type(config)
    for name, kind in kinds_of(made).items():
        value = getattr(config, name)
        if type(value) is not kind:  # most do not need the slower check
            _fitted(value, kind, called(name), value, strict=True)


def typed(value: Any, kind: Any, called: str, *, is_text: bool = False) -> Any:
    """Return a value by its kind: a class, or an annotation with bounds and words.

    A list may be a text with commas. Where it ``is_text``, of the command line, a number is, too.

    Raises:
        ConfigError: it does not fit; the error has its name, ``called``, and what is needed.
    """
    given = value
    if isinstance(value, str) and _is_list(kind):
        given, is_text = [each.strip() for each in value.split(",")], True
    return _fitted(given, kind, called, value, strict=not is_text)


def _fitted(value: Any, kind: Any, called: str, given: Any, *, strict: bool) -> Any:
    try:
        # NumPy's float64 is a float for Python, but not for msgspec.
        return convert(float(value) if isinstance(value, float) else value, kind, strict=strict)
    except ValidationError:
        raise ConfigError(f"{called} must {_words(kind)}, got {given!r}") from None


@cache
def kinds_of(config: Any) -> dict[str, Any]:
    """Return the annotation of each field of a class, by name."""
    return get_type_hints(config, include_extras=True)


def _is_list(kind: Any) -> bool:
    return get_origin(kind) is tuple or any(map(_is_list, get_args(kind)))


def _words(kind: Any) -> str:
    parts = (kind, *get_args(kind))  # the parts of a union with None
    for each in parts:
        if get_origin(each) is Annotated and (said := each.__metadata__[0].description):
            return str(said)
    return f"be {next((_CALLED[each] for each in parts if each in _CALLED), kind)}"
