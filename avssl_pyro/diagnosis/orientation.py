"""Estimation of camera yaw and mirroring relative to the array, without labels.

A trained visual network estimates direction weights from the picture. The search turns and mirrors the picture and
selects the turn with the highest evidence lower bound, summed over clips. For one clip and one picture the bound is

    max over pi of log p(x | w, pi) - KL(q(w | picture) || p(w)),    w = exp(mu) of the network,

where a few rounds of EM fit the levels pi.

Bootstrap resamples of the clips measure the variation between clips, but not errors that all clips share. Where no
talker moves, a picture that is mirrored and turned so that two talkers change places fits the sound as well. Small
errors of the network then decide, always in the same way. The best turn must therefore lead its rival by more than
such errors, which grow with its lead over the median turn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.distributions import Normal, kl_divergence
from tqdm import tqdm

from avssl_pyro.acoustics.covariance import spatial_covariance
from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.batch import collate_clips
from avssl_pyro.clip import Clip
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, component_log_likelihood, observe
from avssl_pyro.guides.diffuse_start import with_diffuse_start

COARSE_DEG, FINE_DEG = 15.0, 5.0
# Turns this close to the best are not its rivals, because a talker is about as wide.
NEAR_DEG = 12.5
# Standard deviation of a lead's error, as a share of the lead over the median turn; more clips do not lower it.
MODEL_ERROR = 0.08
EM_ROUNDS = 5
BIN_STEP, FRAME_STEP = 4, 4
RESAMPLES = 1000
PICTURES_AT_ONCE = 16


class DirectionGuide(Protocol):
    """Interface of a guide: posterior of the direction weights given the picture."""

    def log_weights(self, image_bcij: Tensor) -> tuple[Tensor, Tensor]: ...

    def sigma(self, mu_bkd: Tensor) -> Tensor: ...


@dataclass(frozen=True, order=True)
class Turn:
    """A turn of a picture: mirrored or not, then turned by a yaw.

    Args:
        mirror: flag of mirroring before the yaw.
        yaw_deg: azimuth of the picture's centre in degrees.
    """

    mirror: bool
    yaw_deg: float

    def then(self, later: "Turn") -> "Turn":
        """Returns the composition of this turn and a later one."""
        before_deg = -self.yaw_deg if later.mirror else self.yaw_deg
        return Turn(self.mirror != later.mirror, float(_wrap_deg(before_deg + later.yaw_deg)))


@dataclass(frozen=True)
class Orientation:
    """Estimate of a camera's orientation relative to the array.

    Args:
        yaw_deg: azimuth of the picture's centre in degrees, seen from the array, -180 to 180.
        mirror: flag of a picture with left and right exchanged.
        yaw_confidence: share of bootstrap resamples of the clips whose best turn is near this one, with equal
            mirroring, times the probability that the model's errors leave it ahead of its rival.
        mirror_confidence: confidence of the mirroring alone, computed in the same way.
        gain_over_given: gain in log evidence over the pictures as given, in nats per clip.
        rival: best turn that is not near this one.
    """

    yaw_deg: float
    mirror: bool
    yaw_confidence: float
    mirror_confidence: float
    gain_over_given: float
    rival: Turn


class OrientationSearch:
    """Search for the yaw and mirroring of the pictures with the highest evidence.

    Args:
        guide: guide of a trained system, in evaluation mode.
        template_dfmm: templates of the spectrogram's frequencies, complex (D, F, M, M), or (D + C, F, M, M) with a
            room.
        stft_config: configuration of the spectrogram.
        diffuse: diffuse share eps of the model.
        prior_sigma: prior standard deviation sigma_0 of the model.
    """

    def __init__(
        self, guide: DirectionGuide, template_dfmm: Tensor, stft_config: StftConfig, diffuse: float, prior_sigma: float
    ) -> None:
        self._guide = guide
        self._template_dfmm = template_dfmm[:, ::BIN_STEP].contiguous()
        self._stft = stft_config
        self._diffuse = diffuse
        self._prior_sigma = prior_sigma

    @torch.no_grad()
    def evidence(self, clips: Sequence[Clip], turns: Sequence[Turn], progress: bool = False) -> npt.NDArray[np.float64]:
        """Returns the log evidence of clips under turns of their pictures, (B, H).

        Values are in nats, up to a constant of the clip.
        """
        rows = []
        for clip in tqdm(clips, unit="clip", desc="turning pictures", disable=not progress):
            batch = collate_clips([clip])
            x_bfmt = stft(batch.audio_bmn, self._stft)[:, ::BIN_STEP, :, ::FRAME_STEP]
            observed, image_bcij = observe(x_bfmt), batch.image_float()
            parts = [turns[n : n + PICTURES_AT_ONCE] for n in range(0, len(turns), PICTURES_AT_ONCE)]
            rows.append(torch.cat([self._evidence(observed, image_bcij, part) for part in parts]))
        return torch.stack(rows).double().numpy()

    def _evidence(self, observed: ObservedSpectrogram, image_bcij: Tensor, turns: Sequence[Turn]) -> Tensor:
        turned_hcij = torch.cat([turn_picture(image_bcij, turn) for turn in turns])
        mu_hkd, _ = self._guide.log_weights(turned_hcij)
        prior = Normal(torch.zeros_like(mu_hkd), self._prior_sigma)
        # The likelihood is invariant to the scale of w, and the posterior's scale differs from the prior's.
        centred_hkd = mu_hkd - mu_hkd.mean(-1, keepdim=True)
        divergence_h = kl_divergence(Normal(centred_hkd, self._guide.sigma(mu_hkd)), prior).sum((-2, -1))
        # Without the audio network the diffuse share of a room is not known; that of a refinement's start serves.
        components = len(self._template_dfmm) - mu_hkd.shape[-1]
        log_w_hkj = with_diffuse_start(mu_hkd, components)
        scm_hkfmm = spatial_covariance(log_w_hkj.softmax(-1), self._template_dfmm, self._diffuse)
        density_hfkt = component_log_likelihood(observed, scm_hkfmm[:, None])[:, 0]
        log_pi_hk = torch.full(mu_hkd.shape[:-1], -float(np.log(mu_hkd.shape[1])))
        for _ in range(EM_ROUNDS):
            joint_hfkt = density_hfkt + log_pi_hk[:, None, :, None]
            share_hk = joint_hfkt.softmax(-2).mean((1, 3))
            log_pi_hk = share_hk.clamp_min(1e-6).log()
        likelihood_h = (density_hfkt + log_pi_hk[:, None, :, None]).logsumexp(-2).sum((-2, -1))
        # Each bin of the thinned spectrogram represents its skipped neighbours.
        return BIN_STEP * FRAME_STEP * likelihood_h - divergence_h

    def search(self, clips: Sequence[Clip], progress: bool = False) -> Orientation:
        """Returns the best orientation by a coarse search and a fine one around its best."""
        coarse = [
            Turn(mirror, yaw) for mirror in (False, True) for yaw in np.arange(-180.0, 180.0, COARSE_DEG).tolist()
        ]
        evidence_bh = self.evidence(clips, coarse, progress)
        # Coarse steps can miss the narrow maximum of the best turn, so the best few are refined.
        fine: set[Turn] = set()
        for number in np.argsort(-evidence_bh.sum(axis=0))[:4]:
            turn = coarse[int(number)]
            fine |= {Turn(turn.mirror, float(_wrap_deg(turn.yaw_deg + step * FINE_DEG))) for step in (-2, -1, 1, 2)}
        extra = sorted(fine - set(coarse))
        evidence_bh = np.concatenate([evidence_bh, self.evidence(clips, extra, progress)], axis=1)
        return conclude([*coarse, *extra], evidence_bh)


def turn_picture(image_bcij: Tensor, turn: Turn) -> Tensor:
    """Returns pictures (B, 3, I, J) corrected by a turn, aligned with the array."""
    mirrored_bcij = image_bcij.flip(-1) if turn.mirror else image_bcij
    # Content moves to larger azimuths, which are to the left.
    return mirrored_bcij.roll(-round(turn.yaw_deg / 360 * image_bcij.shape[-1]), dims=-1)


def conclude(turns: Sequence[Turn], evidence_bh: npt.NDArray[np.float64]) -> Orientation:
    """Returns the best turn of a table of evidences (B, H), with its confidence."""
    mirror_h = np.array([turn.mirror for turn in turns])
    yaw_h = np.array([turn.yaw_deg for turn in turns])
    total_h = evidence_bh.sum(axis=0)
    best = int(total_h.argmax())
    as_mirrored_h = mirror_h == mirror_h[best]
    near_h = as_mirrored_h & (np.abs(_wrap_deg(yaw_h - yaw_h[best])) <= NEAR_DEG)
    draws = np.random.default_rng(0).integers(0, len(evidence_bh), (RESAMPLES, len(evidence_bh)))
    winner_s = evidence_bh[draws].sum(axis=1).argmax(axis=1)
    given_h = (~mirror_h) & (yaw_h == 0)
    rival = int(np.where(near_h, -np.inf, total_h).argmax())
    return Orientation(
        yaw_deg=float(_wrap_deg(yaw_h[best] + _parabola(yaw_h, mirror_h, total_h, best))),
        mirror=bool(mirror_h[best]),
        yaw_confidence=_confidence(near_h, evidence_bh, winner_s),
        mirror_confidence=_confidence(as_mirrored_h, evidence_bh, winner_s),
        gain_over_given=float((total_h[best] - total_h[given_h].max()) / len(evidence_bh)) if given_h.any() else 0.0,
        rival=turns[rival],
    )


def _confidence(
    alike_h: npt.NDArray[np.bool_], evidence_bh: npt.NDArray[np.float64], winner_s: npt.NDArray[np.intp]
) -> float:
    """Returns the confidence in a set of similar turns that contains the best one."""
    total_h = evidence_bh.sum(axis=0)
    lead = float(total_h[alike_h].max() - total_h[~alike_h].max())
    error = MODEL_ERROR * float(total_h.max() - np.median(total_h))
    # A bootstrap of few samples cannot support more certainty than their number allows.
    most = 1 - 1 / (len(evidence_bh) + 2) ** 2
    share = float(alike_h[winner_s].mean()) * most
    return share * (NormalDist().cdf(lead / error) if error > 0 else 0.5)


def _parabola(
    yaw_h: npt.NDArray[np.float64], mirror_h: npt.NDArray[np.bool_], total_h: npt.NDArray[np.float64], best: int
) -> float:
    """Returns the offset in degrees of a parabola's maximum from the best turn.

    The parabola passes through the best turn and its fine neighbours; without them the offset is 0.
    """
    sides = []
    for step in (-FINE_DEG, FINE_DEG):
        there = np.flatnonzero((mirror_h == mirror_h[best]) & (np.abs(_wrap_deg(yaw_h - yaw_h[best] - step)) < 1e-6))
        if not there.size:
            return 0.0
        sides.append(float(total_h[there[0]]))
    curvature = 2 * float(total_h[best]) - sides[0] - sides[1]
    return 0.5 * FINE_DEG * (sides[1] - sides[0]) / curvature if curvature > 0 else 0.0


def _wrap_deg(angle_deg: npt.ArrayLike) -> npt.NDArray[np.float64]:
    # Rounding makes equal turns equal numbers.
    wrapped = wrap_angle(np.deg2rad(np.asarray(angle_deg, dtype=np.float64)))
    rounded: npt.NDArray[np.float64] = np.round(wrapped * (180.0 / np.pi), 6)
    return rounded
