"""Which file or module a name means, what its sources are, and when it is imported anew."""

import shutil
import sys

import pytest

from rkfbench import own
from rkfbench.errors import InputChanged, SpecError
from rkfbench.own import names, sources


@pytest.mark.parametrize("name", ["a:b", "a.b:c", "x/y.py:z", "a b.py:c"])
def test_a_colon_makes_a_reference(name):
    assert own.is_reference(name)
    assert own.short(name) == name[-1]


@pytest.mark.parametrize("name", ["hkf", "a:", ":b", "a:b c", "a:1", None, 3, "rmse[px]@k"])
def test_other_names_are_none(name):
    assert not own.is_reference(name)
    assert own.short(name) == name


def test_a_file_a_module_beside_the_scenario_and_an_installed_one_are_found(folder):
    assert names.find("plugins.py:stepwise").__doc__.startswith("A Kalman filter")
    assert names.find("plugins:stepwise").__doc__.startswith("A Kalman filter")
    assert names.find("rkfbench.filters.linear:kf").__name__ == "kf"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nothing.py:a", "no file nothing.py in"),
        ("no_such_module:a", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("plugins.py:stepwize", "did you mean 'stepwise'"),
        ("../plugins.py:stepwise", "not inside the folder of the scenario"),
        ("broken.py:a", r"SyntaxError.*line 2"),
        ("stops.py:a", r"SystemExit: 3 \(stops.py, line 2\)"),
        ("raises.py:a", r"ZeroDivisionError: division by zero \(raises.py, line 1\)"),
    ],
)
def test_what_cannot_be_found_or_imported_is_told(folder, name, message):
    (folder / "broken.py").write_text("a = 1\ndef a(:\n")
    (folder / "stops.py").write_text("import sys\nsys.exit(3)\n")
    (folder / "raises.py").write_text("a = 1 / 0\n")
    with pytest.raises(SpecError, match=message):
        names.find(name)


def test_what_changes_on_the_disk_is_imported_anew_also_in_a_neighbour(folder):
    (folder / "one.py").write_text("from two import b\na = b\n")
    (folder / "two.py").write_text("b = 1\n")
    assert names.find("one:a") == 1
    before = own.pins(["one:a"])
    (folder / "two.py").write_text("b = 2\n")
    own.beside(folder)
    assert names.find("one:a") == 2
    assert own.pins(["one:a"]) != before


def test_another_process_refuses_other_sources(folder):
    names.find("plugins:whole")
    pins = own.pins(["plugins:whole"])
    own.ready(str(folder), pins)
    (folder / "helper.py").write_text("gain = None\n")
    with pytest.raises(InputChanged, match="source of plugins:whole was changed while the study ran"):
        own.ready(str(folder), pins)


def test_each_folder_has_its_own_files(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other")
    (other / "plugins.py").write_text("from helper import gain\n")
    (other / "helper.py").write_text("gain = 7\n")
    assert callable(names.find("plugins:gain"))
    own.beside(other)
    assert names.find("plugins:gain") == 7
    assert sys.path.count(str(folder)) == 0
    own.beside(folder)
    assert callable(names.find("plugins:gain"))


def test_a_neighbour_with_the_name_of_something_else_is_told(folder):
    (folder / "uses.py").write_text("import json\na = 1\n")
    (folder / "json.py").write_text("")
    with pytest.raises(SpecError, match=r"imports 'json'.*give json.py another name"):
        names.find("uses:a")


def test_the_hash_is_that_of_the_sources_wherever_they_stand(folder, tmp_path_factory):
    names.find("plugins:whole")
    here = own.pins(["plugins:whole"])
    other = tmp_path_factory.mktemp("other")
    for name in ("plugins.py", "helper.py"):
        shutil.copy(folder / name, other)
    own.beside(other)
    names.find("plugins:whole")
    assert own.pins(["plugins:whole"]) == here


def test_the_versions_of_imported_packages_belong_to_the_hash(folder, monkeypatch):
    inside = sources.closure(folder / "plugins.py", "plugins", folder)
    assert sorted(inside) == ["helper", "plugins"]
    before = sources.digest(inside, folder)
    assert sources.digest(inside, folder) == before
    monkeypatch.setattr(sources, "_version", lambda package: "0" if package == "annotated_types" else "1")
    other = sources.digest(inside, folder)
    monkeypatch.setattr(sources, "_version", lambda package: "1")
    assert len({before, other, sources.digest(inside, folder)}) == 3


def test_relative_and_nested_imports_are_followed(tmp_path):
    package = tmp_path / "pack"
    (package / "deep").mkdir(parents=True)
    for path, text in {
        "__init__.py": "",
        "a.py": "from .b import x\nfrom .deep import c\nimport numpy",
        "b.py": "from . import d\nx = 1",
        "d.py": "",
        "deep/__init__.py": "",
        "deep/c.py": "from ..unused import nothing",
        "unused.py": "",
        "stranger.py": "",
    }.items():
        (package / path).write_text(text)
    found = sources.closure(package / "a.py", "pack.a", None)
    assert sorted(found) == ["pack", "pack.a", "pack.b", "pack.d", "pack.deep", "pack.deep.c", "pack.unused"]


def installed(place, package: str, version: str) -> None:
    """A distribution with one module, as pip leaves it behind in `place`."""
    info = place / f"{package}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")


def test_a_module_from_elsewhere_without_a_version_belongs_to_the_hash(folder, tmp_path_factory, monkeypatch):
    place = tmp_path_factory.mktemp("elsewhere")
    (place / "rkf_loose.py").write_text("from rkf_deeper.inner import GAIN\n")
    (place / "rkf_deeper").mkdir()
    (place / "rkf_deeper/inner.py").write_text("GAIN = 1\n")  # a namespace package
    monkeypatch.syspath_prepend(str(place))
    (folder / "uses.py").write_text("from rkf_loose import GAIN\n")
    assert names.find("uses:GAIN") == 1
    before = own.pins(["uses:GAIN"])
    assert sorted(own.copies(["uses:GAIN"])) == ["uses.py"]
    (place / "rkf_deeper/inner.py").write_text("GAIN = 22\n")
    own.beside(folder)
    assert names.find("uses:GAIN") == 22
    assert own.pins(["uses:GAIN"]) != before


def test_an_editable_package_is_hashed_and_an_installed_one_has_a_version(folder, tmp_path_factory, monkeypatch):
    site, project = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("project")
    installed(site, "rkf_editable", "1.0")
    installed(site, "rkf_installed", "2.0")
    (project / "rkf_editable.py").write_text("A = 1\n")
    (site / "rkf_installed.py").write_text("B = 1\n")
    monkeypatch.syspath_prepend(str(project))
    monkeypatch.syspath_prepend(str(site))
    (folder / "uses.py").write_text("import rkf_editable, rkf_installed\n")
    inside = sources.closure(folder / "uses.py", "uses", folder)
    assert sorted(inside) == ["rkf_editable", "uses"]


def test_a_compiled_module_beside_the_scenario_belongs_to_it(folder):
    (folder / "fast.abi3.so").write_bytes(b"\x7fELF")
    (folder / "uses.py").write_text("try:\n    import fast\nexcept ImportError:\n    pass\na = 1\n")
    names.find("uses:a")
    assert sorted(own.copies(["uses:a"])) == ["fast.abi3.so", "uses.py"]


READER = """\
from pathlib import Path

READS = ["deep/w.txt"]
a = float(Path(__file__).with_name("deep").joinpath("w.txt").read_text())
"""


def test_the_files_that_a_plugin_reads_are_hashed_and_copied(folder):
    (folder / "deep").mkdir()
    (folder / "deep/w.txt").write_text("1.5")
    (folder / "reader.py").write_text(READER)
    (folder / "uses.py").write_text("from reader import a\n")
    assert names.find("uses:a") == 1.5
    before = own.pins(["uses:a"])
    assert set(own.copies(["uses:a"])) == {"uses.py", "reader.py", "deep/w.txt"}
    (folder / "deep/w.txt").write_text("2.5")
    assert own.copies(["uses:a"])["deep/w.txt"] == b"1.5"  # as it was read
    with pytest.raises(InputChanged, match="source of uses:a was changed"):
        own.ready(str(folder), before)
    assert names.find("uses:a") == 2.5
    (folder / "deep/w.txt").unlink()
    with pytest.raises(InputChanged):
        own.ready(str(folder), before)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = __file__\n", r"reader.py asks for __file__ and does not say what it reads there: write READS = "),
        ("READS = ['none.txt']\na = 1\n", r"READS of reader.py names none.txt, and there is no such file"),
        ("READS = ['../w.txt']\na = 1\n", r"names \.\./w.txt, which is not in the folder of reader.py"),
        ("READS: list = list('ab')\na = 1\n", r"READS should be a list of names, written out"),
        ("READS = [1]\na = 1\n", r"READS should be a list of names, written out"),
    ],
)
def test_what_does_not_say_what_it_reads_is_told(folder, text, message):
    (folder / "reader.py").write_text(text)
    with pytest.raises(SpecError, match=message):
        names.find("reader:a")


def test_a_plugin_that_reads_nothing_where_it_stands_says_so(folder):
    (folder / "reader.py").write_text("READS = []\na = __file__\n")
    assert names.find("reader:a") == str(folder / "reader.py")


def test_entry_points_are_names_too(folder, monkeypatch):
    from rkfbench.filters import build

    monkeypatch.setattr(
        names, "entry_points", lambda group: {"theirs": "plugins:stepwise"} if group == "filters" else {}
    )
    assert build("theirs", inflate=2.0).params == {"inflate": 2.0}
    assert set(own.pins({"use": "theirs"})) == {"theirs"}
    with pytest.raises(SpecError, match="unknown filter 'thiers'"):
        build("thiers")


def test_a_process_that_lacks_an_installed_package_refuses(folder):
    with pytest.raises(InputChanged, match="source of theirs"):
        own.ready(str(folder), {"theirs": "0123"})


def test_what_python_looked_through_before_stays(tmp_path, monkeypatch):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "my.py").write_text("def f(model, y, x0, P0, Q, R):\n    return y\n")
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    before = list(sys.path)
    for folder in (tmp_path, mine):
        own.beside(folder)
    assert names.find("my.py:f") and sys.path == [*before, f"{mine}{names.OURS}"]
    own.beside(tmp_path)
    assert sys.path == before
