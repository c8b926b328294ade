"""Localizes the sounding sources of clips: one forward pass of a guide, or a refinement fitted to every clip."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import torch
from attrs import evolve
from torch import Tensor

from avssl_pyro.acoustics.channel_gains import ChannelGains, GainEstimator
from avssl_pyro.acoustics.stft import loud_frames, stft
from avssl_pyro.batch import collate_clips
from avssl_pyro.clip import Clip, is_silent
from avssl_pyro.errors import InputError
from avssl_pyro.guides.base import GuideParameters, PosteriorGuide
from avssl_pyro.guides.initializers import UninformedInitializer
from avssl_pyro.guides.refined import RefinedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.direct_level import ONE_PASS_RULE, DirectLevelRule
from avssl_pyro.localization.posterior import ClipPosterior
from avssl_pyro.localization.results import Localization
from avssl_pyro.localization.spread import azimuth_std
from avssl_pyro.systems.system import System


def audio_only_refinement(refinement: RefinementConfig) -> RefinementConfig:
    """The refinement without the image: no prior from it, and no softening, which lobes do not need."""
    return evolve(refinement, image_weight=0.0, softening=1.0)


class Localizer:
    """Estimates the posterior and the sources of clips.

    Args:
        system: model and guide; the guide is put into evaluation mode.
        device: torch device of the computation.
        refinement: settings of the refinement of every clip's posterior; without them one forward pass is final.
        audio_only: ignore the images; the refinement starts from broad lobes around the circle instead.
        uniform_levels: ignore the audio network and give every class the level 1/K ("w/o Aud").
        guide: guide used in place of all these; it may belong to another model of the same array.
        rule: conditions under which a class counts as a source; by default :class:`DirectLevelRule`, or
            :data:`ONE_PASS_RULE` for a guide that is not fitted to each clip.
        pause_db: decibels below a clip's loudest frame; frames quieter than that are left out. Pauses hold only noise,
            and every one of them lowers the levels, the shares of bins that the sources dominate.
        gains: gains and signs of the channels, which are undone; by default each clip's own, as estimated.

    Raises:
        InputError: the device is not available, or the guide does not return its parameters.

    >>> from avssl_pyro.clip import Clip
    >>> from avssl_pyro.systems.pretrained import load_weights_of
    >>> localizer = Localizer(load_weights_of("circle2"))
    >>> silence = Clip.from_audio("silence", np.zeros((2, 16_000), np.float32))
    >>> localizer.localize([silence])[0].sources
    ()
    """

    def __init__(
        self,
        system: System,
        device: torch.device | str = "cpu",
        *,
        refinement: RefinementConfig | None = None,
        audio_only: bool = False,
        uniform_levels: bool = False,
        guide: PosteriorGuide | None = None,
        rule: DirectLevelRule | None = None,
        pause_db: float | None = None,
        gains: ChannelGains | None = None,
    ) -> None:
        self.config = system.config
        try:
            self.device = torch.empty(0, device=device).device
        except (RuntimeError, AssertionError) as error:
            raise InputError(f"device '{device}' cannot be used here ({str(error).splitlines()[0]}).") from error
        if guide is None:
            guide = _guide(system, refinement, audio_only)
        if not hasattr(guide, "parameters_of"):
            raise InputError(
                f"Localizer: {type(guide).__name__} has no 'parameters_of'; give a guide that returns its parameters."
            )
        self.guide = guide.to(self.device).eval()
        self.audio_only = audio_only
        self.rule = _default_rule(self.guide) if rule is None else rule
        self.uniform_levels = uniform_levels
        self.pause_db = pause_db
        self.gains = gains
        self._gain_estimator = GainEstimator(self.config.array, self.config.stft)

    def with_gains(self, gains: ChannelGains) -> "Localizer":
        """Returns this localizer for clips of one recording, whose gains are known."""
        fixed = copy(self)
        fixed.gains = gains
        return fixed

    def gains_of(self, audio_bmn: npt.NDArray[np.float32]) -> ChannelGains:
        """Gains that are undone in excerpts (B, M, N) of one device: those given, or those estimated from them."""
        return self._gain_estimator.estimate(audio_bmn) if self.gains is None else self.gains

    def localize(self, clips: Sequence[Clip]) -> list[Localization]:
        """Posteriors and sources of clips of equal length, in order.

        Raises:
            InputError: a clip's channels are not those of the system's array.
        """
        grid = self.config.grid
        return [
            Localization(posterior, self.rule.select(posterior, grid), grid) for posterior in self.posteriors(clips)
        ]

    def posteriors(self, clips: Sequence[Clip]) -> list[ClipPosterior]:
        """Posteriors of clips of equal length, in order.

        Raises:
            InputError: a clip's channels are not those of the system's array.
        """
        expected = self.config.array.num_microphones
        for clip in clips:
            if clip.audio_mn.shape[0] != expected:
                raise InputError(
                    f"clip {clip.key}: {clip.audio_mn.shape[0]} channels, but the checkpoint was trained with the "
                    f"{expected} microphones of array '{self.config.array.name}'."
                )
        clips = [
            replace(clip, audio_mn=self.gains_of(clip.audio_mn[None]).compensated(clip.audio_mn)) for clip in clips
        ]
        # Clips that keep different numbers of frames cannot be stacked.
        batches = [clips] if self.pause_db is None else [[clip] for clip in clips]
        return [posterior for batch in batches for posterior in self._posteriors(batch)]

    def _posteriors(self, clips: Sequence[Clip]) -> list[ClipPosterior]:
        batch = collate_clips(clips).to(self.device)
        with torch.no_grad():
            x_bfmt = stft(batch.audio_bmn, self.config.stft)
            if self.pause_db is not None:
                x_bfmt = x_bfmt[..., loud_frames(x_bfmt[0], self.pause_db)]
            parameters = self.guide.parameters_of(x_bfmt, batch.image_float())
            summaries = self._summaries(parameters)
        return [
            _silent(summary) if is_silent(clip.audio_mn) else summary
            for clip, summary in zip(clips, summaries, strict=True)
        ]

    def _summaries(self, parameters: GuideParameters) -> list[ClipPosterior]:
        share_bkd = parameters.mu_bkd.softmax(-1)
        diffuse_bkc = _diffuse_shares(parameters)
        level_bk, level_std_bk = self._levels(parameters)
        std_bk = azimuth_std(parameters.mu_bkd, parameters.sigma_bkd, self.config.grid.spacing)
        return [
            ClipPosterior(
                direction_weights_kd=share_bkd[b].double().cpu().numpy(),
                mixing_levels_k=level_bk[b].double().cpu().numpy(),
                level_std_k=level_std_bk[b].double().cpu().numpy(),
                azimuth_std_k=std_bk[b].double().cpu().numpy(),
                activations_kij=parameters.activation_bkij[b].float().cpu().numpy(),
                diffuse_shares_kc=None if diffuse_bkc is None else diffuse_bkc[b].double().cpu().numpy(),
            )
            for b in range(share_bkd.shape[0])
        ]

    def _levels(self, parameters: GuideParameters) -> tuple[Tensor, Tensor]:
        concentration_bk = parameters.concentration_bk
        if self.uniform_levels:
            uniform_bk = torch.full_like(concentration_bk, 1 / concentration_bk.shape[-1])
            return uniform_bk, torch.zeros_like(uniform_bk)
        total_b1 = concentration_bk.sum(-1, keepdim=True)
        level_bk = concentration_bk / total_b1
        return level_bk, (level_bk * (1 - level_bk) / (total_b1 + 1)).sqrt()


def _guide(system: System, refinement: RefinementConfig | None, audio_only: bool) -> PosteriorGuide:
    if audio_only:
        lobes = UninformedInitializer(system.config.model.num_sources, system.config.grid)
        return RefinedGuide(lobes, system.model, audio_only_refinement(refinement or RefinementConfig()))
    return system.guide if refinement is None else RefinedGuide(system.guide, system.model, refinement)


def _default_rule(guide: PosteriorGuide) -> DirectLevelRule:
    return DirectLevelRule() if getattr(guide, "fits_each_clip", False) else ONE_PASS_RULE


def _diffuse_shares(parameters: GuideParameters) -> Tensor | None:
    """Shares of the diffuse weights in all weights of a class, (B, K, C), or None where there are none."""
    if parameters.diffuse_mu_bkc is None:
        return None
    all_bkj = parameters.log_weights_bkj.softmax(-1)
    return all_bkj[..., parameters.mu_bkd.shape[-1] :]


def _silent(posterior: ClipPosterior) -> ClipPosterior:
    """The posterior of a silent clip, whatever its image: all directions and levels are equally likely."""
    k, d = posterior.direction_weights_kd.shape
    return replace(
        posterior,
        direction_weights_kd=np.full((k, d), 1 / d),
        mixing_levels_k=np.full(k, 1 / k),
        azimuth_std_k=np.full(k, np.pi / np.sqrt(3)),
        diffuse_shares_kc=None,
    )
