"""The E-step of the spatial mixture: responsibilities of all classes, and the sums over frames that the M-step needs.

A Hermitian M x M matrix has M^2 real degrees of freedom. The class keeps spectrogram and templates in them, so that
quadratic forms, weighted covariances and projections are real matrix products.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from avssl_pyro.acoustics.covariance import (
    form_coefficients,
    inverse_and_logdet,
    matrix_from_features,
    spatial_covariance,
    template_features,
)
from avssl_pyro.distributions.profiled_gaussian import ObservedSpectrogram, quadratic_form


@dataclass(frozen=True)
class DensityGenerator:
    """log p(x | k) = -power log(x^H P x + offset) - log det H + const, an elliptical density without lambda.

    Args:
        power: exponent; M if the density is profiled out (Eq. 16), more if an inverse gamma prior is integrated over.
        offset_b: offset in units of the scaled x of :class:`ObservedSpectrogram`, (B,).
    """

    power: float
    offset_b: Tensor


class Expectation(NamedTuple):
    """What one E-step returns.

    Args:
        inverse_bkfmm: P = H^-1 of every class.
        quad_bfkt: x^H P x + offset of every bin and class.
        gamma_bfkt: responsibilities times the weight of the bin, summing to it over classes.
        evidence_bft: log-likelihood of every bin times its weight, up to a constant of the clip.
    """

    inverse_bkfmm: Tensor
    quad_bfkt: Tensor
    gamma_bfkt: Tensor
    evidence_bft: Tensor


class EStep:
    """Responsibilities gamma of a batch of clips, and the covariances weighted by them.

    Args:
        observed: spectrograms of the clips.
        template_dfmm: direction templates of the same frequencies, complex (D, F, M, M).
        diffuse: eps relative to the summed weights.
        density_generator: power and offset of the likelihood.
        bin_weight_bft: positive weights c_tf of the bins, which multiply gamma and the log-likelihood; None for 1.
    """

    def __init__(
        self,
        observed: ObservedSpectrogram,
        template_dfmm: Tensor,
        diffuse: float,
        density_generator: DensityGenerator,
        bin_weight_bft: Tensor | None = None,
    ) -> None:
        self.bin_weight_bft = bin_weight_bft
        self.power = density_generator.power
        self._offset_b111 = density_generator.offset_b[..., None, None, None]
        self._observed = observed
        self._template_dfmm = template_dfmm
        self._features_cd = template_features(template_dfmm).flatten(1).T.contiguous()
        self._diffuse = diffuse

    @property
    def num_bins(self) -> int:
        """Time-frequency bins of a clip, F T; weights of bins have a mean near 1."""
        return self._observed.features_bfct.shape[-3] * self._observed.features_bfct.shape[-1]

    def __call__(self, log_w_bkd: Tensor, pi_bk: Tensor) -> Expectation:
        """Responsibilities at the given direction weights and mixing levels."""
        tiny = torch.finfo(pi_bk.dtype).tiny
        scm_bkfmm = spatial_covariance(log_w_bkd.softmax(-1), self._template_dfmm, self._diffuse)
        inverse_bkfmm, logdet_bkf = inverse_and_logdet(scm_bkfmm)
        quad_bfkt = quadratic_form(self._observed, inverse_bkfmm).clamp_min_(0).add_(self._offset_b111)
        bias_bfk = (pi_bk.clamp_min(tiny).log()[..., None] - logdet_bkf).transpose(-2, -1)
        joint_bfkt = torch.add(bias_bfk[..., None], quad_bfkt.log(), alpha=-self.power)
        evidence_bft = joint_bfkt.logsumexp(dim=-2)
        gamma_bfkt = joint_bfkt.sub_(evidence_bft[..., None, :]).exp_()
        if self.bin_weight_bft is not None:
            gamma_bfkt = gamma_bfkt.mul_(self.bin_weight_bft[..., None, :])
            evidence_bft = evidence_bft * self.bin_weight_bft
        return Expectation(inverse_bkfmm, quad_bfkt, gamma_bfkt, evidence_bft)

    def square_responsibilities(self, expected: Expectation) -> Tensor:
        """sum_t c gamma^2 with gamma of sum 1, (B, K, F)."""
        square_bfkt = expected.gamma_bfkt.square()
        if self.bin_weight_bft is not None:
            square_bfkt = square_bfkt / self.bin_weight_bft[..., None, :]
        return square_bfkt.sum(-1).transpose(-2, -1)

    def weighted_covariance(self, expected: Expectation) -> Tensor:
        """Phi_fk = power sum_t gamma x x^H / (x^H P x + offset), (B, K, F, M, M)."""
        ratio_bfkt = expected.gamma_bfkt / expected.quad_bfkt
        phi_bfkc = self.power * (ratio_bfkt @ self._observed.features_bfct.transpose(-2, -1))
        return matrix_from_features(phi_bfkc.transpose(-3, -2))

    def project(self, matrix_bkfmm: Tensor) -> Tensor:
        """sum_f tr((G_fd + eps I) Q_f), (B, K, D); eps, relative to the summed weights, is part of each."""
        trace_bk1 = trace(matrix_bkfmm).sum(-1, keepdim=True)
        projected_bkd = form_coefficients(matrix_bkfmm).flatten(-2) @ self._features_cd
        return (projected_bkd + self._diffuse * trace_bk1).clamp_min(0)

    def information(self, inverse_bkfmm: Tensor) -> Tensor:
        """[power tr(P G_d P G_d) - (tr P G_d)^2] / (power + 1), eps I being part of G_d, (B, K, F, D)."""
        square_bkfmm = inverse_bkfmm @ inverse_bkfmm
        first_bkfd, second_bkfd = self._project_per_bin(inverse_bkfmm), self._project_per_bin(square_bkfmm)
        trace_bkf1, square_bkf1 = trace(inverse_bkfmm)[..., None], trace(square_bkfmm)[..., None]
        twice_bkfd = (
            self._form_squares(inverse_bkfmm, first_bkfd)
            + 2 * self._diffuse * second_bkfd
            + self._diffuse**2 * square_bkf1
        )
        once_bkfd = first_bkfd + self._diffuse * trace_bkf1
        return (self.power * twice_bkfd - once_bkfd.square()) / (self.power + 1)

    def _form_squares(self, inverse_bkfmm: Tensor, first_bkfd: Tensor) -> Tensor:
        """tr(P G_d P G_d), (B, K, F, D); the square of tr(P G_d) for templates of rank one."""
        template_dfmm = self._template_dfmm
        square_df, trace_df = template_dfmm.abs().square().sum((-2, -1)), trace(template_dfmm)
        if torch.allclose(square_df, trace_df.square(), rtol=1e-4):
            return first_bkfd.square()
        # One class at a time: all of them need a hundred megabytes and more a clip.
        classes = [inverse_bkfmm[:, k, None] @ template_dfmm for k in range(inverse_bkfmm.shape[1])]
        squares = [(pg_bdfmm * pg_bdfmm.transpose(-2, -1)).real.sum((-2, -1)) for pg_bdfmm in classes]
        return torch.stack(squares, dim=1).transpose(-2, -1)

    def _project_per_bin(self, matrix_bkfmm: Tensor) -> Tensor:
        """a_fd^H Q_f a_fd, (B, K, F, D)."""
        b, k, f, _, _ = matrix_bkfmm.shape
        coefficients_fnc = form_coefficients(matrix_bkfmm).flatten(0, 1).transpose(0, 1)
        features_fcd = self._features_cd.unflatten(0, (f, -1))
        return (coefficients_fnc @ features_fcd).transpose(0, 1).reshape(b, k, f, -1)


def trace(matrix: Tensor) -> Tensor:
    """Traces of Hermitian matrices (..., M, M)."""
    return matrix.diagonal(dim1=-2, dim2=-1).real.sum(-1)
