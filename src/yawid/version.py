"""Version of yawid: written into every file that it makes."""

from typing import Final

__version__: Final = "0.2.0"
