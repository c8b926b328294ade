import errno
import hashlib
import json
import multiprocessing
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import distributed
import joblib
import pytest
from fake_simulator import FakeSimulator, fake_plan

from avssl_pyro.acoustics.presets import PRESETS, uniform_circle
from avssl_pyro.datasets.builtin import ensure_dataset
from avssl_pyro.datasets.generation import GenerationPlan, generate
from avssl_pyro.datasets.shards import verify_dataset
from avssl_pyro.errors import InputError

MakeScenes = Callable[..., GenerationPlan]


def contents(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def rendered(log: Path) -> list[int]:
    return sorted(int(mark.name.split("-")[0]) for mark in log.iterdir())


def test_shards_are_plain_webdataset_tars(make_scenes: MakeScenes) -> None:
    folder = make_scenes().folder
    assert sorted(contents(folder)) == [
        "manifest.json",
        "scenes-000000.tar",
        "scenes-000001.tar",
        "scenes-000002.tar",
    ]
    with tarfile.open(folder / "scenes-000002.tar") as archive:
        members = archive.getmembers()
    assert [member.name for member in members] == [
        f"fake-0-{index:06d}.{extension}" for index in (8, 9) for extension in ("flac", "jpg", "json")
    ]
    assert {(member.mtime, member.uid, member.gid, member.mode, member.uname) for member in members} == {
        (0, 0, 0, 0o644, "")
    }


def test_manifest_tells_settings_and_checksums(make_scenes: MakeScenes) -> None:
    folder = make_scenes().folder
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["array"] == PRESETS["circle246"].to_dict()
    assert manifest["configuration"]["nested"] == {"levels_db": [-2.5, 2.5]}
    for shard in manifest["shards"]:
        assert hashlib.sha256((folder / shard["name"]).read_bytes()).hexdigest() == shard["sha256"]
    assert [shard["num_scenes"] for shard in manifest["shards"]] == [4, 4, 2]


def test_bytes_do_not_depend_on_who_makes_them(make_scenes: MakeScenes, tmp_path: Path) -> None:
    alone = contents(make_scenes().folder)
    generate(fake_plan(tmp_path / "two", 10, FakeSimulator()), workers=2, progress=False)
    assert contents(tmp_path / "two") == alone
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,  # type: ignore[no-untyped-call]
        distributed.Client(cluster),  # type: ignore[no-untyped-call]
        joblib.parallel_config(backend="dask", n_jobs=-1),
    ):
        generate(fake_plan(tmp_path / "dask", 10, FakeSimulator()), progress=False)
    assert contents(tmp_path / "dask") == alone


def test_another_seed_gives_other_scenes(make_scenes: MakeScenes) -> None:
    assert (
        contents(make_scenes("a").folder)["scenes-000000.tar"]
        != (contents(make_scenes("b", seed=1).folder)["scenes-000000.tar"])
    )


def test_what_is_there_is_not_rendered_again(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.mkdir()
    plan = fake_plan(tmp_path / "scenes", 10, FakeSimulator(log=log))
    generate(plan, workers=1, progress=False)
    before = contents(plan.folder)
    for mark in log.iterdir():
        mark.unlink()
    (plan.folder / "scenes-000001.tar").unlink()
    generate(plan, workers=1, progress=False)
    assert rendered(log) == [4, 5, 6, 7]
    assert contents(plan.folder) == before


def test_a_truncated_shard_is_made_again(make_scenes: MakeScenes) -> None:
    plan = make_scenes()
    before = contents(plan.folder)
    shard = plan.folder / "scenes-000001.tar"
    shard.write_bytes(shard.read_bytes()[:1000])
    generate(plan, workers=1, progress=False)
    assert contents(plan.folder) == before


@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_keeps_what_is_finished_and_leaves_nothing_half_written(tmp_path: Path, workers: int) -> None:
    log = tmp_path / "log"
    log.mkdir()
    folder = tmp_path / "scenes"
    with pytest.raises(OSError, match="No space") as caught:
        generate(fake_plan(folder, 40, FakeSimulator(disk_full_at=25)), workers=workers, progress=False)
    assert caught.value.errno == errno.ENOSPC
    assert not list(folder.glob(".*"))
    finished = {path.name for path in folder.glob("*.tar")}
    assert "scenes-000006.tar" not in finished
    generate(fake_plan(folder, 40, FakeSimulator(log=log)), workers=1, progress=False)
    assert len(rendered(log)) == 40 - 4 * len(finished)
    assert verify_dataset(folder) == []


def test_a_disk_that_fills_while_writing_is_reported_with_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = fake_plan(tmp_path / "scenes", 10, FakeSimulator())

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    plan.folder.mkdir()
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space") as caught:
        generate(plan, workers=1, progress=False)
    assert caught.value.errno == errno.ENOSPC
    assert caught.value.filename == str(plan.folder / "generation.json")
    assert list(plan.folder.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"seed": 3}, "seed = 0, not 3"),
        ({"num_scenes": 11}, "num_scenes = 10, not 11"),
        ({"array": uniform_circle(6)}, r"array\.name = 'circle246', not 'circle6'"),
        ({"configuration": {"num_samples": 320, "nested": {"levels_db": (0, 2.5)}}}, r"nested\.levels_db = \[-2\.5"),
        ({"configuration": {"num_samples": 320, "nested": {"levels_db": (-2.5, 2.5)}, "new": 1}}, r"new = None, not 1"),
    ],
)
@pytest.mark.parametrize("finished", [True, False])
def test_other_settings_in_the_same_folder_are_refused(
    make_scenes: MakeScenes, tmp_path: Path, changes: dict[str, object], field: str, finished: bool
) -> None:
    if finished:
        plan = make_scenes()
    else:
        plan = fake_plan(tmp_path / "scenes", 10, FakeSimulator(disk_full_at=9))
        with pytest.raises(OSError, match="No space"):
            generate(plan, workers=1, progress=False)
    before = contents(plan.folder)
    with pytest.raises(InputError, match=field):
        generate(replace(plan, **changes), workers=1, progress=False)  # type: ignore[arg-type]
    assert contents(plan.folder) == before


def test_shards_of_somebody_else_are_not_overwritten(make_scenes: MakeScenes) -> None:
    plan = make_scenes()
    (plan.folder / "manifest.json").unlink()
    with pytest.raises(InputError, match="empty folder"):
        generate(plan, workers=1, progress=False)


def test_material_that_changed_since_is_noticed_when_a_shard_is_made_again(make_scenes: MakeScenes) -> None:
    plan = make_scenes()
    (plan.folder / "scenes-000001.tar").unlink()
    changed = replace(plan, simulator=FakeSimulator(seed=9))
    with pytest.raises(InputError, match=r"scenes-000001\.tar differs from its record"):
        generate(changed, workers=1, progress=False)
    assert not (plan.folder / "scenes-000001.tar").exists()


@pytest.mark.parametrize("changes", [{"num_scenes": 0}, {"scenes_per_shard": 0}])
def test_empty_datasets_are_refused(tmp_path: Path, changes: dict[str, int]) -> None:
    plan = replace(fake_plan(tmp_path / "scenes", 10, FakeSimulator()), **changes)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="at least 1"):
        generate(plan, workers=1, progress=False)


def test_processes_that_ask_for_the_same_scenes_share_the_work(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.mkdir()
    plan = fake_plan(tmp_path / "scenes", 10, FakeSimulator(log=log, pause=0.02))
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=ensure_dataset, args=(plan, 1)) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 0]
    assert rendered(log) == list(range(10))
    assert len(ensure_dataset(plan, 1, array=PRESETS["circle4"])) == 10
