"""Colors of sources that come and go."""

import numpy as np

from avssl_pyro.tracking.timeline import IdentifiedSource, Timeline, TimelineFrame
from avssl_pyro.viz.palette import OKABE_ITO, track_colors


def timeline(spans: dict[int, tuple[float, float]]) -> Timeline:
    """Names with the first and last second in which they sound."""
    moments = [
        TimelineFrame(
            float(t), tuple(IdentifiedSource(name, 0.0, 0.05, 0.3) for name, (a, b) in spans.items() if a <= t <= b)
        )
        for t in np.arange(0, 100, 0.5)
    ]
    return Timeline(tuple(moments), 0.5, 0.5)


def test_the_first_sources_take_the_palette_in_order() -> None:
    assert track_colors(timeline({3: (0, 9), 5: (2, 9), 9: (4, 9)})) == dict(zip((3, 5, 9), OKABE_ITO, strict=False))


def test_a_color_is_free_again_when_its_source_has_been_gone_for_a_while() -> None:
    spans = {1: (0.0, 10.0), 2: (0.0, 50.0), 3: (12.0, 50.0), 4: (30.0, 50.0)}
    colors = track_colors(timeline(spans), rest_s=5)
    assert colors[3] == OKABE_ITO[2]  # the first one's color still rests
    assert colors[4] == OKABE_ITO[0]


def test_sources_that_sound_together_differ_however_many_came_before() -> None:
    spans = {name: (2.0 * name, 2.0 * name + 5.9) for name in range(40)}
    colors = track_colors(timeline(spans))
    for name in range(38):
        assert len({colors[name], colors[name + 1], colors[name + 2]}) == 3
