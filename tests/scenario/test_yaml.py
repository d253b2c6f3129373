import pytest

from rkfbench.errors import RkfbenchError, ScenarioError
from rkfbench.scenario.locate import locate
from rkfbench.scenario.yaml import MOST_BYTES, MOST_VALUES, Mark, dump, parse, parse_value, read, scalar


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-7", -7),
        ("010", 10),
        ("1e-3", 0.001),
        ("1E5", 100000.0),
        (".5", 0.5),
        ("2.", 2.0),
        ("inf", float("inf")),
        ("-.inf", float("-inf")),
        ("true", True),
        ("False", False),
        ("null", None),
        ("~", None),
        ("no", "no"),
        ("on", "on"),
        ("yes", "yes"),
        ("0x10", "0x10"),
        ("1_000", "1_000"),
        ("12:30:45", "12:30:45"),
        ("2020-01-01", "2020-01-01"),
        ("nan", "nan"),
        ("1e", "1e"),
        (".", "."),
    ],
)
def test_plain_scalars_follow_yaml_1_2(text: str, value: object) -> None:
    found = scalar(text)
    assert found == value
    assert type(found) is type(value)


def test_quoted_scalars_are_strings() -> None:
    assert parse("a: '1'\nb: \"true\"\n", "x") == {"a": "1", "b": "true"}


def test_keys_are_always_text() -> None:
    assert parse("1: a\ntrue: b\n0.05: c\n", "x") == {"1": "a", "true": "b", "0.05": "c"}


def test_every_value_knows_its_place() -> None:
    root = parse("a:\n  b: [1, 2]\n  c:\n    - d\n", "x.yaml")
    assert locate(root, ("a", "b", 1))[:3] == ("x.yaml", 2, 10)
    assert locate(root, ("a", "b"), at_key=True)[:3] == ("x.yaml", 2, 3)
    assert locate(root, ("a", "c"))[:3] == ("x.yaml", 3, 3), "a block stands where its key stands"
    assert locate(root, ("a", "c", 0)).source == "    - d"
    assert locate(root, ("a", "nothing", "here"))[:3] == ("x.yaml", 1, 1)


@pytest.mark.parametrize(
    ("text", "place", "message"),
    [
        ("", "x", "the file is empty"),
        ("# only a comment\n", "x", "the file is empty"),
        ("- 1\n", "x:1:1", "should be a mapping"),
        ("just text\n", "x:1:1", "should be a mapping"),
        ("a: 1\nb: 2\na: 3\n", "x:3:1", "duplicate key 'a' (first in line 1)"),
        ("a: .nan\n", "x:1:4", "NaN is not a value"),
        ("a:\n\tb: 1\n", "x:2:1", "tabs cannot indent"),
        ("a: 1\n---\nb: 2\n", "x:2:1", "one document"),
        ("a: !!python/object:os.system x\n", "x:1:4", "tags such as"),
        ("a: &x [*x]\n", "x:1:8", "stands for nothing before it"),
        ("a: {b: 1\n", "x:2:1", "did not find expected"),
        ("<<: {a: 1}\n", "x:1:1", "merge keys are not used"),
        ("? [1]\n: 2\n", "x:1:3", "a key should be a plain name"),
        ("a: 1\n<<<<<<< ours\nb: 1\n=======\nb: 2\n>>>>>>> theirs\n", "x:2:1", "merge conflict"),
        ("a: \x01\n", "x", "characters that YAML does not allow"),
        ("a: " + "[" * 100 + "\n", "x:1:44", "levels deep"),
    ],
)
def test_what_is_no_plain_yaml_is_refused_with_its_place(text: str, place: str, message: str) -> None:
    with pytest.raises(ScenarioError) as error:
        parse(text, "x")
    first = str(error.value).splitlines()[0]
    assert first.startswith(f"{place}: ")
    assert message in first


def test_aliases_that_multiply_are_stopped() -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    with pytest.raises(ScenarioError, match=f"more than {MOST_VALUES} values"):
        parse("\n".join(lines), "x")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a: 1\nb: \xff\n", "x:2: not UTF-8 text"),
        (b"\x00\x01\x02", "x: not a text file"),
    ],
)
def test_files_that_are_no_text_are_refused(tmp_path, content, message) -> None:
    (tmp_path / "a.yaml").write_bytes(content)
    with pytest.raises(RkfbenchError, match=f"^{message}$") as error:
        read(tmp_path / "a.yaml", "x")
    assert error.value.exit_code == 2


def test_a_directory_and_a_missing_file_are_told_apart(tmp_path) -> None:
    with pytest.raises(RkfbenchError, match="x: is a directory"):
        read(tmp_path, "x")
    with pytest.raises(RkfbenchError, match="x: no such file"):
        read(tmp_path / "none.yaml", "x")


def test_a_byte_order_mark_is_skipped(tmp_path) -> None:
    (tmp_path / "a.yaml").write_bytes(b"\xef\xbb\xbfa: 1\n")
    assert read(tmp_path / "a.yaml", "x") == {"a": 1}


def test_a_value_of_an_option_stands_at_the_option() -> None:
    value = parse_value("{a: [1, {b: no}]}", Mark("--set x=..."))
    assert value == {"a": [1, {"b": "no"}]}
    assert locate(value, ("a", 1, "b")) == Mark("--set x=...")


def test_what_is_dumped_reads_back_the_same() -> None:
    texts = ["1e-3", "no", "0x1", ".5", "inf", ".nan", "~", "", "1:30", "a: b", "a\nb"]
    data = {"1e3": texts, "others": [1e-7, 1.0, 2, float("inf"), True, None, [], {}]}
    assert parse(dump(data), "x") == data


def test_a_file_larger_than_any_scenario_is_not_read(tmp_path) -> None:
    (tmp_path / "a.yaml").write_text("a: " + "x" * MOST_BYTES)
    with pytest.raises(RkfbenchError, match=r"^x: larger than 10 MB$") as error:
        read(tmp_path / "a.yaml", "x")
    assert error.value.exit_code == 2
