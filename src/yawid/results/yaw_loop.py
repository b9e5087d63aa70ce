"""What an answer leaves out where the autopilot feeds the yaw rate back to the rudder.

The part of a yaw damper is in the rudder's own output. Where that is the input, the model is that
of the aircraft without the damper; where the pilot's stick is, the damper is a part of the model.
"""

from msgspec.structs import replace

from yawid.answers.run_summary import Flight, Manoeuvre, RunSummary

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

    def said(found: Flight | Manoeuvre) -> Flight | Manoeuvre:
        return found if found.loop == BARE else replace(found, yaw_loop=text)

    return replace(
        summary,
        manoeuvres=summary.manoeuvres and [said(each) for each in summary.manoeuvres],
        flight=summary.flight and said(summary.flight),
    )
