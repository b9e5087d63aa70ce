"""The names of the methods, for files that need nothing else of them, such as the help texts."""

from typing import Final, Literal

ELS: Final = "els"
RML: Final = "rml"
RecursiveName = Literal["els", "rml"]
RECURSIVE: Final = (ELS, RML)
"""The methods that recurse; ``estimation/methods.py`` has their other properties."""
