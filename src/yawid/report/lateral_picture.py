"""The picture of a manoeuvre's lateral motion: p, r and roll as measured, and by the bare airframe.

The model runs free: eq. 21 from the commands of rudder and aileron after the servos' lag. Where it
starts and how it is trimmed is not known, and is fitted by least squares. The lateral acceleration,
which the estimate does not use, is a check: V (Y_beta beta + Y_delta_r dr) + x r' - z p' + c, with
the place (x, z) of the sensor and its offset c fitted.
"""

import math
from datetime import datetime
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from yawid.answers.run_summary import Bare, Manoeuvre, Value
from yawid.blocks import Floats, Ints, StampedRows
from yawid.lateral import model
from yawid.lateral.record import lagged_lines
from yawid.report.picture import Picture
from yawid.report.time_pictures import TIME_LABEL
from yawid.sinks.mcap.reader import McapRun
from yawid.sinks.palette import AILERON, BARE, DATA, RUDDER

SHOWN: Final = ("p", "r", "roll")
_AT: Final = (2, 4, 0)  # their columns in an attitude
_PITCH: Final = 1
_AWAY_S: Final = 5.0
_LEAST_ROWS: Final = 20
STEP_S: Final = 0.005
"""The step in s of the simulation, within which the commands are lines."""


def lateral_picture(run: McapRun) -> Picture | None:
    """Return the picture of the first manoeuvre whose airframe is known, None without one.

    Raises:
        SourceError: the file is damaged.
    """
    known = (m for m in run.summary.manoeuvres or () if m.lateral and m.lateral.dutch_roll)
    found = next(known, None)
    if found is None or found.lateral is None or (motion := run.motion()) is None:
        return None
    attitude, commands = _own(motion.attitude, found), _own(motion.commands, found, lead_s=1.0)
    if min(len(attitude), len(commands)) < _LEAST_ROWS:
        return None
    t, measured = attitude.t_us / 1e6, attitude.values[:, _AT]
    states, surfaces = free_states(found.lateral, attitude, commands)
    ay = _own(motion.acceleration, found)
    felt = acceleration(found.lateral, attitude.t_us, states, surfaces, ay)
    panels = [
        (each, "rad" if each == "roll" else "rad/s", t, measured[:, i], states[:, i + 1])
        for i, each in enumerate(SHOWN)
    ]
    if felt is not None:
        panels.append(("ay", "m/s²", ay.t_us / 1e6, ay.values[:, 0], felt))

    def draw(figure: Figure) -> None:
        axes = figure.subplots(len(panels) + 1, 1, height_ratios=(0.9, *[1.4] * len(panels)))
        for i, (name, colour) in enumerate((("rudder", RUDDER), ("aileron", AILERON))):
            axes[0].plot(commands.t_us / 1e6, commands.values[:, i], color=colour, label=name)
        axes[0].set_ylabel("commands")
        said = ("measured", "bare airframe")
        for ax, (name, unit, at, own, modelled) in zip(axes[1:], panels, strict=True):
            ax.plot(at, own, color=DATA, linewidth=2.4, label=said[0])
            ax.plot(at, modelled, color=BARE, linewidth=1.1, label=said[1])
            ax.set_ylabel(f"{name}\n[{unit}]")
            said = ("", "")
        for ax in axes:
            ax.set_xlim(t[0], t[-1])
            ax.tick_params(labelbottom=ax is axes[-1])
        axes[-1].set_xlabel(TIME_LABEL)
        figure.align_ylabels(axes)
        figure.legend(loc="outside upper right", ncols=4)

    look = (
        "The bare airframe runs free from the commands of both surfaces; start and trim are "
        "fitted. It knows no gusts, and in roll every small error adds up: there the two part."
    )
    if felt is not None:
        share = float(1.0 - np.var(ay.values[:, 0] - felt) / np.var(ay.values[:, 0]))
        look += (
            " The lateral acceleration was not used: the airframe explains "
            f"{100.0 * max(share, 0.0):.0f} % of its variance."
        )
    title = f"Manoeuvre {found.n}: the lateral motion as measured, and of the bare airframe"
    return Picture("lateral", title, look, draw, (5.6, 5.4), zooms=True)


def _own(rows: StampedRows, found: Manoeuvre, lead_s: float = 0.0) -> StampedRows:
    """Return the rows of a manoeuvre: another boot may have the same seconds."""
    t = rows.t_us / 1e6
    chosen = (t >= found.from_s - lead_s) & (t <= found.to_s) & np.isfinite(rows.values).all(axis=1)
    if found.date is not None:
        begin_s = datetime.fromisoformat(found.date).timestamp()
        away_s = rows.unix_ns / 1e9 - begin_s - (t - found.from_s)
        chosen &= np.abs(away_s) < _AWAY_S
    return rows.select(chosen)


def free_states(bare: Bare, attitude: StampedRows, commands: StampedRows) -> tuple[Floats, Floats]:
    """Return sideslip, p, r, roll (n, 4) and rudder, aileron (n, 2) at the attitudes' times."""
    from scipy.signal import lsim  # it takes long to load, and few runs need it

    A, B = _airframe(bare, float(attitude.values[:, _PITCH].mean()))
    lag_s = 0.0 if bare.servo_lag_s is None else bare.servo_lag_s.value or 0.0
    t, times = ((rows.t_us - attitude.t_us[0]) / 1e6 for rows in (attitude, commands))
    before, after = np.arange(min(times[0], 0.0), 0.0, STEP_S), np.arange(0.0, t[-1], STEP_S)
    at = np.concatenate([before, after, after[-1:] + STEP_S])
    lines = np.stack([np.interp(at, times, x) for x in commands.values[:, :2].T])
    u, at = lagged_lines(lines, lag_s, STEP_S)[:, len(before) :], at[len(before) :]
    # The states run with the inputs, from each unit start, and with each unit trim.
    forced, start = np.zeros((9, 4, 3)), np.zeros((9, 4))
    forced[0, :, :2], forced[5:, :, 2], start[1:5] = B, np.eye(4), np.eye(4)
    whole = np.kron(np.eye(9), A), forced.reshape(36, 3), np.eye(36), np.zeros((36, 3))
    _, _, x = lsim(whole, np.stack([*u, np.ones(len(at))], axis=1), at, start.ravel())
    runs = np.stack([np.interp(t, at, each) for each in x.T], axis=1).reshape(len(t), 9, 4)
    measured = attitude.values[:, _AT]
    weights = 1.0 / np.maximum(measured.std(axis=0), 1e-6)
    rest = ((measured - runs[:, 0, 1:]) * weights).ravel()
    parts = (runs[:, 1:, 1:] * weights).swapaxes(1, 2).reshape(-1, 8)
    found, *_ = np.linalg.lstsq(parts, rest, rcond=None)
    surfaces = np.stack([np.interp(t, at, each) for each in u], axis=1)
    return runs[:, 0] + np.einsum("nks,k->ns", runs[:, 1:], found), surfaces


def acceleration(
    bare: Bare, t_us: Ints, states: Floats, surfaces: Floats, ay: StampedRows
) -> Floats | None:
    """Return the airframe's lateral acceleration in m/s^2 at the rows of ``ay`` (m,), if any.

    ``states`` (n, 4) and ``surfaces`` (n, 2) are :func:`free_states` at the times ``t_us`` (n,).
    """
    if len(ay) < _LEAST_ROWS or not np.ptp(ay.values[:, 0]):
        return None
    of = {name: each.value or 0.0 for name, each in (bare.derivatives or {}).items()}
    force = of.get("Y_beta", 0.0) * states[:, 0] + of.get("Y_delta_r", 0.0) * surfaces[:, 0]
    p, r = (np.gradient(states[:, i], t_us / 1e6) for i in (1, 2))
    columns = [(bare.airspeed_m_s or 0.0) * force, r, -p]
    own, *place = (np.interp(ay.t_us, t_us, column) for column in columns)
    placed = np.column_stack([*place, np.ones(len(ay))])
    left, *_ = np.linalg.lstsq(placed, ay.values[:, 0] - own, rcond=None)
    return np.asarray(own + placed @ left, np.float64)


def _airframe(bare: Bare, pitch: float) -> tuple[Floats, Floats]:
    """Return A (4, 4) of sideslip, p, r, roll, and B (4, 2) of rudder and aileron (eq. 21)."""
    known = (bare.derivatives or {}) | {"alpha_rad": bare.alpha_rad or Value(pitch)}
    theta = model.theta_of([*known], np.array([[each.value or 0.0 for each in known.values()]]))
    found = model.system(theta, bare.airspeed_m_s or math.inf, pitch)
    return found.A[0, :4, :4], found.B[0, :4][:, [model.RUDDER, model.AILERON]]
