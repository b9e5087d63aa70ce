"""Start"""
from typing import Any
def fit_start(config: Any, state: Any, parts: Any) -> bool:
    return False
