"""Names of keypoints: canonical, mirrored, comparable."""

import numpy as np
import pytest

from fauna.data.readers.keypoints import (
    KEYPOINT_SETS,
    canonical_names,
    mirror_indices,
    plain_name,
    shared_keypoints,
)
from fauna.zoo.body import KEYPOINTS

PASCAL = (
    "L_B_Elbow", "L_B_Paw", "L_EarBase", "L_Eye", "L_F_Elbow", "L_F_Paw", "Nose", "R_B_Elbow", "R_B_Paw", "R_EarBase",
    "R_Eye", "R_F_Elbow", "R_F_Paw", "TailBase", "Throat", "Withers",
)  # fmt: skip


def test_animal_pose_is_the_projects_own_set():
    assert KEYPOINT_SETS["animalpose"].canonical == KEYPOINTS
    assert {name: len(each.names) for name, each in KEYPOINT_SETS.items()} == {
        "animalpose": 20, "ap10k": 17, "atrw": 15, "horse10": 22, "zebra": 9, "animal_kingdom": 23, "stanfordextra": 24,
    }  # fmt: skip


@pytest.mark.parametrize("name", KEYPOINT_SETS)
def test_every_set_has_different_names_with_both_sides(name):
    each = KEYPOINT_SETS[name]
    assert len(set(each.names)) == len(set(each.canonical)) == len(each.names)
    assert set(each.renamed) <= set(each.names)
    mirror = np.array(mirror_indices(each.canonical))
    assert np.array_equal(mirror[mirror], np.arange(len(mirror)))
    for place, canonical in enumerate(each.canonical):
        sided = canonical.startswith(("left_", "right_"))
        assert (mirror[place] != place) == sided, canonical


def test_a_set_is_recognised_in_any_order_and_spelling():
    names = KEYPOINT_SETS["ap10k"].names
    assert canonical_names(names[::-1]) == KEYPOINT_SETS["ap10k"].canonical[::-1]
    assert canonical_names([f"{name} " for name in names]) == KEYPOINT_SETS["ap10k"].canonical
    places = dict(zip(names, KEYPOINT_SETS["ap10k"].canonical, strict=True))
    assert places["left_shoulder"] == "left_front_elbow"
    assert places["right_knee"] == "right_back_knee"
    assert canonical_names(["left_shoulder", "right_shoulder"]) == ("left_shoulder", "right_shoulder")  # some other set


def test_pascal_names_are_animal_poses():
    canonical = canonical_names(PASCAL)
    assert set(canonical) < set(KEYPOINTS)
    assert canonical[0] == "left_back_elbow"
    assert canonical[9] == "right_ear"


def test_names_that_would_collide_stay_as_they_are():
    assert canonical_names(["L_Eye", "left eye"]) == ("L_Eye", "left eye")
    assert plain_name("  Mouth_Back_Left") == "left_mouth_back"


def test_what_two_sets_share():
    first, second = KEYPOINT_SETS["ap10k"].canonical, KEYPOINT_SETS["stanfordextra"].canonical
    shared = shared_keypoints(first, second)
    assert len(shared) == 16  # all but the neck
    assert shared == tuple(name for name in first if name != "neck")
