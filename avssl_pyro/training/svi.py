"""Stochastic variational inference over a data set: the training loop.

Everything random in a step (latent noise, dropout, the order of clips) is a function of (seed, step, rank), so a run
that was stopped anywhere and resumed gives the numbers of one that was not.
"""

import contextlib
import math
import time
from collections.abc import Iterator
from pathlib import Path

import pyro
import torch
from lightning_fabric import Fabric
from pyro.infer import Trace_ELBO

from avssl_pyro.acoustics.stft import stft
from avssl_pyro.batch import ClipBatch
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.sampling import WindowShuffleSampler, make_loader
from avssl_pyro.distributions.profiled_gaussian import isotropic_log_likelihood, observe
from avssl_pyro.errors import InputError
from avssl_pyro.guides.amortized import AmortizedGuide
from avssl_pyro.interruption import GracefulInterrupt
from avssl_pyro.systems.checkpoint import save_checkpoint
from avssl_pyro.systems.system import System
from avssl_pyro.training.config import DistillationConfig, OptimizationConfig
from avssl_pyro.training.distillation import DistillationLoss
from avssl_pyro.training.divergence import diverged_gradient, diverged_loss
from avssl_pyro.training.elbo_terms import ElboTerms, ElboTermsMixin, TraceMeanFieldELBOWithTerms
from avssl_pyro.training.metrics_logger import MetricsLogger
from avssl_pyro.training.process import private_pyro, seed_step
from avssl_pyro.training.state import TrainingState

CHECKPOINT_NAME = "checkpoint.safetensors"
_RAISED = f"{InputError.__module__}.{InputError.__name__}: "


def train(
    system: System,
    dataset: SceneDataset,
    config: OptimizationConfig,
    run_dir: Path,
    fabric: Fabric,
    estimator: Trace_ELBO | None = None,
    targets: DistillationConfig | None = None,
    *,
    stop_after: int | None = None,
) -> None:
    """Trains ``system`` in place, or continues where ``run_dir`` left off.

    Leaves ``checkpoint.safetensors``, ``log.jsonl``, TensorBoard events and the state to resume from in ``run_dir``.

    Args:
        system: model and guide.
        dataset: clips of the system's array.
        config: optimization settings; a run is continued with the same.
        run_dir: folder of the run.
        fabric: devices, processes and precision; already launched.
        estimator: any Pyro ELBO with :class:`ElboTermsMixin`; the mean-field one (analytic KL) by default.
        targets: distillation of refined posteriors beside the ELBO; none by default.
        stop_after: number of steps in all after which the run stops as if interrupted.

    Raises:
        TrainingDivergedError: the loss or a gradient is not finite; the last checkpoint stays.
        KeyboardInterrupt: ctrl-C or SIGTERM; raised after the state was saved.
    """
    estimator = estimator or TraceMeanFieldELBOWithTerms()
    targets = targets or DistillationConfig()
    assert isinstance(estimator, ElboTermsMixin)
    loss_module = _loss_module(system, estimator, targets, config)
    trained = [parameter for parameter in loss_module.parameters() if parameter.requires_grad]
    optimizer = torch.optim.AdamW(trained, lr=config.learning_rate, weight_decay=config.weight_decay)
    sampler = WindowShuffleSampler(
        dataset.shard_sizes,
        config.batch_size,
        config.seed,
        num_replicas=fabric.world_size,
        rank=fabric.global_rank,
    )
    total_steps = config.epochs * sampler.steps_per_epoch
    module, fabric_optimizer = fabric.setup(loss_module, optimizer)
    state = TrainingState(run_dir, system, optimizer)
    first_step = state.load()
    logger = MetricsLogger(
        run_dir,
        first_step=first_step,
        total_steps=total_steps,
        clips_per_step=sampler.global_batch_size,
        enabled=fabric.is_global_zero,
    )
    last_save, step, stopping = time.monotonic(), first_step, False
    with contextlib.closing(logger), GracefulInterrupt() as stop, private_pyro():
        for batch in _batches(dataset, sampler, config, first_step, total_steps, fabric.device):
            seed_step(config.seed, step, fabric.global_rank)
            learning_rate = config.learning_rate * _schedule(step, total_steps, config)
            for group in optimizer.param_groups:
                group["lr"] = learning_rate
            x_bfmt = stft(batch.audio_bmn, system.config.stft)
            loss, cross_entropies = module(x_bfmt, batch.image_float(), targets.strength_at(step, total_steps))
            assert estimator.terms is not None
            if _anyone(not torch.isfinite(loss), fabric):
                raise diverged_loss(loss, estimator.terms, batch, step)
            fabric.backward(loss)
            norm = fabric.clip_gradients(
                module, fabric_optimizer, max_norm=config.gradient_clip, error_if_nonfinite=False
            )
            if norm is not None and not torch.isfinite(norm):
                raise diverged_gradient(loss_module, batch, step)
            fabric_optimizer.step()
            fabric_optimizer.zero_grad()
            step += 1
            logger.advance()
            done = step == total_steps
            if step % config.log_every == 0 or done:
                values = {"epoch": step / sampler.steps_per_epoch, "learning_rate": learning_rate}
                values |= {"loss": loss.item()}
                values |= zip(("direction_cross_entropy", "level_cross_entropy"), cross_entropies.tolist(), strict=True)
                logger.record(step, values | _terms(estimator.terms, x_bfmt, system.model.bin_weight) | _scales(system))
            stopping = not done and (_anyone(stop.requested, fabric) or step == stop_after)
            if stopping or done or time.monotonic() - last_save > 60 * config.checkpoint_minutes:
                if fabric.is_global_zero:
                    state.save(step)
                    if not (stopping or done):
                        save_checkpoint(run_dir / CHECKPOINT_NAME, system)
                last_save = time.monotonic()
            if stopping:
                break
    if fabric.is_global_zero:
        # Also where nothing was left to train: the run may have ended between saving its state and its checkpoint.
        save_checkpoint(run_dir / CHECKPOINT_NAME, system)
    if stopping and step != stop_after:
        raise KeyboardInterrupt


def _loss_module(
    system: System, estimator: Trace_ELBO, targets: DistillationConfig, config: OptimizationConfig
) -> DistillationLoss:
    with pyro.settings.context(module_local_params=True):
        elbo = estimator(system.model, system.guide)
    loss_module = DistillationLoss(
        elbo,
        estimator,
        system.model,
        system.guide if isinstance(system.guide, AmortizedGuide) else None,
        targets,
        diffuse_class=system.config.guide.diffuse_class,
    ).train()
    if config.freeze_visual:
        system.guide.visual.requires_grad_(False).eval()
    return loss_module


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
        loader = iter(make_loader(dataset, order, config.num_workers, device))
        while True:
            try:
                batch = next(loader)
            except StopIteration:
                break
            except InputError as error:
                # A worker process wraps the message in its traceback; the user needs the message alone.
                raise InputError(str(error).strip().splitlines()[-1].removeprefix(_RAISED)) from error
            yield batch.to(device, non_blocking=True)


def _anyone(here: bool | torch.Tensor, fabric: Fabric) -> bool:
    """Whether ``here`` holds in any process; all leave the loop at the same step, else the others wait forever."""
    if fabric.world_size == 1:
        return bool(here)
    flag = torch.tensor(float(here), device=fabric.device)
    return bool(torch.as_tensor(fabric.all_reduce(flag, reduce_op="sum")) > 0)


def _schedule(step: int, total_steps: int, config: OptimizationConfig) -> float:
    """Share of the learning rate at a step: linear warm-up, then a cosine."""
    warmup = min(1.0, (step + 1) / max(1, config.warmup_steps))
    progress = step / max(1, total_steps - 1)
    cosine = 0.5 * (1 + math.cos(math.pi * progress))
    return warmup * (config.final_learning_rate + (1 - config.final_learning_rate) * cosine)


@torch.no_grad()
def _terms(terms: ElboTerms, x_bfmt: torch.Tensor, bin_weight: float) -> dict[str, float]:
    """Mean ELBO terms per time-frequency bin, and the gain over isotropic noise.

    The gain does not depend on loudness or length of a clip.
    """
    _, f, _, t = x_bfmt.shape
    gain_b = terms.elbo_b - bin_weight * isotropic_log_likelihood(observe(x_bfmt))
    named = terms.named() | {"elbo_gain": gain_b}
    return {name: value_b.mean().item() / (f * t * bin_weight) for name, value_b in named.items()}


def _scales(system: System) -> dict[str, float]:
    """The learned uncertainties sigma_k and beta, whose collapse shows here first."""
    scales = {f"sigma_{k}": sigma for k, sigma in enumerate(system.guide.log_sigma_k.detach().exp().tolist())}
    if isinstance(system.guide, AmortizedGuide):
        scales["beta"] = system.guide.log_beta.detach().exp().item()
    return scales
