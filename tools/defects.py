"""Small defects as a hurried change might bring them in: where, what, and why."""

from defect import Defect
from defects_above import ABOVE
from defects_below import BELOW

DEFECTS: tuple[Defect, ...] = (*BELOW, *ABOVE)
