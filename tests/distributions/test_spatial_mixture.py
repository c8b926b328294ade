import itertools
import math

import pytest
import torch
from torch import Size, Tensor

from avssl_pyro.acoustics.covariance import template_covariances
from avssl_pyro.distributions.profiled_gaussian import observe
from avssl_pyro.distributions.spatial_mixture import SpatialMixture

F, D, T = 3, 5, 4
DIFFUSE = 0.1


def steering(m: int) -> Tensor:
    return torch.exp(2j * math.pi * torch.rand(F, D, m, dtype=torch.float64))


def mixture(m: int, k: int, *batch: int, psd: bool = False, frames: int = T) -> SpatialMixture:
    return SpatialMixture(
        template_covariances(steering(m)),
        torch.rand(*batch, k, D, dtype=torch.float64) + 0.01,
        torch.rand(*batch, k, dtype=torch.float64).softmax(-1),
        num_frames=frames,
        diffuse=DIFFUSE,
        psd_bfkt=torch.rand(*batch, F, k, frames, dtype=torch.float64) + 0.1 if psd else None,
    )


def spectrogram(m: int, *batch: int) -> Tensor:
    return torch.randn(*batch, F, m, T, dtype=torch.complex128)


def naive_log_prob(given: SpatialMixture, x_fmt: Tensor) -> Tensor:
    """Eqs. (8), (10), (15), (16) bin by bin for one clip, without any floor; also Eq. (8) where lambda is given."""
    m = x_fmt.shape[-2]
    share_kd = given.w / given.w.sum(-1, keepdim=True)
    total = torch.zeros((), dtype=torch.float64)
    for f in range(F):
        for t in range(x_fmt.shape[-1]):
            x_m = x_fmt[f, :, t]
            components = []
            for k in range(given.pi.shape[-1]):
                scm = (share_kd[k][:, None, None] * given.template_dfmm[:, f]).sum(0) + DIFFUSE * torch.eye(m)
                quad = (x_m.conj() @ torch.linalg.solve(scm, x_m)).real
                psd = quad / m if given.psd_bfkt is None else given.psd_bfkt[f, k, t]
                logdet = torch.linalg.slogdet(psd * scm).logabsdet
                components.append(given.pi[k].log() - m * math.log(math.pi) - logdet - quad / psd)
            total += torch.stack(components).logsumexp(0)
    return total


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)


@pytest.mark.parametrize(("m", "k"), [(2, 1), (2, 3), (4, 2), (6, 4)])
@pytest.mark.parametrize("psd", [False, True], ids=["profiled", "psd"])
def test_log_prob_is_the_dense_complex_computation(m: int, k: int, psd: bool) -> None:
    given, x_fmt = mixture(m, k, psd=psd), spectrogram(m)
    torch.testing.assert_close(given.log_prob(x_fmt), naive_log_prob(given, x_fmt), rtol=1e-8, atol=0)


@pytest.mark.parametrize("psd", [False, True], ids=["profiled", "psd"])
@pytest.mark.parametrize(("particles", "batch"), [((), (2,)), ((3,), (2,)), ((2, 3), (1,)), ((4,), (1, 2))])
def test_particles_and_clips_are_evaluated_one_by_one(
    particles: tuple[int, ...], batch: tuple[int, ...], psd: bool
) -> None:
    given, x_bfmt = mixture(3, 2, *particles, *batch, psd=psd), spectrogram(3, *batch)
    found = given.log_prob(x_bfmt)
    assert found.shape == (*particles, *batch)
    expanded = x_bfmt.expand(*particles, *batch, F, 3, T)
    for at in itertools.product(*(range(size) for size in found.shape)):
        lambda_fkt = None if given.psd_bfkt is None else given.psd_bfkt[at]
        single = SpatialMixture(
            given.template_dfmm, given.w[at], given.pi[at], num_frames=T, diffuse=DIFFUSE, psd_bfkt=lambda_fkt
        )
        torch.testing.assert_close(found[at], single.log_prob(expanded[at]))


def test_observing_once_gives_the_same() -> None:
    given, x_bfmt = mixture(3, 2, 2), spectrogram(3, 2)
    assert torch.equal(given.log_prob(observe(x_bfmt)), given.log_prob(x_bfmt))
    assert torch.equal(given.masks(observe(x_bfmt)), given.masks(x_bfmt))


def test_one_source_with_a_psd_is_a_multivariate_normal_of_real_and_imaginary_parts() -> None:
    given, x_fmt = mixture(3, 1, psd=True), spectrogram(3)
    assert given.psd_bfkt is not None
    cov_ftmm = given.psd_bfkt[:, 0, :, None, None] * given.scm_bkfmm[0][:, None]
    real_cov = torch.cat(
        [torch.cat([cov_ftmm.real, -cov_ftmm.imag], -1), torch.cat([cov_ftmm.imag, cov_ftmm.real], -1)], -2
    )
    normal = torch.distributions.MultivariateNormal(torch.zeros(6, dtype=torch.float64), real_cov / 2)
    x_ftm = x_fmt.transpose(-2, -1)
    expected = normal.log_prob(torch.cat([x_ftm.real, x_ftm.imag], -1)).sum()
    torch.testing.assert_close(given.log_prob(x_fmt), expected)


@pytest.mark.parametrize("spread", [0.01, 1.0, 5.0])
def test_profiled_density_is_an_upper_bound_over_all_psds(spread: float) -> None:
    given, x_bfmt = mixture(4, 3, 2), spectrogram(4, 2)
    best = given.component_log_prob(x_bfmt)
    quad_over_m = (
        torch.einsum("bfmt,bkfmn,bfnt->bfkt", x_bfmt.conj(), torch.linalg.inv(given.scm_bkfmm), x_bfmt).real / 4
    )
    for offset in (0.0, spread, -spread):
        given.psd_bfkt = quad_over_m * math.exp(offset)
        # The power floor, 1e-10 of the mean power, costs the profiled density this little.
        assert (given.component_log_prob(x_bfmt) <= best + 1e-6).all()
        if offset == 0.0:
            torch.testing.assert_close(given.component_log_prob(x_bfmt), best, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128])
@pytest.mark.parametrize("scale", [1e-25, 1e-3, 1e4, 1e25])
def test_gain_shifts_log_prob_by_its_jacobian_and_leaves_masks_alone(dtype: torch.dtype, scale: float) -> None:
    m, x_bfmt = 4, spectrogram(4, 2).to(dtype)
    double = mixture(m, 3, 2)
    real = x_bfmt.real.dtype
    given = SpatialMixture(
        double.template_dfmm.to(dtype), double.w.to(real), double.pi.to(real), num_frames=T, diffuse=DIFFUSE
    )
    shift = given.log_prob(scale * x_bfmt) - given.log_prob(x_bfmt)
    tolerance = 1e-4 if dtype == torch.complex64 else 1e-9
    assert shift.tolist() == pytest.approx([-2 * m * T * F * math.log(scale)] * 2, rel=tolerance)
    torch.testing.assert_close(given.masks(scale * x_bfmt), given.masks(x_bfmt), rtol=tolerance, atol=tolerance)


def test_only_ratios_of_weights_matter() -> None:
    given, x_bfmt = mixture(3, 2, 2), spectrogram(3, 2)
    louder = SpatialMixture(given.template_dfmm, 1e6 * given.w, given.pi, num_frames=T, diffuse=DIFFUSE)
    torch.testing.assert_close(louder.log_prob(x_bfmt), given.log_prob(x_bfmt))


@pytest.mark.parametrize("psd", [False, True], ids=["profiled", "psd"])
def test_masks_are_the_derivatives_by_log_levels(psd: bool) -> None:
    given, x_bfmt = mixture(3, 4, 2, psd=psd), spectrogram(3, 2)
    log_pi_bk = given.pi.log().requires_grad_()
    given.pi = log_pi_bk.exp()
    mask_bfkt = given.masks(x_bfmt).detach()
    assert mask_bfkt.shape == (2, F, 4, T)
    torch.testing.assert_close(mask_bfkt.sum(-2), torch.ones(2, F, T, dtype=torch.float64))
    (grad_bk,) = torch.autograd.grad(given.log_prob(x_bfmt).sum(), log_pi_bk)
    torch.testing.assert_close(grad_bk, mask_bfkt.sum((1, 3)))


def test_mask_finds_the_source_of_a_plane_wave() -> None:
    a_fdm = steering(4)
    w_kd = torch.full((2, D), 1e-3, dtype=torch.float64)
    w_kd[0, 1] = w_kd[1, 3] = 1.0
    signal_ft = torch.randn(F, T, dtype=torch.complex128)
    first = (torch.arange(T) % 2 == 0).to(torch.complex128)
    x_fmt = torch.einsum("fdm,dt,ft->fmt", a_fdm[:, [1, 3]], torch.stack([first, 1 - first]), signal_ft)
    given = SpatialMixture(template_covariances(a_fdm), w_kd, torch.tensor([0.5, 0.5]).double(), num_frames=T)
    assert (given.masks(x_fmt)[:, 0] > 0.5).equal((first.real > 0.5).expand(F, T))


def test_gradients_pass_gradcheck() -> None:
    given, x_bfmt = mixture(3, 2, 1), spectrogram(3, 1)
    log_w = given.w.log().requires_grad_()
    logit = given.pi.log().requires_grad_()

    def log_prob(log_w: Tensor, logit: Tensor) -> Tensor:
        return SpatialMixture(
            given.template_dfmm, log_w.exp(), logit.softmax(-1), num_frames=T, diffuse=DIFFUSE
        ).log_prob(x_bfmt)

    assert torch.autograd.gradcheck(log_prob, (log_w, logit))


def test_samples_have_the_covariance_of_the_mixture() -> None:
    frames, m = 6000, 3
    given = mixture(m, 2, frames=frames)
    lambda_fk = torch.rand(F, 2, dtype=torch.float64) + 0.5
    given.psd_bfkt = lambda_fk[..., None].expand(F, 2, frames)
    x_fmt = given.sample()
    assert x_fmt.shape == given.event_shape
    outer_fmmt = x_fmt[:, :, None] * x_fmt[:, None].conj()
    expected_fmm = torch.einsum("k,fk,kfmn->fmn", given.pi.to(x_fmt.dtype), lambda_fk.to(x_fmt.dtype), given.scm_bkfmm)
    for part in (torch.real, torch.imag):
        error = part(outer_fmmt.mean(-1) - expected_fmm)
        standard_error = part(outer_fmmt).std(-1) / math.sqrt(frames)
        assert (error.abs() <= 5 * standard_error + 1e-12).all()
    # Circular: the pseudo-covariance x x^T vanishes.
    pseudo = x_fmt[:, :, None] * x_fmt[:, None]
    assert (pseudo.mean(-1).abs() <= 6 * pseudo.abs().std(-1) / math.sqrt(frames)).all()


def test_every_bin_of_a_sample_comes_from_one_source() -> None:
    """Levels decide how often a source speaks, its power how loud: bins are not mixed."""
    given = mixture(3, 2, frames=2000)
    given.psd_bfkt = torch.tensor([1.0, 1e8]).double()[:, None].expand(F, 2, 2000)
    given.pi = torch.tensor([0.75, 0.25]).double()
    loud = given.sample().abs().square().mean(-2) > 1e4
    standard_error = math.sqrt(0.75 * 0.25 / loud.numel())
    assert abs(loud.double().mean().item() - 0.25) < 5 * standard_error


def test_shapes_and_seed_of_samples() -> None:
    given = mixture(3, 2, 4, psd=True)
    torch.manual_seed(5)
    first = given.sample((7, 2))
    assert first.shape == (7, 2, 4, F, 3, T)
    assert first.dtype == torch.complex128
    log_prob_b = given.log_prob(first)
    assert log_prob_b.shape == (7, 2, 4)
    torch.testing.assert_close(log_prob_b[3, 1], given.log_prob(first[3, 1]))
    torch.manual_seed(5)
    assert torch.equal(given.sample((7, 2)), first)


def test_profiled_mixture_says_why_it_cannot_be_sampled() -> None:
    with pytest.raises(NotImplementedError, match="give psd_bfkt"):
        mixture(2, 2).sample()


@pytest.mark.parametrize("psd", [False, True], ids=["profiled", "psd"])
def test_expanded_mixture_repeats_every_clip(psd: bool) -> None:
    given, x_bfmt = mixture(3, 2, 2, psd=psd), spectrogram(3, 2)
    expanded = given.expand([5, 2])
    assert expanded.batch_shape == Size([5, 2])
    assert expanded.event_shape == given.event_shape
    torch.testing.assert_close(expanded.log_prob(x_bfmt), given.log_prob(x_bfmt).expand(5, 2))
    if psd:
        assert expanded.sample().shape == (5, 2, F, 3, T)


def test_particles_of_one_mixture_meet_a_batch_of_clips() -> None:
    given, x_bfmt = mixture(3, 2, 4, 1), spectrogram(3, 5)
    found = given.log_prob(x_bfmt)
    assert found.shape == (4, 5)
    single = SpatialMixture(given.template_dfmm, given.w[2, 0], given.pi[2, 0], num_frames=T, diffuse=DIFFUSE)
    torch.testing.assert_close(found[2, 3], single.log_prob(x_bfmt[3]))


def test_psds_of_many_clips_share_one_mixture() -> None:
    given = mixture(3, 2, psd=True)
    psd_bfkt = torch.rand(4, F, 2, T, dtype=torch.float64) + 0.1
    shared = SpatialMixture(given.template_dfmm, given.w, given.pi, num_frames=T, diffuse=DIFFUSE, psd_bfkt=psd_bfkt)
    assert shared.batch_shape == Size([4])
    x_bfmt = shared.sample()
    given.psd_bfkt = psd_bfkt[1]
    torch.testing.assert_close(shared.log_prob(x_bfmt)[1], given.log_prob(x_bfmt[1]))


def test_levels_shared_by_particles_of_weights_broadcast() -> None:
    given, x_bfmt = mixture(3, 2, 4, 2), spectrogram(3, 2)
    shared = SpatialMixture(given.template_dfmm, given.w, given.pi[0], num_frames=T, diffuse=DIFFUSE)
    assert shared.batch_shape == Size([4, 2])
    assert shared.log_prob(x_bfmt).shape == (4, 2)
    torch.testing.assert_close(shared.log_prob(x_bfmt)[0], given.log_prob(x_bfmt)[0])


@pytest.mark.parametrize(
    ("w", "pi", "words"),
    [
        ((2, D + 1), (2,), f"D = {D}"),
        ((2, D), (3,), "same K"),
    ],
)
def test_parameters_whose_shapes_disagree_are_refused(w: tuple[int, ...], pi: tuple[int, ...], words: str) -> None:
    template_dfmm = template_covariances(steering(3))
    with pytest.raises(ValueError, match=words):
        SpatialMixture(template_dfmm, torch.ones(w), torch.ones(pi) / pi[-1], num_frames=T)


@pytest.mark.parametrize("shape", [(F, 2, T + 1), (F + 1, 2, T), (F, 3, T), (2, T)])
def test_psd_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    given = mixture(3, 2)
    with pytest.raises(ValueError, match="psd_bfkt"):
        SpatialMixture(given.template_dfmm, given.w, given.pi, num_frames=T, psd_bfkt=torch.ones(shape))


@pytest.mark.parametrize(
    ("dtype", "diffuse"),
    [(torch.complex64, 0.0), (torch.complex64, 1e-5), (torch.complex128, 1e-12), (torch.complex128, float("nan"))],
)
def test_too_little_diffuse_noise_is_refused(dtype: torch.dtype, diffuse: float) -> None:
    given = mixture(3, 2)
    with pytest.raises(ValueError, match="diffuse"):
        SpatialMixture(given.template_dfmm.to(dtype), given.w, given.pi, num_frames=T, diffuse=diffuse)


@pytest.mark.parametrize("shape", [(F, 3, T + 1), (F, 2, T), (3, 3)])
def test_spectrogram_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="shape"):
        mixture(3, 2).log_prob(torch.zeros(shape, dtype=torch.complex128))


@pytest.mark.parametrize(
    ("w", "pi"), [((-1.0, 1.0), (0.5, 0.5)), ((1.0, 1.0), (0.5, 0.6)), ((1.0, math.nan), (0.5, 0.5))]
)
def test_impossible_parameters_are_refused(w: tuple[float, float], pi: tuple[float, float]) -> None:
    template_dfmm = template_covariances(steering(3))
    with pytest.raises(ValueError, match="constraint"):
        SpatialMixture(
            template_dfmm, torch.tensor(w).double()[:, None].expand(2, D), torch.tensor(pi).double(), num_frames=T
        )
