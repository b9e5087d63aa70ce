"""The layout of a run in Rerun: the panels, their order, and the drawings that never change."""

from typing import Final
from uuid import UUID

import numpy as np
from numpy.typing import NDArray

import rerun as rr
import rerun.blueprint as rrb
from yawid.blocks import Floats
from yawid.physics.modes import damping_lines
from yawid.sinks.palette import NEUTRAL, OF_METHODS, Rgba, rgba

TIMELINE: Final = "boot_time"
SHARED_TIME_AXIS: Final = UUID("5c0dca6a-e63f-9cf7-f657-2602590474cc")
_ANGLE: Final = np.linspace(0.0, 2.0 * np.pi, 181)


def blueprint() -> rrb.Blueprint:
    """Return the panels: inputs and outputs, the estimates, and the verdict with its evidence."""
    flight = rrb.Vertical(
        _lines("Rudder (green), aileron (brown)", "/input"),
        _lines("Yaw rate [rad/s]: measured (blue) over predicted (orange)", "/yaw_rate"),
        _lines("Innovation [rad/s], measured less predicted; 2 sigma of noise", "/innovation"),
        rrb.StateTimelineView(
            name="Held stretches, status, flight mode, manoeuvres",
            origin="/state",
            time_view=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        ),
        _whole_run(),
        row_shares=[3, 4, 3, 3, 1],
    )
    learnt = rrb.Vertical(
        _lines(f"wn [rad/s]: {OF_METHODS}; turquoise: bare; 2 sigma", "/dutch_roll/wn"),
        _lines(
            "zeta, likewise; bars: manoeuvres, red: not usable; grey: levels 1, 2 (MIL-F-8785C)",
            "/dutch_roll/zeta",
        ),
        _lines("Parameters a; 2 sigma of noise", "/parameters/a", legend=True),
        _lines(
            "Parameters b [rad/s per unit of input], bias [rad/s]", "/parameters/b", legend=True
        ),
        _lines("Parameters c, of the noise", "/parameters/c", legend=True),
        row_shares=[4, 4, 3, 3, 3],
    )
    return rrb.Blueprint(
        rrb.Horizontal(flight, learnt, _worth(), column_shares=[5, 5, 4]),
        # "following" shows the newest time: the end of a finished run, the present of a live one.
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _worth() -> rrb.Vertical:
    return rrb.Vertical(
        rrb.Tabs(
            rrb.TextDocumentView(name="Verdict", origin="/verdict"),
            rrb.TextDocumentView(name="Manoeuvres", origin="/manoeuvres"),
            rrb.TextLogView(name="Log", origin="/log"),
        ),
        rrb.Spatial2DView(
            name="Poles (x) and zeros (o), turquoise: bare airframe; imaginary axis up",
            origin="/z_plane",
            visual_bounds=rrb.VisualBounds2D(x_range=[-1.35, 1.35], y_range=[-1.15, 1.15]),
        ),
        row_shares=[5, 4],
    )


def _whole_run() -> rrb.TimeSeriesView:
    """Return a hidden view that sets the time range of all linked views: the whole run.

    By default the viewer shows half a minute on either side of the cursor. It keeps the shared
    range under an id of its own, for which its Python API has no name (version 0.41).
    """
    infinite = rr.TimeRangeBoundary.infinite()
    shared = rrb.TimeAxis(view_range=rr.TimeRange(start=infinite, end=infinite))
    view = rrb.TimeSeriesView(name="time axis", origin="/none", visible=False, axis_x=shared)
    view.id = SHARED_TIME_AXIS
    return view


def _lines(name: str, origin: str, *, legend: bool = False) -> rrb.TimeSeriesView:
    """Return a view of lines; ``legend`` is for lines that the name of the view does not explain.

    A legend lies on the lines.
    """
    linked = rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)
    corner = rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend)
    return rrb.TimeSeriesView(name=name, origin=origin, axis_x=linked, plot_legend=corner)


def log_furniture(recording: rr.RecordingStream) -> None:
    """Log the static drawings: unit circle, axes and lines of equal zeta."""
    circle = points(np.exp(1j * _ANGLE))
    cross = [points(np.array([-1.3, 1.3])), points(np.array([-1.1j, 1.1j]))]
    dampings = [points(half) for z in damping_lines() for half in (z, np.conj(z))]
    # Less important lines are paler; grey is visible on the viewer's dark and light background.
    _log_strips(recording, "z_plane/unit_circle", [circle], rgba(NEUTRAL), 1.5)
    _log_strips(recording, "z_plane/axes", cross, rgba(NEUTRAL, 160), 0.7)
    _log_strips(recording, "z_plane/zeta", dampings, rgba(NEUTRAL, 100), 0.6)


def points(z: NDArray[np.complex128] | Floats) -> Floats:
    """Return points (n, 2) of z (n,), the imaginary axis up: Rerun's y axis points down."""
    return np.column_stack([np.real(z), -np.imag(z)])


def _log_strips(
    recording: rr.RecordingStream, entity: str, strips: list[Floats], colour: Rgba, width: float
) -> None:
    lines = rr.LineStrips2D(strips, colors=colour, radii=rr.Radius.ui_points(width / 2.0))
    recording.log(entity, lines, static=True)
