"""Small defects as a hurried change might bring them in: where, what, and why."""

from checks.defect import Defect
from checks.defects_above import ABOVE
from checks.defects_below import BELOW

DEFECTS: tuple[Defect, ...] = (*BELOW, *ABOVE)
