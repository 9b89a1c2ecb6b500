import numpy as np

from fauna.masks.animals import split_animals, touched_border

SHARES = {"animal_share": 0.3, "speck_share": 0.005, "same_gap": 0.1}


def canvas(*boxes):
    mask = np.zeros((100, 200), bool)
    for top, bottom, left, right in boxes:
        mask[top:bottom, left:right] = True
    return mask


def test_an_empty_mask_has_no_animals():
    assert split_animals(canvas(), **SHARES) == []


def test_large_parts_are_animals_largest_first():
    mask = canvas((10, 40, 10, 40), (10, 60, 100, 150))
    animals = split_animals(mask, **SHARES)
    assert [int(each.sum()) for each in animals] == [2500, 900]
    assert (np.logical_or.reduce(animals) == mask).all()


def test_small_parts_join_the_nearest_animal_and_specks_go():
    left, right = (10, 60, 10, 60), (10, 60, 120, 170)
    foot, speck = (62, 72, 40, 50), (0, 2, 90, 92)
    animals = split_animals(canvas(left, right, foot, speck), **SHARES)
    assert (animals[0] == canvas(left, foot)).all()
    assert (animals[1] == canvas(right)).all()


def test_a_pole_does_not_make_two_animals_of_one():
    left, right = (10, 60, 10, 60), (10, 60, 64, 110)
    assert [int(each.sum()) for each in split_animals(canvas(left, right), **SHARES)] == [4800]
    assert len(split_animals(canvas(left, (10, 60, 66, 110)), **SHARES)) == 2


def test_corners_connect():
    assert len(split_animals(canvas((0, 10, 0, 10), (10, 20, 10, 20)), **SHARES)) == 1


def test_touching_the_border():
    assert touched_border(canvas((10, 20, 10, 20))) == 0.0
    assert touched_border(canvas()) == 0.0
    assert touched_border(canvas((90, 100, 10, 20))) == 0.25
    assert touched_border(canvas((0, 100, 0, 200))) == 1.0
