"""Settings from the command line, a TOML file or Python, checked: each by its name and its type.

Bounds, and what does not fit together, are checked where :class:`RunConfig` is made of them.
"""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from yawid.config.fields import kinds_of, typed
from yawid.config.run import GIVEN, RunConfig, option_name, settings_declared
from yawid.errors import ConfigError, did_you_mean

FORGETTING = frozenset({"memory", "forgetting"})
COMMAND_LINE = "the command line"
"""Where settings stand that were given as options."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises:
        ConfigError: the file cannot be read or is no TOML.
    """
    import tomllib  # help needs nothing of it

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
        is_text = where == COMMAND_LINE
        called = f"--{option_name(name)}" if is_text else f"{where}: {name}"
        settings[name] = typed(value, kinds_of(RunConfig)[name], called, is_text=is_text)
    given = (name for name in GIVEN if settings.get(name, "auto") != "auto")
    settings.setdefault("given", tuple(given))
    return settings
