import pytest

from rkfbench.filters import FILTERS
from rkfbench.scenario.files import FOLDER
from rkfbench.scenario.json_schema import paper_schema, schema, texts
from rkfbench.scenario.schema import Reading, ScenarioFile


def objects(node: object) -> list[dict]:
    inner = node.values() if isinstance(node, dict) else node if isinstance(node, list) else ()
    here = [node] if isinstance(node, dict) and "properties" in node and node.get("type") == "object" else []
    return here + [each for value in inner for each in objects(value)]


def test_unknown_keys_are_refused_at_every_depth_but_of_plugins_and_overrides() -> None:
    free = ("A plug-in.", Reading.__doc__)
    for each in [each for whole in (schema(), paper_schema()) for each in objects(whole)]:
        assert each["additionalProperties"] is (each.get("description") in free)


def test_every_key_of_a_scenario_has_a_description() -> None:
    for name, field in ScenarioFile.model_fields.items():
        described = field.description or getattr(field.annotation, "__doc__", "")
        assert described, name


def test_filters_models_and_laws_come_from_the_catalogues() -> None:
    whole = schema()
    forms = whole["properties"]["filters"]["items"]["anyOf"]
    assert forms[0]["enum"] == list(FILTERS)
    hkf = next(each for each in forms[1:] if each.get("properties", {}).get("use") == {"const": "hkf"})
    assert {"threshold", "root", "label", "extra", "assumed"} <= set(hkf["properties"])
    assert {"const": "contaminated"} in [each["properties"]["kind"] for each in whole["$defs"]["Law"]["anyOf"]]


@pytest.mark.parametrize("name", texts())
def test_the_committed_schemas_are_current(name) -> None:
    stored = (FOLDER / name).read_text(encoding="utf-8")
    assert stored == texts()[name], "write them anew with rkfbench.scenario.json_schema.write()"
