from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile

from avssl_pyro.cli import prepare
from avssl_pyro.cli.simulate_recordings import main
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.recordings.starss23 import list_starss

SMALL = ["--seconds", "4", "--width", "288", "--frame-rate", "5", "--seed", "7"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("simulated")
    main(["--out", str(out), *SMALL, "--num-recordings", "2"])
    return out


def test_recordings_are_those_of_starss23(folder: Path) -> None:
    first, second = list_starss(folder, "mic", "dev-test")
    assert (first.name, second.name) == ("fold4_room7_mix001", "fold4_room7_mix002")
    info = soundfile.info(str(first.audio))
    assert (info.channels, info.samplerate, info.subtype, info.duration) == (4, 24_000, "PCM_16", 4.0)
    recording = first.open()
    assert recording.video is not None
    assert (recording.video.width, recording.video.height) == (288, 144)
    assert recording.duration_s == pytest.approx(4.0, abs=0.25)
    assert len(list(recording.windows(1.0))) >= 3
    rows = first.read_labels()
    assert rows and max(row.frame for row in rows) < 40
    assert first.labels is not None
    assert {line.count(",") for line in first.labels.read_text().splitlines()} == {5}
    assert rows != second.read_labels()


def test_prepare_reads_them(folder: Path, tmp_path: Path) -> None:
    prepare.main(["--recordings", str(folder), "--split", "dev-test", "--out", str(tmp_path / "clips")])
    dataset = SceneDataset(tmp_path / "clips")
    assert len(dataset) >= 6
    assert dataset[0].audio_mn.shape == (4, 16_000)
    assert any(dataset.labels(index).talker_azimuths for index in range(len(dataset)))


def test_the_same_seed_gives_the_same_sound_and_labels(folder: Path, tmp_path: Path) -> None:
    main(["--out", str(tmp_path), *SMALL, "--yaw", "33", "--mirror"])
    for name in (
        "mic_dev/dev-test-simulated/fold4_room7_mix001.wav",
        "metadata_dev/dev-test-simulated/fold4_room7_mix001.csv",
    ):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_any_array_hears_on_its_own_channels(tmp_path: Path) -> None:
    pair = tmp_path / "pair.yaml"
    pair.write_text("name: pair\npositions_m: [[0, 0.1, 0], [0, -0.1, 0]]\nchannels: [4, 2]\n")
    main(["--out", str(tmp_path), *SMALL, "--array", str(pair), "--split", "dev-train", "--sample-rate", "16000"])
    audio_nm, rate = soundfile.read(tmp_path / "mic_dev" / "dev-train-simulated" / "fold3_room7_mix001.wav")
    assert (audio_nm.shape, rate) == ((64_000, 4), 16_000)
    assert np.flatnonzero(np.abs(audio_nm).max(axis=0) > 0).tolist() == [1, 3]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--seconds", "0.5"], "--seconds is 0.5"),
        (["--num-recordings", "0"], "--num-recordings is 0"),
        (["--width", "1001"], "--width is 1001"),
        (["--frame-rate", "0"], "--frame-rate is 0"),
        (["--sample-rate", "10"], "--sample-rate is 10"),
        (["--seed", "-1"], "--seed is -1"),
        (["--yaw", "nan"], "--yaw is nan"),
        (["--array", "circle7"], "neither a preset"),
        (["--people", "nowhere"], "nowhere: no such folder"),
    ],
)
def test_impossible_wishes_are_refused_before_anything_is_written(
    args: list[str], words: str, tmp_path: Path, refusal: Callable[[Callable[[], int | None]], str]
) -> None:
    assert words in refusal(lambda: main(["--out", str(tmp_path / "out"), *args]))
    assert not (tmp_path / "out").exists()
