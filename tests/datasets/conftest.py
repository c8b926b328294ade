"""Datasets of a simulator that costs nothing."""

from collections.abc import Callable
from pathlib import Path

import pytest
from fake_simulator import FakeSimulator, fake_plan

from avssl_pyro.datasets.generation import GenerationPlan, generate


@pytest.fixture
def make_scenes(tmp_path: Path) -> Callable[..., GenerationPlan]:
    """Makes a small dataset in a folder of the given name and returns its plan."""

    def make(name: str = "scenes", num_scenes: int = 10, **settings: object) -> GenerationPlan:
        plan = fake_plan(tmp_path / name, num_scenes, FakeSimulator(**settings))  # type: ignore[arg-type]
        generate(plan, workers=1, progress=False)
        return plan

    return make
