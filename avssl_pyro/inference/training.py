"""Stochastic variational inference over a data set: the training loop.

Everything random in a step (latent noise, dropout, the order of clips) is a function of (seed, step, rank), so a run
that was stopped anywhere and resumed gives the numbers of one that was not.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from pyro.infer import Trace_ELBO
from tqdm import tqdm

from avssl_pyro.acoustics.stft import stft
from avssl_pyro.data.batch import ClipBatch
from avssl_pyro.data.dataset import SceneDataset
from avssl_pyro.data.loader import make_loader
from avssl_pyro.data.sampling import WindowShuffleSampler
from avssl_pyro.inference.checkpoint import save_checkpoint
from avssl_pyro.inference.interruption import StopRequest
from avssl_pyro.inference.progress_log import ProgressLog
from avssl_pyro.inference.system import System
from avssl_pyro.inference.terms import ElboTerms, RecordingMeanFieldELBO, RecordsTerms
from avssl_pyro.inference.training_state import TrainingState

CHECKPOINT_NAME = "checkpoint.safetensors"


@dataclass(frozen=True)
class OptimizationConfig:
    """How a system is trained.

    Args:
        epochs: passes over the data.
        batch_size: clips per process and step.
        learning_rate: of AdamW, at its highest.
        weight_decay: of AdamW.
        warmup_steps: steps over which the learning rate rises from 0.
        final_learning_rate: learning rate of the last step as a share of the highest; a cosine leads there.
        gradient_clip: largest norm of the gradient of the ELBO per time-frequency bin.
        seed: of weights, noise and order.
        num_workers: processes that read ahead; 0 reads in the training process.
        log_every: steps between log records.
        checkpoint_minutes: minutes between checkpoints.
    """

    epochs: int = 5
    batch_size: int = 16
    learning_rate: float = 1e-3
    weight_decay: float = 1e-2
    warmup_steps: int = 100
    final_learning_rate: float = 0.02
    gradient_clip: float = 1.0
    seed: int = 0
    num_workers: int = 1
    log_every: int = 10
    checkpoint_minutes: float = 3.0


class TrainingDivergedError(RuntimeError):
    """A term of the ELBO or a gradient was not finite; tells the step, the term and the clips."""


def train(
    system: System,
    dataset: SceneDataset,
    config: OptimizationConfig,
    run_dir: Path,
    fabric: Fabric,
    estimator: Trace_ELBO | None = None,
    *,
    stop_after: int | None = None,
) -> None:
    """Trains ``system`` in place, or continues where ``run_dir`` left off.

    Leaves ``checkpoint.safetensors``, ``log.jsonl``, TensorBoard events and the state to resume from in ``run_dir``.

    Args:
        system: model and guide.
        dataset: clips of the system's array.
        config: optimization settings; must be those of the run that is continued.
        run_dir: folder of the run.
        fabric: devices, processes and precision; already launched.
        estimator: any Pyro ELBO with :class:`RecordsTerms`; the mean-field one (analytic KL) by default.
        stop_after: leave after this many steps in all, as if interrupted.

    Raises:
        TrainingDivergedError: see there; the last checkpoint stays.
        KeyboardInterrupt: ctrl-C or SIGTERM; raised after the state was saved.
    """
    estimator = estimator or RecordingMeanFieldELBO()
    assert isinstance(estimator, RecordsTerms)
    loss_module = estimator(system.model, system.guide).train()
    optimizer = torch.optim.AdamW(loss_module.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    sampler = WindowShuffleSampler(
        dataset.shard_sizes,
        config.batch_size,
        config.seed,
        num_replicas=fabric.world_size,
        rank=fabric.global_rank,
    )
    total_steps = config.epochs * sampler.steps_per_epoch
    state = TrainingState(run_dir, system, optimizer)
    first_step = state.load()
    module, fabric_optimizer = fabric.setup(loss_module, optimizer)
    log = ProgressLog(run_dir, first_step) if fabric.is_global_zero else None
    bar = tqdm(
        total=total_steps * sampler.global_batch_size,
        initial=first_step * sampler.global_batch_size,
        unit="clip",
        desc="training",
        disable=not fabric.is_global_zero,
        smoothing=0.05,
        mininterval=0.5,
    )
    last_save = last_log = time.monotonic()
    step = first_step
    with bar, StopRequest() as stop:
        for batch in _batches(dataset, sampler, config, first_step, total_steps, fabric.device):
            _seed_step(config.seed, step, fabric.global_rank)
            learning_rate = config.learning_rate * _schedule(step, total_steps, config)
            for group in optimizer.param_groups:
                group["lr"] = learning_rate
            x_bfmt = stft(batch.audio_bmn, system.config.stft)
            b, f, _, t = x_bfmt.shape
            loss = module(x_bfmt, batch.image_float()) / (b * f * t)
            assert estimator.terms is not None
            _check_finite(loss, estimator.terms, batch, step)
            fabric.backward(loss)
            norm = torch.nn.utils.clip_grad_norm_(loss_module.parameters(), config.gradient_clip)
            if not torch.isfinite(norm):
                raise TrainingDivergedError(_describe_gradient(loss_module, batch, step))
            fabric_optimizer.step()
            optimizer.zero_grad()
            step += 1
            bar.update(sampler.global_batch_size)
            now = time.monotonic()
            if log is not None and (step % config.log_every == 0 or step == total_steps):
                rate = config.log_every * sampler.global_batch_size / max(now - last_log, 1e-9)
                record = _record(step, sampler, loss, estimator.terms, f * t, system, learning_rate, rate)
                log.write(record)
                bar.set_postfix_str(_summary(record))
                last_log = now
            stopping = stop.requested or step == stop_after
            if stopping or now - last_save > 60 * config.checkpoint_minutes or step == total_steps:
                if fabric.is_global_zero:
                    state.save(step)
                    save_checkpoint(run_dir / CHECKPOINT_NAME, system)
                last_save = now
            if stopping:
                break
    if log is not None:
        log.close()
    if stop.requested:
        raise KeyboardInterrupt


def _batches(
    dataset: SceneDataset,
    sampler: WindowShuffleSampler,
    config: OptimizationConfig,
    first_step: int,
    total_steps: int,
    device: torch.device,
) -> Iterator[ClipBatch]:
    if first_step >= total_steps:
        return
    first_epoch, skip = divmod(first_step, sampler.steps_per_epoch)
    for epoch in range(first_epoch, config.epochs):
        order = sampler.at(epoch, skip if epoch == first_epoch else 0)
        for batch in make_loader(dataset, order, config.num_workers, device):
            yield batch.to(device, non_blocking=True)


def _seed_step(seed: int, step: int, rank: int) -> None:
    (state,) = np.random.SeedSequence([seed, step, rank]).generate_state(1, np.uint64)
    torch.manual_seed(int(state) >> 1)


def _schedule(step: int, total_steps: int, config: OptimizationConfig) -> float:
    """Share of the learning rate at a step: linear warm-up, then a cosine."""
    warmup = min(1.0, (step + 1) / max(1, config.warmup_steps))
    progress = step / max(1, total_steps - 1)
    cosine = 0.5 * (1 + math.cos(math.pi * progress))
    return warmup * (config.final_learning_rate + (1 - config.final_learning_rate) * cosine)


def _check_finite(loss: torch.Tensor, terms: ElboTerms, batch: ClipBatch, step: int) -> None:
    if torch.isfinite(loss):
        return
    for name, value_b in terms.named().items():
        bad = [key for key, fine in zip(batch.keys, torch.isfinite(value_b).tolist(), strict=True) if not fine]
        if bad:
            raise TrainingDivergedError(
                f"step {step}: the ELBO term {name} is not finite for clip {bad[0]}"
                f"{f' and {len(bad) - 1} more' if len(bad) > 1 else ''}; try a smaller --optimization.learning-rate."
            )
    raise TrainingDivergedError(f"step {step}: the loss is not finite though each of its terms is.")


def _describe_gradient(module: torch.nn.Module, batch: ClipBatch, step: int) -> str:
    bad = [
        name
        for name, parameter in module.named_parameters()
        if parameter.grad is not None and not torch.isfinite(parameter.grad).all()
    ]
    where = f"of {bad[0]}" if bad else "as a whole"
    return (
        f"step {step}: the gradient {where} is not finite in the batch with clips {batch.keys[0]} to {batch.keys[-1]}."
    )


def _record(
    step: int,
    sampler: WindowShuffleSampler,
    loss: torch.Tensor,
    terms: ElboTerms,
    bins: int,
    system: System,
    learning_rate: float,
    clips_per_second: float,
) -> dict[str, Any]:
    record: dict[str, Any] = {"step": step, "epoch": step / sampler.steps_per_epoch, "loss": loss.item()}
    record |= {name: value_b.mean().item() / bins for name, value_b in terms.named().items()}
    sigma_k = system.guide.log_sigma_k.detach().exp()
    record |= {f"sigma_{k}": value for k, value in enumerate(sigma_k.tolist())}
    if hasattr(system.guide, "log_beta"):
        record["beta"] = system.guide.log_beta.detach().exp().item()
    return record | {"learning_rate": learning_rate, "clips_per_second": clips_per_second}


def _summary(record: dict[str, Any]) -> str:
    """The terms of the ELBO per time-frequency bin, as shown beside the progress bar."""
    return (
        f"elbo {-record['loss']:.4f} = lik {record['log_likelihood']:.4f} - "
        f"kl_w {record['kl_direction_weights']:.4f} - kl_pi {record.get('kl_mixing_levels', 0.0):.4f}"
    )
