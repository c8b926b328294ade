from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import sofar

from avssl_pyro.acoustics.grid import DirectionGrid
from avssl_pyro.acoustics.measured import MeasuredResponses
from avssl_pyro.acoustics.presets import PRESETS
from avssl_pyro.acoustics.sofa import read_sofa
from avssl_pyro.acoustics.steering import FreeField
from avssl_pyro.acoustics.stft_config import StftConfig
from avssl_pyro.errors import InputError

ARRAY = PRESETS["circle4"]
GRID = DirectionGrid(36)
GRID_DEG = np.rad2deg(GRID.azimuths)
FREQUENCIES = StftConfig(bin_step=8).frequencies
EVERY_5_DEG = np.arange(0.0, 360.0, 5.0)

ONE_RECEIVER = {"Data_IR": np.ones((72, 1, 8)), "Data_Delay": np.zeros((1, 1)), "ReceiverPosition": np.zeros((1, 3))}


def templates(a_fdm: Any) -> npt.NDArray[np.complex128]:
    """a a^H: what the model sees of steering vectors, free of a common phase."""
    return np.einsum("fdm,fdn->fdmn", a_fdm, a_fdm.conj())


FREE = templates(FreeField(ARRAY)(GRID, FREQUENCIES).numpy())


def read_templates(path: Path) -> npt.NDArray[np.complex128]:
    return templates(read_sofa(path)(GRID, FREQUENCIES).numpy())


def test_pure_delays_in_the_very_directions_are_free_field(write_sofa: Callable[..., Path]) -> None:
    responses = read_sofa(write_sofa(ARRAY, GRID_DEG))
    assert responses.num_microphones == 4
    a_fdm = responses(GRID, FREQUENCIES).numpy()
    assert a_fdm.shape == (len(FREQUENCIES), 36, 4)
    assert np.abs(templates(a_fdm) - FREE).max() < 1e-6


def test_transfer_functions_are_read_as_impulse_responses_are(tmp_path: Path) -> None:
    lead_dm = GRID.unit_vectors @ ARRAY.positions.T / 343
    transfer_dmn = np.exp(2j * np.pi * FREQUENCIES * (lead_dm[..., None] - 0.003))
    sofa = sofar.Sofa("GeneralTF")
    sofa.N, sofa.Data_Real, sofa.Data_Imag = FREQUENCIES, transfer_dmn.real, transfer_dmn.imag
    sofa.ReceiverPosition = ARRAY.positions
    # In metres and at several distances, which directions do not depend on.
    sofa.SourcePosition = GRID.unit_vectors * np.linspace(0.5, 2, 36)[:, None]
    sofa.SourcePosition_Type, sofa.SourcePosition_Units = "cartesian", "metre"
    path = tmp_path / "transfer.sofa"
    sofar.write_sofa(str(path), sofa)
    assert np.abs(read_templates(path) - FREE).max() < 1e-6


def test_between_measured_directions_and_frequencies_level_and_phase_are_interpolated(
    write_sofa: Callable[..., Path],
) -> None:
    path = write_sofa(ARRAY, EVERY_5_DEG + 2.5)
    # Half a step off, the phase is wrong by k r (2.5 degrees)^2 / 2 at most.
    bound_f = 2 * np.pi * FREQUENCIES / 343 * 0.1 * np.deg2rad(2.5) ** 2
    error_f = np.abs(read_templates(path) - FREE).max(axis=(1, 2, 3))
    assert (error_f <= bound_f + 1e-6).all()
    measured = read_sofa(path)
    thinned = MeasuredResponses(measured.azimuths_d, measured.frequencies_n[::32], measured.response_dmn[..., ::32])
    # Delays have a phase in proportion to frequency, so every 500 Hz are enough.
    assert np.abs(templates(thinned(GRID, FREQUENCIES).numpy()) - FREE).max() < bound_f.max() + 1e-6


def test_gains_between_microphones_are_kept_and_those_of_directions_are_not(write_sofa: Callable[..., Path]) -> None:
    path = write_sofa(ARRAY, GRID_DEG)
    louder = sofar.read_sofa(str(path), verbose=False)
    gain_m, gain_d = np.array([1.0, 2.0, 0.5, 1.0]), np.linspace(0.1, 3.0, 36)
    louder.Data_IR = louder.Data_IR * gain_m[:, None] * gain_d[:, None, None]
    sofar.write_sofa(str(path), louder)
    a_fdm = read_sofa(path)(GRID, FREQUENCIES).numpy()
    expected = np.broadcast_to(2 * gain_m / np.linalg.norm(gain_m), a_fdm.shape)
    assert np.abs(a_fdm) == pytest.approx(expected, rel=1e-6)


def test_delays_beside_the_responses_count(write_sofa: Callable[..., Path]) -> None:
    path = write_sofa(ARRAY, GRID_DEG)
    shifted = sofar.read_sofa(str(path), verbose=False)
    shifted.Data_IR = np.roll(shifted.Data_IR, -7, axis=-1)
    shifted.Data_IR[:, 2] = np.roll(shifted.Data_IR[:, 2], -3, axis=-1)
    shifted.Data_Delay = np.array([[7.0, 7.0, 10.0, 7.0]])
    sofar.write_sofa(str(path), shifted)
    assert np.abs(read_templates(path) - FREE).max() < 1e-6


def test_a_listener_that_turns_before_a_fixed_loudspeaker_is_understood(write_sofa: Callable[..., Path]) -> None:
    view = np.stack([np.cos(GRID.azimuths), -np.sin(GRID.azimuths), np.zeros(36)], axis=-1)
    path = write_sofa(
        ARRAY,
        GRID_DEG,
        SourcePosition=np.array([[0.0, 0.0, 1.5]]),
        ListenerView=view,
    )
    assert np.abs(read_templates(path) - FREE).max() < 1e-6


def test_other_elevations_are_left_out(write_sofa: Callable[..., Path]) -> None:
    twice_deg = np.concatenate([GRID_DEG, GRID_DEG])
    elevation_deg = np.repeat([40.0, 0.0], 36)
    path = write_sofa(ARRAY, twice_deg, SourcePosition=np.stack([twice_deg, elevation_deg, np.ones(72)], axis=-1))
    spoilt = sofar.read_sofa(str(path), verbose=False)
    spoilt.Data_IR[:36] = 1.0
    sofar.write_sofa(str(path), spoilt)
    assert np.abs(read_templates(path) - FREE).max() < 1e-6


@pytest.mark.parametrize(
    ("azimuths_deg", "changes", "words"),
    [
        (np.arange(-60.0, 61.0, 5.0), {}, ["between azimuth 60 and -60", "gap of 240", "10 degrees"]),
        (np.delete(EVERY_5_DEG, [6, 7]), {}, ["between azimuth 25 and 40", "gap of 15"]),
        (EVERY_5_DEG, {"SourcePosition": np.array([[0.0, 60.0, 1.0]])}, ["no source within 5 degrees", "horizontal"]),
        (EVERY_5_DEG, {"Data_IR": np.full((72, 4, 8), np.nan)}, ["not finite", "export"]),
        (EVERY_5_DEG, ONE_RECEIVER, ["1 receiver", "at least two"]),
        (EVERY_5_DEG, {"ListenerPosition": np.array([[1.0, 0.0, 0.0]])}, ["at the listener's position"]),
    ],
)
def test_files_that_will_not_do_are_refused_in_one_sentence(
    write_sofa: Callable[..., Path], azimuths_deg: npt.NDArray[np.float64], changes: dict[str, Any], words: list[str]
) -> None:
    path = write_sofa(ARRAY, azimuths_deg, **changes)
    with pytest.raises(InputError) as refused:
        read_sofa(path)
    message = str(refused.value)
    assert all(word in message for word in [*words, "measured.sofa"]), message
    assert "\n" not in message


def test_other_data_types_are_named(tmp_path: Path) -> None:
    path = tmp_path / "sections.sofa"
    sofar.write_sofa(str(path), sofar.Sofa("SimpleFreeFieldHRSOS"))
    with pytest.raises(InputError, match=r"sections\.sofa: it has data of type 'SOS'; give .*FIR"):
        read_sofa(path)


@pytest.mark.parametrize("content", [b"", b"RIFF garbage", None])
def test_unreadable_files_are_named(write_sofa: Callable[..., Path], tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "broken.sofa"
    whole = write_sofa(ARRAY, EVERY_5_DEG).read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content is None else content)
    with pytest.raises(InputError, match=r"broken\.sofa: cannot be read as a SOFA file") as refused:
        read_sofa(path)
    assert "\n" not in str(refused.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.sofa: no such SOFA file"):
        read_sofa(tmp_path / "absent.sofa")


def test_frequencies_beyond_the_measurement_are_refused(write_sofa: Callable[..., Path]) -> None:
    whole = read_sofa(write_sofa(ARRAY, EVERY_5_DEG))
    low = MeasuredResponses(whole.azimuths_d, whole.frequencies_n[:200], whole.response_dmn[..., :200])
    with pytest.raises(InputError, match=r"end at 3109\.38 Hz, but .* up to 8000 Hz .* high_hz"):
        low(GRID, FREQUENCIES)


def test_what_was_not_heard_at_all_tells_nothing(write_sofa: Callable[..., Path]) -> None:
    whole = read_sofa(write_sofa(ARRAY, EVERY_5_DEG))
    whole.response_dmn[..., 0] = 0.0
    a_fdm = whole(GRID, FREQUENCIES).numpy()
    assert (a_fdm[0] == 1).all()
    assert np.abs(templates(a_fdm)[1:] - FREE[1:]).max() < 0.05
