"""Fixtures of the tests of the FMUs; what they share else is in fmu_support.py, because there is another conftest."""

import pytest
from fmu_support import ESTIMATOR, MODELS, VEHICLE, Unit, unit


@pytest.fixture(scope="session")
def estimator() -> Unit:
    return unit(ESTIMATOR)


@pytest.fixture(scope="session")
def vehicle() -> Unit:
    return unit(VEHICLE)


@pytest.fixture(scope="session", params=MODELS)
def model(request: pytest.FixtureRequest) -> Unit:
    """Each of the two."""
    return unit(request.param)
