"""What a field of a configuration may be: its annotation says it, in bounds and in words.

msgspec judges by the annotation; the words of an error are the bounds' ``description``.
"""

import sys
from collections.abc import Callable, Hashable
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
    """Return the bound of a text that is one of those names."""
    return Meta(pattern=rf"\A({'|'.join(names)})\Z", description=f"be one of {', '.join(names)}")


def check_fields(config: Any, called: Callable[[str], str] = str) -> None:
    """Find out whether each field is what its annotation says; ``called`` names it to the user.

    Raises:
        ConfigError: the first that is not.
    """
    made: Any = type(config)
    for name, kind in _kinds(made).items():
        value = getattr(config, name)
        if not fits(value, kind):
            raise ConfigError(f"{called(name)} must {_words(kind)}, got {value!r}")


def fits(value: Any, kind: Any) -> bool:
    """Tell whether a value is of a kind: a class, or an annotation with bounds."""
    if type(value) is kind:
        return True
    try:
        # NumPy's own float is one to Python, not to msgspec.
        convert(float(value) if isinstance(value, float) else value, kind)
    except ValidationError:
        return False
    return True


@cache
def _kinds(config: Hashable) -> dict[str, Any]:
    return get_type_hints(config, include_extras=True)


def _words(kind: Any) -> str:
    for each in (kind, *get_args(kind)):  # of what may be None, what else it may be
        if get_origin(each) is Annotated and (said := each.__metadata__[0].description):
            return str(said)
        if get_origin(each) is Literal:
            return f"be one of {', '.join(get_args(each))}"
    return f"be {getattr(kind, '__name__', kind)}"
