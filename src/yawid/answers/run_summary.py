"""The summary of a run, as ``--json`` prints it and its MCAP holds it; a type for each object.

What does not apply is None and has no key in JSON; no number there is NaN or infinite. The fields
have the order of the keys.
"""

import json
from typing import Annotated, ClassVar, Final, Self

import msgspec

from yawid.answers.heard import BootSpan, GainSeen, LinkCounts, VehicleSeen
from yawid.answers.model_parts import DERIVATIVES, EQ_22_23
from yawid.answers.model_parts import HIGHEST as HIGHEST
from yawid.answers.model_parts import LOWEST as LOWEST
from yawid.answers.model_parts import POINTS as POINTS
from yawid.answers.model_parts import DutchRoll as DutchRoll  # all of an answer is found here
from yawid.answers.model_parts import MethodSummary as MethodSummary
from yawid.answers.model_parts import OneStructure as OneStructure
from yawid.answers.model_parts import Orders as Orders
from yawid.answers.model_parts import Response as Response
from yawid.answers.model_parts import TimeConstant as TimeConstant
from yawid.answers.model_parts import Value as Value
from yawid.answers.ordinary import OrdinaryAnswer as OrdinaryAnswer
from yawid.answers.part import Count, Number, Part, Positive, named, says
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.session import LiveFacts

FORM: Final = "1"
"""The form of stored answers: another one where those of the version before may not be used."""
CT: Final = "ct"
"""The method of a manoeuvre's answer: the continuous-time fit."""


class ChannelFound(Part, frozen=True):
    """The source of a channel, how it was found, its travel, and its message rate."""

    source: Annotated[
        str, says("message and field that carry the channel, or a column of a record")
    ]
    how: Annotated[
        str | None, says("how it was found: parameter, option, assumed, ...; and what its twins do")
    ] = None
    min_us: Annotated[Number | None, says("pulse at one end of the travel", "us")] = None
    trim_us: Annotated[Number | None, says("pulse at rest", "us")] = None
    max_us: Annotated[Number | None, says("pulse at the other end", "us")] = None
    reversed: Annotated[
        bool | None, says("whether a longer pulse turns the surface the other way")
    ] = None
    measured: Annotated[
        bool | None,
        says(
            "of a record: true where the deflection is measured, on straight "
            "lines between rows; false where it is a command, held from row to "
            "row"
        ),
    ] = None
    yaw_loop: Annotated[
        str | None,
        says(
            "gains by which the autopilot feeds the yaw rate back to the "
            "rudder; of a flight or a manoeuvre what holds of that loop: see "
            "loop"
        ),
    ] = None
    yaw_gains: Annotated[
        list[GainSeen] | None,
        says(
            "gains of that feedback that changed while the log lasts, and from "
            "when each of them holds; absent where none changed"
        ),
    ] = None
    rate_hz: Annotated[
        Positive | None,
        says(
            "messages a second: of the first seconds, or of the whole run if "
            "first_rate_hz is there",
            "Hz",
        ),
    ] = None
    first_rate_hz: Annotated[
        Positive | None, says("messages a second in the first seconds, which chose the grid", "Hz")
    ] = None


class Bare(Part, frozen=True, kw_only=True):
    """The bare airframe, of one manoeuvre (``lateral``) or of a flight (``bare``).

    ``derivatives`` are dimensional, by the names of ``NAMES``, and ``alpha_rad`` is the angle of
    attack of the body's axes. That of a flight has the ``correlations`` of derivatives, angle and
    servo lag, in this order, and the names of those that what is known beforehand determines
    (``from_prior``). Where a gate stops it there are only ``used``, the manoeuvres looked at, and
    the verdict, which says why.
    """

    NAMES: ClassVar = tuple[str, ...](DERIVATIVES["x-names"])

    dutch_roll: Annotated[
        DutchRoll | None, says("of the bare airframe; absent where a gate stops it")
    ] = None
    roll_mode: Annotated[TimeConstant | None, says("how fast a roll rate decays")] = None
    spiral: Annotated[
        TimeConstant | None, says("how fast a bank decays, or grows where it is negative")
    ] = None
    derivatives: Annotated[
        dict[str, Value] | None,
        says(
            "dimensional, per rad, rad/s or unit of the input, with Ixz folded in",
            **DERIVATIVES,
        ),
    ] = None
    alpha_rad: Annotated[Value | None, says("angle of attack of the body's axes")] = None
    servo_lag_s: Annotated[Value | None, says("lag of the servos of rudder and aileron", "s")] = (
        None
    )
    rudder_mix: Annotated[
        Value | None,
        says(
            "rudder per aileron that rolls with the least sideslip, each in the unit of its channel"
        ),
    ] = None
    correlations: Annotated[
        list[list[Number]] | None,
        says("of the derivatives, alpha_rad and servo_lag_s, in this order; of a flight only"),
    ] = None
    from_prior: Annotated[
        list[str] | None,
        says("names of the numbers that what is known beforehand determines more than the record"),
    ] = None
    gust_std_rad: Annotated[Number | None, says("sideslip of the gusts")] = None
    whiteness_rho1: Annotated[
        Number | None, says("largest autocorrelation of the innovations over 40 ms or a sample")
    ] = None
    airspeed_m_s: Annotated[Number | None, says("true airspeed for which it holds", "m/s")] = None
    used: Annotated[
        list[Count], says("numbers n of the manoeuvres that it rests on, or that were looked at")
    ]
    verdict: Annotated[Verdict, says("whether it is known; if not, why, and what to do")]

    def __bool__(self) -> bool:
        """Return whether it is known."""
        return self.verdict.usable


WHOLE_S = 6.0
"""A shorter manoeuvre was cut off: a whole one has a second before the movement, and 5 s after it.
Without it a movement of a second at the end of a log gave the reason for the whole flight."""


class Conditions(Part, frozen=True, kw_only=True):
    """The conditions in which manoeuvre ``n`` was flown; times are in s since boot.

    ``date`` is the UTC time of its first sample (ISO 8601), None where no date is known. ``loop``
    says what an answer is of: ``airframe``, ``with_roll_loop`` in a flight mode that holds roll, or
    ``unknown`` without a known mode; ``yaw_loop`` what it leaves out of a yaw damper.
    ``airspeed_source`` is ``airspeed`` or ``ground speed``, ``airspeed_kind`` the kind it gives;
    the altitude is in m above the sea.
    """

    n: Count
    from_s: Number
    to_s: Number
    duration_s: Annotated[Number, says("length of the manoeuvre", "s")]
    date: str | None = None
    mode: str | None = None
    loop: Annotated[str, says(enum=["airframe", "with_roll_loop", "unknown"])]
    yaw_loop: Annotated[
        str | None,
        says(
            "gains by which the autopilot feeds the yaw rate back to the "
            "rudder; of a flight or a manoeuvre what holds of that loop: see "
            "loop"
        ),
    ] = None
    airspeed_m_s: Number | None = None
    airspeed_std_m_s: Number | None = None
    airspeed_source: Annotated[str | None, says(enum=["airspeed", "ground speed"])] = None
    airspeed_kind: str | None = None
    altitude_m: Number | None = None


class Manoeuvre(Conditions, frozen=True, kw_only=True):
    """One manoeuvre: the conditions in which it was flown, and its answer."""

    inputs: list[str]
    turn_removed: bool
    estimates: Annotated[dict[str, MethodSummary], says("of the manoeuvre, by method")]
    verdict: Annotated[Verdict, says("of the manoeuvre")]
    lateral: Annotated[
        Bare | None,
        says("the bare airframe of this manoeuvre; it comes after the answer as flown"),
    ] = None

    @property
    def answer(self) -> MethodSummary | None:
        """The estimate of the method that answers, None where nothing could be estimated."""
        return self.estimates.get(self.verdict.method or "")

    @property
    def standing(self) -> tuple[bool, int, float]:
        """A sort key, smallest for the manoeuvre whose reasons a flight without an answer gives.

        It is the one with the fewest fatal reasons; of several the longest, which contains the most
        of what was flown. One that was cut off before the rudder had rested comes last.
        """
        return self.duration_s < WHOLE_S, len(self.verdict.fatal), -self.duration_s

    @property
    def dutch_roll(self) -> DutchRoll | None:
        """The Dutch roll of the method that answers."""
        return None if self.answer is None else self.answer.dutch_roll


class BetweenStd(Part, frozen=True, kw_only=True):
    """The scatter of manoeuvres beyond their own sigmas: the tau of the random effects."""

    wn_rad_s: Annotated[Number | None, says("of natural frequencies", "rad/s")] = None
    zeta: Annotated[Number | None, says("of damping ratios", "1")] = None


TAU_WN_SHARE, TAU_ZETA = 0.015, 0.02
"""The floors of that scatter, relative for wn, for zeta absolute: few manoeuvres do not show it."""


class Flight(Part, frozen=True, kw_only=True):
    """The answer from a flight's manoeuvres of one ``loop``; ``used`` and ``disagree`` name them.

    The Dutch roll is that at ``airspeed_m_s``, the median of those used; its sigmas are those of a
    next manoeuvre. ``kappa_rad_m`` is wn / V and ``K_per_V`` is K / V, with V the equivalent
    airspeed. ``physics`` holds K, T_theta_s and eq. 22's derivatives, ``settling_s`` is there, too.
    Without a usable manoeuvre there is only the verdict, with the best one's reasons.
    """

    method: Annotated[str | None, says("the method that answers")] = None
    airspeed_m_s: Number | None = None
    airspeed_source: Annotated[str | None, says(enum=["airspeed", "ground speed"])] = None
    airspeed_kind: str | None = None
    altitude_m: Number | None = None
    date: str | None = None
    loop: Annotated[str | None, says(enum=["airframe", "with_roll_loop", "unknown"])] = None
    yaw_loop: Annotated[
        str | None,
        says(
            "gains by which the autopilot feeds the yaw rate back to the "
            "rudder; of a flight or a manoeuvre what holds of that loop: see "
            "loop"
        ),
    ] = None
    dutch_roll: Annotated[
        DutchRoll | None,
        says("the answer, or what a method found; absent where no mode of the model is one"),
    ] = None
    kappa_rad_m: Value | None = None
    K_per_V: Value | None = None
    physics: Annotated[
        dict[str, Value] | None,
        says(
            "numbers of eq. 22-23 at the flight's airspeed, from all "
            "manoeuvres used; absent where none has them",
            **EQ_22_23,
        ),
    ] = None
    overshoot_pct: Value | None = None
    settling_s: Value | None = None
    between_std: Annotated[
        BetweenStd | None, says("tau, by how much manoeuvres scatter beyond their own sigmas")
    ] = None
    used: Annotated[list[Count], says("numbers n of the manoeuvres that the answer rests on")]
    disagree: Annotated[list[Count], says("numbers n of those left out because they disagree")]
    verdict: Annotated[Verdict, says("of the flight; that of the headline decides the exit code")]

    def __bool__(self) -> bool:
        """Return whether it is usable."""
        return self.verdict.usable


class Source(Part, frozen=True):
    """The log that the samples of a replayed MCAP are from."""

    log: Annotated[str | None, says("absolute path of the log that the MCAP was made from")] = None
    sha256: Annotated[
        str | None, says("of the log's bytes; absent where it was not read to its end")
    ] = None
    bytes_read: Annotated[
        Count | None, says("how far the log was read; instead of the hash", "bytes")
    ] = None


class Origin(Part, frozen=True, kw_only=True):
    """The origin of an answer: the log, the vehicle, the link and the channels."""

    log: Annotated[
        str, says("absolute path of the log, or the endpoint of a live session without a tlog")
    ]
    sha256: Annotated[
        str | None, says("of the log's bytes; absent where it was not read to its end")
    ] = None
    bytes_read: Annotated[
        Count | None, says("how far the log was read; instead of the hash", "bytes")
    ] = None
    source: Annotated[
        Source | None, says("the log that the samples of a replayed MCAP are from")
    ] = None
    duration_s: Annotated[Number, says("last record minus first, by the receiver's stamps", "s")]
    vehicle: Annotated[
        VehicleSeen | None,
        says("the aircraft estimated; absent where none was heard, and of a record"),
    ] = None
    vehicles: Annotated[
        list[VehicleSeen] | None, says("every vehicle heard, where there are several")
    ] = None
    boots: Annotated[
        list[BootSpan] | None, says("what each boot of the vehicle covers, where there are several")
    ] = None
    link: Annotated[LinkCounts, says("what was received over the link")]
    channels: Annotated[
        dict[str, ChannelFound],
        says(
            "where each channel comes from",
            **named(rudder="rudder", aileron="aileron", yaw="yaw rate"),
        ),
    ]

    @property
    def own_source(self) -> Source:
        """The log with its hash, or with the number of bytes read."""
        return Source(self.log, self.sha256, self.bytes_read)


class Judged:
    """What has the one verdict of a run.

    It is the flight's; without a manoeuvre it says what the log lacks, and how the rudder moved. It
    is None, not judged, where no manoeuvres were searched for and the log has rudder and yaw at a
    sufficient rate: ``warnings`` are then those of the log.
    """

    __slots__ = ()

    verdict: Verdict | None
    warnings: list[Reason] | None

    @property
    def deciding(self) -> Verdict:
        """The verdict; where nothing was judged, one that is neither usable nor has a reason."""
        return self.verdict or Verdict(usable=False, reasons=self.warnings or [])

    @property
    def exit_code(self) -> int:
        """The exit code of the verdict, 0 where nothing was judged."""
        return 0 if self.verdict is None else self.verdict.exit_code


class RunSummary(Origin, Judged, frozen=True, kw_only=True):
    """The summary of a run; ``estimates`` by method, None where there was no bank.

    ``estimates`` are those of the stream at its end, which have no verdict. ``manoeuvres`` is None
    where none were searched for, ``flight`` where there was none. ``flights`` has an answer for
    each loop with a usable manoeuvre, ``flight`` first; it is None without one.
    ``ordinary`` is next to them all; with ``--ordinary only`` it is all there is, and decides.
    """

    estimates: Annotated[
        dict[str, MethodSummary] | None, says("of the stream at its end, by method")
    ] = None
    verdict: Annotated[
        Verdict | None,
        says("the flight's, or why the log has no answer; absent where nothing was judged"),
    ] = None
    warnings: Annotated[
        list[Reason] | None, says("reasons found in link and channels where nothing was judged")
    ] = None
    manoeuvres: Annotated[
        list[Manoeuvre] | None, says("each with its answer; absent where they were not looked for")
    ] = None
    flight: Annotated[
        Flight | None,
        says("what the manoeuvres say together, the headline; absent where there was none"),
    ] = None
    flights: Annotated[
        list[Flight] | None,
        says(
            "for each loop with a usable manoeuvre what its manoeuvres say together, flight first"
        ),
    ] = None
    bare: Annotated[
        Bare | None,
        says("the bare airframe of the flight: without the roll loop it was flown with"),
    ] = None
    ordinary: Annotated[
        OrdinaryAnswer | None,
        says("from ordinary flight: the aircraft without its autopilot, mode only"),
    ] = None
    live: Annotated[LiveFacts | None, says("what a live session adds")] = None
    files: Annotated[
        dict[str, str] | None,
        says(
            "absolute paths of the files written",
            **named(mcap="the run", rrd="Rerun's recording", tlog="what a live session heard"),
        ),
    ] = None

    @classmethod
    def from_json(cls, data: bytes, *, is_whole: bool = True) -> Self:
        """Return the summary in a file's JSON; keys of newer versions are left out.

        If it is not ``is_whole``, only its origin, and the reasons of its verdict, are read.

        Raises:
            ValueError: it is no JSON, or not as yawid writes it; the text names the field.
        """
        try:
            # JSON may contain half a surrogate pair, a file may not: it becomes a question mark.
            text = json.dumps(json.loads(data), ensure_ascii=False).encode("utf-8", "replace")
            found = json.loads(text)
            if not is_whole and isinstance(found, dict):
                keys = {*Origin.__struct_fields__, "verdict", "warnings"}
                found = {key: value for key, value in found.items() if key in keys}
            return msgspec.convert(found, cls)
        except RecursionError as error:
            raise ValueError("it is nested too deeply") from error
        except msgspec.ValidationError as error:
            what, _, where = str(error).partition(" - at `$.")
            raise ValueError(f"{where.rstrip('`') or 'its summary'}: {what}") from error

    @property
    def by_loop(self) -> list[Flight]:
        """The flight's answers, one for each loop; the first is ``flight``."""
        return self.flights or ([] if self.flight is None else [self.flight])

    @property
    def used(self) -> set[int]:
        """The numbers of the manoeuvres on which an answer of the flight rests."""
        return {n for flight in self.by_loop for n in flight.used}

    @property
    def answer(self) -> MethodSummary | None:
        """The stream's estimate by the method asked for, None where nothing was estimated."""
        return next(iter((self.estimates or {}).values()), None)

    @property
    def dutch_roll(self) -> DutchRoll | None:
        """The Dutch roll of that estimate."""
        return None if self.answer is None else self.answer.dutch_roll
