"""Settings from the command line, a TOML file or Python, checked: each by its name and its type.

Bounds, and what does not fit together, are checked where :class:`RunConfig` is made of them.
"""

import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

from msgspec import Meta, ValidationError, convert

from yawid.config.fields import fits
from yawid.config.run import GIVEN, RunConfig, option_name, settings_declared
from yawid.errors import ConfigError, did_you_mean

COMMAND_LINE = "the command line"
"""Where settings stand that were given as options."""
_SOME = Meta(min_length=1)
_LISTS: dict[str, tuple[Any, str]] = {
    "orders": (
        Annotated[tuple[int, ...], _SOME],
        "na,nb,nc,nk, four whole numbers (yawid orders compares them)",
    ),
    "inputs": (Annotated[tuple[str, ...], _SOME], "rudder or rudder,aileron"),
    "given": (tuple[str, ...], "names of settings"),
    "columns": (tuple[str, ...], "NAME=COLUMN,..."),
    "band": (Annotated[tuple[float, ...], _SOME], "LO,HI in Hz"),
}
"""The settings that are lists, or a text with commas: their kind, and what errors ask for."""
_KINDS = {float: "a number", int: "a whole number", str: "a text"}
FORGETTING = frozenset({"memory", "forgetting"})


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises:
        ConfigError: the file cannot be read or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(
            f"{path}: not a readable TOML file: {getattr(error, 'strerror', None) or error}"
        ) from error


def overruled(settings: Mapping[str, Any], by: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings overruled ``by`` others; both have been checked."""
    if by.keys() & FORGETTING:  # both say the same thing: the one given overrules both
        settings = {name: value for name, value in settings.items() if name not in FORGETTING}
    given = {*settings.get("given", ()), *by.get("given", ())}
    return {**settings, **by, "given": tuple(sorted(given))}


def check_settings(loaded: dict[str, Any], where: str) -> dict[str, Any]:
    """Return settings by field names, after a check that each is known.

    ``given`` is added if it is missing: the settings of ``GIVEN`` that are there and not ``auto``.

    Raises:
        ConfigError: a setting is unknown or of the wrong type.
    """
    known = {form: each.name for each in fields(RunConfig)
             for form in (each.name, option_name(each.name))}  # fmt: skip
    known |= {alias: each.name for each, said in settings_declared() for alias in said.aliases}
    settings = {}
    for raw, value in loaded.items():
        name = known.get(raw) or known.get(raw.replace("_", "-"))
        if name is None:
            options = sorted(option_name(each.name) for each, _ in settings_declared())
            near = did_you_mean(raw, options) or f"; known are {', '.join(options)}"
            raise ConfigError(f"{where}: unknown setting {raw!r}{near}")
        settings[name] = _typed(name, value, where)
    given = (name for name in GIVEN if settings.get(name, "auto") != "auto")
    settings.setdefault("given", tuple(given))
    return settings


def _typed(name: str, value: Any, where: str) -> Any:
    named = f"--{option_name(name)}" if where == COMMAND_LINE else f"{where}: {name}"
    if name in _LISTS:
        kind, wanted = _LISTS[name]
        is_text = isinstance(value, str)
        parts = value.split(",") if is_text else value
        if is_text and name in ("orders", "band"):
            parts = [part.strip() for part in parts]
        try:
            return convert(parts, kind, strict=not is_text)  # 3.5 is no order
        except ValidationError:
            raise ConfigError(f"{named} must be {wanted}, got {value!r}") from None
    hint = get_type_hints(RunConfig)[name]
    plain = next((each for each in (float, int) if each in (hint, *get_args(hint))), str)
    if where == COMMAND_LINE:
        with suppress(ValidationError):
            return convert(value, plain, strict=False)
    if not fits(value, plain):
        raise ConfigError(f"{named} must be {_KINDS[plain]}, got {value!r}")
    return value
