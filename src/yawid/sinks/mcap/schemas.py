"""The messages of yawid's MCAP files, as protobuf descriptors built from one table.

Field numbers are the positions in the table. A changed table is another format: files of the one
before are refused. The numbers of ``foxglove.Log`` are those of its publisher. The fields of
``yawid.Parameters`` have the names of theta's elements, since a plot of theta[3] explains nothing:
so the descriptors are made for each run.
"""

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Final, TypeAlias

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor import Descriptor
from google.protobuf.json_format import ParseDict
from google.protobuf.message import Message

from yawid.blocks import Held, Noted, Status, words
from yawid.config.names import RECURSIVE
from yawid.quantities.airspeed import Kind
from yawid.quantities.table import OF_NOISE, RUDDER, YAW_CHANNEL, quantity
from yawid.quantities.units import HALF_TRAVEL

_KINDS = ", ".join(f"{kind.value} {words(kind)}" for kind in Kind)
_NOTED = ", ".join(f"{flag.value} {words(flag)}" for flag in Noted)

MODE_VALUES: Final = ("wn", "wn_std", "zeta", "zeta_std")
"""The values of a mode: fields of ``yawid.Modes``, and again with ``dutch_roll_`` before them."""

ESTIMATE: Final = "yawid.Estimate"
Fields: TypeAlias = tuple[tuple[str, str], ...]
TABLE: Final[Mapping[str, Fields]] = {
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
    "Attitude": tuple((n, "double") for n in ("boot_time", "roll", "pitch", "p", "q", "r")),
    "Commands": tuple((n, "double") for n in ("boot_time", "rudder", "aileron", "epoch", "exact")),
    "Acceleration": tuple((n, "double") for n in ("boot_time", "ay", "next_attitude_us")),
}  # fmt: skip
"""The fields of each message, as (name, type). A type with [] is repeated; one that begins with a
dot is a message, one with a dot inside is an enum. An unknown number is NaN, an unknown text "".
"""
_LOG: Final[Fields] = (
    ("timestamp", ".google.protobuf.Timestamp"), ("level", "foxglove.Level"),
    ("message", "string"), ("name", "string"), ("file", "string"), ("line", "fixed32"),
)  # fmt: skip
_LEVELS: Final = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")
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
    "/yawid/verdict": "yawid.Verdict",
    "/yawid/log": "foxglove.Log",
    "/yawid/attitude": "yawid.Attitude",
    "/yawid/commands": "yawid.Commands",
    "/yawid/acceleration": "yawid.Acceleration",
}
"""Every topic in protobuf of a run's file, and the type of its messages."""
SAMPLE, MODES, MODE = "/yawid/sample", "/yawid/modes", "/yawid/mode"
LOG, VERDICT = "/yawid/log", "/yawid/verdict"
MOTION: Final = ("/yawid/attitude", "/yawid/commands", "/yawid/acceleration")
"""The topics of the lateral motion, in the order of :class:`yawid.blocks.MotionBlock`."""


def estimate_topics(methods: Sequence[str]) -> dict[str, str]:
    """Return the topic of each method's estimates; the primary method comes first."""
    return {m: f"/yawid/estimate/{m}" if i else "/yawid/estimate" for i, m in enumerate(methods)}


def units(rudder_unit: str) -> dict[str, str]:
    """Return unit and words of each field that has them, by ``Message.field``."""
    texts = {
        f"{message}.{field}": described(field, message)
        for message, fields in TABLE.items()
        for field, kind in fields
        if kind != "bool"
    }
    return {name: text.replace(RUDDER, rudder_unit) for name, text in texts.items() if text}


def described(field: str, message: str = "") -> str:
    """Return unit and words of a field, "" where its name explains it."""
    if (own := _OWN.get(f"{message}.{field}")) is not None:
        return own
    try:
        row = quantity(_CALLED.get(field, field))
    except KeyError:
        return ""
    # The sigmas of each sample are those of noise; a manoeuvre's are total.
    words = OF_NOISE if message == "Modes" and field.endswith("_std") else row.words
    return ", ".join(filter(None, (row.unit, words)))


def _field(number: int, name: str, kind: str) -> dict[str, object]:
    """Return a field of a descriptor, as protobuf has it in JSON."""
    label = "LABEL_REPEATED" if kind.endswith("[]") else "LABEL_OPTIONAL"
    field = {"name": name, "number": number, "label": label}
    plain = kind.removesuffix("[]")
    if "." not in plain:
        return field | {"type": f"TYPE_{plain.upper()}"}
    type_name = f".{plain.removeprefix('.')}"
    return field | {"type": "TYPE_MESSAGE" if plain == type_name else "TYPE_ENUM",
                    "typeName": type_name}  # fmt: skip


def _file(
    package: str, messages: Mapping[str, Fields], enum: str, values: Iterable[tuple[str, int]]
) -> descriptor_pb2.FileDescriptorProto:
    members = [{"name": name, "number": number} for name, number in values]
    kinds = [
        {"name": name, "field": [_field(i, *each) for i, each in enumerate(fields, start=1)]}
        for name, fields in messages.items()
    ]
    file = {"name": f"{package}.proto", "package": package, "syntax": "proto3",
            "enumType": [{"name": enum, "value": members}], "messageType": kinds}  # fmt: skip
    return ParseDict(file, descriptor_pb2.FileDescriptorProto())


@lru_cache
def _pool(parameters: tuple[str, ...]) -> descriptor_pool.DescriptorPool:
    # This pool is our own: the default pool is shared with everything that the process has loaded.
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    theta = tuple((name, "double") for name in parameters)
    status = [(member.name, member.value) for member in Status]
    levels = [(name, i) for i, name in enumerate(_LEVELS)]
    log = _file("foxglove", {"Log": _LOG}, "Level", levels)
    log.dependency.append("google/protobuf/timestamp.proto")
    for file in (_file("yawid", {"Parameters": theta, **TABLE}, "Status", status), log):
        pool.AddSerializedFile(file.SerializeToString(deterministic=True))
    return pool


def descriptor(full_name: str, parameters: tuple[str, ...] = ()) -> Descriptor:
    """Return the descriptor of a message by its full type name, such as ``yawid.Sample``.

    ``parameters`` (p,) names theta; without them ``yawid.Estimate`` has theta only by position.
    """
    return _pool(parameters).FindMessageTypeByName(full_name)


def message_class(full_name: str, parameters: tuple[str, ...] = ()) -> type[Message]:
    """Return the class that builds a message, for messages that are written or read rarely."""
    return message_factory.GetMessageClass(descriptor(full_name, parameters))


def schema_data(full_name: str, parameters: tuple[str, ...] = ()) -> bytes:
    """Return the serialised FileDescriptorSet of a message, its dependencies first."""
    files = descriptor_pb2.FileDescriptorSet()
    main = descriptor(full_name, parameters).file
    for file in (*main.dependencies, main):
        files.file.add().ParseFromString(file.serialized_pb)
    return files.SerializeToString(deterministic=True)
