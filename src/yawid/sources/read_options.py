"""How frames are to be read: what no result depends on and no output may hold."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from yawid.sources.logs.tlog import Form
from yawid.sources.mavlink.decoder import Decoder
from yawid.sources.mavlink.link_stats import LinkStats
from yawid.sources.mavlink.signing import Signing, SigningKey


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """The form of a log, and the key that frames must be signed with (None: any frame will do).

    ``key_file`` is where the key came from, to be named in a command line.

    It stands beside ``RunConfig``, not in it: the configuration goes into files, a key must not.
    """

    form: Form = "auto"
    key: SigningKey | None = None
    key_file: Path | None = None

    def decoder(self, wanted: Iterable[str]) -> Decoder:
        """Return a decoder for one stream."""
        return Decoder(wanted, None if self.key is None else Signing(self.key))

    def unchecked(self, link: LinkStats) -> str | None:
        """Return what is to be said of signed frames whose signatures nobody looked at, if any."""
        if self.key is not None or not link.signed:
            return None
        return "signed frames are read without a look at their signatures: --signing-key-file FILE"
