import pytest
import yaml
from omegaconf import OmegaConf

from fauna._conf import CONF_DIR
from fauna.errors import FaunaError
from fauna.queue.plan import read_plan
from tests.runs import composed


def test_the_rows_of_the_paper_are_there_and_first_seeds_come_first():
    plan = read_plan("ablation", [])
    runs = [run.name for run in plan.runs()]
    assert runs[: len(plan.rows)] == [f"{row}-0" for row in plan.rows]
    assert {"final", "no_bank", "category", "no_adversarial", "single", "k2", "k10", "k100"} == set(plan.rows)
    assert runs.count("final-1") == 1
    assert "k2-1" not in runs
    assert len(set(runs)) == len(runs)


def test_keys_can_be_changed_and_lists_may_nest():
    plan = read_plan(
        "ablation", ["evaluations.real=[data=fauna,data.root=photos,baselines=[]]", "seeds=[3,4]", "experiment=tiny"]
    )
    assert plan.evaluations["real"] == ["data=fauna", "data.root=photos", "baselines=[]"]
    assert "zoo" in plan.evaluations
    assert plan.seeds == [3, 4]
    assert plan.experiment == "tiny"


def test_common_words_come_before_those_of_a_row():
    runs = {
        run.name: run.overrides
        for run in read_plan("ablation", ["common=[init_from=a.safetensors,init_components=[viewpoint,shape]]"]).runs()
    }
    assert runs["final-0"] == ("init_from=a.safetensors", "init_components=[viewpoint,shape]")
    assert runs["k2-0"] == ("init_from=a.safetensors", "init_components=[viewpoint,shape]", "bank.num_slots=2")


def settings(node, path=()):
    """Every setting of a configuration by its path."""
    if isinstance(node, dict):
        return {key: value for name, below in node.items() for key, value in settings(below, (*path, name)).items()}
    return {path: node}


@pytest.mark.parametrize("experiment", ["ablation", "ablation_bodies"])
def test_a_row_differs_from_the_first_in_what_it_names_only(experiment):
    rows = {}
    for run in read_plan("ablation", []).runs():
        if run.seed == 0:
            words = (f"+experiment={experiment}", *run.overrides)
            rows[run.row] = settings(OmegaConf.to_container(composed(*words), resolve=False))
    final = rows.pop("final")
    changed = {
        row: {
            ".".join(key): of_row.get(key) for key in final.keys() | of_row.keys() if final.get(key) != of_row.get(key)
        }
        for row, of_row in rows.items()
    }
    assert {row: {key.split(".")[0] for key in keys} for row, keys in changed.items()} == {
        "no_bank": {"bank", "batch_code"},
        "category": {"bank"},
        "no_adversarial": {"discriminator"},
        **dict.fromkeys(("single", "k2", "k10", "k100"), {"bank"}),
    }
    assert [changed[row] for row in ("k2", "k10", "k100")] == [{"bank.num_slots": slots} for slots in (2, 10, 100)]


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("ablatoin", [], "expected one of ablation"),
        ("missing.yaml", [], "expected one of ablation"),
        ("ablation", ["epochs=3"], "with a key among out, table, experiment"),
        ("ablation", ["rows.final=bank=none"], "rows.final"),
        ("ablation", ["more_seeds.nobody=[1]"], "names of rows"),
        ("ablation", ["seeds=[one]"], "whole numbers"),
        ("ablation", ["common=init_from=a"], "common"),
        ("ablation", ["common=[init_from]"], "common with 'init_from', where KEY=VALUE belongs"),
        ("ablation", ["seeds=[]"], "no seeds for k2, k10, k100"),
    ],
)
def test_wrong_words_get_one_line(name, changes, expected):
    with pytest.raises(FaunaError, match=expected) as caught:
        read_plan(name, changes)
    assert "\n" not in str(caught.value)


def test_a_file_of_ones_own(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "experiment: tiny\nseeds: [0]\nrows: {a: [], b: [bank=none]}\nevaluations: {zoo: [data=zoo]}\nmetrics: [iou]\n"
    )
    assert [run.name for run in read_plan(str(path), []).runs()] == ["a-0", "b-0"]
    path.write_text("rows: [")
    with pytest.raises(FaunaError, match="mend"):
        read_plan(str(path), [])


def test_the_rare_species_of_the_table_are_those_of_the_data():
    data = yaml.safe_load((CONF_DIR / "data" / "zoo_few_shot.yaml").read_text())
    assert sorted(read_plan("ablation", []).groups["few_shot"]) == sorted(data["source"]["few_shot"])


GOOD = {"experiment": "tiny", "seeds": [0], "rows": {"a": []}, "evaluations": {"zoo": ["data=zoo"]}, "metrics": ["iou"]}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"common": "init_from=w"}, "common = 'init_from=w'"),
        ({"common": [3]}, "common"),
        ({"experiment": 3}, "experiment = 3"),
        ({"rows": ["a"]}, "rows = "),
        ({"rows": {"../a": []}}, "'../a'"),
        ({"metrics": "iou"}, "metrics = 'iou'"),
        ({"seeds": 3}, "seeds 3"),
        ({"seeds": [True]}, "whole numbers"),
        ({"seeds": [-1]}, "whole numbers"),
        ({"more_seeds": {"a": 1}}, "whole numbers"),
        (None, "got .*; mend"),
    ],
)
def test_files_of_another_form_get_one_line(tmp_path, change, expected):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump([1] if change is None else GOOD | change))
    with pytest.raises(FaunaError, match=f"^fauna-queue: expected a queue .*{expected}") as caught:
        read_plan(str(path), [])
    assert "\n" not in str(caught.value)
