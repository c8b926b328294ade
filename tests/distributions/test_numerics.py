"""No finite input makes the spatial mixture fail, or makes its value or a gradient NaN or infinite."""

import math

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from torch import Tensor

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.distributions.spatial_mixture import LEAST_DIFFUSE, SpatialMixture

F, D, T = 2, 6, 3
PRECISIONS = [torch.complex64, torch.complex128]


def silence(x_bfmt: Tensor) -> Tensor:
    return torch.zeros_like(x_bfmt)


def silent_frame(x_bfmt: Tensor) -> Tensor:
    x_bfmt[..., 1] = 0
    return x_bfmt


def one_silent_clip(x_bfmt: Tensor) -> Tensor:
    x_bfmt[0] = 0
    return x_bfmt


def dead_microphone(x_bfmt: Tensor) -> Tensor:
    x_bfmt[..., 1, :] = 0
    return x_bfmt


def single_microphone(x_bfmt: Tensor) -> Tensor:
    x_bfmt[..., 1:, :] = 0
    return x_bfmt


def identical_channels(x_bfmt: Tensor) -> Tensor:
    return x_bfmt[..., :1, :].expand_as(x_bfmt)


def clipped(x_bfmt: Tensor) -> Tensor:
    return torch.complex(x_bfmt.real.sign(), x_bfmt.imag.sign())


def one_loud_bin(x_bfmt: Tensor) -> Tensor:
    quiet = 1e-15 * x_bfmt
    quiet[:, 0, :, 0] = x_bfmt[:, 0, :, 0]
    return quiet


def as_it_is(x_bfmt: Tensor) -> Tensor:
    return x_bfmt


RECORDINGS = [
    silence,
    silent_frame,
    one_silent_clip,
    dead_microphone,
    single_microphone,
    identical_channels,
    clipped,
    one_loud_bin,
    as_it_is,
]


@pytest.mark.parametrize("dtype", PRECISIONS, ids=["complex64", "complex128"])
@given(
    seed=st.integers(0, 2**31),
    m=st.integers(2, 16),
    k=st.integers(1, 16),
    exponent=st.integers(-30, 30),
    spread=st.floats(0, 30),
    concentration=st.sampled_from([1e-3, 0.01, 1.0, 100.0]),
    recording=st.sampled_from(RECORDINGS),
    least=st.booleans(),
    coherent=st.booleans(),
)
@example(0, 16, 2, 0, 30.0, 0.01, as_it_is, True, True)
@example(0, 16, 16, 0, 30.0, 1e-3, identical_channels, False, True)
@settings(max_examples=60)
def test_value_and_gradients_stay_finite(
    dtype: torch.dtype,
    seed: int,
    m: int,
    k: int,
    exponent: int,
    spread: float,
    concentration: float,
    recording: object,
    least: bool,
    coherent: bool,
) -> None:
    torch.manual_seed(seed)
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    a_fdm = torch.exp(2j * math.pi * torch.rand(F, D, m, dtype=torch.float64)).to(dtype)
    x_bfmt = torch.randn(2, F, m, T, dtype=dtype)
    if coherent:
        # A wave straight from a candidate direction is the case in which sources differ most.
        x_bfmt = a_fdm[:, 0, :, None] * torch.randn(2, F, 1, T, dtype=dtype)
    x_bfmt = 10.0**exponent * recording(x_bfmt)  # type: ignore[operator]
    log_w_bkd = (spread * (2 * torch.rand(2, k, D, dtype=real) - 1)).requires_grad_()
    concentration_bk = torch.full((2, k), concentration, dtype=real, requires_grad=True)
    pi_bk = torch.distributions.Dirichlet(concentration_bk).rsample()
    mixture = SpatialMixture(
        template_covariances(a_fdm),
        log_w_bkd.exp(),
        pi_bk,
        num_frames=T,
        diffuse=LEAST_DIFFUSE[dtype] if least else 0.1,
    )
    log_prob_b = mixture.log_prob(x_bfmt)
    assert log_prob_b.isfinite().all()
    assert mixture.masks(x_bfmt).isfinite().all()
    grads = torch.autograd.grad(log_prob_b.sum(), (log_w_bkd, pi_bk, concentration_bk))
    for grad in grads:
        assert grad.isfinite().all()


@pytest.mark.parametrize("dtype", PRECISIONS, ids=["complex64", "complex128"])
@pytest.mark.parametrize("level", [0.0, 5e-324, 1e-45, "tiny", 1e-37, 1e-30])
def test_gradient_by_a_vanishing_level_stays_finite(dtype: torch.dtype, level: float | str) -> None:
    """The class of a level that has underflown may be the only one that fits: 16 microphones, one pure plane wave."""
    torch.manual_seed(0)
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    tiny = torch.finfo(real).tiny if level == "tiny" else float(level)
    a_fdm = torch.exp(2j * math.pi * torch.rand(F, D, 16, dtype=torch.float64)).to(dtype)
    x_bfmt = (a_fdm[:, 3, :, None] * torch.randn(F, 1, T, dtype=dtype))[None]
    w_bkd = torch.full((1, 2, D), 1e-9, dtype=real)
    w_bkd[0, 0, 0] = w_bkd[0, 1, 3] = 1.0
    pi_bk = torch.tensor([[1.0, tiny]], dtype=real, requires_grad=True)
    mixture = SpatialMixture(template_covariances(a_fdm), w_bkd, pi_bk, num_frames=T, diffuse=LEAST_DIFFUSE[dtype])
    log_prob_b = mixture.log_prob(x_bfmt)
    (grad_bk,) = torch.autograd.grad(log_prob_b.sum(), pi_bk)
    assert log_prob_b.isfinite().all()
    assert grad_bk.isfinite().all()


@pytest.mark.parametrize("dtype", PRECISIONS, ids=["complex64", "complex128"])
def test_single_precision_agrees_with_double(dtype: torch.dtype) -> None:
    """At the least diffuse power of each precision the likelihood is still right, not just finite."""
    torch.manual_seed(0)
    m, k = 8, 4
    a_fdm = torch.exp(2j * math.pi * torch.rand(F, D, m, dtype=torch.float64))
    x_bfmt = a_fdm[:, 0, :, None] * torch.randn(1, F, 1, T, dtype=torch.complex128) + 0.1 * torch.randn(1, F, m, T)
    log_w_bkd = 10 * torch.randn(1, k, D, dtype=torch.float64)
    pi_bk = torch.full((1, k), 1 / k, dtype=torch.float64)

    def log_prob(to: torch.dtype, real: torch.dtype) -> float:
        mixture = SpatialMixture(
            template_covariances(a_fdm.to(to)),
            log_w_bkd.to(real).exp(),
            pi_bk.to(real),
            num_frames=T,
            diffuse=LEAST_DIFFUSE[torch.complex64],
        )
        return mixture.log_prob(x_bfmt.to(to)).item()

    share = (log_w_bkd.softmax(-1)).to(torch.complex128)
    scm = torch.einsum("bkd,fdm,fdn->bkfmn", share, a_fdm, a_fdm.conj()) + 1e-3 * torch.eye(m)
    quad = torch.einsum("bfmt,bkfmn,bfnt->bkft", x_bfmt.conj(), torch.linalg.inv(scm), x_bfmt).real
    gauss = -m * (math.pi * quad / m).log() - torch.linalg.slogdet(scm).logabsdet[..., None] - m
    expected = (gauss.logsumexp(1) - math.log(k)).sum().item()
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    assert log_prob(dtype, real) == pytest.approx(expected, rel=1e-4 if real == torch.float32 else 1e-7)


@pytest.mark.parametrize("dtype", PRECISIONS, ids=["complex64", "complex128"])
@pytest.mark.parametrize("exponent", [-15, 0, 17])
def test_given_psd_stays_finite_at_any_amplitude(dtype: torch.dtype, exponent: int) -> None:
    torch.manual_seed(0)
    m, k = 4, 2
    real = torch.float32 if dtype == torch.complex64 else torch.float64
    a_fdm = torch.exp(2j * math.pi * torch.rand(F, D, m, dtype=torch.float64)).to(dtype)
    x_fmt = 10.0**exponent * silent_frame(torch.randn(F, m, T, dtype=dtype))
    # A power just inside the range of float32, some of it much larger than the recording's.
    psd_fkt = torch.full((F, k, T), 10.0 ** (2 * exponent), dtype=real)
    psd_fkt[0] *= 1e3
    mixture = SpatialMixture(
        template_covariances(a_fdm),
        torch.ones(k, D, dtype=real),
        torch.full((k,), 1 / k, dtype=real),
        num_frames=T,
        psd_bfkt=psd_fkt,
    )
    assert mixture.log_prob(x_fmt).isfinite()
    assert mixture.masks(x_fmt).isfinite().all()
