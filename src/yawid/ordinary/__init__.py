"""The bare airframe's Dutch roll from a flight in which nobody moved the rudder on purpose."""

from yawid.ordinary.answer import answer_of
from yawid.ordinary.pieces import Ordinary

__all__ = ["Ordinary", "answer_of"]
