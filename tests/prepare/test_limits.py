"""Every setting has a rule, the shipped values fit it, and what does not is told in one line before anything is made."""

import pytest
import yaml

from fauna._conf import CONF_DIR
from fauna.errors import FaunaError
from fauna.prepare.limits import RULES, Number, flattened
from fauna.prepare.runs import prepare
from fauna.prepare.settings import FILE, prepare_settings


def test_every_key_of_the_file_has_a_rule():
    content = yaml.safe_load((CONF_DIR / FILE).read_text(encoding="utf-8"))
    assert list(RULES) == list(flattened(content))
    assert all(rule.fits(flattened(content)[key]) for key, rule in RULES.items())


@pytest.mark.parametrize("key", [key for key, rule in RULES.items() if isinstance(rule, Number)])
def test_numbers_have_both_ends(key):
    rule = RULES[key]
    assert isinstance(rule, Number)
    assert not rule.fits(rule.low - 1)
    assert not rule.fits(rule.high + 1)
    assert not rule.fits(float("nan"))
    assert not rule.fits(True)
    assert rule.fits(rule.low)
    assert rule.fits(rule.high)
    for value in (rule.low - 1, rule.high + 1, ".nan", "abc", "[1]"):
        with pytest.raises(FaunaError, match=rf"^{key}: expected ") as error:
            prepare_settings([f"{key}={value}"])
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("split.held_out=okapi", "got 'okapi'; write [okapi]"),
        (
            "split.held_out=[1]",
            "expected a list of names such as [okapi], got [1]; write it as in [okapi], numbers in quotes",
        ),
        ("split.held_out=null", "expected a list of names"),
        ("source.rename=[okapi:]", "expected a list of names such as [libby:cat]"),
        ("source.rename=[okapi]", "expected old:new each, got ['okapi']; e.g. [libby:cat]"),
        ("source.rename=libby:cat", "write [libby:cat]"),
        ("work=''", "work: expected a name that is not empty or null, got ''"),
        ("runner=cluster", "runner: expected one of local, ray, got 'cluster'"),
        ("crop.rule=round", "crop.rule: expected one of widen, fauna"),
        ("mask.alpha_shares=[0.9,0.1]", "the smaller one first"),
        ("mask.alpha_shares=[0.1]", "expected two shares"),
        ("mask.segmenter=sam:", "mask.segmenter: expected a name that is not empty, got {'sam': None}"),
        ("crop.size={a: 1}", "crop.size: expected a whole number from 32 to 2,048, got {'a': 1}"),
        ("filter.min_fill=0.9", "filter.min_fill: expected at most filter.max_fill=0.85, got 0.9"),
        ("split.val_fraction=0.99", "expected at most 1 with split.test_fraction"),
        ("shard=3", "shard: expected i/n with 0 <= i < n, got '3'"),
        ("sheets.columns=0", "sheets.columns: expected a whole number from 1 to 100, got 0"),
        ("crop.size=3.5", "crop.size: expected a whole number from 32 to 2,048, got 3.5"),
        ("features.grid=abc", "features.grid: expected a whole number from 1 to 256 or null, got 'abc'"),
        ("source.frames_per_second=null", "got nothing"),
    ],
)
def test_other_values_are_told_in_one_line(word, told):
    with pytest.raises(FaunaError) as error:
        prepare_settings([word])
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_values_that_look_like_others_are_taken():
    assert prepare_settings(["overrides=7"]).overrides == "7"
    assert prepare_settings(["split.held_out=['1']"]).split.held_out == ("1",)
    assert prepare_settings(["filter.max_fill=1"]).filter.max_fill == 1.0
    assert prepare_settings(["filter.min_extent=null"]).filter.min_extent is None


def test_nothing_is_made_before_the_settings_are_looked_at(tmp_path):
    (tmp_path / "pile").mkdir()
    with pytest.raises(FaunaError, match="shard: expected i/n"):
        prepare("scan", tmp_path / "pile", tmp_path / "set", prepare_settings(["shard=5/3"]))
    assert [path.name for path in tmp_path.iterdir()] == ["pile"]
