"""Finished parts of an experiment on disk, so that a stopped run continues."""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, get_origin

import numpy as np
from cattrs import Converter

from avssl_pyro.atomic_file import remove_temporaries, write_atomically
from avssl_pyro.errors import InputError

ResultT = TypeVar("ResultT")


def _is_array(kind: Any) -> bool:
    return kind is np.ndarray or get_origin(kind) is np.ndarray


def _json_converter() -> Converter:
    """Converts dataclasses and arrays to JSON values and back; NaN is null."""
    converter = Converter(detailed_validation=False)
    converter.register_unstructure_hook(float, lambda value: None if math.isnan(value) else float(value))
    converter.register_structure_hook(float, lambda value, _: math.nan if value is None else float(value))
    converter.register_unstructure_hook_func(_is_array, lambda values: values.tolist())
    converter.register_structure_hook_func(_is_array, lambda values, _: np.array(values, dtype=np.float64))
    return converter


CONVERTER = _json_converter()


@dataclass(frozen=True)
class ResultCache(Generic[ResultT]):
    """A folder with one JSON file for each finished part, named by its settings.

    Args:
        folder: made when the first result is stored.
        kind: type of the results: a dataclass, or a container of numbers.
        format: name and version of the results; a new version stores new files.
    """

    folder: Path
    kind: type[ResultT]
    format: str

    def path(self, name: str, settings: Mapping[str, Any]) -> Path:
        """File of the part ``name``; other settings (weights, scenes, options) lead to another file."""
        facts = json.dumps({"format": self.format, **CONVERTER.unstructure(dict(settings))}, sort_keys=True)
        return self.folder / f"{name}-{hashlib.sha256(facts.encode()).hexdigest()[:16]}.json"

    def get_or_run(self, name: str, settings: Mapping[str, Any], run: Callable[[], ResultT]) -> ResultT:
        """Returns the stored result of these settings, or else runs, stores and returns a new one.

        Raises:
            InputError: the stored file is damaged.
            OSError: the new one cannot be written; nothing is left behind.
        """
        path = self.path(name, settings)
        if not path.exists():
            content = {"format": self.format, "settings": settings, "result": run()}
            text = json.dumps(CONVERTER.unstructure(content), allow_nan=False)
            self.folder.mkdir(parents=True, exist_ok=True)
            remove_temporaries(self.folder)
            write_atomically(path, text.encode())
        # A new result, too, is read from its file: stopped and uninterrupted runs agree to the last digit.
        return self._read(path)

    def _read(self, path: Path) -> ResultT:
        try:
            return CONVERTER.structure(json.loads(path.read_text(encoding="utf-8"))["result"], self.kind)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"{path}: damaged ({type(error).__name__}: {error}); delete it and run the same command again."
            ) from error
