"""What an answer leaves out where the autopilot feeds the yaw rate back to the rudder.

The part of a yaw damper is in the rudder's own output. Where that is the input, the model is that
of the aircraft without the damper; where the pilot's stick is, the damper is a part of the model.
"""

from msgspec.structs import replace

from yawid.answers.run_summary import (
    Bare,
    Flight,
    Manoeuvre,
    ReasonSummary,
    RunSummary,
    VerdictSummary,
)

BARE = "airframe"
"""The ``loop`` of a manoeuvre in which only the sticks move the surfaces."""


def with_yaw_loop(summary: RunSummary) -> RunSummary:
    """Return the summary whose flight and manoeuvres say what holds of the autopilot's yaw loop."""
    rudder = (summary.channels or {}).get("rudder")
    if rudder is None or rudder.yaw_loop is None:
        return summary
    name = "yaw damper" if "YAW2SRV_DAMP" in rudder.yaw_loop else "yaw-rate loop"
    is_stick = rudder.source.startswith("RC_CHANNELS")
    with_it = "with" if is_stick else "without"
    held = "the stick does not hold its part" if is_stick else "the servo output holds its part"
    text = f"{with_it} its {name} ({rudder.yaw_loop}): {held}"

    fed_back = not all(each.loop == BARE for each in summary.manoeuvres or ())

    def said(found: Flight | Manoeuvre) -> Flight | Manoeuvre:
        if found.loop == BARE:
            return found
        if isinstance(found, Manoeuvre):
            found = replace(found, lateral=_without(found.lateral, name, rudder.yaw_loop))
        return replace(found, yaw_loop=text)

    return replace(
        summary,
        manoeuvres=summary.manoeuvres and [said(each) for each in summary.manoeuvres],
        flight=None if summary.flight is None else said(summary.flight),
        bare=_without(summary.bare, name, rudder.yaw_loop) if fed_back else summary.bare,
        flights=summary.flights and [said(each) for each in summary.flights],
    )


def _without(bare: Bare | None, name: str, gains: str | None) -> Bare | None:
    """Return the bare airframe refused: its fit takes the damper's answer for the aircraft's.

    On a flight of SITL with gains up to 8 wn was 9 % high, and nothing else showed it.
    """
    if bare is None or bare.dutch_roll is None:
        return bare
    text = f"the {name} ({gains}) moves the rudder by the yaw rate of the same sample"
    said = ReasonSummary("bare_unknown", "warning", text)
    step = f"Switch the {name} off for the manoeuvre."
    verdict = VerdictSummary(usable=False, reasons=[said], next=step)
    return Bare(used=bare.used, verdict=verdict)
