"""Checkpoints: the weights of a system and, in the same file, the configuration that rebuilds it.

Responses that were measured are stored as well, not only the name and hash of their file: a few megabytes buy that a
checkpoint runs wherever it is copied to, by itself.
"""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cattrs
import cattrs.v
import torch
from cattrs.errors import BaseValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.measured import MeasuredResponses
from avssl_pyro.acoustics.steering_kinds import MeasuredKind
from avssl_pyro.atomic_file import write_atomically
from avssl_pyro.errors import InputError
from avssl_pyro.systems.system import System, SystemConfig, build_system

FORMAT = "avssl-checkpoint/1"
# Where measured responses stand among the tensors.
AZIMUTHS, FREQUENCIES, RESPONSES = "array.azimuths", "array.frequencies", "array.responses"

_converter = cattrs.Converter(forbid_extra_keys=True)
_converter.register_unstructure_hook(MicrophoneArray, lambda array: array.to_dict())
_converter.register_structure_hook(MicrophoneArray, lambda data, _: MicrophoneArray.from_dict(data))


def config_to_dict(config: SystemConfig) -> dict[str, Any]:
    """The configuration as plain JSON values."""
    data: dict[str, Any] = _converter.unstructure(config)
    return data


def config_from_dict(data: Any, where: str) -> SystemConfig:
    """The inverse of :func:`config_to_dict`.

    Raises:
        InputError: a field is missing, unknown or of the wrong type.
    """
    try:
        return _converter.structure(data, SystemConfig)
    except (BaseValidationError, TypeError, ValueError, AttributeError) as error:
        problems = "; ".join(cattrs.transform_error(error, format_exception=_problem))
        raise InputError(
            f"{where}: its configuration does not fit this version of the program ({problems})."
        ) from error


def _problem(error: BaseException, expected: type | None) -> str:
    return str(error).rstrip(".") if isinstance(error, InputError) else cattrs.v.format_exception(error, expected)


def save_checkpoint(path: Path, system: System) -> None:
    """Writes weights and configuration to ``path`` (.safetensors), and the configuration beside it as JSON to read.

    Raises:
        InputError: the array's measured responses have to be read, and cannot be.
        OSError: the files cannot be written; nothing half-written is left behind.
    """
    config = config_to_dict(system.config)
    state = {name: value.detach().cpu().contiguous() for name, value in system.state_dict().items()}
    state |= _stored_responses(system.config.array)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, save(state, metadata={"format": FORMAT, "config": json.dumps(config)}))
    write_atomically(path.with_suffix(".json"), json.dumps(config, indent=1).encode())


def fingerprint(system: System) -> str:
    """SHA-256 of a system's configuration and weights, in hexadecimal; the same before saving and after loading."""
    digest = hashlib.sha256(json.dumps(config_to_dict(system.config), sort_keys=True).encode())
    # Without metadata, whose order safetensors leaves to chance.
    digest.update(save({name: value.detach().cpu().contiguous() for name, value in system.state_dict().items()}))
    return digest.hexdigest()


def _stored_responses(array: MicrophoneArray) -> dict[str, Tensor]:
    if not isinstance(array.steering, MeasuredKind):
        return {}
    measured = array.steering.measured()
    # Single precision like the model; as pairs, because not every reader of the format has complex numbers.
    response_dmn = torch.from_numpy(measured.response_dmn).to(torch.complex64)
    return {
        AZIMUTHS: torch.from_numpy(measured.azimuths_d),
        FREQUENCIES: torch.from_numpy(measured.frequencies_n),
        RESPONSES: torch.view_as_real(response_dmn).contiguous(),
    }


def _with_responses(config: SystemConfig, state: dict[str, Tensor], path: Path) -> SystemConfig:
    """The configuration with the measured responses that the checkpoint holds, if any."""
    kind = config.array.steering
    if not isinstance(kind, MeasuredKind):
        return config
    try:
        azimuths_d, frequencies_n, pairs = (state[name] for name in (AZIMUTHS, FREQUENCIES, RESPONSES))
        response_dmn = torch.view_as_complex(pairs).numpy()
        measured = MeasuredResponses(azimuths_d.numpy(), frequencies_n.numpy(), response_dmn)
    except (KeyError, RuntimeError, IndexError, InputError) as error:
        raise InputError(
            f"{path}: the measured responses of its array are missing or damaged ({error}); take another copy."
        ) from error
    return replace(config, array=replace(config.array, steering=replace(kind, responses=measured)))


def load_checkpoint(path: Path) -> System:
    """Rebuilds the system of a checkpoint, in evaluation mode.

    Raises:
        InputError: there is no such file, it is no checkpoint, or it does not fit this version of the program.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint; give a .safetensors file written by training.")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
    except (SafetensorError, OSError) as error:
        raise InputError(
            f"{path}: not a readable checkpoint ({error}); give a .safetensors file of training."
        ) from error
    if metadata.get("format") != FORMAT:
        found = metadata.get("format", "no format")
        raise InputError(f"{path}: holds '{found}' where '{FORMAT}' is expected; give a checkpoint of this program.")
    try:
        config = json.loads(metadata.get("config", ""))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: its configuration is missing or damaged ({error}); take another copy.") from error
    system = build_system(_with_responses(config_from_dict(config, str(path)), state, path))
    try:
        system.load_state_dict(state)
    except RuntimeError as error:
        problem = " ".join(str(error).split())
        raise InputError(f"{path}: its weights do not fit its configuration ({problem}).") from error
    system.model.eval()
    system.guide.eval()
    return system
