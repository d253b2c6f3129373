"""Which file or module a name means, what its sources are, and when it is imported anew."""

import shutil
import sys

import pytest

from rkfbench import own
from rkfbench.errors import RkfbenchError, SpecError
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
    with pytest.raises(RkfbenchError, match="source of plugins:whole was changed while the study ran"):
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
    before = sources.digest(inside, installed=False)
    assert sources.digest(inside, installed=False) == before
    monkeypatch.setattr(sources, "_version", lambda package: "0" if package == "annotated_types" else "1")
    other = sources.digest(inside, installed=False)
    monkeypatch.setattr(sources, "_version", lambda package: "1")
    assert len({before, other, sources.digest(inside, installed=False)}) == 3


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


def test_entry_points_are_names_too(folder, monkeypatch):
    from rkfbench.filters import build

    monkeypatch.setattr(
        names, "entry_points", lambda group: {"theirs": "plugins:stepwise"} if group == "filters" else {}
    )
    assert build("theirs", inflate=2.0).params == {"inflate": 2.0}
    assert set(own.pins({"use": "theirs"})) == {"theirs"}
    with pytest.raises(SpecError, match="unknown filter 'thiers'"):
        build("thiers")
