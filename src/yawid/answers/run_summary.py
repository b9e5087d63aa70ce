"""The summary of a run, as ``--json`` prints it and its MCAP holds it; a type for each object.

What does not apply is None and has no key in JSON; no number there is NaN or infinite. The fields
have the order of the keys.
"""

import json
from typing import ClassVar, Final, Self

import msgspec

from yawid.answers.heard import BootSpan, GainSeen, LinkCounts, VehicleSeen
from yawid.answers.model_parts import DutchRoll as DutchRoll  # all of an answer is found here
from yawid.answers.model_parts import Fit, Mode
from yawid.answers.model_parts import TimeConstant as TimeConstant
from yawid.answers.model_parts import Value as Value
from yawid.answers.ordinary import OrdinaryAnswer as OrdinaryAnswer
from yawid.answers.part import Count, Number, Part, Positive
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.session import LiveFacts

FORM: Final = "1"
"""The form of stored answers: another one where those of the version before may not be used."""
CT: Final = "ct"
"""The method of a manoeuvre's answer: the continuous-time fit."""


class ChannelFound(Part, frozen=True):
    """The source of a channel, how it was found, its travel, and its message rate.

    ``rate_hz`` is the rate of the first seconds, which chose the grid, or of the whole run if
    ``first_rate_hz`` is given, which is then that of the first seconds. ``measured`` is there for a
    record: a deflection on straight lines, or a held command; ``yaw_loop`` has a damper's gains,
    ``yaw_gains`` those that changed in flight.
    """

    source: str
    how: str | None = None
    min_us: Number | None = None
    trim_us: Number | None = None
    max_us: Number | None = None
    reversed: bool | None = None
    measured: bool | None = None
    yaw_loop: str | None = None
    yaw_gains: list[GainSeen] | None = None
    rate_hz: Positive | None = None
    first_rate_hz: Positive | None = None


class Orders(Part, frozen=True):
    """The orders of the ARMAX model; nb and nk are those of every input."""

    na: Count
    nb: Count
    nc: Count
    nk: Count

    def __str__(self) -> str:
        """Return them as ``--orders`` takes them."""
        return f"{self.na},{self.nb},{self.nc},{self.nk}"


LOWEST, HIGHEST, POINTS = 0.6, 1.6, 21
"""Where the model of an answer holds, as parts of wn, and how many points of its response there its
covariance is made of. Below it a model of eq. 23 does not have the zeros of an aircraft: |G| was 6
times too high at .3 wn."""


class Response(Part, frozen=True, kw_only=True):
    """The transfer function of a manoeuvre's answer, from each input to the yaw rate.

    G(s) = sum of r / (s - p), and of the conjugate where p is complex. ``poles`` are [real,
    imaginary] in rad/s, one of each pair, the Dutch roll first, then the real ones; ``residues``
    has as many by the name of the input, in rad/s^2 per unit of it. ``covariance`` is that of wn
    and zeta of each pair, of each real pole, then of the residues of each input: both parts of a
    pair's, and a real one's.
    """

    poles: list[list[Number]]
    residues: dict[str, list[list[Number]]]
    covariance: list[list[Number]]


class OneStructure(Part, frozen=True, kw_only=True):
    """What one structure of the continuous-time fit found, and its weight in the answer."""

    wn_rad_s: Positive
    wn_std: Number
    zeta: Number
    zeta_std: Number
    weight: Number


class MethodSummary(Part, frozen=True, kw_only=True):
    """The results of one method, of the stream or of a manoeuvre.

    The recursive methods have orders and theta, whose sigmas (of noise) are by parameter names. The
    continuous-time fit (``ct``) has the ``response`` of its answer, its ``structure``, and what
    each of the ``structures`` found; ``roll_left_out`` says why roll was no output of it.
    ``yaw_acceleration`` is what a step of the rudder makes at once, K T wn^2 in rad/s^2 per unit.
    """

    method: str
    orders: Orders | None = None
    sample_time_s: Positive
    forgetting_factor: Number | None = None
    updates: Count | None = None
    held: Count | None = None
    theta: dict[str, Number] | None = None
    theta_std: dict[str, Number] | None = None
    modes: list[Mode] | None = None
    dutch_roll: DutchRoll | None = None
    physics: dict[str, Value] | None = None
    yaw_acceleration: Value | None = None
    response: Response | None = None
    structure: str | None = None
    structures: dict[str, OneStructure] | None = None
    roll_left_out: str | None = None
    fit: Fit


class Bare(Part, frozen=True, kw_only=True):
    """The bare airframe, of one manoeuvre (``lateral``) or of a flight (``bare``).

    ``derivatives`` are dimensional, by the names of ``NAMES``, and ``alpha_rad`` is the angle of
    attack of the body's axes. That of a flight has the ``correlations`` of derivatives, angle and
    servo lag, in this order, and the names of those that what is known beforehand determines
    (``from_prior``). Where a gate stops it there are only ``used``, the manoeuvres looked at, and
    the verdict, which says why.
    """

    NAMES: ClassVar = (
        "Y_beta", "L_beta", "L_p", "L_r", "L_delta_a", "L_delta_r",
        "N_beta", "N_p", "N_r", "N_delta_a", "N_delta_r", "Y_delta_r",
    )  # fmt: skip

    dutch_roll: DutchRoll | None = None
    roll_mode: TimeConstant | None = None
    spiral: TimeConstant | None = None
    derivatives: dict[str, Value] | None = None
    alpha_rad: Value | None = None
    servo_lag_s: Value | None = None
    rudder_mix: Value | None = None
    correlations: list[list[Number]] | None = None
    from_prior: list[str] | None = None
    gust_std_rad: Number | None = None
    whiteness_rho1: Number | None = None
    airspeed_m_s: Number | None = None
    used: list[Count]
    verdict: Verdict

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
    duration_s: Number
    date: str | None = None
    mode: str | None = None
    loop: str
    yaw_loop: str | None = None
    airspeed_m_s: Number | None = None
    airspeed_std_m_s: Number | None = None
    airspeed_source: str | None = None
    airspeed_kind: str | None = None
    altitude_m: Number | None = None


class Manoeuvre(Conditions, frozen=True, kw_only=True):
    """One manoeuvre: the conditions in which it was flown, and its answer."""

    inputs: list[str]
    turn_removed: bool
    estimates: dict[str, MethodSummary]
    verdict: Verdict
    lateral: Bare | None = None

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

    wn_rad_s: Number | None = None
    zeta: Number | None = None


TAU_WN_SHARE, TAU_ZETA = 0.015, 0.02
"""The floors of that scatter, relative for wn, for zeta absolute: few manoeuvres do not show it."""


class Flight(Part, frozen=True, kw_only=True):
    """The answer from a flight's manoeuvres of one ``loop``; ``used`` and ``disagree`` name them.

    The Dutch roll is that at ``airspeed_m_s``, the median of those used; its sigmas are those of a
    next manoeuvre. ``kappa_rad_m`` is wn / V and ``K_per_V`` is K / V, with V the equivalent
    airspeed. ``physics`` holds K, T_theta_s and the four derivatives of eq. 22 at that airspeed.
    Without a usable manoeuvre there is only the verdict, with the best one's reasons.
    """

    method: str | None = None
    airspeed_m_s: Number | None = None
    airspeed_source: str | None = None
    airspeed_kind: str | None = None
    altitude_m: Number | None = None
    date: str | None = None
    loop: str | None = None
    yaw_loop: str | None = None
    dutch_roll: DutchRoll | None = None
    kappa_rad_m: Value | None = None
    K_per_V: Value | None = None
    physics: dict[str, Value] | None = None
    between_std: BetweenStd | None = None
    used: list[Count]
    disagree: list[Count]
    verdict: Verdict

    def __bool__(self) -> bool:
        """Return whether it is usable."""
        return self.verdict.usable


class Source(Part, frozen=True):
    """The log that the samples of a replayed MCAP are from."""

    log: str | None = None
    sha256: str | None = None
    bytes_read: Count | None = None


class Origin(Part, frozen=True, kw_only=True):
    """The origin of an answer: the log, the vehicle, the link and the channels.

    A log that was not read to its end has ``bytes_read`` instead of a hash.
    """

    log: str
    sha256: str | None = None
    bytes_read: Count | None = None
    source: Source | None = None
    duration_s: Number
    vehicle: VehicleSeen | None = None
    vehicles: list[VehicleSeen] | None = None
    boots: list[BootSpan] | None = None
    link: LinkCounts
    channels: dict[str, ChannelFound]

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

    estimates: dict[str, MethodSummary] | None = None
    verdict: Verdict | None = None
    warnings: list[Reason] | None = None
    manoeuvres: list[Manoeuvre] | None = None
    flight: Flight | None = None
    flights: list[Flight] | None = None
    bare: Bare | None = None
    ordinary: OrdinaryAnswer | None = None
    live: LiveFacts | None = None
    files: dict[str, str] | None = None

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
