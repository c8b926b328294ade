"""Audio network from beamformed log power to mixing levels (Fig. 3 b)."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

# Power of all diffuse components relative to that of the directions, before training.
INITIAL_DIFFUSE_RATIO = 0.1


class DilatedSeparableConv(nn.Module):
    """Dilated depthwise-separable convolution over time with a residual connection.

    Filters (B, C, D, T) over time, separately for every direction (or source), with batch norm and leaky ReLU.

    Args:
        channels: number of channels C.
        dilation: dilation over time in frames.
        dropout: probability of dropping a channel.
    """

    def __init__(self, channels: int, dilation: int, dropout: float) -> None:
        super().__init__()
        self.depthwise = nn.Conv2d(
            channels, channels, (1, 3), padding=(0, dilation), dilation=(1, dilation), groups=channels, bias=False
        )
        self.pointwise = nn.Conv2d(channels, channels, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)
        self.activation = nn.LeakyReLU(0.1, inplace=True)
        self.dropout = nn.Dropout2d(dropout)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.dropout(self.activation(self.norm(self.pointwise(self.depthwise(x)))))


class AudioNet(nn.Module):
    """Audio network of Fig. 3 (b), which estimates the mixing levels of sources.

    The stages are delay-and-sum beamforming towards all D directions, log power, normalisation per frequency,
    convolutions over time with frequencies as channels, combination of directions into sources by w (Eq. 3),
    convolutions, average over time, an affine map and a softmax over sources. Beyond the paper, features of a source
    are compared with those of all sources before the affine map. Without this, a source and its neighbour have similar
    features.

    Args:
        steering_fdm: steering vectors, complex (F, D, M).
        channels: number of channels of the convolutions.
        direction_dilations: dilations, in frames, of the convolutions before directions are combined.
        source_dilations: dilations, in frames, of the convolutions after directions are combined.
        dropout: probability of dropping a channel in every block.
        most_bins: largest number of frequencies; every n-th frequency is used, which preserves the information on
            directions at a fraction of the cost.
        pooled_frames: number of frames averaged in power before the logarithm.
        num_diffuse: number of diffuse components whose power relative to the directions is estimated too, see
            :meth:`log_diffuse_ratios`.
    """

    def __init__(
        self,
        steering_fdm: Tensor,
        channels: int = 48,
        direction_dilations: Sequence[int] = (1,),
        source_dilations: Sequence[int] = (1, 2, 4),
        dropout: float = 0.1,
        most_bins: int = 96,
        pooled_frames: int = 3,
        num_diffuse: int = 0,
    ) -> None:
        super().__init__()
        self.bins = slice(None, None, -(-steering_fdm.shape[0] // most_bins))
        self.pooled_frames = pooled_frames
        beamformer_fdm = steering_fdm[self.bins].conj() / steering_fdm.shape[-1]
        # Real and imaginary part of a^H x as one real product with [Re x; Im x]: (F', 2D, 2M).
        real, imag = beamformer_fdm.real, beamformer_fdm.imag
        beamformer = torch.cat([torch.cat([real, -imag], dim=-1), torch.cat([imag, real], dim=-1)], dim=-2)
        self.beamformer: Tensor
        self.register_buffer("beamformer", beamformer, persistent=False)
        self.embed = nn.Linear(beamformer_fdm.shape[0], channels, bias=False)
        self.embed_norm = nn.Sequential(nn.BatchNorm2d(channels), nn.LeakyReLU(0.1, inplace=True))
        self.over_directions = nn.Sequential(*(DilatedSeparableConv(channels, i, dropout) for i in direction_dilations))
        self.over_sources = nn.Sequential(*(DilatedSeparableConv(channels, i, dropout) for i in source_dilations))
        self.beside = nn.Sequential(
            nn.Linear(3 * channels, channels),
            nn.LeakyReLU(0.1, inplace=True),
            nn.Linear(channels, channels, bias=False),
        )
        self.affine = nn.Linear(channels, 1)
        self.num_diffuse = num_diffuse
        if num_diffuse:
            self.affine_diffuse = nn.Linear(channels, num_diffuse)
            nn.init.zeros_(self.affine_diffuse.weight)
            nn.init.constant_(self.affine_diffuse.bias, math.log(INITIAL_DIFFUSE_RATIO / num_diffuse))

    @torch.no_grad()
    def _log_power(self, x_bfmt: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Returns beamformed log power, and its mean and standard deviation.

        The log power is (B, F', D T'), mean and standard deviation per frequency are (B, F').
        """
        with torch.autocast(x_bfmt.device.type, enabled=False):
            return self._beamformed(x_bfmt)

    def _beamformed(self, x_bfmt: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        num_frames = x_bfmt.shape[-1]
        pooled = min(self.pooled_frames, num_frames)
        x_bfmt = x_bfmt[:, self.bins, :, : num_frames - num_frames % pooled]
        beam = self.beamformer @ torch.cat([x_bfmt.real, x_bfmt.imag], dim=-2)
        real_bfdt, imag_bfdt = beam.chunk(2, dim=-2)
        power_bfdt = real_bfdt.square_().addcmul_(imag_bfdt, imag_bfdt)
        power_bfdt = power_bfdt.unflatten(-1, (-1, pooled)).mean(-1).flatten(-2)
        # The floor is relative to the clip, so that the features do not depend on the recording's gain.
        floor = (1e-8 * power_bfdt.mean(dim=(1, 2), keepdim=True)).clamp_min(torch.finfo(power_bfdt.dtype).tiny)
        log_power = power_bfdt.add_(floor).log_()
        mean_bf = log_power.mean(-1)
        square_bf = torch.linalg.vector_norm(log_power, dim=-1).square() / log_power.shape[-1]
        return log_power, mean_bf, (square_bf - mean_bf.square()).clamp_min(0).sqrt()

    def direction_features(self, x_bfmt: Tensor) -> Tensor:
        """Returns features u_cd of every direction, (B, C, D, T').

        Args:
            x_bfmt: spectrogram, (B, F, M, T).
        """
        log_power, mean_bf, std_bf = self._log_power(x_bfmt)
        # (u - mean) / std followed by a 1x1 convolution over frequencies is one product with rescaled weights, which
        # avoids a normalised copy of the network's largest tensor.
        weight_bcf = self.embed.weight / (std_bf[:, None, :] + 1e-3)
        offset_bc = weight_bcf @ mean_bf[..., None]
        embedded = torch.baddbmm(-offset_bc, weight_bcf, log_power)
        num_directions = self.beamformer.shape[-2] // 2
        features: Tensor = self.over_directions(self.embed_norm(embedded.unflatten(-1, (num_directions, -1))))
        return features

    def source_features(self, feature_bcdt: Tensor, share_bkd: Tensor) -> Tensor:
        """Returns features of every source, (P..., B, K, C), compared with those of all sources.

        Args:
            feature_bcdt: result of :meth:`direction_features`, (B, C, D, T').
            share_bkd: weights of the sources over directions, which sum to 1, (P..., B, K, D).
        """
        particles = share_bkd.shape[:-3]
        b, _, d, _ = feature_bcdt.shape
        k = share_bkd.shape[-2]
        # Eq. (3): v_ck = sum_d w_kd u_cd, one product per clip for any number of particles.
        stacked_bkd = share_bkd.reshape(-1, b, k, d).transpose(0, 1).reshape(b, -1, d)
        source_bckt = torch.einsum("bkd,bcdt->bckt", stacked_bkd, feature_bcdt)
        pooled_bpkc = self.over_sources(source_bckt).mean(dim=-1).transpose(1, 2).unflatten(1, (-1, k))
        others_bpkc = [pooled_bpkc.mean(-2, keepdim=True), pooled_bpkc.amax(-2, keepdim=True)]
        compared_bpkc = torch.cat([pooled_bpkc, *(other.expand_as(pooled_bpkc) for other in others_bpkc)], dim=-1)
        described_bpkc = pooled_bpkc + self.beside(compared_bpkc)
        return described_bpkc.transpose(0, 1).reshape(*particles, b, k, -1)

    def levels(self, source_bkc: Tensor) -> Tensor:
        """Returns mixing levels pi_bar, (P..., B, K), from the features of sources."""
        level_bk: Tensor = self.affine(source_bkc).squeeze(-1).softmax(dim=-1)
        return level_bk

    def log_diffuse_ratios(self, source_bkc: Tensor) -> Tensor:
        """Returns the log power of diffuse components relative to the directions' of a source, (P..., B, K, C')."""
        ratio_bkc: Tensor = self.affine_diffuse(source_bkc)
        return ratio_bkc

    def forward(self, x_bfmt: Tensor, share_bkd: Tensor) -> Tensor:
        """Returns mixing levels pi_bar_bk of Eq. (2).

        Args:
            x_bfmt: spectrogram, (B, F, M, T).
            share_bkd: weights of the sources over directions, which sum to 1, (P..., B, K, D).
        """
        return self.levels(self.source_features(self.direction_features(x_bfmt), share_bkd))
