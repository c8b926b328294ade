"""A color for each source of a recording, its own for as long as it lives."""

from collections.abc import Sequence

from avssl_pyro.tracking.timeline import Timeline
from avssl_pyro.viz.palette import OKABE_ITO, Color


def track_colors(timeline: Timeline, rest_s: float = 5.0, palette: Sequence[Color] = OKABE_ITO) -> dict[int, Color]:
    """A color per name of a timeline.

    Names come and go. A new one takes the first color of the palette that nothing has used for ``rest_s``, or else the
    one that has been free for longest: sources that sound together differ as long as there are colors enough.
    """
    spans: dict[int, tuple[float, float]] = {}
    for moment in timeline.moments:
        for source in moment.sources:
            first, _ = spans.get(source.name, (moment.time_s, moment.time_s))
            spans[source.name] = (first, moment.time_s)
    free_since = [float("-inf")] * len(palette)
    colors: dict[int, Color] = {}
    for name, (first, last) in sorted(spans.items(), key=lambda item: (item[1][0], item[0])):
        rested = [index for index, since in enumerate(free_since) if since + rest_s < first]
        index = rested[0] if rested else free_since.index(min(free_since))
        free_since[index] = max(free_since[index], last)
        colors[name] = palette[index]
    return colors
