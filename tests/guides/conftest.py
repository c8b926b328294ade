from collections.abc import Iterator

import pyro
import pytest


@pytest.fixture(autouse=True)
def _fresh_parameter_store() -> Iterator[None]:
    """Pyro's parameter store is global: nothing of one test may reach the next."""
    pyro.clear_param_store()
    yield
    pyro.clear_param_store()
