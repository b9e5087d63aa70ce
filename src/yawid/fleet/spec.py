"""What a fleet asks of every log: it travels to the workers, and nothing heavy with it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from yawid.config.run import RunConfig


@dataclass(frozen=True, slots=True)
class Spec:
    """What is asked of every log: the settings of the run, how logs are read, what is kept.

    ``settings`` are those of :class:`RunConfig` that were given, ``modes`` keeps a row a second.

    Raises:
        ConfigError: the key cannot be read.
    """

    settings: Mapping[str, Any] = field(default_factory=dict)
    form: Literal["auto", "tlog", "raw"] = "auto"
    key_file: str | None = None
    modes: bool = False
    key_mark: str | None = field(init=False, default=None)
    """Of the key that the file held when this was made: what it holds, not its path, counts."""

    def __post_init__(self) -> None:
        """Read the key's mark; the readers are imported where there is a key, as they are heavy."""
        if self.key_file is not None:
            from yawid.sources.open_log import ReadOptions

            key = ReadOptions.asked(self.form, Path(self.key_file)).key
            object.__setattr__(self, "key_mark", key and key.mark)

    @property
    def config_hash(self) -> str:
        """The same for the same settings, however they were given."""
        config = RunConfig(**self.settings)
        is_auto = config.orders == "auto"
        usual = replace(config, orders=RunConfig().orders) if is_auto else config
        whole = [asdict(usual), is_auto, self.form, self.key_mark, self.modes]
        text = json.dumps(whole, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
