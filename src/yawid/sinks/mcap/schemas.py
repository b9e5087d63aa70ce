"""The messages of yawid's MCAP files, as protobuf descriptors built from one table.

Field numbers are the positions in the table. A changed table is another format: files of the one
before are refused. The numbers of ``foxglove.Log`` are those of its publisher.

Only ``yawid.Parameters`` is made for each run: its fields have the names of theta's elements, since
a plot of theta[3] explains nothing. Therefore ``yawid.Estimate``, which holds it, has a descriptor
file of its own, and so have the messages of the lateral motion, which few runs keep; all other
messages are in one that is the same in every run.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

import msgspec
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor import Descriptor
from google.protobuf.message import DecodeError, Message

from yawid.answers.ordinary import OrdinaryAnswer
from yawid.answers.run_summary import Bare
from yawid.blocks import Held, Noted, Status, words
from yawid.config.names import RECURSIVE
from yawid.quantities.airspeed import Kind
from yawid.quantities.table import OF_NOISE, RUDDER, YAW_CHANNEL, quantity
from yawid.quantities.units import HALF_TRAVEL

_FieldProto = descriptor_pb2.FieldDescriptorProto
_PACKAGE = "yawid"
_YAWID_PROTO: Final = "yawid/yawid.proto"
_KINDS = ", ".join(f"{kind.value} {words(kind)}" for kind in Kind)
_NOTED = ", ".join(f"{flag.value} {words(flag)}" for flag in Noted)

MODE_VALUES: Final = ("wn", "wn_std", "zeta", "zeta_std")
"""The values of a mode: fields of ``yawid.Modes``, and again with ``dutch_roll_`` before them."""

ESTIMATE: Final = "yawid.Estimate"
TABLE: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "HeldReasons": tuple((str(flag.name).lower(), "bool") for flag in Held),
    "Sample": (
        ("boot_time", "double"), ("received_time", "double"), ("k", "sfixed64"),
        ("epoch", "fixed32"), ("held", "fixed32"), ("held_reasons", ".yawid.HeldReasons"),
        ("u", "double[]"), ("rudder", "double"), ("aileron", "double"), ("yaw_rate", "double"),
        ("yaw", "double"), ("roll", "double"), ("turn_rate", "double"), ("airspeed", "double"),
        ("noted", "fixed32"), ("mode", "double"), ("on_ground", "double"), ("altitude", "double"),
        ("ground_speed", "double"), ("airspeed_kind", "double"),
        ("rudder_moves", "double"),
    ),
    "Estimate": (
        ("boot_time", "double"), ("status", "yawid.Status"), ("held", "fixed32"),
        ("held_reasons", ".yawid.HeldReasons"), ("theta", "double[]"), ("theta_std", "double[]"),
        ("y_hat", "double"), ("innovation", "double"), ("residual", "double"),
        ("noise_std", "double"), ("parameters", ".yawid.Parameters"),
    ),
    "Modes": (
        ("boot_time", "double"), ("pole_re", "double[]"), ("pole_im", "double[]"),
        *((name, "double[]") for name in MODE_VALUES),
        *((f"dutch_roll_{name}", "double") for name in MODE_VALUES),
        *((name + std, "double") for name in YAW_CHANNEL for std in ("", "_std")),
    ),
    "Reason": (
        ("id", "string"), ("weight", "string"), ("text", "string"), ("remedy", "string"),
    ),
    "Verdict": (("usable", "bool"), ("reasons", ".yawid.Reason[]")),
    "Mode": (("boot_time", "double"), ("custom_mode", "double"), ("name", "string")),
    "Manoeuvre": (
        ("n", "fixed32"), ("from_s", "double"), ("to_s", "double"), ("duration_s", "double"),
        ("date", "string"), ("mode", "string"), ("loop", "string"), ("airspeed_m_s", "double"),
        ("airspeed_std_m_s", "double"), ("airspeed_source", "string"), ("altitude_m", "double"),
        ("inputs", "string[]"), ("turn_removed", "bool"), ("method", "string"),
        ("wn_rad_s", "double"), ("wn_std", "double"), ("zeta", "double"), ("zeta_std", "double"),
        ("K", "double"), ("K_std", "double"), ("yaw_acceleration", "double"),
        ("yaw_acceleration_std", "double"), ("simulation_pct", "double"), ("usable", "bool"),
        ("reasons", ".yawid.Reason[]"), ("wn_std_noise", "double"), ("zeta_std_noise", "double"),
        ("airspeed_kind", "string"), ("structure", "string"),
    ),
}  # fmt: skip
"""The fields of each message, as (name, type). A type with [] is repeated; one that begins with a
dot is a message, one with a dot inside is an enum. An unknown number is NaN, an unknown text "".
"""
MOTION_TABLE: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "Attitude": tuple((n, "double") for n in ("boot_time", "roll", "pitch", "p", "q", "r")),
    "Commands": tuple((n, "double") for n in ("boot_time", "rudder", "aileron", "epoch", "exact")),
    "Acceleration": tuple((n, "double") for n in ("boot_time", "ay", "next_attitude_us")),
}
"""The messages of the lateral motion, one for each one received, as in ``TABLE``."""
_STD: Final = ("", "_std")
LATERAL_TABLE: Final = {
    "Lateral": (
        ("n", "fixed32"), ("usable", "bool"), ("reasons", "string"),
        *((n, "double") for n in ("wn_rad_s", "wn_std", "zeta", "zeta_std")),
        *((f"{n}{s}", "double") for n in ("roll_mode_s", "spiral_s", "servo_lag_s") for s in _STD),
        *((f"{n}{s}", "double") for n in Bare.NAMES for s in _STD),
        ("gust_std_rad", "double"), ("whiteness_rho1", "double"), ("airspeed_m_s", "double"),
    ),
}  # fmt: skip
"""The message of a manoeuvre's bare airframe; unknown numbers are NaN."""
_CALLED: Final = {"yaw_rate": "r", **{f"dutch_roll_{name}": name for name in MODE_VALUES}}
"""The names in the table of quantities of fields that are called otherwise here."""
_OWN: Final[Mapping[str, str]] = {
    "Sample.k": "index on the grid of boot time, t = k * sample_time_s",
    "Sample.epoch": "count of changes in the meaning of u",
    "Sample.held": "bits as in held_reasons, 0: the estimators saw this sample",
    "Sample.u": f"rudder: {RUDDER}, aileron: {HALF_TRAVEL}; mean over [t, t + sample_time_s)",
    "Sample.rudder": f"{RUDDER}, as in u; NaN where it is no input",
    "Sample.noted": f"bits: {_NOTED}",
    "Sample.mode": "HEARTBEAT.custom_mode; NaN where unknown",
    "Sample.airspeed_kind": f"{_KINDS}; NaN where unknown",
    "Estimate.held": "bits as in held_reasons",
    "Estimate.theta": "a, c: 1; b: rad/s per unit of its input as in u; bias: rad/s",
    "Estimate.theta_std": "as theta",
    "Estimate.parameters": "theta once more, its elements by their names",
    "Commands.rudder": f"{RUDDER}; the command received at this time",
    "Commands.aileron": f"{HALF_TRAVEL}; the command received at this time",
    "Commands.epoch": "count of changes in the meaning of the commands",
    "Commands.exact": "1 where boot_time is the message's own, 0 for the row of a record",
    "Acceleration.next_attitude_us": "boot_time of the next attitude received, in us",
    "Lateral.n": "number of the manoeuvre",
    "Reason.weight": "fatal or warning",
    "Reason.remedy": "what to do about it, in a sentence",
    "Mode.custom_mode": "HEARTBEAT.custom_mode; NaN where unknown",
    "Mode.name": "as the autopilot calls it",
}
"""Units and words of the fields that the table of quantities does not describe."""

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
    "/yawid/attitude": "yawid.Attitude",
    "/yawid/commands": "yawid.Commands",
    "/yawid/acceleration": "yawid.Acceleration",
    "/yawid/lateral": "yawid.Lateral",
}
"""Every topic of a run's file, and the type of its messages."""
SAMPLE, MODES, LOG = "/yawid/sample", "/yawid/modes", "/yawid/log"
MANOEUVRE: Final = "/yawid/manoeuvre"
FLIGHT: Final = "/yawid/flight"
"""The topic of the flight's verdict, which decides where there was a manoeuvre."""
VERDICT: Final = "/yawid/verdict"
LATERAL: Final = "/yawid/lateral"
ORDINARY_TOPIC: Final = "/yawid/ordinary"
"""The topic of ordinary flight's answer, as JSON with its schema."""
MOTION: Final = ("/yawid/attitude", "/yawid/commands", "/yawid/acceleration")
"""The topics of the lateral motion, in the order of :class:`yawid.blocks.MotionBlock`."""


def estimate_topics(methods: Sequence[str]) -> dict[str, str]:
    """Return the topic of each method's estimates; the primary method comes first."""
    return {m: f"/yawid/estimate/{m}" if i else "/yawid/estimate" for i, m in enumerate(methods)}


def units(
    rudder_unit: str, messages: Mapping[str, tuple[tuple[str, str], ...]] = TABLE
) -> dict[str, str]:
    """Return unit and words of each field that has them, by ``Message.field``."""
    texts = {
        f"{message}.{field}": _text(message, field)
        for message, fields in messages.items()
        for field, kind in fields
        if kind != "bool"
    }
    return {name: text.replace(RUDDER, rudder_unit) for name, text in texts.items() if text}


def _text(message: str, field: str) -> str:
    if (own := _OWN.get(f"{message}.{field}")) is not None:
        return own
    try:
        row = quantity(_CALLED.get(field, field))
    except KeyError:  # the field's name explains it
        return ""
    # The sigmas of each sample are those of noise; a manoeuvre's are total.
    words = OF_NOISE if message == "Modes" and field.endswith("_std") else row.words
    return ", ".join(filter(None, (row.unit, words)))


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
    for field, kind in {**TABLE, **MOTION_TABLE, **LATERAL_TABLE}[name]:
        _add_field(message, field, kind)


def _motion_file() -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(
        name="yawid/motion.proto", package=_PACKAGE, syntax="proto3"
    )
    for name in (*MOTION_TABLE, *LATERAL_TABLE):
        _add_message(file, name)
    return file


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
    # This pool is our own: the default pool is shared with everything that the process has loaded.
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    ours = _yawid_file(), _estimate_file(parameters), _motion_file(), _foxglove_log_file()
    for file in ours:
        pool.AddSerializedFile(file.SerializeToString(deterministic=True))
    return pool


def ordinary_schema() -> bytes:
    """Return the JSON schema of ordinary flight's answer."""
    (root,), parts = msgspec.json.schema_components([OrdinaryAnswer])
    name = root["$ref"].rpartition("/")[2]
    return msgspec.json.encode(parts.pop(name) | {"$defs": parts})


def descriptor(full_name: str, parameters: tuple[str, ...] = ()) -> Descriptor:
    """Return the descriptor of a message by its full type name, such as ``yawid.Sample``.

    ``parameters`` (p,) names theta; without them ``yawid.Estimate`` has theta only by position.
    """
    return _pool(parameters).FindMessageTypeByName(full_name)


def descriptor_in(full_name: str, data: bytes) -> Descriptor:
    """Return the descriptor of a message from ``data``, a FileDescriptorSet in a file.

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


def message_class(full_name: str) -> type[Message]:
    """Return the class that builds a message, for messages that are written rarely."""
    return message_factory.GetMessageClass(descriptor(full_name))


def schema_data(full_name: str, parameters: tuple[str, ...] = ()) -> bytes:
    """Return the serialised FileDescriptorSet of a message, its dependencies first."""
    files = descriptor_pb2.FileDescriptorSet()
    main = descriptor(full_name, parameters).file
    for file in (*main.dependencies, main):
        files.file.add().ParseFromString(file.serialized_pb)
    return files.SerializeToString(deterministic=True)


def is_ours(full_name: str, data: bytes) -> bool:
    """Return whether a schema is equal, byte for byte, to one that this version writes.

    The names of theta in it must be those of some orders, which excludes damaged names.
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
    """Return whether names are a1, a2 .., b1 .., b1_aileron .., c1 .., bias, without a gap."""
    counts = Counter(re.sub(r"\d+", "", name) for name in parameters)
    kinds = ("a", "b", "b_aileron", "c")
    names = [f"{kind[0]}{i + 1}{kind[1:]}" for kind in kinds for i in range(counts[kind])]
    return list(parameters) == [*names, "bias"]
