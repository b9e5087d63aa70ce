"""The names of the methods, for files that need nothing else of them, such as the help texts."""

from typing import Final

ELS: Final = "els"
RML: Final = "rml"
OE: Final = "oe"
RECURSIVE: Final = (ELS, RML)
"""The methods that recurse; ``estimation/methods.py`` has their other properties."""
