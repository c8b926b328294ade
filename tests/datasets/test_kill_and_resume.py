import contextlib
import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_simulator import FakeSimulator, fake_plan

from avssl_pyro.datasets.generation import generate
from avssl_pyro.datasets.shards import verify_dataset

# Forking after the imports makes a start cost milliseconds, so that kills fall on the work and not on the imports.
STARTER = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from fake_simulator import FakeSimulator, fake_plan
from avssl_pyro.datasets.generation import generate

def die_at(call, before):
    calls = 0
    def watched(function):
        def wrapper(*args, **kwargs):
            nonlocal calls
            calls += 1
            if calls == call and before:
                os.kill(os.getpid(), signal.SIGKILL)
            result = function(*args, **kwargs)
            if calls == call:
                os.kill(os.getpid(), signal.SIGKILL)
            return result
        return wrapper
    for name in ("fsync", "replace", "unlink", "mkdir"):
        setattr(os, name, watched(getattr(os, name)))

for line in sys.stdin:
    child = os.fork()
    if child == 0:
        # What dying workers say must not come between the answers.
        os.dup2(2, 1)
        folder, scenes, workers, call, before = line.split()
        simulator = FakeSimulator(pause=0.002)
        if int(call):
            die_at(int(call), bool(int(before)))
        generate(fake_plan(Path(folder), int(scenes), simulator, 2), int(workers), progress=False)
        os._exit(0)
    print(child, flush=True)
    print(os.waitpid(child, 0)[1], flush=True)
"""


class Starter:
    """Starts generations in fresh processes, one at a time."""

    def __init__(self, pipes: subprocess.Popen[str]) -> None:
        self._pipes = pipes

    def start(self, folder: Path, scenes: int, *, workers: int = 1, die_at_call: int = 0, before: bool = False) -> int:
        """Returns the number of the process; 0 as ``die_at_call`` lets it live."""
        assert self._pipes.stdin is not None
        print(folder, scenes, workers, die_at_call, int(before), file=self._pipes.stdin, flush=True)
        return self._answer()

    def wait(self) -> int:
        return self._answer()

    def _answer(self) -> int:
        assert self._pipes.stdout is not None
        return int(self._pipes.stdout.readline())


@pytest.fixture
def starter() -> Iterator[Starter]:
    program = STARTER.format(tests=str(Path(__file__).parents[1] / "support"))
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as pipes:
        yield Starter(pipes)


def contents(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def shards(folder: Path) -> dict[str, tuple[int, int]]:
    """Finished shards with inode and time, which change when one is written again."""
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in folder.glob("*.tar")}


def reference(folder: Path, scenes: int) -> dict[str, str]:
    generate(fake_plan(folder, scenes, FakeSimulator(), 2), workers=1, progress=False)
    return contents(folder)


@pytest.mark.parametrize(("workers", "wanted_kills", "longest_s"), [(1, 24, 0.08), (2, 4, 1.5)])
def test_killed_at_random_moments(
    starter: Starter, tmp_path: Path, workers: int, wanted_kills: int, longest_s: float
) -> None:
    expected = reference(tmp_path / "reference", 80)
    draw = random.Random(7)
    kills = rounds = 0
    while kills < wanted_kills:
        folder, status = tmp_path / f"scenes{rounds}", None
        finished: dict[str, tuple[int, int]] = {}
        while status != 0:
            process = starter.start(folder, 80, workers=workers)
            if kills < wanted_kills:
                time.sleep(draw.uniform(0.0, longest_s))
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            status = starter.wait()
            kills += status == signal.SIGKILL
            if workers == 1:
                assert finished.items() <= shards(folder).items(), "a finished shard was lost or made again"
                finished = shards(folder)
        assert verify_dataset(folder) == []
        assert contents(folder) == expected
        rounds += 1


def test_killed_before_and_after_every_change_to_the_folder(starter: Starter, tmp_path: Path) -> None:
    expected = reference(tmp_path / "reference", 5)
    calls = 0
    while True:
        calls += 1
        for before in (True, False):
            folder = tmp_path / f"scenes-{calls}-{before}"
            starter.start(folder, 5, die_at_call=calls, before=before)
            killed = starter.wait() == signal.SIGKILL
            finished = shards(folder) if folder.exists() else {}
            starter.start(folder, 5)
            assert starter.wait() == 0
            assert finished.items() <= shards(folder).items()
            assert contents(folder) == expected
        if not killed:
            break
    assert calls > 20
