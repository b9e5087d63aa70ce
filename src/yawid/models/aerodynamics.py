"""The bare airframe's coefficients without dimensions, and JSBSim's ``<aerodynamics>`` of them.

The derivatives of the bare airframe are primed: moments over inertias, with Ixz folded in. With
q = rho V^2 / 2 and J = [[Ixx, -Ixz], [-Ixz, Izz]] of the body's axes (Ixz = the integral of x z)::

    [C_l, C_n]_x = J [L_x, N_x] / (q S b),   C_Yx = Y_x m V / (q S),

times 2 V / b for the rates p and r, per rad of the surfaces. JSBSim's rudder is positive with its
trailing edge left, which turns the nose left; so is that of these coefficients.

What was identified is all of the motion, about the centre of gravity. JSBSim adds the moments of
the side force, which acts at the aerodynamic reference point, and the side force of thrust in
sideslip. Both are subtracted in the file, so that their sum with it is what was identified.
"""

import math
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Final, NamedTuple
from xml.sax.saxutils import escape

import numpy as np

from yawid.errors import ConfigError
from yawid.models.linear import LinearModel
from yawid.quantities.units import HALF_TRAVEL

NAMES: Final = {"beta": "b", "p": "p", "r": "r", "delta_a": "da", "delta_r": "dr"}
AXES: Final = {"SIDE": "CY", "ROLL": "Cl", "YAW": "Cn"}
_FACTORS: Final = {
    "b": ("aero/beta-rad",),
    "p": ("aero/bi2vel", "velocities/p-aero-rad_sec"),
    "r": ("aero/bi2vel", "velocities/r-aero-rad_sec"),
    "da": ("fcs/left-aileron-pos-rad",),
    "dr": ("fcs/rudder-pos-rad",),
}
"""What each coefficient is multiplied by: JSBSim's properties."""
_THRUST: Final = """\
  <function name="aero/yawid/thrust">
   <description>CYb holds the side force of thrust, which JSBSim adds by itself</description>
   <product>
    <property>forces/fbx-prop-lbs</property>
    <property>aero/beta-rad</property>
   </product>
  </function>"""
_ARM: Final = """\
  <function name="aero/yawid/{name}-arm">
   <description>The moments are about the centre of gravity, the side force is not</description>
   <product>
    <difference>
     <property>metrics/aero-rp-{along}-in</property>
     <property>inertia/cg-{along}-in</property>
    </difference>
    <difference>
     <sum>
{forces}
     </sum>
     <product>
      <property>forces/fwx-aero-lbs</property>
      <property>aero/beta-rad</property>
     </product>
    </difference>
    <value>{per_in}</value>
   </product>
  </function>"""
_ALONG: Final = {"ROLL": ("z", -1.0), "YAW": ("x", 1.0)}
"""The axis along which the arm of the side force lies, and the sign that takes its moment away."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimensions:
    """What a flight does not show: mass in kg, inertias in kg m^2, m^2, m, deg, kg/m^3.

    The travels are the deflections of half the travel, the density that of the air flown in.
    """

    mass: float | None = None
    ixx: float | None = None
    izz: float | None = None
    ixz: float | None = None
    area: float | None = None
    span: float | None = None
    rudder_max_deg: float | None = None
    aileron_max_deg: float | None = None
    density: float | None = None

    def check(self) -> None:
        """Check that all are given and possible.

        Raises:
            ConfigError: some are missing, or are not above 0 (``ixz``: finite).
        """
        known = {each.name: getattr(self, each.name) for each in fields(self)}
        if missing := [name for name, value in known.items() if value is None]:
            raise ConfigError(
                "coefficients need the aircraft's dimensions: give "
                + " ".join(f"--{name.replace('_', '-')}" for name in missing)
            )
        for name, value in known.items():
            if not math.isfinite(value) or (name != "ixz" and value <= 0.0):
                raise ConfigError(f"--{name.replace('_', '-')} must be above 0, got {value!r}")
        if self.ixz**2 >= self.ixx * self.izz:  # type: ignore[operator]  # none is None
            raise ConfigError("--ixz is too large for --ixx and --izz")


class Coefficient(NamedTuple):
    """A coefficient, its sigma, and whether what is known beforehand determines it."""

    value: float
    std: float
    from_prior: bool


def coefficients(model: LinearModel, of: Dimensions) -> dict[str, Coefficient]:
    """Return the coefficients by name (CYb, Clp, Cndr, ...), rates over 2V/b, surfaces in rad.

    Raises:
        ConfigError: a dimension is missing or impossible, or the model is not the bare airframe's.
    """
    if "airspeed_m_s" not in model.facts or "alpha_rad" not in model.continuous.names:
        raise ConfigError(f"coefficients are those of the bare airframe, not of the {model.of}")
    of.check()
    form, V = model.continuous, model.facts["airspeed_m_s"]
    rows = _map(of, V, {each.name: each.unit for each in model.inputs})
    found = {}
    for name, parts in rows.items():
        weights = np.array([parts.get(each, 0.0) for each in form.names])
        if not weights.any():
            continue
        std = math.sqrt(max(float(weights @ form.covariance @ weights), 0.0))
        main = max(parts, key=lambda each: abs(parts[each]) if each in form.names else -1.0)
        found[name] = Coefficient(float(weights @ form.values), std, main in model.from_prior)
    return found


def _map(of: Dimensions, V: float, units: Mapping[str, str]) -> dict[str, dict[str, float]]:
    """Return for each coefficient the factors of the derivatives that it is made of."""
    mass, ixx, izz, ixz = (float(x or 0.0) for x in (of.mass, of.ixx, of.izz, of.ixz))
    area, span = float(of.area or 0.0), float(of.span or 0.0)
    force = 0.5 * float(of.density or 0.0) * V**2 * area
    travel = {
        "delta_a": math.radians(of.aileron_max_deg or 0.0),
        "delta_r": -math.radians(of.rudder_max_deg or 0.0),
    }
    if units["rudder"] != HALF_TRAVEL:
        travel["delta_r"] = -1.0
    rows: dict[str, dict[str, float]] = {}
    for x, short in NAMES.items():
        per = 2.0 * V / span if x in ("p", "r") else 1.0 / travel.get(x, 1.0)
        rows[f"CY{short}"] = {f"Y_{x}": mass * V / force * per}
        moment = per / (force * span)
        rows[f"Cl{short}"] = {f"L_{x}": ixx * moment, f"N_{x}": -ixz * moment}
        rows[f"Cn{short}"] = {f"N_{x}": izz * moment, f"L_{x}": -ixz * moment}
    return rows


def aerodynamics(model: LinearModel, of: Dimensions) -> str:
    """Return JSBSim's ``<aerodynamics>`` with the axes SIDE, ROLL and YAW.

    Raises:
        ConfigError: as :func:`coefficients`.
    """
    return "\n".join(_lines(coefficients(model, of), model, of)) + "\n"


def _lines(found: Mapping[str, Coefficient], model: LinearModel, of: Dimensions) -> Iterator[str]:
    V, lag = model.facts["airspeed_m_s"], model.facts.get("servo_lag_s")
    yield '<?xml version="1.0"?>'
    yield "<!-- The lateral motion as yawid identified it: bare airframe, small motions about trim,"
    yield f"     at {V:.2f} m/s true airspeed and {of.density:.4f} kg/m^3, for S = {of.area:g} m^2,"
    yield f"     b = {of.span:g} m, m = {of.mass:g} kg, Ixx = {of.ixx:g}, Izz = {of.izz:g} and"
    yield f"     Ixz = {of.ixz:g} kg m^2. Positive rudder turns the nose left, as JSBSim's does."
    yield "     They replace these axes of an aircraft's file; lift, drag and pitch are not here."
    known = "" if lag is None else f": {lag:.3f} s"
    yield f"     The lag of the servos is not in it{known}."
    for reason in model.reasons:
        said = re.sub("-(?=-)", "- ", f"Warning {reason}")  # a comment may not contain --
        yield textwrap.fill(said, 92, initial_indent="     ", subsequent_indent="     ")
    yield "-->"
    yield "<aerodynamics>"
    for axis, letter in AXES.items():
        yield f' <axis name="{axis}">'
        for name, each in found.items():
            if name.startswith(letter):
                yield from _function(name, each)
        if axis == "SIDE":
            yield _THRUST
        else:
            along, sign = _ALONG[axis]
            forces = [f"aero/coefficient/{n}" for n in found if n[:2] == "CY"]
            lines = "\n".join(
                f"      <property>{n}</property>" for n in [*forces, "aero/yawid/thrust"]
            )
            yield _ARM.format(
                name=axis.lower(), along=along, forces=lines, per_in=f"{sign / 12:.9f}"
            )
        yield " </axis>"
    yield "</aerodynamics>"


def _function(name: str, each: Coefficient) -> Iterator[str]:
    prior = "; what is known beforehand determines it, not the flight" if each.from_prior else ""
    length = () if name.startswith("CY") else ("metrics/bw-ft",)
    yield f'  <function name="aero/coefficient/{name}">'
    yield f"   <description>{escape(f'{name}, sigma {each.std:.3g}{prior}')}</description>"
    yield "   <product>"
    for factor in ("aero/qbar-psf", "metrics/Sw-sqft", *length, *_FACTORS[name[2:]]):
        yield f"    <property>{factor}</property>"
    yield f"    <value>{each.value:.8g}</value>"
    yield "   </product>"
    yield "  </function>"
