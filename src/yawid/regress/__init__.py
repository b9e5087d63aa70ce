"""Headless regression: recorded logs replayed and compared with their references.

A case is a folder with log.tlog, case.toml (origin, licence, sha256, floor, options, tolerances),
and the references expected.csv and expected.json. Only ``update`` writes references, and it wants a
reason.
"""

from yawid.regress.case import Case, find_cases
from yawid.regress.check import Outcome, check_case, regress
from yawid.regress.new_case import new_case
from yawid.regress.update import update

__all__ = ["Case", "Outcome", "check_case", "find_cases", "new_case", "regress", "update"]
