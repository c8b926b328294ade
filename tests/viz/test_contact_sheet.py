from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.viz.contact_sheet import TALKER_COLORS, contact_sheet

BLUE = (0, 0, 200)


@dataclass(frozen=True)
class BlueScene:
    labels: SceneLabels
    metadata: dict[str, Any]

    @property
    def clip(self) -> Clip:
        image_ijc = np.broadcast_to(np.array(BLUE, np.uint8), (88, 288, 3))
        return Clip("blue", np.zeros((2, 16000), np.float32), image_ijc)


def columns_of(sheet_ijc: np.ndarray, color: tuple[int, ...]) -> np.ndarray:
    close_ij = (np.abs(sheet_ijc.astype(int) - color).max(axis=-1) <= 60).sum(axis=0)
    return np.flatnonzero(close_ij > 20)


@pytest.mark.parametrize(("azimuth_deg", "share"), [(90.0, 0.25), (-90.0, 0.75), (0.0, 0.5), (170.0, 10 / 360)])
def test_lines_stand_at_the_azimuths_with_left_at_the_left(azimuth_deg: float, share: float) -> None:
    encoded = contact_sheet([BlueScene(SceneLabels((float(np.deg2rad(azimuth_deg)),)), {})], "title")
    decoded_ijc = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)
    assert decoded_ijc is not None
    sheet_ijc = decoded_ijc[..., ::-1]
    image = columns_of(sheet_ijc, BLUE)
    line = columns_of(sheet_ijc, tuple(int(TALKER_COLORS[0][start : start + 2], 16) for start in (1, 3, 5)))
    assert (line.mean() - image[0]) / (image[-1] - image[0]) == pytest.approx(share, abs=0.01)


def test_an_odd_number_of_scenes_with_silence_and_without_facts_is_drawn() -> None:
    people = [{"azimuth_deg": 30.0, "distance_m": 1.0, "speaks": True, "level_db": 0.0}]
    scenes = [BlueScene(SceneLabels((), (0.5,)), {}), BlueScene(SceneLabels((0.5,)), {"people": people})] * 2
    assert cv2.imdecode(np.frombuffer(contact_sheet(scenes[:3], ""), np.uint8), cv2.IMREAD_COLOR) is not None
