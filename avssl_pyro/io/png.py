"""Images to disk, whole or not at all."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.atomic_file import write_atomically


def write_png(path: Path, encoded: bytes) -> None:
    """Writes an encoded picture; the folder is made if it is not there.

    Raises:
        OSError: the file cannot be written; nothing is left behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, encoded)


def save_png(path: Path, image_ijc: npt.NDArray[np.uint8]) -> None:
    """Writes an RGB image, (I, J, 3); otherwise as :func:`write_png`."""
    _, encoded = cv2.imencode(".png", cv2.cvtColor(image_ijc, cv2.COLOR_RGB2BGR))
    write_png(path, encoded.tobytes())
