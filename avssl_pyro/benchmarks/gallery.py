"""Pictures in the manner of the paper's Fig. 5, of scenes chosen by a rule."""

import cv2
import numpy as np
import numpy.typing as npt

from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.errors import InputError
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.viz.overlay import draw_overlay

COLUMN_WIDTH, GAP = 800, 8
LEAST_DISTANCE_M = 1.0


def draw_gallery(localizer: Localizer, dataset: SceneDataset, each: int) -> npt.NDArray[np.uint8]:
    """Picture of ``each`` scenes with two talkers on the left, and as many with three on the right, RGB.

    Raises:
        InputError: there are not enough scenes.
    """
    return np.concatenate([_column(localizer, dataset, talkers, each) for talkers in (2, 3)], axis=1)


def _column(localizer: Localizer, dataset: SceneDataset, talkers: int, each: int) -> npt.NDArray[np.uint8]:
    chosen = choose_scenes(dataset, talkers, each)
    if len(chosen) < each:
        raise InputError(
            f"gallery: only {len(chosen)} scenes have {talkers} talkers, a silent person and nobody close; give more "
            "scenes."
        )
    pictures = []
    for index in chosen:
        picture_ijc = draw_scene(localizer, dataset, index)
        height = round(picture_ijc.shape[0] * COLUMN_WIDTH / picture_ijc.shape[1])
        small_ijc = cv2.resize(picture_ijc, (COLUMN_WIDTH, height), interpolation=cv2.INTER_AREA)
        pictures.append(cv2.copyMakeBorder(small_ijc, 0, GAP, 0, GAP, cv2.BORDER_CONSTANT, value=(255, 255, 255)))
    return np.concatenate(pictures).astype(np.uint8)


def choose_scenes(dataset: SceneDataset, talkers: int, most: int) -> list[int]:
    """Indices of the first scenes with ``talkers`` talkers, a silent person, and nobody closer than a metre."""
    chosen: list[int] = []
    for index in range(len(dataset)):
        labels, people = dataset.labels(index), dataset.metadata(index).get("people", ())
        apart = all(person["distance_m"] >= LEAST_DISTANCE_M for person in people)
        if len(labels.talker_azimuths) == talkers and labels.silent_azimuths and apart:
            chosen.append(index)
        if len(chosen) == most:
            break
    return chosen


def draw_scene(localizer: Localizer, dataset: SceneDataset, index: int) -> npt.NDArray[np.uint8]:
    """Overlay of the posterior of a labelled scene, with its true azimuths, RGB."""
    clip = dataset[index]
    (found,) = localizer.localize([clip])
    truth = np.array(dataset.labels(index).talker_azimuths)
    return draw_overlay(clip.image_ijc, found.posterior, found.sources, localizer.config.grid, truth=truth)
