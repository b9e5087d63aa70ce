"""An identified model, as ``yawid export --what model`` writes it to JSON."""

from typing import Annotated

from yawid.answers.part import Number, Part, says


class ModelSignal(Part, frozen=True):
    """An input, an output or a state of a model."""

    name: Annotated[str, says("name of the signal")]
    unit: Annotated[str, says("its unit")]


class ModelParameter(Part, frozen=True):
    """A parameter of a model with its sigma; the covariance has their order."""

    value: Annotated[Number, says("value", "as the quantity it belongs to")]
    std: Annotated[Number, says("its sigma", "as the quantity it belongs to")]
    unit: Annotated[str, says("its unit")]


class ModelTransfer(Part, frozen=True, kw_only=True):
    """A transfer function, highest power first, with the sigmas of its coefficients."""

    input: Annotated[str, says("name of the input")]
    output: Annotated[str, says("name of the output")]
    num: Annotated[
        list[Number],
        says("numerator in s, or in z where there is a sample time; highest power first"),
    ]
    num_std: Annotated[list[Number], says("sigmas of its coefficients")]
    den: Annotated[list[Number], says("denominator, highest power first")]
    den_std: Annotated[list[Number], says("sigmas of its coefficients")]


class ModelForm(Part, frozen=True, kw_only=True):
    """A model in continuous time, or, where it has a sample time, with held inputs."""

    sample_time_s: Annotated[
        Number | None, says("time from sample to sample; absent in continuous time", "s")
    ] = None
    parameters: Annotated[
        dict[str, ModelParameter],
        says(
            "the numbers that all else is made of, by name",
            propertyNames={"pattern": r"^[A-Za-z_0-9]+$"},
        ),
    ]
    covariance: Annotated[list[list[Number]], says("of the parameters, in their order")]
    A: Annotated[list[list[Number]], says("state matrix, rows")]
    B: Annotated[list[list[Number]], says("input matrix, rows")]
    C: Annotated[list[list[Number]], says("output matrix, rows")]
    D: Annotated[list[list[Number]], says("matrix from inputs to outputs, rows")]
    A_std: Annotated[list[list[Number]], says("sigmas of its elements, 0 of those that are known")]
    B_std: Annotated[list[list[Number]], says("sigmas of its elements, 0 of those that are known")]
    transfer_functions: Annotated[list[ModelTransfer], says("from each input to each output")]


class ModelResponse(Part, frozen=True, kw_only=True):
    """The frequency response from an input to an output.

    A sigma is null where the model does not hold, what is unknown of coherence is, too.
    """

    input: Annotated[str, says("name of the input")]
    output: Annotated[str, says("name of the output")]
    w_rad_s: Annotated[list[Number], says("angular frequencies")]
    re: Annotated[list[Number], says("real part of the response")]
    im: Annotated[list[Number], says("imaginary part of the response")]
    magnitude_std: Annotated[
        list[Number | None], says("sigma of its magnitude; null where the model does not hold")
    ]
    phase_std_rad: Annotated[list[Number | None], says("sigma of its phase")]
    coherence: Annotated[
        list[Number | None] | None,
        says(
            "squared coherence of the output as measured in a manoeuvre and as "
            "the model has it; null where unknown"
        ),
    ] = None


class ModelFile(Part, frozen=True, kw_only=True):
    """An identified model: of a manoeuvre, of the flight, or of the bare airframe."""

    log: Annotated[str, says("the log or the run that it is of")]
    of: Annotated[str, says("manoeuvre N, flight, or bare airframe")]
    usable: Annotated[bool, says("whether the answer that it is of may be used")]
    reasons: Annotated[list[str], says("reasons of that answer's verdict, with their texts")]
    sigma_is: Annotated[str, says("what sigmas contain: total")]
    input_is: Annotated[
        str,
        says(
            "how the record has the rudder: its mean over each sample, or held from one to the next"
        ),
    ]
    airspeed_m_s: Annotated[
        Number | None, says("airspeed of the model: equivalent, of the bare airframe true", "m/s")
    ] = None
    servo_lag_s: Annotated[
        Number | None, says("lag of the servos, which the bare airframe's model does not hold", "s")
    ] = None
    from_prior: Annotated[
        list[str],
        says("names of the numbers that what is known beforehand determines more than the record"),
    ]
    inputs: Annotated[list[ModelSignal], says("inputs, about their trim")]
    outputs: Annotated[list[ModelSignal], says("outputs")]
    states: Annotated[
        list[ModelSignal],
        says("states; of the yaw channel the first is the yaw rate, the others carry its past"),
    ]
    continuous: Annotated[ModelForm, says("in continuous time")]
    discrete: Annotated[ModelForm, says("with inputs held from sample to sample")]
    frequency_response: Annotated[
        list[ModelResponse], says("of the continuous model, from each input to each output")
    ]
