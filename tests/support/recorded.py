"""Small recordings on disk: a video whose stripes tell the frame, and noise whose loudness tells the second."""

import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import soundfile

FPS = 10.0


def write_video(path: Path, num_frames: int, size: tuple[int, int] = (144, 72), fps: float = FPS) -> Path:
    """Frame n shows n as eight black or white stripes, which survive any codec; see :func:`frame_number`."""
    bit_j = 7 - np.arange(size[0]) * 8 // size[0]
    frames_ijc = [
        np.broadcast_to((255 * (number >> bit_j & 1))[None, :, None], (size[1], size[0], 3)).astype(np.uint8)
        for number in range(num_frames)
    ]
    return write_frames(path, frames_ijc, fps)


def frame_number(frame_ijc: np.ndarray) -> int:
    """What number a frame of :func:`write_video` shows."""
    rows, columns = frame_ijc.shape[:2]
    middles = (2 * np.arange(8) + 1) * columns // 16
    return int(((frame_ijc[rows // 2, middles].mean(axis=-1) > 128) * 2 ** np.arange(7, -1, -1)).sum())


def write_frames(path: Path, frames_ijc: Sequence[np.ndarray], fps: float = FPS) -> Path:
    """RGB frames as MP4."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows, columns = frames_ijc[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, (columns, rows))
    for frame_ijc in frames_ijc:
        writer.write(cv2.cvtColor(frame_ijc, cv2.COLOR_RGB2BGR))
    writer.release()
    return path


def write_noise(
    path: Path,
    levels: Sequence[float],
    num_channels: int = 4,
    rate: int = 24_000,
    subtype: str = "PCM_24",
    constant: float = 0.01,
) -> Path:
    """Second s is noise of RMS ``levels[s]`` around a constant, another one in each channel, which is not to count."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    seconds = [level * rng.standard_normal((rate, num_channels)) for level in levels]
    soundfile.write(path, np.concatenate(seconds) + constant * np.arange(num_channels), rate, subtype=subtype)
    return path


def stretch_frame(path: Path, frame: int, factor: int) -> None:
    """Makes one frame of an MP4 last ``factor`` times as long, as cameras of variable frame rate do."""
    content = path.read_bytes()
    place = content.index(b"stts")
    entries, count, delta = struct.unpack(">III", content[place + 8 : place + 20])
    assert entries == 1
    table = struct.pack(">I", 3)
    for number, length in ((frame, delta), (1, factor * delta), (count - frame - 1, delta)):
        table += struct.pack(">II", number, length)
    content = content[: place + 8] + table + content[place + 20 :]
    content = content.replace(b"edts", b"free")
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        at = content.index(name) - 4
        (size,) = struct.unpack(">I", content[at : at + 4])
        content = content[:at] + struct.pack(">I", size + 16) + content[at + 4 :]
    path.write_bytes(content)
