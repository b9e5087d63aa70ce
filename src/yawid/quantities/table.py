"""THE table of quantities: the name, the unit and the words of every number of a run.

MCAP, Parquet, tables in Python, records, JSON Schema and the pages take them from here. A sigma
needs no row: ``X_std`` is the total sigma of X, ``X_std_noise`` the part of it that noise explains
(:func:`quantity`). A field that is no number with a unit has a row if several outputs have it.
"""

from typing import Final, Literal, NamedTuple

from yawid.quantities.units import HALF_TRAVEL

RUDDER: Final = "{rudder}"
"""The place in a unit for the unit of the rudder, which is half-travel or rad in a run."""
BY_GROUND: Final = "ground"
"""The ``airspeed_kind`` in a record where its airspeed is the ground speed."""


class Quantity(NamedTuple):
    """One row of the table.

    ``unit`` is an SI unit, ``1`` for a ratio, empty without a unit. For a channel, ``kind`` says
    what it is between two messages: ``held`` (the value of the first), ``linear`` (interpolated),
    or ``mean`` (the mean over a sample); it is empty for what is not measured or not used. ``kept``
    says whether a run's samples have the channel. ``symbol`` is the usual symbol; after = comes
    that of the paper.
    """

    name: str
    unit: str
    words: str
    kind: Literal["held", "linear", "mean", ""] = ""
    kept: bool = False
    symbol: str = ""

    def unit_for(self, rudder: str = "unit of rudder") -> str:
        """Return the unit in words: empty for a ratio, with the rudder's unit filled in."""
        return "" if self.unit == "1" else self.unit.replace(RUDDER, rudder).replace("^2", "²")


_CHANNELS: Final = (
    Quantity("t", "s", "time since boot, or since 1970: then the date is known", "", True),
    Quantity(
        "rudder", HALF_TRAVEL,
        "deflection, positive nose right, from now on; a measured one (deg, rad): now",
        "mean", True,
    ),
    Quantity("r", "rad/s", "yaw rate now, positive nose right", "linear", True),
    Quantity("roll", "rad", "bank, right wing down positive", "linear", True),
    Quantity("aileron", HALF_TRAVEL, "deflection, positive rolls right", "mean", True),
    Quantity(
        "airspeed", "m/s", "equivalent airspeed; by its unit another: ktas, kcas, m/s tas",
        "held", True,
    ),
    Quantity("yaw", "rad", "heading; a run has it unwrapped", "linear", True),
    Quantity("altitude", "m", "above the sea", "held", True),
    Quantity("on_ground", "1", "1 on the ground, 0 in the air", "held", True),
    Quantity("mode", "", "flight mode: its name, or HEARTBEAT.custom_mode", "held", True),
    Quantity(
        "held", "", "why the row is not used: names of Held with spaces between; or empty", "", True
    ),
    Quantity(
        "turn_rate", "rad/s",
        "turn rate that bank and airspeed imply; computed from them where missing", "linear", True,
    ),
    Quantity(
        "ground_speed", "m/s",
        "compared with the airspeed; used instead where there is none (airspeed_kind: ground)",
        "held", True,
    ),
    Quantity(
        "airspeed_kind", "",
        "which airspeed the source gives; this column holds the equivalent airspeed computed from "
        "it, or the number itself if it is indicated or calibrated",
        "held", True,
    ),
    Quantity(
        "rudder_moves", "1", "1 where the rudder moved within a run's sample, 0 where at its ends",
        "held", True,
    ),
    Quantity("time", "UTC", "date and time, ISO 8601", "", True),
    Quantity("pitch", "rad", "nose up positive", "linear"),
    Quantity("q", "rad/s", "pitch rate", "linear"),
    Quantity("air_density", "kg/m^3", "of the air flown in: for a true airspeed", "held"),
    Quantity("p", "rad/s", "roll rate; of the bare airframe"),
    Quantity("ay", "m/s^2", "lateral acceleration; drawn next to the bare airframe's"),
)  # fmt: skip
CHANNELS: Final = {row.name: row for row in _CHANNELS}
"""The channels by the names of a record's columns. A file that yawid exported with all kept
channels, on the run's grid, gives the same samples when it is replayed."""
TEXTS: Final = frozenset({"mode", "held", "time", "airspeed_kind"})
"""The columns of a record that may hold texts; ``t`` may hold dates too."""


def of_kind(kind: str) -> tuple[str, ...]:
    """Return the channels of a kind that a run's samples have, in the table's order."""
    return tuple(row.name for row in _CHANNELS if row.kept and row.kind == kind)


YAW_CHANNEL: Final = {
    row.name: row
    for row in (
        Quantity("K", f"rad/s per {RUDDER}", "static gain", symbol="K"),
        Quantity("T_theta_s", "s", "numerator time constant", symbol="T_θ"),
        Quantity("omega_beta", "rad/s", "natural frequency", symbol="ωn = ω_β"),
        Quantity("xi_beta", "1", "damping ratio", symbol="ζ = ξ_β"),
        Quantity("a_z_beta", "1/s", "side force by sideslip", symbol="−Y_β/V = a_z^β"),
        Quantity("a_my_omega_y", "1/s", "yaw damping", symbol="−N_r = a_my^ωy"),
        Quantity("a_my_beta", "1/s^2", "weathercock stability", symbol="N_β = a_my^β"),
        Quantity(
            "a_my_delta_h", f"1/s^2 per {RUDDER}", "rudder effectiveness", symbol="N_δr = a_my^δH"
        ),
        Quantity("servo_tau_s", "s", "lag of the servo", symbol="τ"),
    )
}
"""The numbers of eq. 22-23 and the servo's lag, in the order of all blocks. They are unknown where
the equations do not hold, or where no real pole is the servo's.

The paper's beta is psi - theta_Gamma, positive with the nose right of the path: the negative of the
usual sideslip, which is positive with wind from the right. With that usual sideslip, r the yaw rate
and d the rudder (positive nose right), r' = N_beta beta + N_r r + N_dr d and beta' = Y_beta/V beta
- r: the paper's numbers are N_beta and N_dr, and the negatives of N_r and Y_beta/V.
"""
REDUCTION_ERROR: Final = "reduction_error"
"""A further number of the summary: the misfit of eq. 23 to a model with more poles."""
_OTHERS: Final = (
    # Of an answer.
    Quantity("wn_rad_s", "rad/s", "natural frequency", symbol="ωn"),
    Quantity("zeta", "1", "damping ratio", symbol="ζ"),
    Quantity("level", "1", "of MIL-F-8785C, 1 to 3, 4 is worse; only of the bare airframe"),
    Quantity("kappa_rad_m", "rad/m", "wn over the equivalent airspeed", symbol="ωn/V"),
    Quantity(
        "K_per_V", f"rad/m per {RUDDER}", "K of eq. 23 over the equivalent airspeed", symbol="K/V"
    ),
    Quantity(
        "effect_per_V2", f"rad/m^2 per {RUDDER}",
        "the rudder's effect on the Dutch roll (its residue) over V^2", symbol="b/V²",
    ),
    Quantity(
        "yaw_acceleration", f"rad/s^2 per {RUDDER}", "what a step of the rudder makes at once, "
        "K T ωn^2",
    ),
    Quantity(
        "overshoot_pct", "%", "after a step of the rudder, how far the yaw rate's swing (its Dutch "
        "roll) goes on past its end, of the swing before: 100 exp(-pi zeta / root(1 - zeta^2))",
        symbol="Δh/k",
    ),
    Quantity(
        "settling_s", "s", "from a step of the rudder until the yaw rate's swing (its Dutch roll) "
        "stays within 5 % of the largest distance from its end",
    ),
    Quantity(REDUCTION_ERROR, "1", "misfit of eq. 23, 0.3 to 3 ωn"),
    # Of the model and its fit.
    Quantity(
        "method", "", "ct (continuous-time fit), els (extended least squares) or rml (recursive "
        "maximum likelihood)",
    ),
    Quantity("structure", "", "the poles of a continuous-time fit: 2, 2L or 3"),
    Quantity("na", "", "order of A"),
    Quantity("nb", "", "order of the B of every input"),
    Quantity("nc", "", "order of C"),
    Quantity("nk", "", "delay of every input in samples, 1 is a plant without dead time"),
    Quantity("sample_time_s", "s", "of the grid"),
    Quantity("forgetting_factor", "1", "per sample, at the end; 1 forgets nothing"),
    Quantity("updates", "", "samples that moved theta"),
    Quantity("theta", "", "the model's parameters; the unit of rudder is half its travel, or rad"),
    Quantity("theta_std", "", "their sigmas, of noise alone"),
    Quantity("one_step_pct", "%", "fit one step ahead, always high: judge by the fit simulated"),
    Quantity("simulation_pct", "%", "fit of the final model, run free from the inputs"),
    Quantity("innovation_std", "rad/s", "standard deviation of the a priori innovation"),
    Quantity("residual_std", "rad/s", "standard deviation of the a posteriori residual"),
    Quantity(
        "whiteness_p", "1", "probability of residuals as coloured as these, were they white "
        "(Ljung-Box)",
    ),
    Quantity(
        "spr_margin", "1", "of 1/C - 1/2 being positive real: below 0 ELS need not converge"
    ),
    # Of each sample.
    Quantity("boot_time", "s", "since boot, by the vehicle's clock"),
    Quantity("received_time", "s", "Unix time of reception"),
    Quantity("y_hat", "rad/s", "the output as predicted one step ahead"),
    Quantity("innovation", "rad/s", "a priori"),
    Quantity("residual", "rad/s", "a posteriori"),
    Quantity("noise_std", "rad/s", "of the innovation"),
    Quantity("pole_re", "rad/s", "real part of a pole, continuous time"),
    Quantity("pole_im", "rad/s", "imaginary part of a pole, continuous time"),
    # Of a manoeuvre, and of the flight.
    Quantity("sysid", "", "MAVLink system id"),
    Quantity("compid", "", "MAVLink component id"),
    Quantity("boot", "", "number of the vehicle's boot in the log, from 1"),
    Quantity("n", "", "number in the flight, from 1"),
    Quantity("from_s", "s", "first second, since boot"),
    Quantity("to_s", "s", "last second, since boot"),
    Quantity("duration_s", "s", "length of the manoeuvre"),
    Quantity("date", "", "UTC time of the first sample, ISO 8601"),
    Quantity("loop", "", "whose number it is: airframe, with_roll_loop or unknown"),
    Quantity(
        "airspeed_m_s", "m/s", "airspeed, or the ground speed: airspeed_source says which; the "
        "mean, of a flight the median of those used",
    ),
    Quantity("airspeed_std_m_s", "m/s", "its scatter during the manoeuvre"),
    Quantity(
        "airspeed_source", "", "what airspeed_m_s is: airspeed, or ground speed, which gives no "
        "kappa",
    ),
    Quantity("altitude_m", "m", "mean altitude above the sea"),
    Quantity("inputs", "", "of the model"),
    Quantity(
        "turn_removed", "", "whether the turn that bank and airspeed imply was subtracted"
    ),
    Quantity("usable", "", "whether the answer may be used"),
    # Of the link.
    Quantity("frames", "", "intact frames"),
    Quantity("skipped_bytes", "bytes", "outside of frames"),
    Quantity("bad_crc", "", "frames passed over for a wrong CRC"),
    Quantity("unknown", "", "frames of messages that are not known"),
    Quantity("lost", "", "frames missing by sequence number"),
    Quantity("reboots", "", "reboots of the vehicle"),
    Quantity("clock_steps", "", "steps of the vehicle's clock that are not a reboot"),
    Quantity("gaps", "", "breaks in the samples because messages are missing"),
)  # fmt: skip
QUANTITIES: Final = {row.name: row for row in (*_CHANNELS, *YAW_CHANNEL.values(), *_OTHERS)}
_STEMS: Final = {"wn": "wn_rad_s", "kappa": "kappa_rad_m", "settling": "settling_s"}
"""The full names, which end with a unit, by what is before ``_std`` in their sigmas' names."""
OF_NOISE: Final = "sigma, of noise alone"


def quantity(name: str) -> Quantity:
    """Return the row of a name; for ``X_std`` and ``X_std_noise`` it is made from the row of X.

    Raises:
        KeyError: the table has no such name.
    """
    if name in QUANTITIES:
        return QUANTITIES[name]
    std = name.removesuffix("_noise")
    of = std.removesuffix("_std")
    row = QUANTITIES[_STEMS.get(of, of)]
    words = "total sigma: noise, how the structures of the fit differ, floors"
    if std != name:
        words = f"the part of {std} that noise alone explains"
    return Quantity(name, row.unit, row.words if of == name else words)
