"""Fixtures of the FMU tests; their functions are in fmu_support.py.

Functions in a conftest could not be imported: tests/lab has a conftest, too.
"""

import pytest
from fmu_support import ESTIMATOR, MODELS, VEHICLE, Unit, load_unit


@pytest.fixture(scope="session")
def estimator() -> Unit:
    return load_unit(ESTIMATOR)


@pytest.fixture(scope="session")
def vehicle() -> Unit:
    return load_unit(VEHICLE)


@pytest.fixture(scope="session", params=MODELS)
def model(request: pytest.FixtureRequest) -> Unit:
    """Each of the two."""
    return load_unit(request.param)
