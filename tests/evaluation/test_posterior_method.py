import numpy as np

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.clip import Clip
from avssl_pyro.evaluation.methods import PosteriorMethod, tune
from avssl_pyro.localization.posterior import ClipPosterior

GRID = DirectionGrid()
IMAGE = np.zeros((88, 288, 3), dtype=np.uint8)
# A talker at 42.5 degrees (direction 27), a silent person at -92.5 (direction 54), and diffuse noise.
LEVELS = np.array([0.6, 0.05, 0.35])


def posterior(index):
    weights_kd = np.full((3, 72), 1e-4)
    weights_kd[0, (27 + index) % 72] = 1.0
    weights_kd[1, 54] = 1.0
    weights_kd[2] = 1.0
    weights_kd /= weights_kd.sum(axis=-1, keepdims=True)
    return ClipPosterior(weights_kd, LEVELS, np.full(3, 0.01), np.full(3, 0.02), np.zeros((3, 44, 144), np.float32))


def clips(number):
    return (Clip(str(index), np.zeros((4, 16), np.float32), IMAGE) for index in range(number))


def test_clips_arrive_in_batches_and_posteriors_in_order_without_their_maps():
    sizes = []

    def posteriors(batch):
        sizes.append(len(batch))
        return (posterior(int(clip.key)) for clip in batch)

    observed = PosteriorMethod("amortized", posteriors, GRID, batch_size=4).observe_all(clips(10))
    assert sizes == [4, 4, 2]
    assert [int(item.direction_weights_kd[0].argmax()) for item in observed] == list(range(27, 37))
    assert all(item.activations_kij is None for item in observed)


def test_tuning_leaves_out_the_silent_and_the_diffuse_class():
    method = PosteriorMethod("amortized", lambda batch: [posterior(int(clip.key)) for clip in batch], GRID)
    observed = method.observe_all(clips(5))
    truth = [[np.deg2rad(42.5 - 5 * index)] for index in range(5)]
    tuned = tune(method, observed, truth, np.deg2rad(3))
    assert (tuned.f_measure, tuned.count_accuracy) == (1.0, 1.0)
    assert tuned.setting.least > 0.05


def test_no_source_is_an_empty_vector():
    silent = ClipPosterior(np.full((2, 72), 1 / 72), np.full(2, 0.5), np.zeros(2), np.zeros(2))
    method = PosteriorMethod("amortized", lambda batch: [silent for _ in batch], GRID)
    assert method.decide(silent, method.settings[-1]).shape == (0,)
