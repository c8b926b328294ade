"""Simulated mixtures of talkers of whom each one's own sound is known."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.clip import Clip
from avssl_pyro.simulation.scenes import SceneSimulator


@dataclass(frozen=True)
class TalkerMixture:
    """A clip and what it was mixed from.

    Args:
        clip: what is heard and seen.
        azimuths: of the talkers, (S,), radians.
        unit_vectors_sx: where their mouths are, (S, 3).
        images_smn: each talker alone in the room, (S, M, N); in scale with each other, not with the clip.
        direct_smn: the same without any reflection.
    """

    clip: Clip
    azimuths: tuple[float, ...]
    unit_vectors_sx: npt.NDArray[np.float64]
    images_smn: npt.NDArray[np.float32]
    direct_smn: npt.NDArray[np.float32]

    def images_and_noise(self) -> npt.NDArray[np.float64]:
        """The parts of the clip, (S + 1, M, N): the talkers' images at their level in it, and all that is left."""
        images_smn = self.images_smn.astype(np.float64)
        sum_mn = images_smn.sum(axis=0)
        # The noise is independent of the talkers, so the clip's gain is the one that leaves the least.
        gain = float(np.vdot(sum_mn, self.clip.audio_mn) / np.vdot(sum_mn, sum_mn))
        noise_mn = self.clip.audio_mn - gain * sum_mn
        return np.concatenate([gain * images_smn, noise_mn[None]])


def draw_mixture(simulator: SceneSimulator, index: int) -> TalkerMixture:
    """Scene ``index`` of a simulator."""
    scene = simulator.render(index)
    talkers = [person for person in scene.people if person.speaks]
    unit_vectors_sx = [
        [
            np.cos(person.mouth_elevation) * np.cos(person.azimuth),
            np.cos(person.mouth_elevation) * np.sin(person.azimuth),
            np.sin(person.mouth_elevation),
        ]
        for person in talkers
    ]
    return TalkerMixture(
        clip=scene.clip,
        azimuths=scene.labels.talker_azimuths,
        unit_vectors_sx=np.array(unit_vectors_sx),
        images_smn=simulator.render_talkers(index),
        direct_smn=simulator.render_direct(index),
    )
