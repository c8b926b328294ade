"""Yaw and mirror, with a stand-in for the visual network whose answer is known: it marks colours."""

import numpy as np
import numpy.typing as npt
import pytest
import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.clip import Clip
from avssl_pyro.diagnosis.camera import judge
from avssl_pyro.diagnosis.finding import Severity
from avssl_pyro.diagnosis.orientation import Orientation, OrientationSearch, Turn, conclude, turn_picture
from avssl_pyro.models.room import ROOM_DIFFUSE, Room

ARRAY, CONFIG, NUM_CLIPS, NUM_SAMPLES = PRESETS["circle4"], StftConfig(), 6, 6400


class MarksColors:
    """Log-weights of 6 where a block of columns is saturated red, green or blue, one class a colour; 0 elsewhere."""

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]:
        saturation_bcij = (image_bcij - image_bcij.mean(1, keepdim=True)).clamp_min(0) * 1.5
        mu_bkd = 6 * saturation_bcij.mean(2).unflatten(-1, (72, 4)).mean(-1)
        return torch.cat([mu_bkd, torch.zeros_like(mu_bkd[:, :1])], dim=1), saturation_bcij

    def sigma(self, mu_bkd: Tensor) -> Tensor:
        return torch.full_like(mu_bkd, 0.3)


def scene(rng: np.random.Generator, number: int) -> Clip:
    """Two talkers and somebody silent, anywhere."""
    return talk(rng, number, rng.permutation(8)[:3] * np.pi / 4 + rng.uniform(0, 0.3) - np.pi)


def talk(rng: np.random.Generator, number: int, azimuths: npt.NDArray[np.float64]) -> Clip:
    """Talkers of sparse noise in free field, each behind a coloured bar; a third bar is somebody silent."""
    frequencies = np.fft.rfftfreq(NUM_SAMPLES, 1 / 16_000)
    audio_mn = 0.003 * rng.standard_normal((4, NUM_SAMPLES))
    image_ijc = np.full((88, 288, 3), 128, np.uint8)
    for color, azimuth in enumerate(azimuths):
        column = int((np.pi - azimuth) / (2 * np.pi) * 288) + np.arange(-4, 5)
        image_ijc[:, column % 288] = 255 * np.eye(3, dtype=np.uint8)[color]
        if color == 2:
            continue
        envelope_n = np.repeat(rng.uniform(0, 1, NUM_SAMPLES // 400) ** 3, 400)
        lead_m = ARRAY.positions @ [np.cos(azimuth), np.sin(azimuth), 0] / ARRAY.speed_of_sound
        spectrum_f = np.fft.rfft(0.1 * envelope_n * rng.standard_normal(NUM_SAMPLES))
        turned_mf = spectrum_f * np.exp(2j * np.pi * frequencies * lead_m[:, None])
        audio_mn += np.fft.irfft(turned_mf, NUM_SAMPLES)
    return Clip(str(number), audio_mn.astype(np.float32), image_ijc)


def seen_by(clip: Clip, yaw_deg: float, mirror: bool) -> Clip:
    """The clip with the picture of a camera whose centre shows azimuth ``yaw_deg``, and that mirrors or does not."""
    turned_ijc = np.roll(clip.image_ijc, round(yaw_deg / 360 * 288), axis=1)
    return Clip(clip.key, clip.audio_mn, np.ascontiguousarray(turned_ijc[:, ::-1] if mirror else turned_ijc))


def searcher(room: bool = False) -> OrientationSearch:
    if room:
        template_jfmm = Room.of_array(ARRAY, DirectionGrid(), CONFIG.frequencies).template_jfmm.to(torch.complex64)
        return OrientationSearch(MarksColors(), template_jfmm, CONFIG, diffuse=ROOM_DIFFUSE, prior_sigma=1.0)
    steering_fdm = FreeField(ARRAY)(DirectionGrid(), CONFIG.frequencies).to(torch.complex64)
    return OrientationSearch(MarksColors(), template_covariances(steering_fdm), CONFIG, diffuse=0.1, prior_sigma=1.0)


@pytest.mark.parametrize(
    ("yaw_deg", "mirror", "room"),
    [(0.0, False, False), (37.5, False, False), (-112.5, True, False), (-112.5, True, True)],
)
def test_yaw_and_mirror_are_found(yaw_deg: float, mirror: bool, room: bool) -> None:
    rng = np.random.default_rng(5)
    clips = [seen_by(scene(rng, number), yaw_deg, mirror) for number in range(NUM_CLIPS)]
    found = searcher(room).search(clips)
    assert abs((found.yaw_deg - yaw_deg + 180) % 360 - 180) < 4
    assert found.mirror == mirror
    assert min(found.yaw_confidence, found.mirror_confidence) > 0.9
    (finding,) = judge(found, ARRAY)
    assert finding.severity == (Severity.OK if yaw_deg == 0 else Severity.WARNING)
    assert (" deg, mirrored" in finding.advice) == mirror


@pytest.mark.parametrize("walks", [False, True])
def test_two_talkers_who_stand_still_cannot_tell_a_mirror(walks: bool) -> None:
    rng = np.random.default_rng(4)
    steps_b = np.arange(NUM_CLIPS) * (np.pi / 6 if walks else 0)
    clips = [talk(rng, number, np.array([-2.5 + step, 1.0])) for number, step in enumerate(steps_b)]
    found = searcher().search([seen_by(clip, 37.5, False) for clip in clips])
    (finding,) = judge(found, ARRAY)
    if walks:
        assert (finding.severity, found.mirror) == (Severity.WARNING, False)
        assert found.yaw_deg == pytest.approx(37.5, abs=4)
        return
    assert found.mirror_confidence < 0.9
    assert finding.severity == Severity.NOTE
    assert found.rival.mirror != found.mirror
    assert "walks around" in finding.advice


def test_certainty_does_not_come_from_many_clips_alone() -> None:
    rng = np.random.default_rng(3)
    turns, evidence_bh = table(rng, gain=1000.0)
    evidence_bh[:, turns.index(Turn(False, -100.0))] += 970.0
    close = conclude(turns, evidence_bh)
    assert (close.mirror, close.rival) == (True, Turn(False, -100.0))
    assert 0.5 < close.yaw_confidence < 0.8
    assert 0.5 < close.mirror_confidence < 0.8


@pytest.mark.parametrize("later", [Turn(False, 35.0), Turn(True, -20.0)])
@pytest.mark.parametrize("first", [Turn(False, 120.0), Turn(True, 70.0)])
def test_turns_add_up(first: Turn, later: Turn) -> None:
    image_bcij = torch.rand(1, 3, 4, 288, generator=torch.Generator().manual_seed(0))
    one_by_one = turn_picture(turn_picture(image_bcij, first), later)
    torch.testing.assert_close(turn_picture(image_bcij, first.then(later)), one_by_one)


def test_turning_back_undoes_the_camera() -> None:
    rng = np.random.default_rng(1)
    clip = scene(rng, 0)
    for yaw_deg, mirror in ((45.0, False), (-20.0, True)):
        seen = seen_by(clip, yaw_deg, mirror).image_ijc.transpose(2, 0, 1)[None]
        back_ijc = turn_picture(torch.from_numpy(seen.copy()), Turn(mirror, yaw_deg))[0].permute(1, 2, 0)
        np.testing.assert_array_equal(back_ijc.numpy(), clip.image_ijc)


def table(rng: np.random.Generator, gain: float) -> tuple[list[Turn], npt.NDArray[np.float64]]:
    turns = [Turn(mirror, float(yaw)) for mirror in (False, True) for yaw in range(-180, 180, 5)]
    evidence_bh = rng.normal(0, 10, (20, len(turns)))
    evidence_bh[:, turns.index(Turn(True, 40.0))] += gain
    return turns, evidence_bh


def test_confidence_is_that_of_the_evidence() -> None:
    rng = np.random.default_rng(2)
    clear = conclude(*table(rng, gain=40.0))
    assert (clear.mirror, clear.gain_over_given > 0) == (True, True)
    assert clear.yaw_deg == pytest.approx(40, abs=2.5)
    assert clear.yaw_confidence > 0.95
    guess = conclude(*table(rng, gain=0.0))
    assert guess.yaw_confidence < 0.9
    (finding,) = judge(guess, ARRAY)
    assert finding.severity == Severity.NOTE
    assert "undetermined" in finding.message


def test_a_line_of_microphones_cannot_tell() -> None:
    (finding,) = judge(Orientation(90.0, True, 1.0, 1.0, 100.0, Turn(False, 0.0)), PRESETS["circle2"])
    assert finding.severity == Severity.NOTE
    assert "both sides of this array sound alike" in finding.message
