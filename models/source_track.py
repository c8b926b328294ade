"""One source over time: a hidden Markov model over directions, exact by enumeration.

::

      alive_t-1 ────► alive_t          0 once gone, for good
    sounding_t-1 ───► sounding_t       1 while it speaks, 0 in a pause
      motion_t-1 ───► motion_t         clockwise, at rest, counter-clockwise
                         │
                         ▼
    direction_t-1 ─► direction_t       one of D
                         │
                         ▼             if alive and sounding:
                    detections_t       p(detections | source at d) / p(detections | clutter alone)

    markov plate over windows t; the first window draws everything from the birth prior

The detections of a window enter as a factor, since the rest of their probability, that of clutter and of other sources,
is the same whatever this source does.
"""

import pyro
import pyro.distributions as dist
import torch
from pyro.infer import TraceEnum_ELBO
from pyro.ops.indexing import Vindex
from torch import Tensor

from avssl_pyro.models.track_prior import TrackTables

PARALLEL = {"enumerate": "parallel"}


class SourceTrack:
    """The model of one track.

    Args:
        tables: transition probabilities of one window to the next.
    """

    def __init__(self, tables: TrackTables) -> None:
        self.birth, self.survive = tables.birth, tables.survive
        self.activity_aa = torch.from_numpy(tables.activity_aa)
        self.motion_hh = torch.from_numpy(tables.motion_hh)
        self.move_hde = torch.from_numpy(tables.move_hde)

    def __call__(self, log_ratio_td: Tensor) -> None:
        """The program.

        Args:
            log_ratio_td: how much likelier the detections of window t are with the source sounding in direction d than
                without it, (T, D), float64; window 0 is that of its birth.
        """
        like = log_ratio_td
        motions, directions = self.move_hde.shape[:2]
        for t in pyro.markov(range(len(log_ratio_td))):
            if t == 0:
                p_alive = like.new_tensor([1 - self.birth, self.birth])
                p_sounding = like.new_tensor([0.0, 1.0])
                p_motion = like.new_full((motions,), 1 / motions)
                p_direction = like.new_full((directions,), 1 / directions)
            else:
                p_alive = like.new_tensor([[1.0, 0.0], [1 - self.survive, self.survive]])[alive]
                p_sounding = self.activity_aa[sounding]
                p_motion = self.motion_hh[motion]
            alive = pyro.sample(f"alive_{t}", dist.Categorical(p_alive), infer=PARALLEL)
            sounding = pyro.sample(f"sounding_{t}", dist.Categorical(p_sounding), infer=PARALLEL)
            motion = pyro.sample(f"motion_{t}", dist.Categorical(p_motion), infer=PARALLEL)
            if t > 0:
                p_direction = Vindex(self.move_hde)[motion, direction, :]
            direction = pyro.sample(f"direction_{t}", dist.Categorical(p_direction), infer=PARALLEL)
            log_ratio = log_ratio_td[t][direction]
            pyro.factor(f"detections_{t}", torch.where(alive * sounding > 0, log_ratio, 0.0))


def log_evidence(model: SourceTrack, log_ratio_td: Tensor) -> Tensor:
    """Log probability of the detections relative to clutter alone, a scalar, exact.

    Its gradient by ``log_ratio_td`` is the posterior probability that the source sounds in direction d in window t.
    """

    def guide(log_ratio_td: Tensor) -> None:
        """Nothing is left to guess: every site is summed out."""

    return -TraceEnum_ELBO(max_plate_nesting=0).differentiable_loss(model, guide, log_ratio_td)
