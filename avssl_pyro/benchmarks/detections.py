"""Simulated detections of a localizer around known talkers."""

from dataclasses import dataclass

import numpy as np

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.localization.posterior import LocalizedSource
from avssl_pyro.simulation.motion import MovingTalkers
from avssl_pyro.tracking.tracker import WindowDetections


@dataclass(frozen=True)
class DetectorConfig:
    """Errors of a simulated localizer.

    Args:
        std_deg: standard deviation of an azimuth, degrees.
        miss: share of sounding talkers that are not found.
        clutter: mean number of false detections in a window, uniform over azimuth.
        merge_deg: largest angle, degrees, between talkers that are found as one.
    """

    std_deg: float = 3.0
    miss: float = 0.12
    clutter: float = 0.1
    merge_deg: float = 12.0


def draw_detections(talkers: MovingTalkers, config: DetectorConfig, rng: np.random.Generator) -> list[WindowDetections]:
    """Draws detections of every window: blurred, missed, merged, among clutter."""
    return [
        WindowDetections(float(time_s), _window(talkers.window(t), config, rng))
        for t, time_s in enumerate(talkers.times_s)
    ]


def _window(truth: dict[int, float], config: DetectorConfig, rng: np.random.Generator) -> tuple[LocalizedSource, ...]:
    found: list[float] = []
    for azimuth in truth.values():
        offsets = wrap_angle(azimuth - np.array(found))
        near = np.flatnonzero(np.abs(offsets) < np.deg2rad(config.merge_deg))
        if len(near):
            found[near[0]] += float(offsets[near[0]]) / 2
        else:
            found.append(azimuth)
    kept = [azimuth for azimuth in found if rng.uniform() >= config.miss]
    azimuths = [azimuth + np.deg2rad(config.std_deg) * rng.standard_normal() for azimuth in kept]
    azimuths += list(rng.uniform(-np.pi, np.pi, rng.poisson(config.clutter)))
    level = 0.8 / max(len(azimuths), 1)
    return tuple(
        LocalizedSource(float(wrap_angle(azimuth)), np.deg2rad(2.0), level, 0.01, k)
        for k, azimuth in enumerate(azimuths)
    )
