"""The bare airframe's Dutch roll from a flight in which the rudder was not moved on purpose."""

from yawid.ordinary.answer import LONG_S, answer_of
from yawid.ordinary.pieces import Ordinary
from yawid.ordinary.spectra import Sums

__all__ = ["LONG_S", "Ordinary", "Sums", "answer_of"]
