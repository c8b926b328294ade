"""Whole simulated recordings: where somebody is seen, heard and labelled."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.grid import DirectionGrid, wrap_angle
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.evaluation.peaks import PeakSetting
from avssl_pyro.io.dcase import azimuths_by_frame
from avssl_pyro.simulation.dialogue import dialogue_labels, draw_dialogue, render_dialogue
from avssl_pyro.simulation.motion import (
    MovingPeople,
    MovingPeopleConfig,
    MovingTalkers,
    MovingTalkersConfig,
    draw_moving_people,
)
from avssl_pyro.simulation.moving_source import MotionResolution, RoomAcoustics
from avssl_pyro.simulation.recordings import Camera, PanoramaVideo, RecordingSimulator
from avssl_pyro.simulation.scene_config import SceneConfig
from avssl_pyro.simulation.synthetic.people import ProceduralPerson
from avssl_pyro.simulation.synthetic.rooms import ProceduralRoom
from avssl_pyro.simulation.synthetic.speech import ProceduralSpeech

WALKS = MovingTalkersConfig(seconds=6.0, utterance_s=(1.5, 5.0), pause_s=(0.5, 1.0))
CONFIG = MovingPeopleConfig(walks=WALKS)
SIMULATOR = RecordingSimulator(CONFIG, camera=Camera(576))


def standing(azimuth_deg: float, sounding_t: npt.NDArray[np.bool_], *, silent_deg: float | None = None) -> MovingPeople:
    """Somebody who stands, and perhaps somebody silent."""
    azimuths = np.deg2rad([azimuth_deg] if silent_deg is None else [azimuth_deg, silent_deg])
    count, instants = len(azimuths), len(sounding_t)
    talkers = MovingTalkers(
        np.arange(instants) * 0.1,
        np.tile(azimuths[:, None], instants),
        sounding_t & (np.arange(count) == 0)[:, None],
    )
    same = np.ones(count)
    return MovingPeople(talkers, 1.5 * same, 1.7 * same, 0.0 * same, RoomAcoustics(rt60_s=0.2, array_height_m=1.4))


def recorded(people: MovingPeople, array: MicrophoneArray) -> npt.NDArray[np.float32]:
    return render_dialogue(
        people, draw_dialogue(people, ProceduralSpeech(), np.random.default_rng(0)), array, MotionResolution()
    )


def seen_columns(people: MovingPeople, camera: Camera) -> npt.NDArray[np.float64]:
    """Share of each column's pixels that people change."""
    pictures = [
        PanoramaVideo(who, camera, ProceduralPerson(), ProceduralRoom(), np.random.default_rng(3)).frame_at(0.5)
        for who in (people, replace(people, distances_s=np.zeros(0)))
    ]
    return np.asarray((pictures[0] != pictures[1]).any(axis=2).mean(axis=0), dtype=np.float64)


def centre_deg(share_j: npt.NDArray[np.float64]) -> float:
    angle_j = np.pi - 2 * np.pi * (np.arange(len(share_j)) + 0.5) / len(share_j)
    return float(np.rad2deg(np.angle(np.sum(share_j * np.exp(1j * angle_j)))))


def test_somebody_on_the_left_is_seen_and_heard_on_the_left() -> None:
    people = standing(90.0, np.ones(20, dtype=bool))
    share_j = seen_columns(people, Camera(576))
    assert centre_deg(share_j) == pytest.approx(90.0, abs=5.0)
    assert not share_j[288:].any()
    audio_mn = recorded(people, PRESETS["starss23-mic"])
    power_m = np.square(audio_mn).mean(axis=1)
    assert min(power_m[[0, 2]]) > 1.1 * max(power_m[[1, 3]])  # the left ones are 1 and 3
    left_n, right_n = audio_mn[[0, 2]].sum(axis=0), audio_mn[[1, 3]].sum(axis=0)
    spectrum_f = np.fft.rfft(left_n) * np.conj(np.fft.rfft(right_n))
    correlation_n = np.fft.irfft(spectrum_f / np.maximum(np.abs(spectrum_f), 1e-9))
    lag = int(np.roll(correlation_n, 20)[:41].argmax()) - 20
    assert lag < 0  # the sound on the left is ahead


@pytest.mark.parametrize("name", ["starss23-mic", "circle6"])
@pytest.mark.parametrize("azimuth_deg", [-128.0, 37.0])
def test_sound_comes_from_the_azimuth(name: str, azimuth_deg: float) -> None:
    array = PRESETS[name]
    audio_mn = recorded(standing(azimuth_deg, np.ones(20, dtype=bool)), array)
    _, music, _ = default_baselines(array, DirectionGrid())
    clip = Clip("", audio_mn[:, SAMPLE_RATE // 2 : 3 * SAMPLE_RATE // 2], np.zeros((88, 288, 3), np.uint8))
    (azimuth,) = music.decide(music.observe(clip), PeakSetting(0.5, 1))
    assert abs((np.rad2deg(azimuth) - azimuth_deg + 180) % 360 - 180) < 10.0


def test_ambisonics_weigh_front_and_left() -> None:
    w_power, y_power, _, x_power = np.square(
        recorded(standing(90.0, np.ones(20, dtype=bool)), PRESETS["starss23-foa"])
    ).mean(axis=1)
    assert w_power > y_power > 3 * x_power


@pytest.mark.parametrize(
    ("yaw_deg", "mirror", "seen_deg"), [(40.0, False, 50.0), (0.0, True, -90.0), (40.0, True, -50.0)]
)
def test_the_camera_turns_and_mirrors(yaw_deg: float, mirror: bool, seen_deg: float) -> None:
    people = standing(90.0, np.ones(10, dtype=bool))
    share_j = seen_columns(people, Camera(576, float(np.deg2rad(yaw_deg)), mirror))
    assert centre_deg(share_j) == pytest.approx(seen_deg, abs=5.0)


def test_a_turned_camera_sees_the_same_room_turned() -> None:
    straight, turned, mirrored = (
        replace(SIMULATOR, camera=Camera(576, yaw, mirror)).draw(1).render_video().frame_at(2.0).astype(float)
        for yaw, mirror in ((0.0, False), (np.pi / 2, False), (np.pi / 2, True))
    )
    assert np.abs(np.roll(turned, -144, axis=1) - straight).mean() < 3.0
    np.testing.assert_array_equal(mirrored[:, ::-1], turned)


def test_those_who_sound_are_labelled_where_they_are() -> None:
    turn_t = np.zeros(40, dtype=bool)
    turn_t[8:27] = True
    people = standing(-170.0, turn_t, silent_deg=20.0)
    voices = draw_dialogue(people, ProceduralSpeech(), np.random.default_rng(1))
    rows = dialogue_labels(people, voices)
    assert {row.frame for row in rows} == set(range(8, 27))
    assert {row.source for row in rows} == {0}
    assert rows[0].azimuth_deg == pytest.approx(-170.0)
    assert rows[0].elevation_deg == pytest.approx(np.rad2deg(np.arctan2(0.92 * 1.7 - 1.4, 1.5)))
    assert rows[0].distance_cm == pytest.approx(100 * np.hypot(1.5, 0.92 * 1.7 - 1.4), abs=0.5)
    loud_t = np.square(voices.voice_sn[0]).reshape(40, -1).mean(axis=1) > 0
    assert not loud_t[~turn_t].any()


def test_silence_around_a_short_sentence_is_not_labelled() -> None:
    class OneSecond:
        name = "one second"

        def describe(self) -> str:
            return self.name

        def draw(self, rng: np.random.Generator, num_samples: int) -> npt.NDArray[np.float32]:
            speech_n = np.zeros(num_samples, dtype=np.float32)
            speech_n[8000:24000] = rng.standard_normal(16_000)
            return speech_n

    voices = draw_dialogue(standing(0.0, np.ones(40, dtype=bool)), OneSecond(), np.random.default_rng(0))
    assert np.flatnonzero(voices.sounding_st[0]).tolist() == list(range(5 - 2, 15 + 2))


def test_people_are_as_asked_for() -> None:
    config = MovingPeopleConfig(people=(4, 4), talkers=(2, 2), walks=replace(WALKS, seconds=30.0), standing_share=0.5)
    stand = []
    for seed in range(12):
        people = draw_moving_people(config, np.random.default_rng(seed))
        assert people.talkers.sounding_st.any(axis=1).tolist() == [True, True, False, False]
        assert (people.distances_s >= 0.8).all() and (people.distances_s <= 2.0).all()
        stand += (np.ptp(np.unwrap(people.talkers.azimuths_st, axis=1), axis=1) < 1e-9).tolist()
    assert 0.3 < np.mean(stand) < 0.7


def test_the_truth_moves_evenly_across_the_seam() -> None:
    people = standing(0.0, np.ones(3, dtype=bool))
    talkers = replace(people.talkers, azimuths_st=np.deg2rad([[170.0, 178.0, -174.0]]))
    (found,) = np.rad2deg(replace(people, talkers=talkers).azimuths_at(np.array([0.05, 0.15, 9.0])))
    np.testing.assert_allclose(found, [174.0, -178.0, -174.0])


def test_a_recording_depends_on_its_seed_and_number_alone() -> None:
    first, again, other = (SIMULATOR.draw(index) for index in (0, 0, 1))
    np.testing.assert_array_equal(first.render_audio(), again.render_audio())
    assert first.labels == again.labels
    assert first.labels != other.labels
    circle = replace(SIMULATOR, array=PRESETS["circle4"], camera=Camera(576, 1.0, True)).draw(0)
    assert circle.labels == first.labels


def test_the_labels_are_what_srp_phat_hears() -> None:
    one = MovingPeopleConfig(
        people=(1, 1),
        talkers=(1, 1),
        walks=replace(WALKS, pause_s=(0.1, 0.2)),
        scenes=SceneConfig(rt60_range_s=(0.2, 0.2)),
    )
    recording = RecordingSimulator(one, array=PRESETS["circle6"]).draw(0)
    audio_mn, truth = recording.render_audio(), azimuths_by_frame(recording.labels)
    srp_phat, *_ = default_baselines(PRESETS["circle6"], DirectionGrid())
    errors_deg = []
    for frame in range(3, 55, 6):
        if not all(near in truth for near in range(frame - 2, frame + 3)):
            continue
        samples = slice((frame - 2) * 1600, (frame + 3) * 1600)
        clip = Clip("", audio_mn[:, samples], np.zeros((88, 288, 3), np.uint8))
        (azimuth,) = srp_phat.decide(srp_phat.observe(clip), PeakSetting(0.5, 1))
        errors_deg.append(abs(np.rad2deg(wrap_angle(azimuth - truth[frame][0]))))
    assert len(errors_deg) >= 4
    assert np.median(errors_deg) < 5.0
