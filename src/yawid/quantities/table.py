"""THE table of quantities: what every number of a run is called, its unit and what it says.

MCAP, Parquet, tables in Python, records, JSON Schema and the pages take name, unit and words from
it. A sigma needs no row: ``X_std`` is the total sigma of X, ``X_std_noise`` the part of it that
noise explains (:func:`quantity`). What is no number in a unit stands here where several outputs
have it.
"""

from typing import Final, Literal, NamedTuple

from yawid.quantities.units import HALF_TRAVEL

RUDDER: Final = "{rudder}"
"""In a unit: that of the rudder, which a run has in half travels or in rad."""
BY_GROUND: Final = "ground"
"""A record's ``airspeed_kind`` where its airspeed is the ground speed."""


class Quantity(NamedTuple):
    """One row.

    ``unit`` is SI's, ``1`` of a ratio, empty of what has none. Of a channel: ``kind`` is what it is
    between two messages (``held`` from the first, ``linear``, or the ``mean`` over a sample; empty
    of what is not measured, or not used), and ``kept`` whether a run's samples have it. ``symbol``
    is the usual one, after = the paper's.
    """

    name: str
    unit: str
    words: str
    kind: Literal["held", "linear", "mean", ""] = ""
    kept: bool = False
    symbol: str = ""

    def unit_for(self, rudder: str = "unit of rudder") -> str:
        """Return the unit as people read it: none of a ratio, the rudder's filled in."""
        return "" if self.unit == "1" else self.unit.replace(RUDDER, rudder).replace("^2", "²")


_CHANNELS: Final = (
    Quantity("t", "s", "time since boot, or since 1970: then the date is known", "", True),
    Quantity("rudder", HALF_TRAVEL, "deflection from now on, positive nose right", "mean", True),
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
        "held", "", "why not to learn from the row: names of Held, by spaces; or empty", "", True
    ),
    Quantity(
        "turn_rate", "rad/s", "what bank and airspeed imply; made of them without it",
        "linear", True,
    ),
    Quantity(
        "ground_speed", "m/s",
        "what the airspeed is held against; stands in for none (airspeed_kind: ground)",
        "held", True,
    ),
    Quantity(
        "airspeed_kind", "",
        "which airspeed the source gives; the equivalent one made of it stands here, or the number "
        "itself if it is indicated or calibrated",
        "held", True,
    ),
    Quantity("time", "UTC", "date and time, ISO 8601", "", True),
    Quantity("pitch", "rad", "nose up positive", "linear"),
    Quantity("q", "rad/s", "pitch rate", "linear"),
    Quantity("air_density", "kg/m^3", "of the air flown in: for a true airspeed", "held"),
    Quantity("p", "rad/s", "roll rate; not used"),
    Quantity("ay", "m/s^2", "lateral acceleration; not used"),
)  # fmt: skip
CHANNELS: Final = {row.name: row for row in _CHANNELS}
"""What is measured, by the names that a record's columns have. A file of yawid's that has all that
is kept, on the run's grid, gives the same samples when it is replayed."""
TEXTS: Final = frozenset({"mode", "held", "time", "airspeed_kind"})
"""Columns of a record that may hold texts; ``t`` may hold dates too."""


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
"""Eq. 22-23's numbers and the servo's lag, in the order in which they travel; unknown where those
do not hold, or no real pole is the servo's.

The paper's beta is psi - theta_Gamma, nose right of the path positive: the opposite of sideslip as
usually counted, wind from the right. With that sideslip, r the yaw rate and d the rudder, nose
right, r' = N_beta beta + N_r r + N_dr d, beta' = Y_beta/V beta - r: N_beta and N_dr are the paper's
numbers, N_r and Y_beta/V their negatives.
"""
REDUCTION_ERROR: Final = "reduction_error"
"""A further number of the summary: how badly eq. 23 fits a model of more poles."""
_OTHERS: Final = (
    # Of an answer.
    Quantity("wn_rad_s", "rad/s", "natural frequency", symbol="ωn"),
    Quantity("zeta", "1", "damping ratio", symbol="ζ"),
    Quantity("level", "1", "of MIL-F-8785C, 1 to 3, 4 is worse; only of the bare airframe"),
    Quantity("kappa_rad_m", "rad/m", "wn over the equivalent airspeed", symbol="ωn/V"),
    Quantity(
        "K_per_V", f"rad/m per {RUDDER}", "K of eq. 23 over the equivalent airspeed", symbol="K/V"
    ),
    Quantity(REDUCTION_ERROR, "1", "misfit of eq. 23, 0.3 to 3 ωn"),
    # Of the model and its fit.
    Quantity("method", "", "els (extended least squares) or rml (recursive maximum likelihood)"),
    Quantity("na", "", "order of A"),
    Quantity("nb", "", "order of the B of every input"),
    Quantity("nc", "", "order of C"),
    Quantity("nk", "", "delay of every input in samples, 1 is a plant without dead time"),
    Quantity("sample_time_s", "s", "of the grid"),
    Quantity("forgetting_factor", "1", "per sample, at the end; 1 forgets nothing"),
    Quantity("updates", "", "samples that moved theta"),
    Quantity("theta", "", "the model's parameters; the unit of rudder is half its travel, or rad"),
    Quantity("theta_std", "", "their sigmas, of noise alone"),
    Quantity("one_step_pct", "%", "fit one step ahead, which flatters every model"),
    Quantity("simulation_pct", "%", "fit of the final model, run free from the inputs"),
    Quantity(
        "simulation_held_back_pct", "%", "fit run free over samples that the model has not seen"
    ),
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
    Quantity("clock_steps", "", "steps of the vehicle's clock that are no reboot"),
    Quantity("gaps", "", "breaks in the samples because messages are missing"),
)  # fmt: skip
QUANTITIES: Final = {row.name: row for row in (*_CHANNELS, *YAW_CHANNEL.values(), *_OTHERS)}
_STEMS: Final = {"wn": "wn_rad_s", "kappa": "kappa_rad_m"}
"""What stands before _std of a name that ends with its unit."""
OF_NOISE: Final = "sigma, of noise alone"


def quantity(name: str) -> Quantity:
    """Return the row of a name; of ``X_std`` and ``X_std_noise`` one made of X's.

    Raises:
        KeyError: the table has no such name.
    """
    if name in QUANTITIES:
        return QUANTITIES[name]
    std = name.removesuffix("_noise")
    of = std.removesuffix("_std")
    row = QUANTITIES[_STEMS.get(of, of)]
    words = "total sigma: noise, scatter over the record, other structures"
    if std != name:
        words = f"the part of {std} that noise alone explains"
    return Quantity(name, row.unit, row.words if of == name else words)
