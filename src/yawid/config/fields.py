"""The check of a configuration's fields by their annotations, which have bounds and words.

msgspec checks the bounds; their ``description`` gives the words of an error.
"""

import sys
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from msgspec import Meta, ValidationError, convert

from yawid.errors import ConfigError

_LARGEST = sys.float_info.max
Positive = Annotated[float, Meta(gt=0.0, le=_LARGEST, description="be > 0 and finite")]
NotNegative = Annotated[float, Meta(ge=0.0, le=_LARGEST, description="be >= 0")]
Finite = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST, description="be finite")]
Share = Annotated[float, Meta(gt=0.0, le=1.0, description="lie in (0, 1]")]
Count = Annotated[int, Meta(ge=0, description="be an int >= 0")]


def one_of(*names: str) -> Meta:
    """Return the bounds of a text that must be one of these names."""
    return Meta(pattern=rf"\A({'|'.join(names)})\Z", description=f"be one of {', '.join(names)}")


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
    for name, kind in _kinds(made).items():
        value = getattr(config, name)
        if not fits(value, kind):
            raise ConfigError(f"{called(name)} must {_words(kind)}, got {value!r}")


def fits(value: object, kind: Any) -> bool:
    """Return whether a value fits ``kind``: a class, or an annotation with bounds."""
    if type(value) is kind:
        return True
    try:
        # NumPy's float64 is a float for Python, but not for msgspec.
        convert(float(value) if isinstance(value, float) else value, kind)
    except ValidationError:
        return False
    return True


@cache
def _kinds(config: Hashable) -> dict[str, Any]:
    return get_type_hints(config, include_extras=True)


def _words(kind: Any) -> str:
    for each in (kind, *get_args(kind)):  # the parts of a union with None
        if get_origin(each) is Annotated and (said := each.__metadata__[0].description):
            return str(said)
        if get_origin(each) is Literal:
            return f"be one of {', '.join(get_args(each))}"
    return f"be {getattr(kind, '__name__', kind)}"
