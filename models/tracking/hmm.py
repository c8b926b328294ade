"""Hidden Markov model of one source over directions, exact by enumeration.

::

      alive_t-1 ────► alive_t          0 from the end on
    sounding_t-1 ───► sounding_t       1 in speech, 0 in a pause
      motion_t-1 ───► motion_t         clockwise, at rest, counter-clockwise
                         │
                         ▼
    direction_t-1 ─► direction_t       one of D
                         │
                         ▼             if alive and sounding:
                    detections_t       p(detections | source at d) / p(detections | clutter alone)

    Markov chain over windows t = 0..T-1, from the window of birth; one batch, no plates

The detections of a window enter as a factor. The rest of their probability, from clutter and other sources, does not
depend on the states of this source.
"""

import numpy as np
import numpy.typing as npt
import pyro
import pyro.distributions as dist
import torch
from pyro.infer import TraceEnum_ELBO
from pyro.ops.indexing import Vindex
from pyro.poutine.runtime import InferDict
from torch import Tensor

from avssl_pyro.models.tracking.motion import TrackTables

PARALLEL: InferDict = {"enumerate": "parallel"}


class SourceTrack:
    """Pyro model of one track.

    Args:
        tables: transition probabilities from one window to the next.
    """

    def __init__(self, tables: TrackTables) -> None:
        motions, directions, _ = tables.move_hde.shape
        birth, survive = tables.birth, tables.survive
        # The last row of each table is the initial distribution, for the window of birth.
        self.alive_ll = torch.tensor([[1.0, 0.0], [1 - survive, survive], [1 - birth, birth]], dtype=torch.float64)
        self.activity_aa = _with_row(tables.activity_aa, np.array([0.0, 1.0]))
        self.motion_hh = _with_row(tables.motion_hh, np.full(motions, 1 / motions))
        self.move_hde = _with_row(tables.move_hde, np.full((motions, directions), 1 / directions))

    def __call__(self, log_ratio_td: Tensor) -> None:
        """Samples the states of all windows and adds the factors of the detections.

        Args:
            log_ratio_td: log likelihood ratio of the detections of window t, with the source sounding in direction d
                against clutter alone, (T, D), float64; window 0 is the window of birth.
        """
        tables = (self.alive_ll, self.activity_aa, self.motion_hh, self.move_hde[0])
        alive, sounding, motion, direction = (torch.tensor(len(table) - 1) for table in tables)
        for t in pyro.markov(range(len(log_ratio_td))):
            alive = pyro.sample(f"alive_{t}", dist.Categorical(self.alive_ll[alive]), infer=PARALLEL)
            sounding = pyro.sample(f"sounding_{t}", dist.Categorical(self.activity_aa[sounding]), infer=PARALLEL)
            motion = pyro.sample(f"motion_{t}", dist.Categorical(self.motion_hh[motion]), infer=PARALLEL)
            move = Vindex(self.move_hde)[motion, direction, :]
            direction = pyro.sample(f"direction_{t}", dist.Categorical(move), infer=PARALLEL)
            log_ratio = log_ratio_td[t][direction]
            pyro.factor(f"detections_{t}", torch.where(alive * sounding > 0, log_ratio, 0.0))


def _with_row(table: npt.NDArray[np.float64], row: npt.NDArray[np.float64]) -> Tensor:
    """Appends a row along the last axis but one."""
    return torch.from_numpy(np.concatenate([table, row[..., None, :]], axis=-2))


def log_evidence(model: SourceTrack, log_ratio_td: Tensor) -> Tensor:
    """Returns the exact log probability of detections relative to clutter, a scalar.

    Its gradient by ``log_ratio_td`` is the posterior probability that the source sounds in direction d in window t.

    Args:
        model: model of the track.
        log_ratio_td: log likelihood ratios, (T, D), float64.
    """

    def guide(log_ratio_td: Tensor) -> None:
        """Samples nothing, since every site of the model is summed out."""

    elbo = TraceEnum_ELBO(max_plate_nesting=0)
    if log_ratio_td.requires_grad:
        return -elbo.differentiable_loss(model, guide, log_ratio_td)
    return log_ratio_td.new_tensor(-elbo.loss(model, guide, log_ratio_td))
