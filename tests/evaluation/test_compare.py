"""Paired comparison of reports, against a slow reference, and the table of a sweep."""

import json

import numpy as np
import pytest
import yaml

from fauna.errors import FaunaError
from fauna.evaluation.compare import Loaded, compare, compare_command, distinct_names, load, paired, text
from fauna.evaluation.table import build_table, find_runs, markdown, table_command
from fauna.evaluation.tallies import NamedTally, write_tallies
from fauna.metrics.tally import Tally, image_tally


def loaded(name: str, scores: dict[str, dict[str, float]], *, sha: str = "s", seed: int = 0) -> Loaded:
    """scores: species -> photo -> iou."""
    rows = {s: NamedTally(tuple(photos), image_tally(list(photos.values()))) for s, photos in scores.items()}
    mean = float(np.mean([np.mean(list(photos.values())) for photos in scores.values()]))
    protocol = {"dataset": {"sha256": sha}, "seed": seed, "pairs": 10, "size": 32, "settings": []}
    metrics = {"iou": {"value": mean, "low": mean, "high": mean, "n": sum(map(len, scores.values()))}}
    return Loaded(name, {"metrics": metrics, "protocol": protocol}, {"metrics": {"iou": rows}})


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
    ours, theirs = random_scores(0, 0.0, 0.02), random_scores(1, 0.03, 0.02)
    differences = {s: np.array([theirs[s][p] - value for p, value in ours[s].items()]) for s in ours}
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


def pairs_of(number: int, seed: int, share: float, *, reverse: bool = False) -> NamedTally:
    """All ordered pairs of photographs with two keypoints each; ``share`` of what counts is right."""
    rng = np.random.default_rng(seed)
    owners = np.array([(i, j) for i in range(number) for j in range(number) if i != j])
    counts = (np.random.default_rng(5).random((len(owners), 2)) < 0.8).astype(float)
    sums = counts * (rng.random((len(owners), 2)) < share)
    names = tuple(f"photo/{i}" for i in range(number))
    if reverse:  # the same photographs listed and paired in another order
        return NamedTally(names[::-1], Tally(number - 1 - owners[::-1], sums[::-1], counts[::-1], ("nose", "tail")))
    return NamedTally(names, Tally(owners, sums, counts, ("nose", "tail")))


def slow_value(named: NamedTally, draws: list[str]) -> float:
    """Mean over keypoints of the share that is right, over all pairs of drawn photographs, one by one."""
    right, counted = np.zeros(2), np.zeros(2)
    for (source, target), sums, counts in zip(named.tally.owners, named.tally.sums, named.tally.counts, strict=True):
        times = draws.count(named.names[source]) * draws.count(named.names[target])
        right, counted = right + times * sums, counted + times * counts
    return float(np.mean(right / counted))


def test_of_pairs_sources_and_targets_are_drawn_alike():
    """The interval equals that of drawing photographs and keeping the pairs both of whose ends are drawn."""
    first, other = pairs_of(12, 1, 0.5), pairs_of(12, 2, 0.6, reverse=True)
    reports = [Loaded(name, {}, {"metrics": {"kt": {"dog": each}}}) for name, each in (("a", first), ("b", other))]
    row = paired(*reports, "metrics", "kt", bootstrap=3000, seed=0)
    everyone = list(first.names)
    assert row["difference"] == pytest.approx(slow_value(other, everyone) - slow_value(first, everyone), abs=1e-12)
    rng = np.random.default_rng(99)
    slow = []
    for _ in range(400):
        draws = rng.choice(everyone, len(everyone)).tolist()
        slow.append(slow_value(other, draws) - slow_value(first, draws))
    assert row["high"] - row["low"] == pytest.approx(np.ptp(np.percentile(slow, (2.5, 97.5))), rel=0.2)
    targets_only = []
    for _ in range(400):
        draws = rng.integers(12, size=12)
        by_target = [np.flatnonzero(first.tally.owners[:, 1] == target) for target in draws]
        units = np.concatenate(by_target)
        rows = [
            (each.tally.sums[units].sum(0) / each.tally.counts[units].sum(0)).mean()
            for each in (first, pairs_of(12, 2, 0.6))
        ]
        targets_only.append(rows[1] - rows[0])
    assert row["high"] - row["low"] > 1.2 * np.ptp(np.percentile(targets_only, (2.5, 97.5)))
    assert row["n"] == 12


def test_what_only_one_report_counts_is_not_paired():
    first, other = pairs_of(6, 1, 0.5), pairs_of(6, 2, 0.6)
    other.tally.counts[:, 1] = 0
    reports = [Loaded(name, {}, {"metrics": {"kt": {"dog": each}}}) for name, each in (("a", first), ("b", other))]
    row = paired(*reports, "metrics", "kt", bootstrap=50, seed=0)
    nose = [each.tally.sums[:, 0].sum() / each.tally.counts[:, 0].sum() for each in (first, other)]
    assert row["difference"] == pytest.approx(nose[1] - nose[0], abs=1e-12)


def test_keys_and_groups_of_all_reports_are_shown():
    first, other = loaded("a", random_scores(0, 0.0, 0.02)), loaded("b", random_scores(0, 0.0, 0.02))
    more = {**other.report["metrics"], "chamfer": {"value": 0.1, "low": None, "high": None, "n": 3}}
    held = {"metrics": {"iou": {"value": 0.4, "low": 0.3, "high": 0.5, "n": 2}}}
    tallies = {**other.tallies, "held_out": {"iou": {"wolf": NamedTally(("w",), image_tally([0.4]))}}}
    other = Loaded("b", {**other.report, "metrics": more, "held_out": held}, tallies)
    result = compare([first, other], bootstrap=20, seed=0)
    assert result["metrics"]["metrics"]["chamfer"]["values"] == [None, 0.1]
    assert result["metrics"]["metrics"]["chamfer"]["better"] == "lower"
    assert result["metrics"]["held_out"]["iou"]["values"] == [None, 0.4]
    assert result["metrics"]["held_out"]["iou"]["against_first"][0]["n"] == 0
    assert "held_out" in text(result)


def test_reports_are_told_apart_by_as_much_of_their_paths_as_it_takes(tmp_path):
    paths = [tmp_path / name for name in ("one/0/evaluation", "two/0/evaluation", "two/1")]
    assert distinct_names(paths) == ["one/0", "two/0", "1"]
    assert distinct_names([paths[0], paths[0]]) == ["0", "0 (2)"]


def test_comparison_is_repeatable():
    pair = [loaded("a", random_scores(0, 0.0, 0.02)), loaded("b", random_scores(1, 0.0, 0.02))]
    assert compare(pair, bootstrap=200, seed=3) == compare(pair, bootstrap=200, seed=3)


def save(folder, each: Loaded):
    folder.mkdir(parents=True)
    (folder / "report.json").write_text(json.dumps(each.report))
    write_tallies(folder / "tallies.npz", each.tallies)
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
    assert "| 0 |" in markdown(build_table(find_runs(folder), seed=0, missing={}))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("report.json", "[]"),
        ("report.json", '{"metrics": {}, "protocol": {}}'),
        ("report.json", '{"metrics": [], "protocol": {"dataset": {"sha256": ""}}}'),
        ("report.json", "{"),
        ("tallies.npz", "damaged"),
        ("tallies.npz", None),
    ],
)
def test_damaged_reports_are_refused(name, content, tmp_path):
    folder = save(tmp_path / "one", loaded("one", random_scores(0, 0.0, 0.02)))
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_text(content)
    with pytest.raises(FaunaError, match=r"report|tallies") as caught:
        load(folder)
    assert "\n" not in str(caught.value)


def test_runs_without_weights_stand_in_the_table(tmp_path, capsys):
    folder = sweep(tmp_path, slots=(2, 60, 100))
    (folder / "0" / "weights.safetensors").unlink()

    def evaluate(run, out, overrides):
        if run.name == "1":
            raise FaunaError("expected weights, got a damaged file; train again")
        save(out, loaded(run.name, random_scores(0, 0.05, 0.02)))
        return {}

    table_command([str(folder)], evaluate)
    rows = (folder / "table.md").read_text().splitlines()
    assert [row.split(" | ")[1] for row in rows[2:5]] == ["2", "60", "100"]
    assert rows[2].endswith("| – |")
    assert any("run 0: no weights" in row for row in rows)
    assert any("run 1: not evaluated: expected weights, got a damaged file" in row for row in rows)
    stored = json.loads((folder / "table.json").read_text())
    assert [bool(row["missing"]) for row in stored["runs"]] == [True, True, False]
    assert stored["first"] == "2"


def test_a_sweep_without_any_weights_is_refused(tmp_path):
    folder = sweep(tmp_path)
    for job in ("0", "1"):
        (folder / job / "weights.safetensors").unlink()
    with pytest.raises(FaunaError, match="can be evaluated, got none; of 0: no weights"):
        table_command([str(folder)], lambda *_: {})
