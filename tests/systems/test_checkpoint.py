import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.torch import save_file

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.errors import InputError
from avssl_pyro.systems.checkpoint import (
    config_from_dict,
    config_to_dict,
    fingerprint,
    load_checkpoint,
    save_checkpoint,
)
from avssl_pyro.systems.config import GuideConfig, ModelConfig
from avssl_pyro.systems.system import System, SystemConfig, build_system

CONFIG = SystemConfig(
    PRESETS["circle2"],
    model=ModelConfig(num_sources=2, num_directions=8, alpha=0.05, sigma=0.7, diffuse=0.2),
    guide=GuideConfig(visual_channels=(4, 4), audio_channels=4, circular=False),
    stft=StftConfig(window=64, hop=32),
)


def make_system(config: SystemConfig = CONFIG) -> System:
    torch.manual_seed(0)
    return build_system(config)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "mine.safetensors"
    save_checkpoint(path, make_system())
    return path


def rewrite(path: Path, change: Callable[[dict[str, str], dict[str, torch.Tensor]], None]) -> None:
    """Applies a change to a checkpoint's metadata and weights."""
    with safe_open(path, framework="pt") as file:
        metadata, state = dict(file.metadata()), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    change(metadata, state)
    save_file(state, path, metadata=metadata)


def with_config(change: Callable[[dict[str, Any]], None]) -> Callable[[dict[str, str], dict[str, torch.Tensor]], None]:
    def rewritten(metadata: dict[str, str], _: dict[str, torch.Tensor]) -> None:
        config = json.loads(metadata["config"])
        change(config)
        metadata["config"] = json.dumps(config)

    return rewritten


def test_the_fingerprint_is_that_of_weights_and_configuration(path: Path) -> None:
    system = make_system()
    before = fingerprint(system)
    assert fingerprint(load_checkpoint(path)) == before
    assert fingerprint(make_system(replace(CONFIG, model=evolve(CONFIG.model, alpha=0.06)))) != before
    with torch.no_grad():
        system.guide.log_sigma_k[0] += 1e-3
    assert fingerprint(system) != before


@pytest.mark.parametrize("audio_net", [True, False])
@pytest.mark.parametrize("diffuse_class", [True, False])
def test_a_loaded_system_has_the_same_posterior(tmp_path: Path, audio_net: bool, diffuse_class: bool) -> None:
    config = replace(CONFIG, guide=evolve(CONFIG.guide, audio_net=audio_net, diffuse_class=diffuse_class))
    system = make_system(config)
    x_bfmt = torch.randn(2, len(CONFIG.stft.frequencies), 2, 9, dtype=torch.complex64)
    image_bcij = torch.rand(2, 3, 16, 32)
    with torch.no_grad():
        # Batch statistics are part of what was learned.
        system.guide.train().parameters_of(x_bfmt, image_bcij)
        system.guide.log_sigma_k.add_(0.3)
        save_checkpoint(tmp_path / "run" / "mine.safetensors", system)
        torch.manual_seed(5)
        loaded = load_checkpoint(tmp_path / "run" / "mine.safetensors")
        assert loaded.config == config
        assert not loaded.guide.training
        expected = system.guide.eval().parameters_of(x_bfmt, image_bcij)
        for found, right in zip(loaded.guide.parameters_of(x_bfmt, image_bcij), expected, strict=True):
            # A model without a room has no diffuse weights.
            assert (found is None) == (right is None)
            assert found is None or torch.equal(found, right)
        assert expected.mu_bkd is not None
    assert torch.equal(loaded.model.template_dfmm, system.model.template_dfmm)
    assert loaded.model.diffuse == 0.2


def test_configuration_lies_beside_the_weights_to_be_read(path: Path) -> None:
    beside = json.loads(path.with_suffix(".json").read_text())
    assert config_from_dict(beside, "x") == CONFIG
    assert beside["array"]["positions_m"] == [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]
    assert sorted(file.name for file in path.parent.iterdir()) == ["mine.json", "mine.safetensors"]


def test_the_checkpoint_alone_is_enough(path: Path) -> None:
    path.with_suffix(".json").unlink()
    assert load_checkpoint(path).config == CONFIG


def test_weights_hold_no_code(path: Path) -> None:
    """Anything but safetensors, such as a pickle, is refused unread."""
    torch.save({"format": "avssl-checkpoint/1"}, path)
    with pytest.raises(InputError, match=r"mine\.safetensors: not a readable checkpoint"):
        load_checkpoint(path)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.999])
def test_truncated_files_are_named(path: Path, share: float) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"mine\.safetensors: not a readable checkpoint"):
        load_checkpoint(path)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.safetensors: no such checkpoint"):
        load_checkpoint(tmp_path / "none.safetensors")
    with pytest.raises(InputError, match="no such checkpoint"):
        load_checkpoint(tmp_path)


def test_other_safetensors_files_are_told_apart(path: Path) -> None:
    save_file({"weight": torch.zeros(2)}, path)
    with pytest.raises(InputError, match=r"mine\.safetensors: holds 'no format'"):
        load_checkpoint(path)


def test_a_later_format_is_told_apart(path: Path) -> None:
    rewrite(path, lambda metadata, _: metadata.update(format="avssl-checkpoint/9"))
    with pytest.raises(InputError, match=r"mine\.safetensors: holds 'avssl-checkpoint/9'"):
        load_checkpoint(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda metadata, _: metadata.pop("config"),
        lambda metadata, _: metadata.update(config="{"),
        lambda metadata, _: metadata.update(config="[]"),
        lambda metadata, _: metadata.update(config="null"),
        with_config(lambda config: config.pop("array")),
        with_config(lambda config: config.update(surprise=1)),
        with_config(lambda config: config["array"].update(positions_m=[[0, 0, 0]])),
        with_config(lambda config: config["array"].pop("positions_m")),
        with_config(lambda config: config["model"].update(num_sources="many")),
        with_config(lambda config: config["model"].update(num_sources=0)),
        with_config(lambda config: config["model"].update(num_directions=-1)),
        with_config(lambda config: config["model"].update(num_directions=0)),
        with_config(lambda config: config["model"].update(alpha=-1.0)),
        with_config(lambda config: config["model"].update(sigma=0.0)),
        with_config(lambda config: config["model"].update(diffuse=0.0)),
        with_config(lambda config: config["guide"].update(visual_channels=[])),
        with_config(lambda config: config["guide"].update(visual_channels=5)),
        with_config(lambda config: config["guide"].update(audio_channels=0)),
        with_config(lambda config: config["guide"].update(dropout=2.0)),
        with_config(lambda config: config["guide"].update(initial_sigma=0.0)),
        with_config(lambda config: config["guide"].update(initial_beta=-1.0)),
        with_config(lambda config: config["stft"].update(window=0)),
        with_config(lambda config: config["stft"].update(hop=0)),
        with_config(lambda config: config["stft"].update(sample_rate=-1)),
        with_config(lambda config: config["stft"].update(bin_step=0)),
        with_config(lambda config: config["model"].update(num_sources=3)),
        with_config(lambda config: config["guide"].update(audio_channels=8)),
        with_config(lambda config: config["guide"].update(audio_net=False)),
        lambda _, state: state.pop("guide.log_beta"),
        lambda _, state: state.update({"guide.extra": torch.zeros(1)}),
    ],
)
def test_a_damaged_checkpoint_is_refused_in_one_sentence(
    path: Path, change: Callable[[dict[str, str], dict[str, torch.Tensor]], None]
) -> None:
    rewrite(path, change)
    with pytest.raises(InputError, match=r"mine\.safetensors: ") as refused:
        load_checkpoint(path)
    assert "\n" not in str(refused.value)


configs = st.builds(
    SystemConfig,
    st.sampled_from(list(PRESETS.values()))
    | st.builds(
        MicrophoneArray, st.text(max_size=8), st.just(((0.0, 0.1, 0.0), (1 / 3, -0.2, 1e-3))), st.floats(200, 400)
    ),
    st.builds(
        ModelConfig, st.integers(1, 9), st.integers(1, 99), st.floats(1e-6, 9), st.floats(1e-6, 9), st.floats(0.1, 9)
    ),
    st.builds(
        GuideConfig,
        st.booleans(),
        st.lists(st.integers(1, 99), min_size=2, max_size=5).map(tuple),
        st.integers(1, 99),
        st.floats(0, 0.9),
        st.booleans(),
        st.booleans(),
    ),
    st.builds(StftConfig, st.sampled_from([256, 512]), st.integers(1, 256)),
)


@given(configs)
@settings(max_examples=40)
def test_any_configuration_survives_json(config: SystemConfig) -> None:
    assert config_from_dict(json.loads(json.dumps(config_to_dict(config))), "x") == config


def test_a_failed_write_leaves_the_old_checkpoint(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {file.name: file.read_bytes() for file in path.parent.iterdir()}

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space left") as failed:
        save_checkpoint(path, make_system())
    assert failed.value.filename == str(path)
    monkeypatch.undo()
    assert {file.name: file.read_bytes() for file in path.parent.iterdir()} == before
