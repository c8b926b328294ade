"""Training of a model in one call."""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from avssl_pyro.api.model import Model, load
from avssl_pyro.errors import InputError
from avssl_pyro.training.config import PRESETS, TrainingConfig
from avssl_pyro.training.run import run_training
from avssl_pyro.training.svi import CHECKPOINT_NAME
from avssl_pyro.viz.plots import save_run_curves


def train(
    preset: str = "quick",
    *,
    out: str | Path = TrainingConfig.out,
    data: str | Path | Sequence[str | Path] = (),
    **settings: Any,
) -> Model:
    """Trains a model on clips without labels; stopped at any moment, the same call goes on.

    Args:
        preset: name of the settings to start from: quick, two-cores, paper, museum or adapt.
        out: folder of the run: checkpoint, log, curves.
        data: folders of shards; by default a small set of scenes is rendered.
        settings: any other field of :class:`avssl_pyro.training.config.TrainingConfig`, such as ``array``.

    Returns:
        The trained model.

    Raises:
        InputError: a setting or a file cannot be used, or the folder holds a run with other settings.
        TrainingDivergedError: the loss is no longer finite.

    >>> model = train("adapt", data="clips", array="circle4", out="runs/robot")  # doctest: +SKIP
    """
    if preset not in PRESETS:
        raise InputError(f"train: preset is '{preset}'; give one of {', '.join(PRESETS)}.")
    unknown = sorted(settings.keys() - {field.name for field in fields(TrainingConfig)})
    if unknown:
        names = ", ".join(field.name for field in fields(TrainingConfig))
        raise InputError(f"train: there is no setting '{unknown[0]}'; the settings are {names}.")
    folders = (data,) if isinstance(data, str | Path) else data
    config = replace(PRESETS[preset], out=Path(out), data=tuple(Path(folder) for folder in folders), **settings)
    run_training(config, on_end=save_run_curves)
    return load(config.out / CHECKPOINT_NAME)
