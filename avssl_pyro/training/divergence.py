"""Errors of a training whose loss or gradient is not finite."""

import torch
from torch import Tensor, nn

from avssl_pyro.batch import ClipBatch
from avssl_pyro.training.elbo_terms import ElboTerms


class TrainingDivergedError(RuntimeError):
    """A term of the ELBO or a gradient was not finite; the message names the step, the term and the clips."""


def diverged_loss(loss: Tensor, terms: ElboTerms, batch: ClipBatch, step: int) -> TrainingDivergedError:
    """The error for a loss that is not finite in some process, with ``loss`` and ``terms`` of this process."""
    if torch.isfinite(loss):
        return TrainingDivergedError(
            f"step {step}: the loss of another process is not finite; its own message names the clip."
        )
    for name, value_b in terms.named().items():
        bad = [key for key, fine in zip(batch.keys, torch.isfinite(value_b).tolist(), strict=True) if not fine]
        if bad:
            more = f" and {len(bad) - 1} more" if len(bad) > 1 else ""
            return TrainingDivergedError(
                f"step {step}: the ELBO term {name} is not finite for clip {bad[0]}{more}; "
                "try a smaller --optimization.learning-rate."
            )
    return TrainingDivergedError(f"step {step}: the loss is not finite though each of its terms is.")


def diverged_gradient(module: nn.Module, batch: ClipBatch, step: int) -> TrainingDivergedError:
    """The error for a gradient that is not finite."""
    bad = [
        name
        for name, parameter in module.named_parameters()
        if parameter.grad is not None and not torch.isfinite(parameter.grad).all()
    ]
    where = f"of {bad[0]}" if bad else "as a whole"
    return TrainingDivergedError(
        f"step {step}: the gradient {where} is not finite in the batch with clips {batch.keys[0]} to {batch.keys[-1]}."
    )
