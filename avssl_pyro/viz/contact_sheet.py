"""Contact sheet of scenes with their labels, for visual checks of mirror, scale and levels."""

import io
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from avssl_pyro.clip import IMAGE_MAX_ELEVATION_DEG, SAMPLE_RATE, Clip
from avssl_pyro.datasets.dataset import SceneDataset
from avssl_pyro.datasets.encoding import LabeledScene
from avssl_pyro.simulation.scenes import SceneSimulator

TALKER_COLORS = ("#ffb000", "#00e0ff", "#ff5fa2", "#8cff66")
SILENT_COLOR = "#ffffff"
SHEET_COLUMNS = 2
DOTS_PER_INCH = 100
MOST_SCENES = 12


def stored_scenes_sheet(dataset: SceneDataset, title: str) -> bytes:
    """Draws up to twelve scenes of a data set, evenly spread; see :func:`contact_sheet`."""
    count = min(len(dataset), MOST_SCENES)
    return contact_sheet([dataset.scene(index * len(dataset) // count) for index in range(count)], title)


def simulated_scenes_sheet(simulator: SceneSimulator, num_scenes: int, title: str) -> bytes:
    """Renders and draws up to twelve scenes of a simulator, the first ones; see :func:`contact_sheet`."""
    return contact_sheet([simulator.render(index) for index in range(min(num_scenes, MOST_SCENES))], title)


def contact_sheet(scenes: Sequence[LabeledScene], title: str) -> bytes:
    """Draws images with true azimuths, the waveform of the first microphone, and the level of each talker.

    Talkers have solid lines, silent people dashed lines; azimuths are in degrees, positive to the left.

    Returns:
        Contents of a PNG file.
    """
    rows = -(-len(scenes) // SHEET_COLUMNS)
    figure = Figure(figsize=(19.0, 0.7 + 2.1 * rows), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    grid = figure.subplots(rows, 3 * SHEET_COLUMNS, width_ratios=[5.0, 2.2, 1.3] * SHEET_COLUMNS, squeeze=False)
    cells = grid.reshape(rows * SHEET_COLUMNS, 3)
    for cell, scene in zip(cells, scenes, strict=False):
        _draw_image(cell[0], scene)
        _draw_waveform(cell[1], scene.clip)
        _draw_levels(cell[2], scene)
    for cell in cells[len(scenes) :]:
        for axes in cell:
            axes.set_axis_off()
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def _draw_image(axes: Axes, scene: LabeledScene) -> None:
    top = IMAGE_MAX_ELEVATION_DEG
    axes.imshow(scene.clip.image_ijc, extent=(180, -180, -top, top), aspect="equal", interpolation="nearest")
    for number, azimuth in enumerate(scene.labels.talker_azimuths):
        _mark(axes, scene, azimuth, TALKER_COLORS[number % len(TALKER_COLORS)], "solid")
    for azimuth in scene.labels.silent_azimuths:
        _mark(axes, scene, azimuth, SILENT_COLOR, "dashed")
    axes.set_xticks([180, 90, 0, -90, -180], ["+180°", "+90° left", "0°", "-90° right", "-180°"], fontsize=7)
    axes.set_yticks([-top, 0, top], [f"{-top:.0f}°", "0°", f"{top:.0f}°"], fontsize=7)
    axes.set_title(_caption(scene), fontsize=8, loc="left", pad=3)


def _caption(scene: LabeledScene) -> str:
    words = [f"scene {scene.clip.key}", f"{len(scene.clip.audio_mn)} microphones"]
    if "rt60_s" in scene.metadata:
        words.append(f"RT60 {scene.metadata['rt60_s']:.2f} s")
    return ", ".join(words)


def _mark(axes: Axes, scene: LabeledScene, azimuth: float, color: str, line_style: str) -> None:
    azimuth_deg = math.degrees(azimuth)
    words = [f"{azimuth_deg:+.0f}°"]
    words += [
        f"{person['distance_m']:.1f} m"
        for person in scene.metadata.get("people", [])
        if math.isclose(person["azimuth_deg"], azimuth_deg, abs_tol=1e-3)
    ]
    axes.axvline(azimuth_deg, color="black", linewidth=2.4, linestyle=line_style, alpha=0.5)
    axes.axvline(azimuth_deg, color=color, linewidth=1.2, linestyle=line_style)
    axes.text(
        azimuth_deg,
        -IMAGE_MAX_ELEVATION_DEG + 3,
        "\n".join(words),
        color="black",
        fontsize=6,
        ha="center",
        va="bottom",
        clip_on=True,
        bbox={"facecolor": color, "edgecolor": "none", "boxstyle": "round,pad=0.15", "alpha": 0.85},
    )


def _draw_waveform(axes: Axes, clip: Clip) -> None:
    audio_n = clip.audio_mn[0]
    axes.plot(np.arange(len(audio_n)) / SAMPLE_RATE, audio_n, linewidth=0.4, color="#204a87")
    rms_db = 10 * math.log10(max(float(np.mean(np.square(audio_n, dtype=np.float64))), 1e-12))
    peak_db = 20 * math.log10(max(float(np.abs(clip.audio_mn).max()), 1e-6))
    axes.set_title(f"channel 1: {rms_db:.0f} dB RMS; peak {peak_db:.0f} dB", fontsize=8, loc="left", pad=3)
    axes.set_ylim(-1, 1)
    axes.margins(x=0)
    axes.tick_params(labelsize=7)
    axes.set_xlabel("s", fontsize=7, labelpad=0)


def _draw_levels(axes: Axes, scene: LabeledScene) -> None:
    talkers = [person for person in scene.metadata.get("people", []) if person["speaks"]]
    if not talkers:
        axes.set_axis_off()
        return
    levels_db = [float(person["level_db"]) for person in talkers]
    colors = [TALKER_COLORS[number % len(TALKER_COLORS)] for number in range(len(talkers))]
    axes.barh(range(len(talkers)), levels_db, color=colors, edgecolor="black", linewidth=0.5)
    axes.set_yticks(range(len(talkers)), [f"{person['azimuth_deg']:+.0f}°" for person in talkers], fontsize=7)
    axes.set_ylim(len(talkers) - 0.4, -0.6)
    axes.axvline(0.0, color="black", linewidth=0.6)
    reach = max(3.0, *(abs(level_db) for level_db in levels_db))
    axes.set_xlim(-reach, reach)
    axes.set_title("talker level, dB", fontsize=8, loc="left", pad=3)
    axes.tick_params(axis="x", labelsize=7)
