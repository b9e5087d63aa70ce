"""What a fleet does with every log: sent to the workers, so it imports nothing large."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from yawid.config.run import RunConfig


@dataclass(frozen=True, slots=True)
class Spec:
    """What is done with every log: the settings of the run, how logs are read, what is kept.

    ``settings`` are the fields of :class:`RunConfig` that were given. With ``modes``, a row is kept
    for each second.

    Raises:
        ConfigError: the signing key cannot be read.
    """

    settings: Mapping[str, Any] = field(default_factory=dict)
    form: Literal["auto", "tlog", "raw"] = "auto"
    key_file: str | None = None
    modes: bool = False
    key_mark: str | None = field(init=False, default=None)
    """Fingerprint of the key that ``key_file`` held at the start: the key counts, not its path."""

    def __post_init__(self) -> None:
        """Read the key's fingerprint; the readers are large, so only a key imports them."""
        if self.key_file is not None:
            from yawid.sources.open_log import ReadOptions

            key = ReadOptions.asked(self.form, Path(self.key_file)).key
            object.__setattr__(self, "key_mark", key and key.mark)

    @property
    def config_hash(self) -> str:
        """A hash that is equal for equal settings, whether given or left at their defaults."""
        config = RunConfig(**self.settings)
        is_auto = config.orders == "auto"
        usual = replace(config, orders=RunConfig().orders) if is_auto else config
        whole = [asdict(usual), is_auto, self.form, self.key_mark, self.modes]
        text = json.dumps(whole, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
