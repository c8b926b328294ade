"""The spatial mixture with classes that are on or off in every frame."""

from itertools import product

import torch
from torch import Size, Tensor

from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram
from avssl_pyro.distributions.spatial_mixture import LEAST_LEVEL_OVER_TINY, SpatialMixture

# 2^K patterns of activity are summed over.
MOST_SOURCES = 10


class ActivityMixture(SpatialMixture):
    """x_tf ~ sum_k pi_tk N_C(0, lambda_tfk H_fk) with pi_tk = s_tk pi_k / sum_j s_tj pi_j, s_tk ~ Bernoulli(activity).

    ::

        frame t:  s_t (not all off) ──► pi_t ──► z_tf ──► x_tf    frequency f, given the frame

    The patterns s_t in {0, 1}^K, of which silence and those with more than ``most_active`` classes are ruled out, are
    summed over exactly. Pauses do not lower the level of a talker: pi is the share of a class while it is on.

    Args:
        template_dfmm, w, pi, num_frames, diffuse, psd_bfkt: as of :class:`SpatialMixture`; K at most 10.
        activity: prior probability that a class is on, between 0 and 1.
        most_active: largest number of classes that are on in a frame; None for all. Fewer are faster.

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
        most_active = pi.shape[-1] if most_active is None else most_active
        patterns = product((0.0, 1.0), repeat=pi.shape[-1])
        # All possible patterns, (S, K), made once because every evaluation uses them several times.
        self._patterns_sk = pi.new_tensor([pattern for pattern in patterns if 0 < sum(pattern) <= most_active])
        super().__init__(
            template_dfmm,
            w,
            pi,
            num_frames=num_frames,
            diffuse=diffuse,
            psd_bfkt=psd_bfkt,
            validate_args=validate_args,
        )

    def _log_prior_s(self) -> Tensor:
        """log p(s) of every possible pattern, (S,)."""
        pattern_sk = self._patterns_sk
        on = pattern_sk.new_tensor(self.activity).logit()
        return (on * pattern_sk.sum(-1)).log_softmax(-1)

    def _frames(self, value: Tensor | ObservedSpectrogram) -> tuple[Tensor, Tensor]:
        """log p(x_t, s_t), (B..., S, T), and p(x_tf | z_tf = k) relative to the likeliest class, (B..., F, K, T)."""
        component_bfkt = self.component_log_prob(value)
        highest_bf1t = component_bfkt.detach().amax(-2, keepdim=True)
        relative_bfkt = (component_bfkt - highest_bf1t).exp()
        # One matrix product over the classes for all patterns; a class that a pattern leaves out adds nothing.
        given_bfst = self._sums(relative_bfkt).log() + highest_bf1t
        return given_bfst.sum(-3) + self._log_prior_s()[:, None], relative_bfkt

    def _sums(self, relative_bfkt: Tensor) -> Tensor:
        """sum_k pi_sk p(x_tf | k) relative to the likeliest class, (B..., F, S, T)."""
        least = LEAST_LEVEL_OVER_TINY * torch.finfo(relative_bfkt.dtype).tiny
        return (self._levels_sk()[..., None, :, :] @ relative_bfkt).clamp_min(least)

    def _levels_sk(self) -> Tensor:
        """Levels under every pattern, (B..., S, K), each row summing to 1."""
        level_bsk = self._patterns_sk * self._levels()[..., None, :]
        return level_bsk / level_bsk.sum(-1, keepdim=True)

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
        frame_bst, relative_bfkt = self._frames(value)
        odds_bfst = frame_bst.softmax(-2)[..., None, :, :] / self._sums(relative_bfkt)
        mask_bfkt = relative_bfkt * (self._levels_sk().mT[..., None, :, :] @ odds_bfst)
        return mask_bfkt / mask_bfkt.sum(-2, keepdim=True)

    def _draw_classes(self, sample_shape: Size) -> Tensor:
        f, _, t = self.event_shape
        patterns = torch.distributions.Categorical(logits=self._log_prior_s())
        pattern_bt = patterns.sample(Size([*sample_shape, *self.batch_shape, t]))
        level_btk = self._patterns_sk[pattern_bt] * self._levels()[..., None, :]
        level_bftk = level_btk[..., None, :, :].expand(*pattern_bt.shape[:-1], f, t, -1)
        return torch.distributions.Categorical(level_bftk).sample()
