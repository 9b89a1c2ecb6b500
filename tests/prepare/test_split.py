"""The paper's rules, and no leak."""

from collections import Counter
from dataclasses import replace

import pytest

from fauna.errors import FaunaError
from fauna.prepare.settings import prepare_settings
from fauna.prepare.split import Members, assigned, choose_split
from tests.prepare.rows import row

RULES = prepare_settings(
    ["split.val_fraction=0.04", "split.test_fraction=0.05", "split.few_shot_below=100", "split.few_shot_val=5"]
).split


def split(rows, rules=RULES, back_views=frozenset()):
    members = Members()
    for each in rows:
        members.add(each.species, each.cluster or each.photo)
    chosen = choose_split(members, rules)
    return list(assigned(rows, chosen, back_views)), chosen


def herd(species: str, count: int, **facts):
    return [row(f"{species}/{number}.jpg", **facts) for number in range(count)]


def test_few_shot_species_give_five_others_a_fraction():
    rows, _ = split([*herd("horse", 500), *herd("mink", 60), *herd("okapi", 7)])
    counts = {name: Counter(each.split for each in rows if each.species == name) for name in ("horse", "mink", "okapi")}
    assert counts["horse"] == {"train": 455, "val": 20, "test": 25}
    assert counts["mink"] == {"train": 55, "val": 5}
    assert counts["okapi"] == {"train": 2, "val": 5}


def test_the_papers_numbers():
    """116 few-shot species give 5 each; 65,473 photographs of 7 species give 2,462."""
    large = 63_115 + 2_358
    assert round(prepare_settings([]).split.val_fraction * large) == 2462


def test_some_stay_for_training():
    for count in (1, 2, 3):
        rows, _ = split(herd("mink", count))
        assert Counter(each.split for each in rows)["train"] >= 1


def test_clusters_stay_together_across_species_and_held_out_species_take_theirs_along():
    shared = [row("dog/1.jpg", cluster="c"), row("horse/1.jpg", cluster="c"), row("horse/2.jpg", cluster="c")]
    rows, chosen = split([*herd("dog", 30), *herd("horse", 30), *shared], replace(RULES, held_out=("dog",)))
    assert {each.split for each in rows if each.cluster == "c"} == {"test"}
    assert {each.split for each in rows if each.species == "dog"} == {"test"}
    assert chosen.joint == {"c"}


def test_videos_are_not_broken_for_a_handful_of_validation_frames():
    video = [row(f"horse/v/{number}.jpg", cluster="v") for number in range(40)]
    rows, _ = split([*video, *herd("horse", 20)])
    assert {each.split for each in rows if each.cluster == "v"} == {"train"}
    assert Counter(each.split for each in rows)["val"] == 5


def test_where_all_clusters_are_large_the_smallest_is_set_aside():
    videos = [
        row(f"horse/{video}/{number}.jpg", cluster=video) for video in "abc" for number in range(20 - ord(video) + 97)
    ]
    rows, _ = split(videos)
    assert {each.cluster for each in rows if each.split == "val"} == {"c"}
    assert Counter(each.split for each in rows)["train"] == 39


def test_new_photographs_do_not_stir_up_the_old():
    old, _ = split(herd("mink", 60))
    new, _ = split(herd("mink", 63))
    before = {each.id for each in old if each.split == "val"}
    after = {each.id for each in new if each.split == "val"}
    assert len(before & after) >= 2
    assert len(after) == 5


def test_seeds_choose_differently_and_order_does_not_matter():
    rows = herd("mink", 60)
    chosen = {
        seed: {each.id for each in split(rows, replace(RULES, seed=seed))[0] if each.split == "val"} for seed in (0, 1)
    }
    assert chosen[0] != chosen[1]
    assert {each.id for each in split(rows[::-1])[0] if each.split == "val"} == chosen[0]


def test_back_views_are_training_photographs_only():
    plain, _ = split(herd("mink", 30))
    val = next(each for each in plain if each.split == "val")
    train = next(each for each in plain if each.split == "train")
    rows, _ = split(herd("mink", 30), back_views=frozenset({val.source, train.id}))
    found = {each.id: each.split for each in rows}
    assert found[val.id] == "val"
    assert found[train.id] == "back"


@pytest.mark.parametrize("seed", range(8))
def test_clusters_shared_by_species_leave_each_its_training_photographs(seed):
    """A duplicate of a rare species' photograph among those of a large one must not take it to validation."""
    rows = []
    for number in range(5):
        rows += [row(f"horse/{number}.jpg", cluster=f"{number}"), row(f"zebra/{number}.jpg", cluster=f"{number}")]
    rules = replace(RULES, seed=seed, min_train=3, few_shot_val=2)
    counts = Counter((each.species, each.split) for each in split(rows, rules)[0])
    assert counts["horse", "val"] == counts["zebra", "val"] == 2
    lone = [row("okapi/1.jpg", cluster="c"), *herd("horse", 3), row("horse/x.jpg", cluster="c")]
    found, _ = split(lone, replace(RULES, seed=seed, few_shot_val=3))
    assert [each.split for each in found if each.species == "okapi"] == ["train"]
    assert Counter(each.split for each in found if each.species == "horse") == {"val": 3, "train": 1}


def test_rare_species_are_left_out_by_name_and_rejected_rows_pass():
    rows, chosen = split([*herd("mink", 3), *herd("horse", 10)], replace(RULES, min_photos=5))
    assert {each.reasons for each in rows if each.species == "mink"} == {("split:few_photos",)}
    assert chosen.left_out == {"mink"}
    refused = row("horse/x.jpg").rejected("scan", "unreadable")
    assert list(assigned([refused], chosen, frozenset())) == [refused]


def test_held_out_species_must_be_there():
    with pytest.raises(FaunaError, match=r"split.held_out: expected species of the set \(mink\), got wolf"):
        split(herd("mink", 3), replace(RULES, held_out=("wolf",)))
