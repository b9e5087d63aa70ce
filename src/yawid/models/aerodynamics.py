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
from collections.abc import Mapping
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element, indent, tostring

import numpy as np

from yawid.errors import ConfigError
from yawid.models.linear import LinearModel
from yawid.quantities.units import HALF_TRAVEL

NAMES: Final = {"beta": "b", "p": "p", "r": "r", "delta_a": "da", "delta_r": "dr"}
AXES: Final = {"CY": "SIDE", "Cl": "ROLL", "Cn": "YAW"}
_FACTORS: Final = {
    "b": ("aero/beta-rad",),
    "p": ("aero/bi2vel", "velocities/p-aero-rad_sec"),
    "r": ("aero/bi2vel", "velocities/r-aero-rad_sec"),
    "da": ("fcs/left-aileron-pos-rad",),
    "dr": ("fcs/rudder-pos-rad",),
}
"""What each coefficient is multiplied by: JSBSim's properties."""
DIMENSIONS: Final = (
    "mass", "ixx", "izz", "ixz", "area", "span", "rudder_max_deg", "aileron_max_deg", "density",
)  # fmt: skip
"""What a flight does not show: mass in kg, inertias in kg m^2, m^2, m, deg, kg/m^3. The travels are
the deflections of half the travel, the density that of the air flown in."""


def checked(given: Mapping[str, float | None]) -> dict[str, float]:
    """Return the aircraft's DIMENSIONS.

    Raises:
        ConfigError: some are missing, or are not above 0 (``ixz``: finite), or are impossible.
    """
    known = {name: value for name in DIMENSIONS if (value := given.get(name)) is not None}
    if missing := [name for name in DIMENSIONS if name not in known]:
        given_as = ",".join(f"{name.replace('_', '-')}=..." for name in missing)
        raise ConfigError(f"coefficients need the aircraft's dimensions: --aircraft {given_as}")
    for name, value in known.items():
        if not math.isfinite(value) or (name != "ixz" and value <= 0.0):
            raise ConfigError(f"the aircraft's {name} must be above 0, got {value!r}")
    if known["ixz"] ** 2 >= known["ixx"] * known["izz"]:
        raise ConfigError("the aircraft's ixz is too large for its ixx and izz")
    return known


class Coefficient(NamedTuple):
    """A coefficient, its sigma, and whether what is known beforehand determines it."""

    value: float
    std: float
    from_prior: bool


def coefficients(model: LinearModel, given: Mapping[str, float | None]) -> dict[str, Coefficient]:
    """Return the coefficients by name (CYb, Clp, Cndr, ...), rates over 2V/b, surfaces in rad.

    ``given`` has DIMENSIONS.

    Raises:
        ConfigError: a dimension is missing or impossible, or the model is not the bare airframe's.
    """
    if "airspeed_m_s" not in model.facts or "alpha_rad" not in model.names:
        raise ConfigError(f"coefficients are those of the bare airframe, not of the {model.of}")
    of, V = checked(given), model.facts["airspeed_m_s"]
    q_area = 0.5 * of["density"] * V**2 * of["area"]
    in_rad = {each.name: each.unit for each in model.inputs}["rudder"] != HALF_TRAVEL
    travel_rad = 1.0 if in_rad else math.radians(of["rudder_max_deg"])
    per = {"beta": 1.0} | dict.fromkeys("pr", 2.0 * V / of["span"])
    per |= {"delta_a": 1.0 / math.radians(of["aileron_max_deg"]), "delta_r": -1.0 / travel_rad}
    found = {}
    for x, short in NAMES.items():
        moment = per[x] / (q_area * of["span"])
        for axis, parts in {
            "CY": {"Y": of["mass"] * V / q_area * per[x]},
            "Cl": {"L": of["ixx"] * moment, "N": -of["ixz"] * moment},
            "Cn": {"N": of["izz"] * moment, "L": -of["ixz"] * moment},
        }.items():
            own = {f"{letter}_{x}": factor for letter, factor in parts.items()}
            weights = np.array([own.get(name, 0.0) for name in model.names])
            if weights.any():
                std = math.sqrt(max(float(weights @ model.covariance @ weights), 0.0))
                main = model.names[int(np.abs(weights).argmax())]
                value = float(weights @ model.values)
                found[f"{axis}{short}"] = Coefficient(value, std, main in model.from_prior)
    return found


def aerodynamics(model: LinearModel, given: Mapping[str, float | None]) -> str:
    """Return JSBSim's ``<aerodynamics>`` with the axes SIDE, ROLL and YAW.

    Raises:
        ConfigError: as :func:`coefficients`.
    """
    found, rows = coefficients(model, given), []
    for name, each in found.items():
        prior = "; what is known beforehand determines it, not the flight" * each.from_prior
        length = () if name.startswith("CY") else ("metrics/bw-ft",)
        factors = "aero/qbar-psf", "metrics/Sw-sqft", *length, *_FACTORS[name[2:]]
        value = _element("value", text=f"{each.value:.8g}")
        said = f"{name}, sigma {each.std:.3g}{prior}"
        rows.append((name[:2], _product(f"coefficient/{name}", said, *factors, value)))
    said = "CYb holds the side force of thrust, which JSBSim adds by itself"
    thrust = _product("yawid/thrust", said, "forces/fbx-prop-lbs", "aero/beta-rad")
    forces = [f"aero/coefficient/{name}" for name in found if name.startswith("CY")]
    drag = _element("product", "forces/fwx-aero-lbs", "aero/beta-rad")
    side = _element("difference", _element("sum", *forces, "aero/yawid/thrust"), drag)
    rows.append(("CY", thrust))
    for of, along, per_in in (("Cl", "z", -1.0 / 12.0), ("Cn", "x", 1.0 / 12.0)):
        said = "The moments are about the centre of gravity, the side force is not"
        arm = _element("difference", f"metrics/aero-rp-{along}-in", f"inertia/cg-{along}-in")
        value = _element("value", text=f"{per_in:.9f}")
        rows.append((of, _product(f"yawid/{AXES[of].lower()}-arm", said, arm, side, value)))
    root = _element("aerodynamics")
    for of, axis in AXES.items():
        root.append(_element("axis", *(each for letters, each in rows if letters == of), name=axis))
    indent(root, " ")
    head = _head(model, checked(given))
    return f'<?xml version="1.0"?>\n<!-- {head}\n-->\n{tostring(root, "unicode")}\n'


def _head(model: LinearModel, of: Mapping[str, float]) -> str:
    """Return the text of the file's comment."""
    V, lag = model.facts["airspeed_m_s"], model.facts.get("servo_lag_s")
    known = "" if lag is None else f": {lag:.3f} s"
    said = [
        f"The lateral motion as yawid identified it: bare airframe, small motions about trim, at "
        f"{V:.2f} m/s true airspeed and {of['density']:.4f} kg/m^3, for S = {of['area']:g} m^2, "
        f"b = {of['span']:g} m, m = {of['mass']:g} kg, Ixx = {of['ixx']:g}, Izz = {of['izz']:g} "
        f"and Ixz = {of['ixz']:g} kg m^2. Positive rudder turns the nose left, as JSBSim's does. "
        "They replace these axes of an aircraft's file; lift, drag and pitch are not here. The lag "
        f"of the servos is not in it{known}.",
        *(f"Warning {reason}" for reason in model.reasons),
    ]
    text = re.sub("-(?=-)", "- ", "\n".join(said))  # a comment may not contain --
    return "\n     ".join(row for each in text.split("\n") for row in textwrap.wrap(each, 92))


def _element(
    tag: str, *inside: Element | str, text: str | None = None, **attributes: str
) -> Element:
    """Return an element with a text, or with others in it; a string is a property by its name."""
    found = Element(tag, attributes)
    found.text = text
    found.extend(_element("property", text=x) if isinstance(x, str) else x for x in inside)
    return found


def _product(name: str, said: str, *factors: Element | str) -> Element:
    """Return the function ``name`` that is the product of some factors."""
    product, description = _element("product", *factors), _element("description", text=said)
    return _element("function", description, product, name=f"aero/{name}")
