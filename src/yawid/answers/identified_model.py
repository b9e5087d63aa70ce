"""An identified model, as ``yawid export --what model`` writes it to JSON."""

from yawid.answers.part import Number, Part


class ModelSignal(Part, frozen=True):
    """An input, an output or a state of a model."""

    name: str
    unit: str


class ModelParameter(Part, frozen=True):
    """A parameter of a model with its sigma; the covariance has their order."""

    value: Number
    std: Number
    unit: str


class ModelTransfer(Part, frozen=True, kw_only=True):
    """A transfer function, highest power first, with the sigmas of its coefficients."""

    input: str
    output: str
    num: list[Number]
    num_std: list[Number]
    den: list[Number]
    den_std: list[Number]


class ModelForm(Part, frozen=True, kw_only=True):
    """A model in continuous time, or, where it has a sample time, with held inputs."""

    sample_time_s: Number | None = None
    parameters: dict[str, ModelParameter]
    covariance: list[list[Number]]
    A: list[list[Number]]
    B: list[list[Number]]
    C: list[list[Number]]
    D: list[list[Number]]
    A_std: list[list[Number]]
    B_std: list[list[Number]]
    transfer_functions: list[ModelTransfer]


class ModelResponse(Part, frozen=True, kw_only=True):
    """The frequency response from an input to an output.

    A sigma is null where the model does not hold, what is unknown of coherence is, too.
    """

    input: str
    output: str
    w_rad_s: list[Number]
    re: list[Number]
    im: list[Number]
    magnitude_std: list[Number | None]
    phase_std_rad: list[Number | None]
    coherence: list[Number | None] | None = None


class ModelFile(Part, frozen=True, kw_only=True):
    """An identified model: of a manoeuvre, of the flight, or of the bare airframe."""

    log: str
    of: str
    usable: bool
    reasons: list[str]
    sigma_is: str
    input_is: str
    airspeed_m_s: Number | None = None
    servo_lag_s: Number | None = None
    from_prior: list[str]
    inputs: list[ModelSignal]
    outputs: list[ModelSignal]
    states: list[ModelSignal]
    continuous: ModelForm
    discrete: ModelForm
    frequency_response: list[ModelResponse]
