"""The bare airframe's Dutch roll from a flight in which the rudder was not moved on purpose."""

from yawid.ordinary.answer import answer_of
from yawid.ordinary.pieces import Ordinary

__all__ = ["Ordinary", "answer_of"]
