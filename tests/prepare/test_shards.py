"""Shards are disjoint, complete, stable, and keep groups together."""

import pytest

from fauna.errors import FaunaError
from fauna.prepare.shard import Shard, parse_shard, shard_of


def test_every_group_is_in_one_shard_and_shards_are_about_equal():
    groups = [f"horse/{number}.jpg" for number in range(2000)]
    for count in (1, 3, 16):
        sizes = [sum(group in Shard(index, count) for group in groups) for index in range(count)]
        assert sum(sizes) == len(groups)
        assert min(sizes) > 0.7 * len(groups) / count


def test_shards_never_change():
    """Another hash would send photographs of begun work to other shards."""
    assert [shard_of(f"horse/{number}.jpg", 16) for number in range(8)] == [14, 9, 3, 4, 14, 11, 14, 14]


def test_names_that_are_no_utf8_have_a_shard():
    assert 0 <= shard_of("a\udcff", 5) < 5


@pytest.mark.parametrize("text", ["", "3", "3/3", "-1/4", "a/b", "4/3", "0/0", "1/2/3", "1.0/2"])
def test_other_words_are_refused(text):
    with pytest.raises(FaunaError, match="shard: expected i/n"):
        parse_shard(text)


def test_words_of_shards():
    assert parse_shard("3/16") == Shard(3, 16)
    assert Shard(3, 16).stem == "00003-of-00016"
