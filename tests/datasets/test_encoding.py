import json
from typing import Any

import numpy as np
import pytest
from fake_simulator import FakeScene, FakeSimulator
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from avssl_pyro.acoustics.presets import uniform_circle
from avssl_pyro.clip import Clip, SceneLabels
from avssl_pyro.datasets.encoding import decode_audio, decode_image, decode_metadata, encode_scene
from avssl_pyro.errors import InputError

SCENE = FakeSimulator().render(0)


def scene(**changes: Any) -> FakeScene:
    clip = Clip(**({"key": "k", "audio_mn": SCENE.clip.audio_mn, "image_ijc": SCENE.clip.image_ijc} | changes))
    return FakeScene(clip, SCENE.labels, SCENE.metadata)


@given(
    st.integers(1, 20).flatmap(
        lambda channels: hnp.arrays(
            np.float32, (channels, 64), elements=st.floats(-1.5, 1.5, width=32), fill=st.just(0.25)
        )
    )
)
def test_audio_survives_to_half_a_16_bit_step_and_clips_instead_of_wrapping(audio_mn: np.ndarray) -> None:
    files = encode_scene(scene(audio_mn=audio_mn))
    extension = "wav" if len(audio_mn) > 8 else "flac"
    decoded_mn = decode_audio(files[extension], "here")
    assert decoded_mn.shape == audio_mn.shape
    assert decoded_mn.dtype == np.float32
    np.testing.assert_allclose(decoded_mn, np.clip(audio_mn, -1, 32767 / 32768), atol=0.5 / 32768 + 1e-7)


def test_image_keeps_its_colors_in_order() -> None:
    image_ijc = decode_image(encode_scene(SCENE)["jpg"], "here")
    difference_ijc = np.abs(image_ijc.astype(int) - SCENE.clip.image_ijc.astype(int))
    assert difference_ijc.max() <= 8


@given(st.lists(st.floats(-np.pi, np.pi), max_size=4), st.lists(st.floats(-np.pi, np.pi), max_size=4))
def test_labels_are_degrees_in_the_file_and_radians_in_the_program(talkers: list[float], silent: list[float]) -> None:
    labels = SceneLabels(tuple(talkers), tuple(silent))
    content = encode_scene(FakeScene(SCENE.clip, labels, {"rt60_s": 0.3}))["json"]
    assert json.loads(content)["talker_azimuths_deg"] == pytest.approx(np.rad2deg(talkers).tolist(), abs=1e-8)
    decoded, metadata = decode_metadata(content, "here")
    assert decoded.talker_azimuths == pytest.approx(labels.talker_azimuths, abs=1e-10)
    assert decoded.silent_azimuths == pytest.approx(labels.silent_azimuths, abs=1e-10)
    assert metadata == {"rt60_s": 0.3}


def test_arrays_of_sixteen_microphones_are_stored_as_wav() -> None:
    assert list(encode_scene(FakeSimulator(array=uniform_circle(16)).render(0))) == ["wav", "jpg", "json"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"key": "a/b"}, "'a/b'"),
        ({"key": "a.b"}, "'a.b'"),
        ({"audio_mn": np.full((2, 10), np.nan, np.float32)}, "finite"),
        ({"image_ijc": np.zeros((10, 20, 3), np.uint8)}, r"\(10, 20, 3\)"),
    ],
)
def test_what_cannot_be_stored_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        encode_scene(scene(**changes))


@given(st.binary(max_size=200))
def test_garbage_is_named_not_crashed_on(content: bytes) -> None:
    for decode in (decode_audio, decode_image, decode_metadata):
        with pytest.raises(InputError, match="scene 'x'"):
            decode(content, "scene 'x'")
