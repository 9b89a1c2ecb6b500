"""Paired comparison of reports, against a slow reference, and the table of a sweep."""

import json

import numpy as np
import pytest
import yaml

from fauna.errors import FaunaError
from fauna.evaluation.compare import Loaded, compare, compare_command, load, paired, text
from fauna.evaluation.table import build_table, find_runs, markdown, table_command


def loaded(name: str, scores: dict[str, dict[str, float]], *, sha: str = "s", seed: int = 0) -> Loaded:
    """scores: species -> photo -> iou."""
    images = {p: {"species": s, "scores": {"iou": v}} for s, photos in scores.items() for p, v in photos.items()}
    mean = float(np.mean([np.mean(list(photos.values())) for photos in scores.values()]))
    protocol = {"dataset": {"sha256": sha}, "seed": seed, "pairs": 10, "size": 32, "settings": []}
    metrics = {"iou": {"value": mean, "low": mean, "high": mean, "n": len(images)}}
    return Loaded(name, {"metrics": metrics, "protocol": protocol}, {"metrics": images})


def random_scores(seed: int, shift: float, spread: float) -> dict[str, dict[str, float]]:
    rng = np.random.default_rng(seed)
    sizes = {"dog": 12, "horse": 5}
    return {
        s: {f"{s}/{i}": float(0.5 + 0.02 * i + shift + spread * rng.normal()) for i in range(n)}
        for s, n in sizes.items()
    }


def test_difference_and_interval_equal_a_slow_reference():
    first, other = loaded("a", random_scores(0, 0.0, 0.02)), loaded("b", random_scores(1, 0.03, 0.02))
    row = paired(first, other, "metrics", "iou", bootstrap=4000, seed=0)
    differences = {
        s: np.array([other.images["metrics"][p]["scores"]["iou"] - v["scores"]["iou"]
                     for p, v in first.images["metrics"].items() if v["species"] == s])
        for s in ("dog", "horse")
    }  # fmt: skip
    expected = np.mean([d.mean() for d in differences.values()])
    rng = np.random.default_rng(99)
    slow = [np.mean([rng.choice(d, len(d)).mean() for d in differences.values()]) for _ in range(4000)]
    assert row["difference"] == pytest.approx(expected, abs=1e-12)
    assert (row["low"], row["high"]) == pytest.approx(np.percentile(slow, (2.5, 97.5)), abs=2e-3)
    assert row["n"] == 17


def test_equal_reports_show_no_difference_and_a_constant_gain_a_clear_one():
    first = loaded("a", random_scores(0, 0.0, 0.02))
    same = paired(first, first, "metrics", "iou", bootstrap=500, seed=0)
    assert (same["difference"], same["low"], same["high"], same["p"]) == (0.0, 0.0, 0.0, 1.0)
    better = paired(first, loaded("b", random_scores(0, 0.01, 0.02)), "metrics", "iou", bootstrap=500, seed=0)
    assert better["p"] == 1 / 500
    assert better["low"] == pytest.approx(0.01)


def test_pairing_sees_what_the_intervals_of_both_reports_hide():
    """Photos differ far more than models do."""
    wide = {"dog": {f"dog/{i}": i / 30 for i in range(30)}}
    gain = {"dog": {name: value + 0.01 + 0.001 * (-1) ** i for i, (name, value) in enumerate(wide["dog"].items())}}
    row = paired(loaded("a", wide), loaded("b", gain), "metrics", "iou", bootstrap=500, seed=0)
    assert 0.009 < row["low"] < row["high"] < 0.011


def test_only_shared_photographs_are_paired_and_the_rest_is_told():
    first, other = random_scores(0, 0.0, 0.02), random_scores(0, 0.0, 0.02)
    del other["dog"]["dog/3"]
    result = compare([loaded("a", first), loaded("b", other, sha="t", seed=1)], bootstrap=100, seed=0)
    assert result["metrics"]["metrics"]["iou"]["against_first"][0]["n"] == 16
    assert any("other photographs" in warning for warning in result["warnings"])
    assert any("seed=1" in warning for warning in result["warnings"])
    assert "warning: b was evaluated on other photographs than a" in text(result)


def test_nothing_in_common_gives_no_number():
    row = paired(
        loaded("a", {"dog": {"x": 0.1}}), loaded("b", {"dog": {"y": 0.1}}), "metrics", "iou", bootstrap=9, seed=0
    )
    assert row == {"difference": None, "low": None, "high": None, "p": None, "n": 0}


def test_comparison_is_repeatable():
    pair = [loaded("a", random_scores(0, 0.0, 0.02)), loaded("b", random_scores(1, 0.0, 0.02))]
    assert compare(pair, bootstrap=200, seed=3) == compare(pair, bootstrap=200, seed=3)


def save(folder, each: Loaded):
    folder.mkdir(parents=True)
    (folder / "report.json").write_text(json.dumps(each.report))
    (folder / "images.json").write_text(json.dumps(each.images))
    return folder


def test_command(tmp_path, capsys):
    for name, shift in (("one", 0.0), ("two", 0.1)):
        save(tmp_path / name, loaded(name, random_scores(0, shift, 0.02)))
    compare_command([str(tmp_path / "one"), str(tmp_path / "two"), f"out={tmp_path}/c.json", "bootstrap=50"])
    shown = capsys.readouterr().out
    assert "+0.100 [+0.100, +0.100]" in shown
    assert "better" in shown
    assert json.loads((tmp_path / "c.json").read_text())["reports"] == ["one", "two"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["only"], "at least two report folders, got 1"),
        (["a", "b"], "report.json"),
        (["a", "b", "bootstrap=many"], "report.json|whole number"),
        (["a", "--fast"], "got a flag"),
    ],
)
def test_wrong_arguments(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FaunaError, match=words) as caught:
        compare_command(arguments)
    assert "\n" not in str(caught.value)


def sweep(tmp_path, slots=(2, 60)):
    for job, number in enumerate(slots):
        run = tmp_path / "sweep" / str(job)
        (run / ".hydra").mkdir(parents=True)
        (run / "weights.safetensors").write_bytes(b"")
        (run / ".hydra" / "overrides.yaml").write_text(
            yaml.safe_dump(["+experiment=laptop", f"bank.num_slots={number}"])
        )
    return tmp_path / "sweep"


def test_table_evaluates_what_has_no_report_and_stars_clear_differences(tmp_path, capsys):
    folder = sweep(tmp_path)
    save(folder / "0" / "evaluation", loaded("0", random_scores(0, 0.0, 0.02)))
    asked = []

    def evaluate(run, out, overrides):
        asked.append((run.name, overrides))
        save(out, loaded(run.name, random_scores(0, 0.05, 0.02)))
        return {}

    table_command([str(folder), "max_photos=5"], evaluate)
    assert asked == [("1", ["max_photos=5", "seed=0"])]
    rows = (folder / "table.md").read_text().splitlines()
    assert rows[0] == "| run | bank.num_slots | iou |"
    assert rows[2].startswith("| 0 | 2 |")
    assert rows[3].startswith("| 1 | 60 |")
    assert rows[3].endswith("* |")
    assert not rows[2].endswith("* |")
    assert json.loads((folder / "table.json").read_text())["changed"] == ["bank.num_slots"]
    assert "evaluating" in capsys.readouterr().out
    table_command([str(folder)], evaluate)
    assert len(asked) == 1


def test_jobs_are_sorted_by_number(tmp_path):
    assert [run.name for run in find_runs(sweep(tmp_path, slots=range(1, 13)))] == [str(job) for job in range(12)]


def test_what_is_no_sweep_is_refused(tmp_path):
    with pytest.raises(FaunaError, match="folder of a sweep"):
        find_runs(tmp_path)
    with pytest.raises(FaunaError, match="expected one folder, got 0"):
        table_command(["seed=1"], lambda *_: {})
    with pytest.raises(FaunaError, match="report.json"):
        load(tmp_path)


def test_markdown_of_one_run(tmp_path):
    folder = sweep(tmp_path, slots=(2,))
    save(folder / "0" / "evaluation", loaded("0", random_scores(0, 0.0, 0.02)))
    assert "| 0 |" in markdown(build_table(find_runs(folder), seed=0))
