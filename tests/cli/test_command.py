import errno
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from avssl_pyro.cli.command import run
from avssl_pyro.errors import InputError


def outcome(main: Callable[[], int | None], capsys: pytest.CaptureFixture[str]) -> tuple[object, str]:
    with pytest.raises(SystemExit) as stopped:
        run(main)
    return stopped.value.code, capsys.readouterr().err


def raising(error: BaseException) -> Callable[[], None]:
    def main() -> None:
        raise error

    return main


@pytest.mark.parametrize("code", [0, 1])
def test_the_commands_own_code_is_kept(code: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert outcome(lambda: code, capsys) == (code, "")


def test_no_code_is_success(capsys: pytest.CaptureFixture[str]) -> None:
    assert outcome(lambda: None, capsys) == (0, "")


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (InputError("x.wav: silent."), 2, "error: x.wav: silent.\n"),
        (FileNotFoundError(errno.ENOENT, "No such file", "x.wav"), 2, "error: x.wav: no such file or folder.\n"),
        (PermissionError(errno.EACCES, "Permission denied", "x"), 2, "error: x: permission denied"),
        (OSError(errno.ENOSPC, "No space left on device", "out/a"), 2, "error: out/a: no space is left on the disk"),
        (OSError(errno.ENOSPC, "No space left on device"), 2, "error: no space is left on the disk"),
        (OSError("strange"), 2, "error: strange.\n"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_faults_of_input_and_disk_end_in_one_sentence(
    error: BaseException, code: int, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found, stderr = outcome(raising(error), capsys)
    assert found == code
    assert stderr.startswith(sentence)
    assert stderr.count("\n") == 1


def test_defects_keep_their_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        run(raising(ZeroDivisionError()))


def test_a_reader_that_leaves_early_is_no_fault(tmp_path: Path) -> None:
    program = tmp_path / "chatty.py"
    program.write_text(
        "from avssl_pyro.cli.command import run\n"
        "def main():\n"
        "    for _ in range(100000):\n"
        "        print('line')\n"
        "run(main)\n"
    )
    command = f"'{sys.executable}' '{program}' | head -1"
    finished = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert finished.stdout == "line\n"
    assert finished.stderr == ""
