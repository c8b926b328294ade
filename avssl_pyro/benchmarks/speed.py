"""Speed and memory: ratios of tasks timed alternately in one run, since absolute times drift."""

import contextlib
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.distributions import Dirichlet

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.acoustics.covariance import spatial_covariance
from avssl_pyro.acoustics.stft import stft
from avssl_pyro.batch import collate_clips
from avssl_pyro.benchmarks.comparison import system_band_hz
from avssl_pyro.clip import CLIP_SAMPLES, IMAGE_COLUMNS, IMAGE_ROWS, Clip
from avssl_pyro.criticism.closed_form import kl_dirichlet, kl_log_normal
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.generation import generate
from avssl_pyro.datasets.sampling import WindowShuffleSampler, make_loader
from avssl_pyro.datasets.scene_plan import plan_scenes
from avssl_pyro.distributions.profiled_gaussian import component_log_likelihood, observe
from avssl_pyro.evaluation.baselines import default_baselines
from avssl_pyro.evaluation.tables import Column, Table
from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.guides.refinement_config import RefinementConfig
from avssl_pyro.localization.localizer import Localizer
from avssl_pyro.simulation.scenes import SceneSimulator
from avssl_pyro.systems.pretrained import load_pretrained
from avssl_pyro.systems.system import System, SystemConfig, build_system
from avssl_pyro.training.elbo_terms import TraceMeanFieldELBOWithTerms
from avssl_pyro.training.process import keep_freed_memory

Measure = Callable[["SpeedConfig"], dict[str, float]]


@dataclass(frozen=True)
class SpeedConfig:
    """Sizes of the measurements.

    Args:
        array: microphone array.
        batch_size: number of clips per training step.
        repeats: number of timings of each task; medians are shown.
        data: folders of shards to read; by default a few scenes made for the purpose.
    """

    array: MicrophoneArray
    batch_size: int = 16
    repeats: int = 20
    data: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Measurement:
    """Median milliseconds of things timed in turn.

    Args:
        milliseconds: by name, in the order measured.
        peak_gib: most memory the process held.
    """

    milliseconds: dict[str, float] = field(default_factory=dict)
    peak_gib: float = 0.0


def measure_speed(config: SpeedConfig) -> Iterator[Table[tuple[str, float]]]:
    """Tables of training, reading and localization, each as soon as it is measured."""
    training = _in_fresh_process(_training, config)
    pyro_ms, plain_ms = training.milliseconds.values()
    columns: list[Column[tuple[str, float]]] = [
        Column("training step", lambda row: row[0]),
        Column("ms", lambda row: row[1], "{:.0f}"),
        Column("clips/s", lambda row: 1e3 * config.batch_size / row[1], "{:.1f}"),
    ]
    yield _table(
        training,
        columns,
        f"batch {config.batch_size}, {config.array.name}",
        f"Pyro / plain torch: {pyro_ms / plain_ms:.3f}",
    )
    with _scenes(config) as folders:
        reading = _in_fresh_process(_reading, replace(config, data=folders))
    columns = [
        Column("reading shards", lambda row: row[0]),
        Column("clips/s", lambda row: 1e3 / row[1], "{:.0f}"),
        Column("of training", lambda row: pyro_ms / config.batch_size / row[1], "{:.1f}"),
    ]
    yield _table(reading, columns)
    localizing = _in_fresh_process(_localizing, config)
    music_ms = localizing.milliseconds["music"]
    columns = [
        Column("localizing", lambda row: row[0]),
        Column("ms/clip", lambda row: row[1], "{:.1f}"),
        Column("of music", lambda row: row[1] / music_ms, "{:.2f}"),
    ]
    yield _table(localizing, columns)


def _table(
    measured: Measurement, columns: list[Column[tuple[str, float]]], title: str = "", *notes: str
) -> Table[tuple[str, float]]:
    memory = f"peak memory {measured.peak_gib:.2f} GiB"
    return Table(list(measured.milliseconds.items()), columns, title, (*notes, memory))


@contextlib.contextmanager
def _scenes(config: SpeedConfig) -> Iterator[tuple[Path, ...]]:
    if config.data:
        yield config.data
        return
    with TemporaryDirectory() as folder:
        simulator = SceneSimulator(array=config.array)
        generate(plan_scenes(Path(folder), simulator, 2 * config.batch_size, config.batch_size), workers=1)
        yield (Path(folder),)


def _in_fresh_process(measure: Measure, config: SpeedConfig) -> Measurement:
    """Peak memory is a property of a process, so every measurement gets one of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(_measured, measure, config).result()


def _measured(measure: Measure, config: SpeedConfig) -> Measurement:
    keep_freed_memory()
    milliseconds = measure(config)
    return Measurement(milliseconds, _peak_gib())


def _peak_gib() -> float:
    """Most memory this process held; NaN on systems that do not report it."""
    try:
        import resource  # noqa: PLC0415
    except ImportError:
        return math.nan
    # Linux counts in KiB, macOS in bytes.
    unit = 1 if sys.platform == "darwin" else 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30


def _training(config: SpeedConfig) -> dict[str, float]:
    torch.manual_seed(0)
    system = build_system(SystemConfig(config.array))
    batch = collate_clips(_noise(config))
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
        config.repeats,
    )


def plain_loss(system: System, x_bfmt: Tensor, image_bcij: Tensor) -> Tensor:
    """The negative ELBO as one would write it without Pyro, with the same networks and the same fast likelihood."""
    guide, sizes = system.guide, system.config.model
    assert isinstance(guide, AmortizedGuide)
    mu_bkd, _ = guide.log_weights(image_bcij)
    feature_bcdt = guide.audio.direction_features(x_bfmt)
    sigma_k = guide.log_sigma_k.exp()
    w_bkd = (mu_bkd + sigma_k[:, None] * torch.randn_like(mu_bkd)).exp()
    concentration_bk = guide.concentration(guide.source_features(feature_bcdt, w_bkd))
    pi_bk = Dirichlet(concentration_bk).rsample()
    scm_bkfmm = spatial_covariance(w_bkd, system.model.template_dfmm, sizes.diffuse)
    log_pi = pi_bk.clamp_min(torch.finfo(pi_bk.dtype).tiny).log()[:, None, :, None]
    log_likelihood = (log_pi + component_log_likelihood(observe(x_bfmt), scm_bkfmm)).logsumexp(-2).sum()
    kl = kl_log_normal(mu_bkd, sigma_k, sizes.sigma).sum() + kl_dirichlet(concentration_bk, sizes.alpha).sum()
    return kl - sizes.bin_weight * log_likelihood


def _reading(config: SpeedConfig) -> dict[str, float]:
    """Milliseconds per clip, read as training does by default: in its own process."""
    dataset = SceneDataset(config.data, config.array)
    sampler = WindowShuffleSampler(dataset.shard_sizes, config.batch_size)
    epochs = -(-(10 * config.repeats + 1) // sampler.steps_per_epoch)
    batches = iter(make_loader(dataset, [indices for epoch in range(epochs) for indices in sampler.at(epoch)]))
    next(batches)
    start = time.perf_counter()
    clips = sum(len(batch) for batch in batches)
    return {"into batches": 1e3 * (time.perf_counter() - start) / clips}


def _localizing(config: SpeedConfig) -> dict[str, float]:
    """Milliseconds per clip; the baselines search the system's own grid and band."""
    system = load_pretrained(config.array).system
    amortized = Localizer(system)
    # A tolerance that nothing meets: every clip takes all rounds, as in the slowest case.
    refined = Localizer(system, refinement=RefinementConfig(tolerance=-math.inf))
    clips = _noise(config)
    baselines = default_baselines(system.config.array, system.config.grid, freq_range_hz=system_band_hz(system))
    contenders: dict[str, Callable[[], Any]] = {
        baseline.name: partial(baseline.observe_all, clips) for baseline in baselines
    }
    contenders["amortized, one by one"] = lambda: [amortized.posteriors([clip]) for clip in clips]
    contenders["refined, one by one"] = lambda: [refined.posteriors([clip]) for clip in clips]
    contenders[f"amortized, batch of {len(clips)}"] = lambda: amortized.posteriors(clips)
    contenders[f"refined, batch of {len(clips)}"] = lambda: refined.posteriors(clips)
    return {name: ms / len(clips) for name, ms in _alternate(contenders, config.repeats // 2).items()}


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


def _noise(config: SpeedConfig) -> list[Clip]:
    rng = np.random.default_rng(0)
    channels = config.array.num_microphones
    return [
        Clip(
            key=str(index),
            audio_mn=rng.normal(0, 0.1, (channels, CLIP_SAMPLES)).astype(np.float32),
            image_ijc=rng.integers(0, 256, (IMAGE_ROWS, IMAGE_COLUMNS, 3), dtype=np.uint8),
        )
        for index in range(config.batch_size)
    ]
