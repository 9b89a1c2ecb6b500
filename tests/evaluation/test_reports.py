"""Reports of hand-made predictions: what they hold, that they repeat, and that the page needs no network."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from fauna.errors import FaunaError
from fauna.evaluation.published import BANK_SIZES, COMPARISON, ROWS
from fauna.evaluation.reading import FORMAT
from fauna.evaluation.report import write_reports
from fauna.evaluation.report_cards import verdict
from fauna.evaluation.report_md import ordered
from fauna.evaluation.scoring import ScoreOptions
from fauna.evaluation.store import ArrayStore
from fauna.metrics.keys import DEFINITIONS, better, definition, lower_is_better
from tests.evaluation.objects import write_predictions

OPTIONS = ScoreOptions(seed=0, pairs=100, bootstrap=50, settings=("fit_on_test",))


@pytest.fixture
def predictions(tmp_path):
    return write_predictions(tmp_path / "predictions")


def test_report_has_its_parts(predictions, tmp_path):
    report = write_reports(predictions, tmp_path / "out", OPTIONS, pictures=5)
    stored = json.loads((tmp_path / "out" / "report.json").read_text())
    assert stored == json.loads(json.dumps(report))
    assert stored["metrics"]["iou"]["value"] == 1.0
    assert stored["metrics"]["iou"]["n"] == 6
    assert set(stored["metrics"]["iou"]) >= {"value", "low", "high", "n"}
    assert set(stored["species"]) == {"long", "round"}
    assert stored["species"]["long"]["metrics"]["iou"]["n"] == 3
    assert "nose" in stored["species"]["long"]["keypoints"]
    assert stored["baselines"]["mean_shape"]["metrics"]["iou"]["value"] == 1.0
    assert stored["baselines"]["mean_shape"]["description"]
    assert stored["protocol"]["seed"] == 0
    assert stored["protocol"]["pairs"] == 100
    assert stored["protocol"]["dataset"]["sha256"] == "1" * 64
    assert stored["protocol"]["definitions"]["iou"]
    assert stored["validation"]["iou"] == pytest.approx(0.8)
    assert stored["left_out"][0] == {
        "of": "model",
        "metrics": ["all"],
        "reason": "a broken file",
        "count": 1,
        "names": ["long/9"],
    }
    whole = next(row for row in stored["left_out"] if "chamfer" in row["metrics"] and row["of"] == "model")
    assert {"novel_view_iou", "azimuth_error_deg"} <= set(whole["metrics"])
    assert (whole["names"], whole["count"]) == (["long", "round"], 6)
    assert "chamfer" in stored["metrics"]
    assert "| chamfer |" not in (tmp_path / "out" / "report.md").read_text().split("## What the keys mean")[0]


def test_scoring_again_gives_the_same_report(predictions, tmp_path):
    first = write_reports(predictions, tmp_path / "a", OPTIONS, pictures=5)
    second = write_reports(predictions, tmp_path / "b", OPTIONS, pictures=5)
    assert {**first, "timing": 0} == {**second, "timing": 0}
    for name in ("images.json", "report.md"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_wider_masks_lower_the_silhouette_score_only(tmp_path):
    exact = write_reports(write_predictions(tmp_path / "p"), tmp_path / "a", OPTIONS, pictures=1)["metrics"]
    wide = write_reports(write_predictions(tmp_path / "q", grow=2), tmp_path / "b", OPTIONS, pictures=1)["metrics"]
    assert wide["iou"]["value"] < 0.9 < exact["iou"]["value"]
    assert wide["kt_pck@0.1"] == exact["kt_pck@0.1"]


def test_held_out_species_stand_apart(tmp_path):
    folder = write_predictions(tmp_path / "p", held_out=True)
    report = write_reports(folder, tmp_path / "out", OPTIONS, pictures=5)
    assert set(report["species"]) == {"long"}
    assert set(report["held_out"]["species"]) == {"round"}
    assert report["held_out"]["metrics"]["iou"]["n"] == 3
    images = json.loads((tmp_path / "out" / "images.json").read_text())
    assert {row["species"] for row in images["held_out"].values()} == {"round"}
    for row in images["held_out"].values():  # what each baseline scored on the same photograph
        assert set(row["baselines"]) == set(report["baselines"]) != set()
        assert row["baselines"]["mean_shape"]["iou"] == row["scores"]["iou"]  # the same meshes
    assert "Pictures of species never seen" in (tmp_path / "out" / "report.html").read_text()


def test_without_keypoints_the_reason_is_named(tmp_path):
    folder = write_predictions(tmp_path / "p", keypoints=False)
    report = write_reports(folder, tmp_path / "out", OPTIONS, pictures=5)
    assert report["metrics"]["iou"]["value"] == 1.0
    assert report["metrics"].get("kt_pck@0.1", {"value": None})["value"] is None
    reasons = {(metric, row["reason"]) for row in report["left_out"] for metric in row["metrics"]}
    assert ("keypoint metrics", "the dataset has no keypoints") in reasons
    assert ("3D metrics", "the dataset has no 3D truth") in reasons


class Page(HTMLParser):
    """Collects what a browser would fetch, and whether tags close."""

    def __init__(self):
        super().__init__()
        self.sources, self.open, self.images = [], [], 0

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href")]
        self.images += tag == "img"
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_whole_and_needs_no_network(predictions, tmp_path):
    write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)
    text = (tmp_path / "out" / "report.html").read_text()
    page = Page()
    page.feed(text)
    assert page.open == []
    assert page.images == 3  # best, median and worst of one species
    assert all(source.startswith(("data:image/png;base64,", "#")) for source in page.sources)
    assert not re.search(r"(?:https?:)?//[a-z]", re.sub(r"base64,[^\"]+", "", text))
    assert "<script" not in text


def test_first_screen_says_in_words_how_good_the_model_is(predictions, tmp_path):
    write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)
    top = (tmp_path / "out" / "report.html").read_text().split('id="pictures"')[0]
    assert "Outline" in top
    assert "100\N{NO-BREAK SPACE}%" in top
    assert "average animal" in top
    assert "iou" not in top
    assert "<table" not in top


def test_pictures_come_before_tables_and_the_papers_numbers_are_folded_at_the_end(predictions, tmp_path):
    write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)
    page = (tmp_path / "out" / "report.html").read_text()
    places = [
        page.index(text) for text in ('id="pictures"', "<table", 'id="protocol"', "<summary>Numbers of the paper")
    ]
    assert places == sorted(places)
    assert page.rindex("<details") < page.index("MagicPony")


def test_a_model_tried_on_new_species_only_is_shown_by_them(tmp_path):
    folder = write_predictions(tmp_path / "p", held_out=True)
    facts = json.loads((folder / "facts.json").read_text())
    del facts["groups"]["metrics"]
    (folder / "facts.json").write_text(json.dumps(facts))
    write_reports(folder, tmp_path / "out", OPTIONS, pictures=1)
    page = (tmp_path / "out" / "report.html").read_text()
    top = page.split('id="pictures"')[0]
    assert "tried on 3 photographs of 1 species it has never seen in training" in top
    assert "Outline" in top
    assert "average animal" in top
    assert "<h2>Pictures</h2>" not in page
    assert page.count("Pictures of species never seen") == 1


@pytest.mark.parametrize(("masks", "words"), [(True, "outline 100"), (False, "same spot on another animal")])
def test_captions_name_what_photographs_are_ranked_by(masks, words, tmp_path):
    folder = write_predictions(tmp_path / "p")
    if not masks:
        store = ArrayStore(folder / "samples", identity=None)
        items = [replace(item, arrays={k: v for k, v in item.arrays.items() if k != "mask"}) for item in store.items()]
        shutil.rmtree(folder / "samples")
        again = ArrayStore(folder / "samples", identity={"test": 1})
        for item in items:
            again.add(item)
        again.flush()
    write_reports(folder, tmp_path / "out", OPTIONS, pictures=1)
    caption = re.search(r"<figcaption>(best.*?)</figcaption>", (tmp_path / "out" / "report.html").read_text())
    assert caption
    assert words in caption[1]


def card_report(*, low: float, high: float, baseline: float) -> dict:
    row = {"value": (low + high) / 2, "low": low, "high": high, "n": 9}
    others = {"untrained": {"metrics": {"iou": {"value": baseline}, "azimuth_within_30": {"value": 0.1}}}}
    others["mean_shape"] = {"metrics": {"iou": {"value": 0.1}, "azimuth_within_30": row}}
    return {"metrics": {"iou": row, "azimuth_within_30": row}, "baselines": others}


@pytest.mark.parametrize(
    ("baseline", "words"),
    [(0.3, "above every baseline"), (0.5, "level with the best baseline"), (0.8, "below a baseline")],
)
def test_verdict_compares_the_interval_with_the_best_baseline(baseline, words):
    assert f"<b>{words}</b> in outline" in verdict(card_report(low=0.4, high=0.6, baseline=baseline))


def test_a_baseline_with_the_models_own_camera_says_nothing_about_direction():
    assert "above every baseline</b> in outline and direction" in verdict(card_report(low=0.4, high=0.6, baseline=0.2))


def test_unfinished_or_missing_predictions_are_refused(tmp_path):
    with pytest.raises(FaunaError, match="finished predictions folder"):
        write_reports(tmp_path, tmp_path / "out", OPTIONS, pictures=1)


def test_predictions_of_an_earlier_version_are_refused(predictions, tmp_path):
    facts = json.loads((predictions / "facts.json").read_text())
    (predictions / "facts.json").write_text(json.dumps({key: row for key, row in facts.items() if key != "format"}))
    with pytest.raises(FaunaError, match="of another version; evaluate the checkpoint again"):
        write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)


def test_markdown_and_order():
    keys = ["leg_chamfer", "iou", "kt_pck@0.1", "chamfer", "unheard_of", "chamfer_similarity"]
    assert ordered(keys) == ["iou", "kt_pck@0.1", "chamfer", "chamfer_similarity", "leg_chamfer", "unheard_of"]
    assert definition("kt_pck@0.1_shared_base_lr_free") == DEFINITIONS["kt_pck@0.1_shared_base"]
    assert definition("unheard_of") is None
    assert better("global_flip") == ""
    assert not lower_is_better("azimuth_within_30")
    assert lower_is_better("front_back_flips")


def test_keypoint_transfer_is_printed_for_horses():
    transfer = [row for row in ROWS if row.metric == "kt_pck@0.1"]
    assert transfer
    assert {name for row in transfer for name, _ in row.columns} == {"horse"}


@pytest.mark.parametrize(
    "content", [f'{{"format": {FORMAT}}}', "[]", f'{{"format": {FORMAT}, "groups": {{}}}}', "7", "{"]
)
def test_broken_facts_are_refused(content, predictions, tmp_path):
    (predictions / "facts.json").write_text(content)
    with pytest.raises(FaunaError, match="finished predictions folder") as caught:
        write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)
    assert "\n" not in str(caught.value)


def test_samples_that_the_facts_name_must_be_there(predictions, tmp_path):
    facts = json.loads((predictions / "facts.json").read_text())
    facts["groups"]["metrics"].append("long/77")
    (predictions / "facts.json").write_text(json.dumps(facts))
    with pytest.raises(FaunaError, match="got none of long/77"):
        write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)


def test_records_without_an_array_are_refused(predictions, tmp_path):
    store = ArrayStore(predictions / "model", identity=None)
    broken = [replace(item, arrays={k: v for k, v in item.arrays.items() if k != "verts"}) for item in store.items()]
    shutil.rmtree(predictions / "model")
    again = ArrayStore(predictions / "model", identity={"test": 1})
    for item in broken:
        again.add(item)
    again.flush()
    with pytest.raises(FaunaError, match="whole records"):
        write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)


def test_a_damaged_baseline_is_named_and_left_out(predictions, tmp_path):
    facts = json.loads((predictions / "facts.json").read_text())
    facts["settings"]["baselines"] = ["box_copy"]
    (predictions / "facts.json").write_text(json.dumps(facts))
    (predictions / "box_copy.npz").write_bytes(b"PK\x03\x04 damaged")
    report = write_reports(predictions, tmp_path / "out", OPTIONS, pictures=1)
    row = next(row for row in report["left_out"] if row["of"] == "box_copy")
    assert "box_copy.npz expects stored transfers" in row["reason"]
    assert report["baselines"] == {}


def test_published_numbers_are_fractions_and_stand_beside_keys():
    assert all(0 < value < 1 for row in ROWS for _, value in row.columns)
    assert {row.metric for row in ROWS} <= set(DEFINITIONS)
    ours = {(row.dataset, row.metric): row.columns[0][1] for row in COMPARISON if row.method == "3D-Fauna"}
    assert ours == {
        ("PASCAL", "kt_pck@0.1"): 0.539,
        ("PASCAL", "pck@0.1_fit_on_test"): 0.782,
        ("APT-36K", "pck@0.1_fit_on_test"): 0.841,
        ("Animal3D", "pck@0.1_fit_on_test"): 0.901,
    }
    values = [row.columns[0][1] for row in BANK_SIZES]
    assert values == sorted(values)
