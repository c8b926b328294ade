"""Runs a trained system on clips: a forward pass of the guide, refined clip by clip if asked, gives each posterior."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from avssl_pyro.acoustics.grid import wrap_angle
from avssl_pyro.acoustics.stft import loud_frames, stft
from avssl_pyro.batch import collate_clips
from avssl_pyro.clip import Clip
from avssl_pyro.errors import InputError
from avssl_pyro.guides.base import GuideParameters, Initializer, PosteriorGuide
from avssl_pyro.guides.refined import RefinedGuide, RefinementConfig
from avssl_pyro.localization.posterior import ClipPosterior
from avssl_pyro.systems.system import System

DIRECTION_DRAWS = 64


class Localizer:
    """A system ready to localize.

    Raises:
        InputError: the device cannot be used here, or the guide cannot be asked for its parameters.

    Args:
        system: model and guide; the guide is put into evaluation mode.
        device: where to compute.
        uniform_levels: ignore the audio network and give every class the level 1/K ("w/o Aud").
        refinement: refine every clip's posterior so; by default the networks' answer is final.
        start: where refinement starts; by default at the system's own guide.
        guide: asked instead of all these, whatever it is; it may belong to another model of the same array.
        pause_db: leave out frames whose power is so many decibels below that of the clip's loudest. In pauses there is
            nothing but noise, and a level, the share of bins that a source dominates, falls with every one of them.
        seed: of the draws behind the posterior spread of directions.
    """

    def __init__(
        self,
        system: System,
        device: torch.device | str = "cpu",
        *,
        uniform_levels: bool = False,
        refinement: RefinementConfig | None = None,
        start: Initializer | None = None,
        guide: PosteriorGuide | None = None,
        pause_db: float | None = None,
        seed: int = 0,
    ) -> None:
        self.config = system.config
        try:
            self.device = torch.empty(0, device=device).device
        except (RuntimeError, AssertionError) as error:
            raise InputError(f"device '{device}' cannot be used here ({str(error).splitlines()[0]}).") from error
        if guide is None and refinement is not None:
            guide = RefinedGuide(system.guide if start is None else start, system.model, refinement)
        if guide is not None and not hasattr(guide, "parameters_of"):
            raise InputError(
                f"Localizer: {type(guide).__name__} has no 'parameters_of'; give a guide that can tell its parameters."
            )
        asked: PosteriorGuide = system.guide if guide is None else guide
        self.guide = asked.to(self.device).eval()
        self.uniform_levels = uniform_levels
        self.pause_db = pause_db
        self.seed = seed

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
            summary if clip.audio_mn.any() else _silent(summary) for clip, summary in zip(clips, summaries, strict=True)
        ]

    def _summaries(self, parameters: GuideParameters) -> list[ClipPosterior]:
        share_bkd = parameters.mu_bkd.softmax(-1)
        level_bk, level_std_bk = self._levels(parameters)
        std_bk = self._azimuth_std(parameters)
        return [
            ClipPosterior(
                direction_weights_kd=share_bkd[b].double().cpu().numpy(),
                mixing_levels_k=level_bk[b].double().cpu().numpy(),
                level_std_k=level_std_bk[b].double().cpu().numpy(),
                azimuth_std_k=std_bk[b].double().cpu().numpy(),
                activations_kij=parameters.activation_bkij[b].float().cpu().numpy(),
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

    def _azimuth_std(self, parameters: GuideParameters) -> Tensor:
        """Spread of arg max_d w_kd under q(w | image), plus the grid's own resolution, (B, K), radians."""
        mu_bkd = parameters.mu_bkd.cpu()
        generator = torch.Generator().manual_seed(self.seed)
        noise = torch.randn(DIRECTION_DRAWS, *mu_bkd.shape[1:], generator=generator, dtype=mu_bkd.dtype)
        drawn_sbk = (mu_bkd + parameters.sigma_bkd.cpu() * noise[:, None]).argmax(-1)
        azimuths_d = self.config.grid.azimuths
        offset_sbk = wrap_angle(azimuths_d[drawn_sbk.numpy()] - azimuths_d[mu_bkd.argmax(-1).numpy()])
        variance_bk = np.mean(offset_sbk**2, axis=0) + self.config.grid.spacing**2 / 12
        return torch.from_numpy(np.sqrt(variance_bk))


def _silent(posterior: ClipPosterior) -> ClipPosterior:
    """What is known of a clip in which nothing sounds, whatever the picture suggests: every direction is alike."""
    k, d = posterior.direction_weights_kd.shape
    return replace(
        posterior,
        direction_weights_kd=np.full((k, d), 1 / d),
        mixing_levels_k=np.full(k, 1 / k),
        azimuth_std_k=np.full(k, np.pi / np.sqrt(3)),
    )
