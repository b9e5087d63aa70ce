"""``yawid export --what model``: a model for other tools, as JSON, MATLAB's, JSBSim's."""

import io
import json
import math
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from yawid.answers.identified_model import (
    ModelFile,
    ModelForm,
    ModelParameter,
    ModelResponse,
    ModelTransfer,
)
from yawid.blocks import Array
from yawid.models.aerodynamics import aerodynamics
from yawid.models.identify import model_of
from yawid.models.linear import LinearModel
from yawid.system.part_file import write_whole
from yawid.tables.run import Run

MODEL_FORMATS: Final = (".json", ".mat", ".xml")
FREQUENCIES: Final = 100
"""The number of frequencies of the response."""
TOTAL: Final = "total"
"""Which sigmas a model has."""


def write_model(
    run: Run,
    which: int | str,
    out: Path,
    dimensions: Mapping[str, float | None],
    *,
    force: bool = False,
) -> tuple[Path, LinearModel]:
    """Write a model of a run, by the suffix of ``out``; return the absolute path and the model.

    ``dimensions`` are those of ``DIMENSIONS``, which JSBSim's coefficients need.

    Raises:
        ConfigError: there is no such model, or JSBSim needs a dimension.
        NotIdentifiable: there is no answer of it.
        SinkError: the file exists and ``force`` is not set, or it cannot be written.
    """
    model = model_of(run.facts, which)
    if out.suffix == ".json":
        text = json.dumps(model_file(model, str(run.path.absolute())).to_json())
        data = f"{text}\n".encode()
    elif out.suffix == ".mat":
        data = _matlab(model)
    else:
        given = {**dimensions, "density": dimensions["density"] or run.air_density}
        data = aerodynamics(model, given).encode()
    write_whole({out: data}, force=force)
    return out.absolute(), model


def model_file(model: LinearModel, log: str) -> ModelFile:
    """Return a model as it is written to JSON."""
    signals = {key: list(getattr(model, key)) for key in ("inputs", "outputs", "states")}
    return ModelFile(
        log=log,
        of=model.of,
        usable=model.usable,
        reasons=list(model.reasons),
        sigma_is=TOTAL,
        input_is=model.input_is,
        airspeed_m_s=model.facts.get("airspeed_m_s"),
        servo_lag_s=model.facts.get("servo_lag_s"),
        from_prior=list(model.from_prior),
        **signals,
        continuous=_form(model, discrete=False),
        discrete=_form(model, discrete=True),
        frequency_response=[_response(model, *pair) for pair in _pairs(model)],
    )


def _pairs(model: LinearModel) -> list[tuple[str, str]]:
    return [(i.name, o.name) for i, o in product(model.inputs, model.outputs)]


def _form(model: LinearModel, *, discrete: bool) -> ModelForm:
    space = model.ss(discrete=discrete)
    numbers = zip(model.values.tolist(), model.std.tolist(), model.units, strict=True)
    transfers = []
    for i, o in _pairs(model):
        tf = model.tf(i, o, discrete=discrete)
        lists = {key: getattr(tf, key).tolist() for key in ("num", "num_std", "den", "den_std")}
        transfers.append(ModelTransfer(input=i, output=o, **lists))
    matrices = {key: getattr(space, key).tolist() for key in ["A", "B", "C", "D", "A_std", "B_std"]}
    return ModelForm(
        sample_time_s=space.sample_time_s or None,
        parameters=dict(zip(model.names, (ModelParameter(*n) for n in numbers), strict=True)),
        covariance=model.covariance.tolist(),
        **matrices,
        transfer_functions=transfers,
    )


def frequencies(model: LinearModel) -> Array:
    """Return the frequencies (n,) in rad/s of a model's response.

    They begin where it holds, else at 0.1 rad/s, and end at 0.8 of the Nyquist frequency.
    """
    low, _ = model.holds_rad_s or (0.1, None)
    return np.geomspace(low, 0.8 * np.pi / model.sample_time_s, FREQUENCIES)


def _response(model: LinearModel, i: str, o: str) -> ModelResponse:
    found = model.frequency_response(frequencies(model), i, o)
    magnitude_std, phase_std, coherence = (
        [None if math.isnan(x) else x for x in each.tolist()] for each in found[2:]
    )
    return ModelResponse(
        input=i, output=o, w_rad_s=found.w.tolist(), re=found.G.real.tolist(),
        im=found.G.imag.tolist(), magnitude_std=magnitude_std, phase_std_rad=phase_std,
        coherence=coherence if any(x is not None for x in coherence) else None,
    )  # fmt: skip


def _matlab(model: LinearModel) -> bytes:
    """Return a .mat: A, B, C, D, Ts sampled, Ac to Dc continuous, parameters, the response."""
    from scipy.io import savemat

    sampled, space = model.ss(discrete=True), model.ss()
    kept: dict[str, Any] = dict(zip("ABCD", sampled[:4], strict=True))
    kept |= {"Ts": sampled.sample_time_s, "A_std": sampled.A_std, "B_std": sampled.B_std}
    kept |= dict(zip(("Ac", "Bc", "Cc", "Dc"), space[:4], strict=True))
    kept |= {"Ac_std": space.A_std, "Bc_std": space.B_std}
    for key in ("inputs", "outputs", "states"):
        for what in ("name", "unit"):
            texts = [getattr(each, what) for each in getattr(model, key)]
            kept[f"{key}_{what}"] = np.array(texts, object)
    kept |= {
        "parameters": np.array(model.names, object),
        "parameter_units": np.array(model.units, object),
        "values": model.values, "std": model.std, "covariance": model.covariance,
    }  # fmt: skip
    found = {pair: model.frequency_response(frequencies(model), *pair) for pair in _pairs(model)}
    for (i, o), each in found.items():
        names = ("w", f"G_{o}_{i}", f"magnitude_std_{o}_{i}", f"phase_std_{o}_{i}")
        kept |= dict(zip((*names, f"coherence_{o}_{i}"), each, strict=True))
    kept |= {"of": model.of, "usable": model.usable, "sigma_is": TOTAL}
    kept |= {"input_is": model.input_is, "reasons": np.array(model.reasons, object)}
    stream = io.BytesIO()
    savemat(stream, kept | model.facts, oned_as="column")
    return stream.getvalue()
