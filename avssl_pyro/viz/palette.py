"""Colors that stay apart for color-blind readers and on photographs of rooms."""

from collections.abc import Sequence

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
