"""Names of the methods, for those who need no more of them: help is to be light."""

from typing import Final

ELS: Final = "els"
RML: Final = "rml"
RECURSIVE: Final = (ELS, RML)
"""The methods that recurse. What else there is to say of them: ``estimation/methods.py``."""
