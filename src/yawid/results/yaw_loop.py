"""What an answer leaves out where the autopilot feeds the yaw rate back to the rudder.

The part of a yaw damper is in the rudder's own output. Where that is the input, the model is that
of the aircraft without the damper; where the pilot's stick is, the damper is a part of the model.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from yawid.answers.heard import BootSpan, gains_between, words_of_gains
from yawid.answers.run_summary import ChannelFound, Flight, Manoeuvre, RunSummary
from yawid.quantities.vehicles import AIRFRAME


def with_yaw_loop(summary: RunSummary) -> RunSummary:
    """Return the summary whose flight and manoeuvres say what holds of the autopilot's yaw loop."""
    rudder = (summary.channels or {}).get("rudder")
    if rudder is None or rudder.yaw_loop is None:
        return summary
    name = "yaw damper" if "YAW2SRV_DAMP" in rudder.yaw_loop else "yaw-rate loop"
    is_stick = rudder.source.startswith("RC_CHANNELS")
    with_it = "with" if is_stick else "without"
    held = "the stick does not hold its part" if is_stick else "the servo output holds its part"

    def said(found: Flight | Manoeuvre) -> Flight | Manoeuvre:
        if found.loop == AIRFRAME:
            return found
        numbers = [found.n] if isinstance(found, Manoeuvre) else found.used
        of = [(each.from_s, each.to_s) for each in summary.manoeuvres or () if each.n in numbers]
        loop = gains_of(rudder, summary.boots, of)
        if loop is None:
            return found
        return replace(found, yaw_loop=f"{with_it} its {name} ({loop}): {held}")

    return replace(
        summary,
        manoeuvres=summary.manoeuvres and [said(each) for each in summary.manoeuvres],
        flight=None if summary.flight is None else said(summary.flight),
        flights=summary.flights and [said(each) for each in summary.flights],
    )


def gains_of(
    rudder: ChannelFound, boots: Sequence[BootSpan] | None, stretches: Sequence[tuple[float, float]]
) -> str | None:
    """Return the gains of the yaw loop in these stretches; None where it was off in them."""
    if rudder.yaw_loop is None or rudder.yaw_gains is None or not stretches:
        return rudder.yaw_loop
    gains: dict[str, list[float]] = {}
    for from_s, to_s in stretches:
        between = gains_between(rudder.yaw_gains, boots, from_s, to_s)
        for name, values in between.items():
            gains.setdefault(name, []).extend(values)
    return words_of_gains(gains)


def gains_in(
    rudder: ChannelFound | None, boots: Sequence[BootSpan] | None, from_s: float, to_s: float
) -> str | None:
    """Return the gains of the yaw loop in a stretch; None where it was off, or none is known."""
    return None if rudder is None else gains_of(rudder, boots, [(from_s, to_s)])


def damped_by(gains: str) -> tuple[str, str]:
    """Return in words why a yaw loop with these gains hides the bare airframe, and what to do."""
    name = "yaw damper" if "YAW2SRV_DAMP" in gains else "yaw-rate loop"
    why = f"the {name} ({gains}) moves the rudder by the yaw rate of the same sample"
    return why, f"switch the {name} off for the manoeuvre"
