"""How many examples Hypothesis draws: 25 of each test in the gate, 500 in the long list."""

from hypothesis import HealthCheck, Phase, settings

GATE, LONG = 25, 500
for _name, _count in {"gate": GATE, "long": LONG}.items():
    # Examples are the same on each run. A busy machine fails none: tools/bench.py measures times.
    settings.register_profile(
        _name,
        max_examples=_count,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    )
# As in the gate, but a counterexample is not reduced: tools/mutate.py needs no small one.
settings.register_profile(
    "first", settings.get_profile("gate"), phases=(Phase.explicit, Phase.generate)
)


def examples(count: int) -> settings:
    """Return the settings of a test whose example takes long: ``count`` of them in the gate."""
    return settings(max_examples=count * settings.default.max_examples // GATE)
