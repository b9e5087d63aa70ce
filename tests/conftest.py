"""The tests run compiled, as all runs of an installation but its first."""

import pytest

from yawid.estimation.machine.runner import RUNNER, is_plain


def pytest_configure(config: pytest.Config) -> None:
    """Compile before the workers start: each would interpret for seconds, then compile as well."""
    if not (hasattr(config, "workerinput") or is_plain() or RUNNER.is_compiled()):
        RUNNER.compile()
