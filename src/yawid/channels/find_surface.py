"""The search for the outputs that move the rudder and the aileron, by the vehicle's parameters.

ArduPilot names them by SERVOn_FUNCTION (numbers of SRV_Channel.h), PX4 by PWM_MAIN_FUNCn, which
names a servo, and CA_SV_CSi_TYPE, which names the control surface that the servo moves.
"""

import itertools

from yawid.answers.reasons import Reason
from yawid.channels.parameters import PX4_TRAVEL_US, STOCK_TRAVEL_US, ParameterTable
from yawid.channels.surface import STICKS, Surface, SurfacePart
from yawid.channels.vehicle import Vehicle, has_wings
from yawid.quantities.vehicles import ARDUPILOT, FIXED_WING, PX4, WITHOUT_RUDDER

AP_VTAIL, AP_ELEVON, AP_FLAPERON = (79, 80), (77, 78), (24, 25)
"""The SERVOn_FUNCTION of left and right."""
AP_SINGLE = {"rudder": 21, "aileron": 4}
AP_PAIRS = {"rudder": (AP_VTAIL,), "aileron": (AP_ELEVON, AP_FLAPERON)}
"""The pairs of outputs into which the surface may be mixed."""
STOCK_SERVO = {"rudder": 4, "aileron": 1}
"""ArduPilot's stock servo of each surface."""
CONTROL_INDEX = {"rudder": 2, "aileron": 0}
"""The index of each surface in ACTUATOR_CONTROL_TARGET.controls, by PX4's convention."""
PX4_SINGLE = {"rudder": (4,), "aileron": (15,)}
"""The CA_SV_CSi_TYPE of a single surface."""
PX4_PAIR = {"rudder": (7, 8, 0.5, -0.5), "aileron": (1, 2, -0.5, 0.5)}
"""The CA_SV_CSi_TYPE of left and right, and their weights: each gives half of the torque."""
PX4_FIRST_SERVO = 201
"""The output function that means servo 1; it moves control surface 0."""
NAME_IT = "If one of these outputs does move a rudder, name it: --rudder servo:N."
OTHER_LOG = "Use a log of an aircraft that has a rudder."
"""What to do where outputs have other functions, and where the aircraft has no rudder."""
PX4_BANKS = (("PWM_MAIN", 0), ("PWM_AUX", 16), ("HIL_ACT", 0))
"""The prefixes of a bank's parameters, and the number of outputs before it in the message."""


def find_surface(
    what: str, selector: str, vehicle: Vehicle, table: ParameterTable, received: frozenset[str]
) -> Surface | None:
    """Return where to read the ``rudder`` or ``aileron`` from now on, None while nothing names it.

    With ``auto`` these are the outputs that the parameters name. On an ArduPilot fixed-wing that
    has reported no SERVOn_FUNCTION at all, the stock channel is assumed; likewise where none of
    those reported names it, the list is incomplete, and that of the stock channel was lost. On
    another autopilot that
    has named no output, it is ACTUATOR_CONTROL_TARGET if that is ``received`` and the vehicle has
    wings: by PX4's convention control 2 is the torque about the yaw axis, which without wings is
    the difference of the rotors. A generic vehicle (type 0), or one in a log that has lost its
    parameters, does not say which: an option must name its rudder. A vehicle whose type has no
    rudder gets none by an option either, unless its parameters name one.
    """
    is_ardupilot = vehicle.autopilot == ARDUPILOT
    reported = _ardupilot(what, vehicle, table) if is_ardupilot else _px4(what, table, received)
    if vehicle.type in WITHOUT_RUDDER and reported is None:
        return None
    kind, _, number = selector.partition(":")
    if kind == "servo":
        return Surface("SERVO_OUTPUT_RAW", "option", (_servo(table, int(number)),))
    if kind == "vtail":
        left, right = (int(n) for n in number.split(","))
        return Surface("SERVO_OUTPUT_RAW", "option", _vtail(table, left, right))
    if kind == "control":
        return Surface("ACTUATOR_CONTROL_TARGET", "option", (SurfacePart(int(number), None),))
    if kind == "rc":
        message = next((name for name in STICKS if name in received), STICKS[0])
        stock = PX4_TRAVEL_US if vehicle.autopilot == PX4 else STOCK_TRAVEL_US
        travel, reverse, _ = table.travel(f"RC{number}", stock)
        return Surface(message, "option", (SurfacePart(int(number), travel, reverse),))
    by_convention = reported is None and not is_ardupilot and has_wings(vehicle)
    if by_convention and "ACTUATOR_CONTROL_TARGET" in received:
        part = SurfacePart(CONTROL_INDEX[what], None)
        return Surface("ACTUATOR_CONTROL_TARGET", "convention", (part,))
    return reported


def _servo(table: ParameterTable, number: int, weight: float = 1.0) -> SurfacePart:
    travel, reverse, _ = table.travel(f"SERVO{number}")
    return SurfacePart(number, travel, reverse, weight)


def _vtail(table: ParameterTable, left: int, right: int) -> tuple[SurfacePart, ...]:
    """Return both outputs of a V-tail, weighted to give the rudder.

    This inverts left = (elevator + rudder) * gain, right = (elevator - rudder) * gain.
    """
    weight = 0.5 / _mixing(table)
    return _servo(table, left, weight), _servo(table, right, -weight)


def _mixing(table: ParameterTable) -> float:
    """Return the mixer's factor for rudder or aileron: MIXING_GAIN, raised by an offset > 0."""
    gain, offset = table.get("MIXING_GAIN", 0.5), table.get("MIXING_OFFSET", 0.0)
    mixing = gain * (1.0 + max(offset, 0.0) / 100.0)
    return mixing if 0.0 < mixing < 100.0 else 0.5


def _is_before_3_8(what: str, vehicle: Vehicle, table: ParameterTable) -> bool:
    """Return whether an ArduPlane is so old that RCn_REV has the sense of its outputs."""
    return vehicle.autopilot == ARDUPILOT and f"RC{STOCK_SERVO[what]}_REV" in table.values


def _ardupilot(what: str, vehicle: Vehicle, table: ParameterTable) -> Surface | None:
    functions = table.functions()
    assumed = None
    if vehicle.type == FIXED_WING and not _is_before_3_8(what, vehicle, table):
        assumed = Surface("SERVO_OUTPUT_RAW", "assumed", (_servo(table, STOCK_SERVO[what]),))
    if not functions:
        return assumed
    parts = _ap_parts(what, {f: servo for servo, f in reversed(functions.items())}, table)
    if not parts:
        # They come in order: one of a later servo says that that of the stock servo was lost.
        is_lost = STOCK_SERVO[what] not in functions and max(functions) > STOCK_SERVO[what]
        return assumed if table.missing and is_lost else None
    reported = all(table.travel(f"SERVO{part.number}")[2] for part in parts)
    how = "parameter" if reported else "parameter, travel assumed"
    twins = [n for n, function in functions.items() if function == AP_SINGLE[what]][1:]
    alike = tuple(_servo(table, number) for number in twins)
    return Surface("SERVO_OUTPUT_RAW", how, parts, twins=alike)


def _ap_parts(
    what: str, servo_of: dict[int, int], table: ParameterTable
) -> tuple[SurfacePart, ...]:
    """Return the output of the single surface, else the pair of outputs that it is mixed into."""
    single = AP_SINGLE[what]
    if single in servo_of:
        return (_servo(table, servo_of[single]),)
    for pair in AP_PAIRS[what]:
        if servo_of.keys() >= {*pair}:
            left, right = (servo_of[function] for function in pair)
            if pair == AP_VTAIL:
                return _vtail(table, left, right)
            weight = 0.5 if pair == AP_FLAPERON else -0.5 / _mixing(table)
            return _servo(table, left, weight), _servo(table, right, abs(weight))
    return ()


def _px4(what: str, table: ParameterTable, received: frozenset[str]) -> Surface | None:
    names = {i: f"CA_SV_CS{i}_TYPE" for i in range(8)}
    types = {i: int(table.get(name, 0.0)) for i, name in names.items() if name in table.values}
    left, right, left_weight, right_weight = PX4_PAIR[what]
    single = [i for i, kind in types.items() if kind in PX4_SINGLE[what]]
    pair = [i for kind in (left, right) for i, found in types.items() if found == kind]
    if single:
        wanted = [(single[0], 1.0)]
    elif len(pair) == 2:
        wanted = [(pair[0], left_weight), (pair[1], right_weight)]
    else:
        return None
    found = [_px4_output(index, weight, table, received) for index, weight in wanted]
    named = [output for output in found if output is not None]
    if len(named) < len(wanted) or len({message for message, _ in named}) > 1:
        return None
    others = [_px4_output(index, 1.0, table, received) for index in single[1:]]
    message = named[0][0]
    twins = tuple(twin for name, twin in filter(None, others) if name == message)
    return Surface(message, "parameter", tuple(part for _, part in named), twins=twins)


def _px4_output(
    index: int, weight: float, table: ParameterTable, received: frozenset[str]
) -> tuple[str, SurfacePart] | None:
    """Return the message and the output that report control surface ``index``."""
    raw, status = "SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS"
    for (bank, shift), number in itertools.product(PX4_BANKS, range(1, 17)):
        if table.get(f"{bank}_FUNC{number}", 0.0) == PX4_FIRST_SERVO + index:
            travel, reverse = table.px4_travel(bank, number)
            message = status if status in received and raw not in received else raw
            message = "HIL_ACTUATOR_CONTROLS" if bank == "HIL_ACT" else message
            return message, SurfacePart(number + shift, travel, reverse, weight)
    return None


def no_surface(what: str, vehicle: Vehicle, table: ParameterTable) -> Reason:
    """Return the reason that there is no surface, with what was found instead."""
    functions = {n: f for n, f in table.functions().items() if f}
    torn = f"; {table.missing} parameters are missing: download them again" if table.missing else ""
    if functions:
        found = ", ".join(f"SERVO{n}={f}" for n, f in functions.items())
        text = f"none of the servo functions is a {what}; those found are {found}{torn}"
        return Reason("no_rudder", text, OTHER_LOG if vehicle.type in WITHOUT_RUDDER else NAME_IT)
    if vehicle.type in WITHOUT_RUDDER:
        return Reason(
            "no_rudder",
            f"the vehicle is a {vehicle.numbered_type} on {vehicle.autopilot_name}, which has no "
            f"{what}, whatever channel is named",
            OTHER_LOG,
        )
    if _is_before_3_8(what, vehicle, table):
        return Reason(
            "no_rudder",
            "the vehicle is an ArduPlane before 3.8, whose outputs have the travel and the sense "
            "of RCn_, which are not read",
            "Name the output by --rudder servo:N: its sense and travel are then assumed (not "
            "reversed, 1100 to 1900 us), on which the sign and size of the gain depend.",
        )
    return Reason(
        "no_rudder",
        f"no parameter or message names a {what}; the vehicle is a {vehicle.numbered_type} "
        f"on {vehicle.autopilot_name}{torn}",
    )
