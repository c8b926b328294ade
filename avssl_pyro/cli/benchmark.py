"""Measures speed and memory: ratios of things timed alternately in one run, for absolute times drift."""

import contextlib
import math
import resource
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
import tyro
from rich import box
from rich.console import Console
from rich.table import Table
from torch import Tensor
from torch.distributions import Dirichlet

from avssl_pyro.acoustics.covariance import spatial_covariance
from avssl_pyro.acoustics.presets import resolve_array
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.batch import collate_clips
from avssl_pyro.benchmarks.method_suite import system_band_hz
from avssl_pyro.clip import CLIP_SAMPLES, IMAGE_COLUMNS, IMAGE_ROWS, Clip
from avssl_pyro.criticism.closed_form import kl_dirichlet, kl_log_normal
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import generate
from avssl_pyro.datasets.loader import make_loader
from avssl_pyro.datasets.sampling import WindowShuffleSampler
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.distributions.profiled_gaussian import component_log_likelihood, observe
from avssl_pyro.errors import InputError
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.pretrained import load_pretrained
from avssl_pyro.systems.system import System, SystemConfig, build_system
from avssl_pyro.training.elbo_terms import TraceMeanFieldELBOWithTerms
from avssl_pyro.training.process import keep_freed_memory


@dataclass(frozen=True)
class BenchmarkOptions:
    """Time training steps, reading and localization, and measure their memory, on clips of noise."""

    array: str = "circle6"
    """Microphone array."""
    batch_size: int = 16
    """Clips per training step."""
    repeats: int = 20
    """Timings of each thing; medians are shown."""
    data: tuple[Path, ...] = ()
    """Folders of shards to read; by default a few scenes made for the purpose."""

    def __post_init__(self) -> None:
        if self.repeats < 2 or self.batch_size < 1:
            raise InputError(
                f"--repeats {self.repeats} and --batch-size {self.batch_size} must be at least 2 and at least 1."
            )


@dataclass(frozen=True)
class Measurement:
    """Median milliseconds of things timed in turn.

    Args:
        milliseconds: by name, in the order measured.
        peak_gib: most memory the process held.
    """

    milliseconds: dict[str, float] = field(default_factory=dict)
    peak_gib: float = 0.0


def main(args: Sequence[str] | None = None) -> None:
    """Runs the command with ``args`` (by default those of the process)."""
    options = tyro.cli(BenchmarkOptions, args=args)
    console = Console()
    training = _in_fresh_process(_training, options)
    pyro_ms, plain_ms = training.milliseconds.values()
    table = Table(
        "training step", "ms", "clips/s", title=f"batch {options.batch_size}, {options.array}", box=box.SIMPLE_HEAD
    )
    for name, ms in training.milliseconds.items():
        table.add_row(name, f"{ms:.0f}", f"{1e3 * options.batch_size / ms:.1f}")
    console.print(table)
    console.print(f"Pyro / plain torch: {pyro_ms / plain_ms:.3f}    peak memory {training.peak_gib:.2f} GiB\n")
    with _scenes(options) as folders:
        reading = _in_fresh_process(_reading, replace(options, data=folders))
    table = Table("reading shards", "clips/s", "of training", box=box.SIMPLE_HEAD)
    for name, ms in reading.milliseconds.items():
        table.add_row(name, f"{1e3 / ms:.0f}", f"{pyro_ms / options.batch_size / ms:.1f}")
    console.print(table)
    console.print(f"peak memory {reading.peak_gib:.2f} GiB\n")
    localizing = _in_fresh_process(_localizing, options)
    music_ms = localizing.milliseconds["music"]
    table = Table("localizing", "ms/clip", "of music", box=box.SIMPLE_HEAD)
    for name, ms in localizing.milliseconds.items():
        table.add_row(name, f"{ms:.1f}", f"{ms / music_ms:.2f}")
    console.print(table)
    console.print(f"peak memory {localizing.peak_gib:.2f} GiB")


@contextlib.contextmanager
def _scenes(options: BenchmarkOptions) -> Iterator[tuple[Path, ...]]:
    if options.data:
        yield options.data
        return
    with TemporaryDirectory() as folder:
        simulator = SceneSimulator(array=resolve_array(options.array))
        generate(plan_scenes(Path(folder), simulator, 2 * options.batch_size, options.batch_size), workers=1)
        yield (Path(folder),)


def _in_fresh_process(
    measure: Callable[[BenchmarkOptions], dict[str, float]], options: BenchmarkOptions
) -> Measurement:
    """Peak memory is a property of a process, so every measurement gets one of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_measured, measure, options).result()


def _measured(measure: Callable[[BenchmarkOptions], dict[str, float]], options: BenchmarkOptions) -> Measurement:
    keep_freed_memory()
    milliseconds = measure(options)
    return Measurement(milliseconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)


def _training(options: BenchmarkOptions) -> dict[str, float]:
    torch.manual_seed(0)
    system = build_system(SystemConfig(resolve_array(options.array)))
    batch = collate_clips(_noise(options))
    image_bcij = batch.image_float()
    loss_module = TraceMeanFieldELBOWithTerms()(system.model, system.guide).train()
    optimizer = torch.optim.AdamW(loss_module.parameters())

    def step(loss: Callable[[Tensor, Tensor], Tensor]) -> None:
        x_bfmt = stft(batch.audio_bmn, system.config.stft)
        (loss(x_bfmt, image_bcij) / x_bfmt.numel()).backward()
        torch.nn.utils.clip_grad_norm_(loss_module.parameters(), 1.0)
        optimizer.step()
        optimizer.zero_grad()

    return _alternate(
        {
            "Pyro (TraceMeanField_ELBO)": lambda: step(loss_module),
            "plain torch, by hand": lambda: step(lambda x, image: plain_loss(system, x, image)),
        },
        options.repeats,
    )


def plain_loss(system: System, x_bfmt: Tensor, image_bcij: Tensor) -> Tensor:
    """The negative ELBO as one would write it without Pyro, with the same networks and the same fast likelihood."""
    guide, sizes = system.guide, system.config.model
    assert isinstance(guide, AmortizedGuide)
    mu_bkd, _ = guide.log_weights(image_bcij)
    feature_bcdt = guide.audio.direction_features(x_bfmt)
    sigma_k = guide.log_sigma_k.exp()
    w_bkd = (mu_bkd + sigma_k[:, None] * torch.randn_like(mu_bkd)).exp()
    concentration_bk = guide.concentration(feature_bcdt, w_bkd)
    pi_bk = Dirichlet(concentration_bk).rsample()
    scm_bkfmm = spatial_covariance(w_bkd, system.model.template_dfmm, sizes.diffuse)
    log_pi = pi_bk.clamp_min(torch.finfo(pi_bk.dtype).tiny).log()[:, None, :, None]
    log_likelihood = (log_pi + component_log_likelihood(observe(x_bfmt), scm_bkfmm)).logsumexp(-2).sum()
    kl = kl_log_normal(mu_bkd, sigma_k, sizes.sigma).sum() + kl_dirichlet(concentration_bk, sizes.alpha).sum()
    return kl - sizes.bin_weight * log_likelihood


def _reading(options: BenchmarkOptions) -> dict[str, float]:
    """Milliseconds per clip, read as training does by default: in its own process."""
    dataset = SceneDataset(options.data, resolve_array(options.array))
    sampler = WindowShuffleSampler(dataset.shard_sizes, options.batch_size)
    epochs = -(-(10 * options.repeats + 1) // sampler.steps_per_epoch)
    batches = iter(make_loader(dataset, [indices for epoch in range(epochs) for indices in sampler.at(epoch)]))
    next(batches)
    start = time.perf_counter()
    clips = sum(len(batch) for batch in batches)
    return {"into batches": 1e3 * (time.perf_counter() - start) / clips}


def _localizing(options: BenchmarkOptions) -> dict[str, float]:
    """Milliseconds per clip; the baselines search the system's own grid and band."""
    system = load_pretrained(resolve_array(options.array)).system
    amortized = Localizer(system)
    # A tolerance that nothing meets: every clip takes all rounds, as in the slowest case.
    refined = Localizer(system, refinement=RefinementConfig(tolerance=-math.inf))
    clips = _noise(options)
    baselines = default_baselines(system.config.array, system.config.grid, freq_range_hz=system_band_hz(system))
    contenders: dict[str, Callable[[], Any]] = {
        baseline.name: partial(baseline.observe_all, clips) for baseline in baselines
    }
    contenders["amortized, one by one"] = lambda: [amortized.posteriors([clip]) for clip in clips]
    contenders["refined, one by one"] = lambda: [refined.posteriors([clip]) for clip in clips]
    contenders[f"amortized, batch of {len(clips)}"] = lambda: amortized.posteriors(clips)
    contenders[f"refined, batch of {len(clips)}"] = lambda: refined.posteriors(clips)
    return {name: ms / len(clips) for name, ms in _alternate(contenders, options.repeats // 2).items()}


def _alternate(contenders: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Median milliseconds of each, timed in turn after one warm-up."""
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for repeat in range(repeats + 1):
        for name, work in contenders.items():
            start = time.perf_counter()
            work()
            if repeat:
                seconds[name].append(time.perf_counter() - start)
    return {name: 1e3 * statistics.median(values) for name, values in seconds.items()}


def _noise(options: BenchmarkOptions) -> list[Clip]:
    rng = np.random.default_rng(0)
    channels = resolve_array(options.array).num_microphones
    return [
        Clip(
            key=str(index),
            audio_mn=rng.normal(0, 0.1, (channels, CLIP_SAMPLES)).astype(np.float32),
            image_ijc=rng.integers(0, 256, (IMAGE_ROWS, IMAGE_COLUMNS, 3), dtype=np.uint8),
        )
        for index in range(options.batch_size)
    ]
