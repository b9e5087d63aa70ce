"""The rudder mix: how much of the aileron the rudder needs for rolls with little sideslip.

ArduPlane adds KFF_RDDRMIX times the aileron to the rudder, PX4 FW_RLL_TO_YAW_FF times the roll
torque, both in parts of the full travel, as yawid's channels are. The mix is that of the bare
airframe (``lateral/mix.py``): no model from rudder to yaw rate says anything of it.
"""

from typing import Final

import numpy as np
from msgspec.structs import replace

from yawid.answers.damper_report import Mix
from yawid.answers.run_summary import RunSummary
from yawid.damper.autopilots import Autopilot
from yawid.quantities.flying_qualities import wrong_sign

MOST_STD: Final = 0.1
"""A mix is given where its sigma is below this."""
LIMITS: Final = (0.0, 1.0)
"""Both parameters are made for values in these limits."""
UNKNOWN: Final = (
    "the mix needs the bare airframe with the aileron's effect: move the aileron as well, and "
    "replay that log"
)


def mix_of(
    summary: RunSummary, autopilot: Autopilot, flown: float | None, half_travel: float
) -> Mix:
    """Return the mix of a run, or in words why it is not known.

    ``half_travel`` is that of the rudder, in the unit of its channel.
    """
    bare, found = summary.bare, Mix(parameter=autopilot.mix, flown=flown, text=UNKNOWN)
    if bare is None:
        return found
    known = (bare.derivatives or {}).items()
    if wrong := [text for name, x in known if (text := wrong_sign(name, x.value, x.std))]:
        return replace(found, text=f"no mix is advised: {'; '.join(wrong)}")
    mix = bare.rudder_mix
    if mix is None or mix.value is None or mix.std is None:
        why = "; ".join(reason.text for reason in bare.verdict.reasons)
        return replace(found, text=f"{UNKNOWN}{f' ({why})' if why else ''}")
    value, std = mix.value / half_travel, mix.std / half_travel
    if std >= MOST_STD:
        return replace(
            found, text=f"the mix is only known as {value:.2g} ± {std:.2g}: move the aileron more"
        )
    best = f"{np.clip(value, *LIMITS):.2f}"
    found_at = f"found {value:.2f} ± {std:.2f} at {bare.airspeed_m_s:.1f} m/s; flown "
    found_at += "an unknown mix" if flown is None else f"{flown:g}"
    if flown is not None and abs(float(best) - flown) <= std:
        text = f"Keep {autopilot.mix} {flown:g} ({found_at}): the change is within sigma"
    elif float(best) == 0.0:
        text = f"Leave {autopilot.mix} at 0 ({found_at})"
    else:
        text = (
            f"{autopilot.mix} {best} rolls with the least sideslip ({found_at}). It is a "
            "prediction: change it in steps of 0.1 and watch the ball in rolls"
        )
    return replace(found, value=value, std=std, airspeed_m_s=bare.airspeed_m_s, text=text)
