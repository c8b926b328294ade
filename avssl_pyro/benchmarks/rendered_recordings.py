"""Walking talkers rendered in a room and localized window by window, from their sound alone."""

from dataclasses import dataclass, field
from math import ceil

import numpy as np
import numpy.typing as npt

from avssl_pyro.benchmarks.tracking import TrackedRecording
from avssl_pyro.clip import SAMPLE_RATE, Clip
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.localization.posterior import SourceThresholds, select_sources
from avssl_pyro.simulation.moving_audio import MovingAudioConfig, render_moving
from avssl_pyro.simulation.moving_talkers import MovingTalkers, MovingTalkersConfig, draw_moving_talkers
from avssl_pyro.tracking.tracker import WindowDetections

BATCH = 16


@dataclass(frozen=True)
class RenderedRecordings:
    """Recordings whose detections come from a localizer.

    Args:
        localizer: what localizes; the picture it gets is black.
        thresholds: what of its posterior counts as a detection.
        talkers, audio: what is drawn and rendered.
        window_s: length of a window.
        count: number of recordings.
        seed: recording i depends on the seed and i alone.
    """

    localizer: Localizer
    thresholds: SourceThresholds = field(default_factory=SourceThresholds)
    talkers: MovingTalkersConfig = field(default_factory=MovingTalkersConfig)
    audio: MovingAudioConfig = field(default_factory=MovingAudioConfig)
    window_s: float = 0.5
    count: int = 3
    seed: int = 0

    def draw(self, index: int) -> TrackedRecording:
        """TrackedRecording ``index``; a talker is in the windows it fills half of, where it is in their middle."""
        rng = np.random.default_rng([self.seed, index])
        talkers = draw_moving_talkers(self.talkers, rng)
        audio_mn = render_moving(talkers, self.localizer.config.array, self.audio, rng)
        instants = ceil(self.window_s / self.talkers.step_s)
        starts = range(len(talkers.times_s) - instants + 1)
        truth = [_truth(talkers, slice(t, t + instants)) for t in starts]
        return TrackedRecording(truth, self._windows(audio_mn, [float(talkers.times_s[t]) for t in starts]))

    def _windows(self, audio_mn: npt.NDArray[np.float32], starts_s: list[float]) -> list[WindowDetections]:
        length = round(self.window_s * SAMPLE_RATE)
        firsts = [round(start_s * SAMPLE_RATE) for start_s in starts_s]
        clips = [Clip.without_picture(str(first), audio_mn[:, first : first + length]) for first in firsts]
        batches = [clips[first : first + BATCH] for first in range(0, len(clips), BATCH)]
        posteriors = [posterior for batch in batches for posterior in self.localizer.posteriors(batch)]
        grid = self.localizer.config.grid
        return [
            WindowDetections(start_s + self.window_s / 2, select_sources(posterior, grid, self.thresholds))
            for start_s, posterior in zip(starts_s, posteriors, strict=True)
        ]


def _truth(talkers: MovingTalkers, instants: slice) -> dict[int, float]:
    fills_s = talkers.sounding_st[:, instants].mean(axis=1) >= 0.5
    middle = (instants.start + instants.stop) // 2
    return {int(s): float(talkers.azimuths_st[s, middle]) for s in np.flatnonzero(fills_s)}
