"""The messages of our MCAP files, as protobuf descriptors built from one table.

Field numbers are the positions in the table: append, never reorder, or old files become unreadable
to those who remember the schema. The numbers of ``foxglove.Log`` are its publisher's.

``yawid.Parameters`` alone is made anew for each run, its fields being called as theta's elements: a
plot of theta[3] tells nobody anything. So ``yawid.Estimate``, which holds it, has a file of its own
beside that of all others, which are the same in every run.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import DecodeError, Message

from yawid.airspeed import Kind
from yawid.blocks import Held, Noted, Status, words
from yawid.config.estimator import RECURSIVE
from yawid.physics.derivatives import NAMES

_FieldProto = descriptor_pb2.FieldDescriptorProto
_PACKAGE = "yawid"
_YAWID_PROTO: Final = "yawid/yawid.proto"
_YAW_UNITS: Final = {
    "K": "rad/s per {rudder}, of the last whole second; NaN where eq. 23 does not hold",
    "T_theta_s": "s",
    "omega_beta": "rad/s",
    "xi_beta": "1",
    "a_z_beta": "1/s",
    "a_my_omega_y": "1/s",
    "a_my_beta": "1/s^2",
    "a_my_delta_h": "1/s^2 per {rudder}",
    "servo_tau_s": "s; NaN where no real pole is the servo's",
}
YAW_CHANNEL: Final = tuple(
    (name + suffix, "double", _YAW_UNITS[name]) for name in NAMES for suffix in ("", "_std")
)
"""Value and sigma of paper eq. 22-23's numbers, in the order of the physics."""

_KINDS = ", ".join(f"{kind.value} {words(kind)}" for kind in Kind)
_NOTED = ", ".join(f"{flag.value} {words(flag)}" for flag in Noted)

ESTIMATE: Final = "yawid.Estimate"
# message -> (field, type, unit); [] is repeated; a type that begins with a dot is a message, one
# with a dot within an enum;
# {rudder} stands for the unit of the rudder.
TABLE: Final[Mapping[str, tuple[tuple[str, str, str], ...]]] = {
    "HeldReasons": tuple((str(flag.name).lower(), "bool", "") for flag in Held),
    "Sample": (
        ("boot_time", "double", "s, clock of the vehicle"),
        ("received_time", "double", "s, Unix"),
        ("k", "sfixed64", "index on the grid of boot time, t = k * sample_time_s"),
        ("epoch", "fixed32", "count of changes in the meaning of u"),
        ("held", "fixed32", "bits as in held_reasons, 0: the estimators saw this sample"),
        ("held_reasons", ".yawid.HeldReasons", ""),
        (
            "u",
            "double[]",
            "rudder: {rudder}, aileron: half travel; mean over [t, t + sample_time_s)",
        ),
        ("rudder", "double", "{rudder}; NaN where it is no input"),
        ("aileron", "double", "half travel, input or not; NaN where unknown"),
        ("yaw_rate", "double", "rad/s"),
        ("yaw", "double", "rad, unwrapped"),
        ("roll", "double", "rad"),
        ("turn_rate", "double", "rad/s, as bank and airspeed imply; NaN without airspeed"),
        ("airspeed", "double", "m/s; NaN where unknown"),
        ("noted", "fixed32", f"bits: {_NOTED}"),
        ("mode", "double", "HEARTBEAT.custom_mode; NaN where unknown"),
        ("on_ground", "double", "1 on the ground, 0 in the air, NaN where unknown"),
        ("altitude", "double", "m, above the sea; NaN where unknown"),
        ("ground_speed", "double", "m/s; NaN where unknown"),
        ("airspeed_kind", "double", f"{_KINDS}; NaN where unknown"),
    ),
    "Estimate": (
        ("boot_time", "double", "s, clock of the vehicle"),
        ("status", "yawid.Status", ""),
        ("held", "fixed32", "bits as in held_reasons"),
        ("held_reasons", ".yawid.HeldReasons", ""),
        ("theta", "double[]", "a, c: 1; b: rad/s per unit of its input as in u; bias: rad/s"),
        ("theta_std", "double[]", "as theta"),
        ("y_hat", "double", "rad/s, one step ahead"),
        ("innovation", "double", "rad/s, a priori"),
        ("residual", "double", "rad/s, a posteriori"),
        ("noise_std", "double", "rad/s, of the innovation"),
        ("parameters", ".yawid.Parameters", "theta once more, its elements by their names"),
    ),
    "Modes": (
        ("boot_time", "double", "s, clock of the vehicle"),
        ("pole_re", "double[]", "rad/s, continuous time"),
        ("pole_im", "double[]", "rad/s, continuous time"),
        ("wn", "double[]", "rad/s, of each pole"),
        ("wn_std", "double[]", "rad/s"),
        ("zeta", "double[]", "1"),
        ("zeta_std", "double[]", "1"),
        ("dutch_roll_wn", "double", "rad/s; NaN where there is none"),
        ("dutch_roll_wn_std", "double", "rad/s"),
        ("dutch_roll_zeta", "double", "1"),
        ("dutch_roll_zeta_std", "double", "1"),
        *YAW_CHANNEL,
    ),
    "Reason": (
        ("id", "string", ""),
        ("weight", "string", "fatal or warning"),
        ("text", "string", ""),
    ),
    "Verdict": (("usable", "bool", ""), ("reasons", ".yawid.Reason[]", "")),
    "Mode": (
        ("boot_time", "double", "s, clock of the vehicle"),
        ("custom_mode", "double", "HEARTBEAT.custom_mode; NaN where unknown"),
        ("name", "string", "as the autopilot calls it"),
    ),
    "Manoeuvre": (
        ("n", "fixed32", "number, from 1"),
        ("from_s", "double", "s, clock of the vehicle, of its first sample"),
        ("to_s", "double", "s, clock of the vehicle, of its last sample"),
        ("duration_s", "double", "s"),
        ("date", "string", "UTC of its first sample, ISO 8601"),
        ("mode", "string", "as the autopilot calls it; empty where unknown"),
        ("loop", "string", "airframe, with_roll_loop or unknown"),
        ("airspeed_m_s", "double", "m/s, mean; NaN where unknown, and so of every number below"),
        ("airspeed_std_m_s", "double", "m/s"),
        ("airspeed_source", "string", "airspeed or ground speed; empty where unknown"),
        ("altitude_m", "double", "m, above the sea"),
        ("inputs", "string[]", ""),
        *((name, "fixed32", "order of the model") for name in ("na", "nb", "nc", "nk")),
        ("turn_removed", "bool", ""),
        ("method", "string", "whose answer the numbers below are; empty where there is none"),
        ("wn_rad_s", "double", "rad/s"),
        ("wn_std", "double", "rad/s, total"),
        ("zeta", "double", "1"),
        ("zeta_std", "double", "1, total"),
        ("K", "double", "rad/s per {rudder}"),
        ("K_std", "double", "rad/s per {rudder}, total"),
        ("simulation_pct", "double", "percent"),
        ("simulation_held_back_pct", "double", "percent"),
        ("usable", "bool", ""),
        ("reasons", ".yawid.Reason[]", ""),
        ("wn_std_noise", "double", "rad/s, what noise alone explains of wn_std"),
        ("zeta_std_noise", "double", "1, of zeta_std"),
        ("K_std_noise", "double", "rad/s per {rudder}, of K_std"),
        ("airspeed_kind", "string", "which airspeed the source gives; empty where unknown"),
    ),
}

TOPICS: Final[Mapping[str, str]] = {
    "/yawid/sample": "yawid.Sample",
    "/yawid/estimate": ESTIMATE,
    **{f"/yawid/estimate/{method}": ESTIMATE for method in RECURSIVE},
    "/yawid/modes": "yawid.Modes",
    "/yawid/mode": "yawid.Mode",
    "/yawid/manoeuvre": "yawid.Manoeuvre",
    "/yawid/flight": "yawid.Verdict",
    "/yawid/verdict": "yawid.Verdict",
    "/yawid/log": "foxglove.Log",
}
"""Every topic of our files and the message on it."""
SAMPLE, MODES, LOG = "/yawid/sample", "/yawid/modes", "/yawid/log"
MANOEUVRE: Final = "/yawid/manoeuvre"
FLIGHT: Final = "/yawid/flight"
"""The verdict that decides where there was a manoeuvre; VERDICT is that of the stream."""
VERDICT: Final = "/yawid/verdict"
MODE_VALUES: Final = ("wn", "wn_std", "zeta", "zeta_std")
"""Of a mode: fields of ``yawid.Modes`` by themselves and after ``dutch_roll_``."""


def estimate_topics(methods: Sequence[str]) -> dict[str, str]:
    """Return the topic of each method's estimates, the first asked for first."""
    return {m: f"/yawid/estimate/{m}" if i else "/yawid/estimate" for i, m in enumerate(methods)}


def units(rudder_unit: str) -> dict[str, str]:
    """Return the unit of every field that has one, by ``Message.field``."""
    return {
        f"{message}.{field}": unit.replace("{rudder}", rudder_unit)
        for message, fields in TABLE.items()
        for field, _, unit in fields
        if unit
    }


def _add_field(message: descriptor_pb2.DescriptorProto, name: str, kind: str) -> None:
    label = _FieldProto.LABEL_REPEATED if kind.endswith("[]") else _FieldProto.LABEL_OPTIONAL
    kind = kind.removesuffix("[]")
    field = message.field.add(name=name, number=len(message.field) + 1, label=label)
    if kind.startswith("."):
        field.type, field.type_name = _FieldProto.TYPE_MESSAGE, kind
    elif "." in kind:
        field.type, field.type_name = _FieldProto.TYPE_ENUM, f".{kind}"
    else:
        field.type = _FieldProto.Type.Value(f"TYPE_{kind.upper()}")


def _add_message(file: descriptor_pb2.FileDescriptorProto, name: str) -> None:
    message = file.message_type.add(name=name)
    for field, kind, _ in TABLE[name]:
        _add_field(message, field, kind)


def _yawid_file() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(name=_YAWID_PROTO, package=_PACKAGE, syntax="proto3")
    status = file.enum_type.add(name="Status")
    for member in Status:
        status.value.add(name=member.name, number=member.value)
    for name in TABLE:
        if name != "Estimate":
            _add_message(file, name)
    return file


def _estimate_file(parameters: Sequence[str]) -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(
        name="yawid/estimate.proto", package=_PACKAGE, syntax="proto3"
    )
    file.dependency.append(_YAWID_PROTO)
    theta = file.message_type.add(name="Parameters")
    for name in parameters:
        _add_field(theta, name, "double")
    _add_message(file, "Estimate")
    return file


def _foxglove_log_file() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(
        name="foxglove/Log.proto", package="foxglove", syntax="proto3"
    )
    file.dependency.append("google/protobuf/timestamp.proto")
    log = file.message_type.add(name="Log")
    level = log.enum_type.add(name="Level")
    for number, name in enumerate(("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")):
        level.value.add(name=name, number=number)
    _add_field(log, "timestamp", ".google.protobuf.Timestamp")
    _add_field(log, "level", "foxglove.Log.Level")
    for name in ("message", "name", "file"):
        _add_field(log, name, "string")
    _add_field(log, "line", "fixed32")
    return file


@lru_cache
def _pool(parameters: tuple[str, ...]) -> descriptor_pool.DescriptorPool:
    # A pool of our own: the default one is shared with whatever else the process has loaded.
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    for file in (_yawid_file(), _estimate_file(parameters), _foxglove_log_file()):
        pool.AddSerializedFile(file.SerializeToString(deterministic=True))
    return pool


def descriptor(full_name: str, parameters: tuple[str, ...] = ()) -> Descriptor:
    """Return the descriptor of a message by its full type name, such as ``yawid.Sample``.

    ``parameters`` (p,) names theta; without them ``yawid.Estimate`` tells theta by numbers alone.
    """
    return _pool(parameters).FindMessageTypeByName(full_name)


def descriptor_in(full_name: str, data: bytes) -> Descriptor:
    """Return the descriptor of a message in the FileDescriptorSet that stands in a file.

    Raises:
        ValueError: the set cannot be read or does not hold the message.
    """
    pool = descriptor_pool.DescriptorPool()
    try:
        for file in descriptor_pb2.FileDescriptorSet.FromString(data).file:
            pool.AddSerializedFile(file.SerializeToString())
        return pool.FindMessageTypeByName(full_name)
    except (DecodeError, TypeError, KeyError) as error:
        raise ValueError(f"the schema of {full_name} cannot be read") from error


def is_older(written: Descriptor, ours: Descriptor) -> bool:
    """Tell whether every field of ``written`` stands in ``ours`` as it is, which may have more."""
    for field in written.fields:
        known = ours.fields_by_number.get(field.number)
        if known is None or _shape(field) != _shape(known):
            return False
        if field.message_type is not None:
            assert known.message_type is not None  # the same type, by the comparison above
            if not is_older(field.message_type, known.message_type):
                return False
    return True


def _shape(field: FieldDescriptor) -> tuple[object, ...]:
    nested = None if field.message_type is None else field.message_type.full_name
    return field.name, field.type, field.is_repeated, nested


def message_class(full_name: str) -> type[Message]:
    """Return the class that builds a message, for those that are written seldom."""
    return message_factory.GetMessageClass(descriptor(full_name))


def schema_data(full_name: str, parameters: tuple[str, ...] = ()) -> bytes:
    """Return the serialised FileDescriptorSet of a message, its dependencies first."""
    files = descriptor_pb2.FileDescriptorSet()
    main = descriptor(full_name, parameters).file
    for file in (*main.dependencies, main):
        files.file.add().ParseFromString(file.serialized_pb)
    return files.SerializeToString(deterministic=True)


def is_ours(full_name: str, data: bytes) -> bool:
    """Tell whether a schema is, byte for byte, one that this version writes.

    Theta's names in it must be those of some orders: a damaged one is not among them.
    """
    parameters: tuple[str, ...] = ()
    if full_name == ESTIMATE:
        try:
            theta = descriptor_in(f"{_PACKAGE}.Parameters", data)
        except ValueError:
            return False
        parameters = tuple(field.name for field in theta.fields)
        if not _are_of_some_orders(parameters):
            return False
    return full_name in TOPICS.values() and data == schema_data(full_name, parameters)


def _are_of_some_orders(parameters: Sequence[str]) -> bool:
    """Tell whether they are a1, a2 .., b1 .., b1_aileron .., c1 .. and bias, with none left out."""
    counts = Counter(re.sub(r"\d+", "", name) for name in parameters)
    kinds = ("a", "b", "b_aileron", "c")
    names = [f"{kind[0]}{i + 1}{kind[1:]}" for kind in kinds for i in range(counts[kind])]
    return list(parameters) == [*names, "bias"]
