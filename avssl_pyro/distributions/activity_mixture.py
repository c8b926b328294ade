"""The spatial mixture with levels of their own in every frame: a class is on or off, and those that are on share it."""

from itertools import product
from typing import Any

import torch
from torch import Size, Tensor

from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, observe
from avssl_pyro.distributions.spatial_mixture import LEAST_LEVEL_OVER_TINY, SpatialMixture

# 2^K patterns of activity are summed over.
MOST_SOURCES = 10


class ActivityMixture(SpatialMixture):
    """x_tf ~ sum_k pi_tk N_C(0, lambda_tfk H_fk) with pi_tk = s_tk pi_k / sum_j s_tj pi_j, s_tk ~ Bernoulli(activity).

    ::

        frame t:  s_t (not all off) ──► pi_t ──► z_tf ──► x_tf    frequency f, given the frame

    The patterns s_t in {0, 1}^K, of which silence and those with more than ``most_active`` classes are ruled out, are
    summed over exactly. Speech that pauses does not cost its talker's level: pi is the share of a class while it is on.

    Args:
        template_dfmm, w, pi, num_frames, diffuse, psd_bfkt: as of :class:`SpatialMixture`; K at most 10.
        activity: prior probability that a class is on, between 0 and 1.
        most_active: classes that may be on in a frame; None for all. Fewer are faster.

    Raises:
        ValueError: too many classes, or as :class:`SpatialMixture`.
    """

    def __init__(
        self,
        template_dfmm: Tensor,
        w: Tensor,
        pi: Tensor,
        *,
        num_frames: int,
        activity: float,
        most_active: int | None = None,
        diffuse: float = 0.1,
        psd_bfkt: Tensor | None = None,
        validate_args: bool | None = None,
    ) -> None:
        if pi.shape[-1] > MOST_SOURCES:
            raise ValueError(
                f"{pi.shape[-1]} source classes have too many patterns of activity; use at most {MOST_SOURCES}."
            )
        self.activity = activity
        self.most_active = pi.shape[-1] if most_active is None else most_active
        super().__init__(
            template_dfmm,
            w,
            pi,
            num_frames=num_frames,
            diffuse=diffuse,
            psd_bfkt=psd_bfkt,
            validate_args=validate_args,
        )

    def expand(self, batch_shape: Any, _instance: Any = None) -> "ActivityMixture":
        new: ActivityMixture = type(self).__new__(type(self)) if _instance is None else _instance
        new.activity, new.most_active = self.activity, self.most_active
        super().expand(batch_shape, new)
        return new

    @property
    def _patterns_sk(self) -> Tensor:
        """All patterns that are possible, (S, K)."""
        patterns = product((0.0, 1.0), repeat=self.pi.shape[-1])
        return self.pi.new_tensor([pattern for pattern in patterns if 0 < sum(pattern) <= self.most_active])

    def _log_prior_s(self) -> Tensor:
        """Of every pattern, given that it is possible."""
        pattern_sk = self._patterns_sk
        on = pattern_sk.new_tensor(self.activity).logit()
        return (on * pattern_sk.sum(-1)).log_softmax(-1)

    def _frames(self, value: Tensor | ObservedSpectrogram) -> tuple[Tensor, Tensor]:
        """log p(x_t, s_t), (B..., S, T), and log p(x_tf, z_tf = k | all on), (B..., F, K, T)."""
        observed = observe(value) if isinstance(value, Tensor) else value
        joint_bfkt = super().joint_log_prob(observed)
        pattern_sk = self._patterns_sk
        tiny = torch.finfo(joint_bfkt.dtype).tiny
        highest_bf1t = joint_bfkt.detach().amax(-2, keepdim=True)
        # One matrix product over the classes for all patterns; a class that a pattern leaves out adds nothing.
        sums_bfst = pattern_sk @ (joint_bfkt - highest_bf1t).exp()
        log_share_bs = (self._levels() @ pattern_sk.T).clamp_min(LEAST_LEVEL_OVER_TINY * tiny).log()
        given_bst = (sums_bfst.clamp_min(LEAST_LEVEL_OVER_TINY * tiny).log() + highest_bf1t).sum(-3)
        num_frequencies = joint_bfkt.shape[-3]
        prior_bs = self._log_prior_s() - num_frequencies * log_share_bs
        return given_bst + prior_bs[..., None], joint_bfkt

    def _levels(self) -> Tensor:
        return self.pi.clamp_min(LEAST_LEVEL_OVER_TINY * torch.finfo(self.pi.dtype).tiny)

    def log_prob(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """log p(x), (B...)."""
        if self._validate_args and isinstance(value, Tensor):
            self._validate_sample(value)
        return self._frames(value)[0].logsumexp(-2).sum(-1)

    def active(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """Posterior probability that each class is on in each frame, p(s_tk = 1 | x), (B..., K, T)."""
        return self._patterns_sk.T @ self._frames(value)[0].softmax(-2)

    def masks(self, value: Tensor | ObservedSpectrogram) -> Tensor:
        """p(z_tf = k | x), (B..., F, K, T), over all patterns."""
        frame_bst, joint_bfkt = self._frames(value)
        pattern_sk = self._patterns_sk
        weight_bfkt = (joint_bfkt - joint_bfkt.amax(-2, keepdim=True)).exp()
        tiny = LEAST_LEVEL_OVER_TINY * torch.finfo(weight_bfkt.dtype).tiny
        odds_bfst = frame_bst.softmax(-2)[..., None, :, :] / (pattern_sk @ weight_bfkt).clamp_min(tiny)
        mask_bfkt = weight_bfkt * (pattern_sk.T @ odds_bfst)
        return mask_bfkt / mask_bfkt.sum(-2, keepdim=True)

    def _draw_classes(self, sample_shape: Size) -> Tensor:
        f, _, t = self.event_shape
        patterns = torch.distributions.Categorical(logits=self._log_prior_s())
        pattern_bt = patterns.sample(Size([*sample_shape, *self.batch_shape, t]))
        level_btk = self._patterns_sk[pattern_bt] * self._levels()[..., None, :]
        level_bftk = level_btk[..., None, :, :].expand(*pattern_bt.shape[:-1], f, t, -1)
        return torch.distributions.Categorical(level_bftk).sample()
