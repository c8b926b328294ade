import pytest

from avssl_pyro.cli.track_benchmark import main
from avssl_pyro.errors import InputError


def test_prints_every_way_to_link_windows(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--recordings", "1", "--talkers.seconds", "5"])
    printed = capsys.readouterr().out
    for way in ("windows alone", "nearest", "tracked live, 3", "tracked, whole"):
        assert way in printed


def test_localizes_what_is_heard(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--talkers.seconds", "1.5", "--talkers.step-s", "0.25", "--talkers.num-talkers", "1", "1"]
    main(["--heard", "--array", "circle4", "--recordings", "1", *options])
    assert "1 recordings of 1.5 s" in capsys.readouterr().out


def test_nothing_to_track_is_refused() -> None:
    with pytest.raises(InputError, match="--recordings 0"):
        main(["--recordings", "0"])
