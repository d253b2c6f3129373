"""A disk that is full, a folder that may not be written, files that are damaged: told in one message, then mended."""

from __future__ import annotations

import os
import random
import resource
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.survive.study import Study, goes_on, is_whole

slow = pytest.mark.slow


class Disk:
    """A file system of its own in memory (root may make one)."""

    def __init__(self, place: Path) -> None:
        self.place = place
        place.mkdir()
        done = subprocess.run(["mount", "-t", "tmpfs", "tmpfs", str(place)], capture_output=True, check=False)
        if done.returncode:
            pytest.skip("needs the right to mount a file system")

    def set(self, options: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{options}", str(self.place)], check=True)

    def close(self) -> None:
        subprocess.run(["umount", str(self.place)], check=True)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    disk = Disk(tmp_path / "disk")
    yield disk
    disk.close()


@slow
@pytest.mark.parametrize("kilobytes", [16, 200, 560, 700, 1500, 2900, 2960, 3010])
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_full_disk_is_one_message_and_a_larger_one_completes_the_study(
    disk: Disk, whole: dict[str, bytes], kilobytes: int, jobs: str
) -> None:
    study = Study.at(disk.place)
    disk.set(f"size={kilobytes}k")
    done = study.run("--jobs", jobs)
    assert done.code == 2, "choose sizes below what the study needs"
    assert "No space left on device\nwhat was finished is kept: mend this" in done.err
    assert "Traceback" not in done.err
    is_whole(study, whole)
    assert [name for name in study.hidden() if name != ".lock"] == []
    disk.set("size=32m")
    goes_on(study, whole, "--jobs", jobs)


@slow
@pytest.mark.parametrize("most", [1_000, 120_000, 900_000])
def test_a_file_that_may_not_grow_is_one_message(study: Study, whole: dict[str, bytes], most: int) -> None:
    """As under a quota: the system refuses to write more (here: more into one file)."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    done = study.run("--jobs", "1", preexec_fn=limit)
    assert (done.code, "Traceback" in done.err) == (2, False)
    assert "File too large\nwhat was finished is kept" in done.err
    is_whole(study, whole)
    assert study.hidden() == []
    goes_on(study, whole)


@slow
def test_a_file_system_that_may_only_be_read_is_one_message(disk: Disk, whole: dict[str, bytes]) -> None:
    study = Study.at(disk.place)
    for made in (False, True):  # a folder that is not there yet, and one that is complete
        disk.set("ro")
        done = study.run("--jobs", "1")
        assert (done.code, "Traceback" in done.err) == (2, False)
        assert "cannot write" in done.err and "Read-only file system" in done.err
        disk.set("rw")
        if not made:
            goes_on(study, whole)
    assert study.numbers() == whole


@slow
@pytest.mark.parametrize("closed", [".", "results/survivor", "results/survivor/blocks", "results/survivor/tables"])
def test_a_folder_that_may_not_be_written_is_one_message(study: Study, whole: dict[str, bytes], closed: str) -> None:
    assert study.run("--jobs", "1").code == 0
    (study.place / closed).chmod(0o555)
    # root may write everywhere, unless that right is taken away
    like_others = ("setpriv", "--bounding-set", "-dac_override", "--") if os.geteuid() == 0 else ()
    if like_others and not shutil.which("setpriv"):
        pytest.skip("root may write everywhere")
    done = study.run("--fresh", "--jobs", "1", under=like_others)
    (study.place / closed).chmod(0o755)
    if closed == ".":  # nothing is made in there
        assert done.code == 0
    else:
        assert (done.code, "Traceback" in done.err) == (2, False)
        assert f"cannot write {study.place / closed}" in done.err and "Permission denied" in done.err
    is_whole(study, whole)
    goes_on(study, whole)


def cut(content: bytes) -> bytes:
    return content[: random.randrange(len(content))]


def flipped(content: bytes) -> bytes:
    place = random.randrange(len(content))
    return content[:place] + bytes([content[place] ^ 1 << random.randrange(8)]) + content[place + 1 :]


@slow
@pytest.mark.parametrize("damage", [cut, flipped])
def test_whatever_file_is_damaged_is_told_and_made_again(
    small: Study, small_whole: dict[str, bytes], damage: Callable[[bytes], bytes]
) -> None:
    assert small.run_here().code == 0
    for name in [*small.files(), "manifest.json"]:
        path = small.results / name
        whole = path.read_bytes()
        path.write_bytes(damaged := damage(whole))
        done = small.run_here()
        assert done.code == 0, done.err
        if name.startswith("blocks/"):
            assert f"{path} is damaged" in done.err
            assert "1 blocks computed, 1 used again" in done.err
        elif name.endswith((".csv", ".yaml")) or (name == "manifest.json" and len(damaged) < len(whole)):
            assert f"making again {name}: not what was written there" in done.err
        assert small.numbers() == small_whole, name
        assert small.listed().keys() == {other for other in small.files() if not other.startswith("blocks/")}
    assert "making again" not in small.run_here().err
