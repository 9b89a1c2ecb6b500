"""Which of equal pictures is used, which frames are dropped, and what has to stay in one split."""

import pytest

from fauna.prepare.duplicates import find_duplicates, judged
from fauna.prepare.record import Record
from fauna.prepare.settings import DuplicateSettings
from tests.prepare.rows import row

BITS = DuplicateSettings(near_bits=2, same_split_bits=4, frame_bits=3)


def looks(source: str, sha: int, phash: int | None, **facts) -> tuple[Record, ...]:
    known = None if phash is None else f"{phash:016x}"
    facts = {"width": 10, "height": 10} | facts
    return (row(source, sha256=f"{sha:064x}"[::-1], phash=known, **facts),)


def judge(photos, settings=BITS) -> dict[str, Record]:
    photos = sorted(photos, key=lambda rows: rows[0].photo)
    return {
        each.source if each.frame is None else f"{each.source}:{each.frame}": each
        for each in judged(photos, find_duplicates(photos, settings))
    }


def far(number: int) -> int:
    """Hashes that are far from each other."""
    return int(f"{(number * 0x9E3779B97F4A7C15) & (2**64 - 1):016x}", 16)


def test_of_equal_files_the_annotated_one_is_used():
    found = judge([looks("a/1", 1, far(1)), looks("b/1", 1, far(1), given_mask="file:m"), looks("c/1", 2, far(2))])
    assert found["b/1"].ok
    assert found["c/1"].ok
    assert found["a/1"].reasons == ("scan:duplicate",)
    assert found["a/1"].duplicate_of == found["b/1"].photo
    assert found["a/1"].cluster == found["b/1"].cluster != found["c/1"].cluster


def test_of_near_pictures_the_larger_one_is_used_and_not_quite_near_ones_share_a_split():
    found = judge(
        [
            looks("a", 1, far(1)),
            looks("b", 2, far(1) ^ 0b11, width=20),
            looks("c", 3, far(1) ^ 0b111100),
            looks("d", 4, far(9)),
        ]
    )
    assert found["a"].reasons == ("scan:near_duplicate",)
    assert found["a"].duplicate_of == found["b"].photo
    assert found["b"].ok
    assert found["c"].ok  # four bits from a: used, but in its split
    assert found["a"].cluster == found["b"].cluster == found["c"].cluster != found["d"].cluster


def test_equal_hashes_are_near_even_where_no_bit_may_differ():
    found = judge(
        [looks("a", 1, far(1)), looks("b", 2, far(1)), looks("c", 3, far(1) ^ 1)],
        DuplicateSettings(near_bits=0, same_split_bits=0, frame_bits=0),
    )
    assert sum(each.ok for each in found.values()) == 2
    assert found["c"].ok


def test_a_neighbour_that_is_left_out_itself_leaves_nobody_out():
    """A chain a - b - c: b goes for a, and c, which is near b only, stays."""
    found = judge(
        [looks("a", 1, far(1), width=30), looks("b", 2, far(1) ^ 0b11, width=20), looks("c", 3, far(1) ^ 0b1111)]
    )
    assert [found[name].ok for name in "abc"] == [True, False, True]


def test_even_pictures_are_compared_with_nothing():
    found = judge([looks("a", 1, None), looks("b", 2, None)])
    assert all(each.ok for each in found.values())
    assert found["a"].cluster != found["b"].cluster


def test_frames_are_compared_with_the_last_one_kept():
    steps = [0, 0b11, 0b1111, 0b111111, far(5)]  # two bits a step: the third is too far from the first
    frames = [looks("v.mp4", number, bits, frame=number, group="v.mp4") for number, bits in enumerate(steps)]
    found = judge([*frames, looks("other", 99, far(7))])
    assert [found[f"v.mp4:{number}"].reasons for number in range(5)] == [
        (), ("scan:same_frame",), (), ("scan:same_frame",), (),
    ]  # fmt: skip
    assert found["v.mp4:3"].duplicate_of == found["v.mp4:2"].photo
    assert len({found[f"v.mp4:{number}"].cluster for number in range(5)}) == 1
    assert found["other"].cluster != found["v.mp4:0"].cluster


def test_overrides_keep_near_ones_but_not_copies():
    found = judge(
        [
            looks("a", 1, far(1), width=20),
            looks("b", 2, far(1), override="keep"),
            looks("c", 1, far(1), override="keep", width=5),
        ]
    )
    assert found["b"].ok
    assert not found["c"].ok


def test_what_was_refused_before_says_nothing_about_others():
    refused = (looks("a", 1, far(1), width=99)[0].rejected("scan", "size_differs"),)
    found = judge([refused, looks("b", 1, far(1))])
    assert found["b"].ok
    assert found["a"].reasons == ("scan:size_differs",)


@pytest.mark.parametrize("count", [0, 1])
def test_small_sets(count):
    assert len(judge([looks("a", 1, 5)][:count])) == count


def test_order_of_reading_does_not_matter():
    photos = [
        looks(str(number), number // 2, far(number // 3) ^ (number % 4), width=10 + number % 5) for number in range(40)
    ]
    forward = find_duplicates(photos, BITS)
    backward = find_duplicates(photos[::-1], BITS)
    photos.sort(key=lambda rows: rows[0].photo)
    assert list(judged(photos, forward)) == list(judged(photos, backward))


def test_joined_groups_join_what_is_near_their_members():
    found = judge(
        [looks("a", 1, far(1), group="video"), looks("b", 2, far(2), group="video"), looks("c", 3, far(2) ^ 0b1111)]
    )
    assert found["a"].cluster == found["c"].cluster == min(each.photo for each in found.values())
