"""Colors that stay apart for color-blind readers and on photographs of rooms."""

from collections.abc import Sequence

from avssl_pyro.tracking.timeline import Timeline

Color = tuple[float, float, float]


def _rgb(code: str) -> Color:
    red, green, blue = (int(code[start : start + 2], 16) / 255 for start in (0, 2, 4))
    return red, green, blue


# Okabe and Ito (2008) without black, the most distinct ones first.
OKABE_ITO: tuple[Color, ...] = tuple(
    _rgb(code) for code in ("56B4E9", "D55E00", "F0E442", "CC79A7", "009E73", "E69F00", "0072B2")
)


def color_of(index: int, palette: Sequence[Color]) -> Color:
    """Color of a class; palettes shorter than the number of classes repeat."""
    return palette[index % len(palette)]


def ink_on(color: Color) -> str:
    """Black or white, whichever reads better on a color."""
    red, green, blue = color
    return "black" if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else "white"


def track_colors(timeline: Timeline, rest_s: float = 5.0, palette: Sequence[Color] = OKABE_ITO) -> dict[int, Color]:
    """A color for each source of a timeline, by its name.

    A new source takes the first color of the palette that has been unused for ``rest_s``, or else the color unused for
    longest: simultaneous sources differ as long as the palette has colors enough.
    """
    spans: dict[int, tuple[float, float]] = {}
    for moment in timeline.frames:
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
