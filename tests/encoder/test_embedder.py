import pytest
import torch

from fauna.encoder.embedder import ConvTrunk, ImageEmbedder, TrunkOptions
from fauna.errors import FaunaError
from fauna.types import Features

PAPER = TrunkOptions(variant="paper", hidden_dim=256, channels_per_group=4, reduce_dim=None)
SMALL_PAPER = TrunkOptions(variant="paper", hidden_dim=8, channels_per_group=4, reduce_dim=None)
LIGHT = TrunkOptions(variant="light", hidden_dim=8, channels_per_group=4, reduce_dim=6)


def features(size: int, dim: int = 5, batch: int = 2) -> Features:
    generator = torch.Generator().manual_seed(0)
    maps = torch.randn(2, batch, dim, size, size, generator=generator)
    return Features(torch.zeros(batch, 3), maps[0], maps[1])


def test_paper_trunk_has_the_published_number_of_parameters():
    trunk = ConvTrunk(in_dim=384, out_dim=256, options=PAPER)
    assert sum(p.numel() for p in trunk.parameters()) == 4_720_128
    trunk = ConvTrunk(in_dim=384, out_dim=19, options=PAPER)
    assert sum(p.numel() for p in trunk.parameters()) == 3_749_376


@pytest.mark.parametrize("size", [8, 16, 18, 32])
def test_light_trunk_takes_any_map(size):
    trunk = ConvTrunk(in_dim=5, out_dim=7, options=LIGHT)
    assert trunk(features(size).tokens).shape == (2, 7)


def test_photos_do_not_influence_each_other():
    trunk = ConvTrunk(in_dim=5, out_dim=7, options=LIGHT)
    maps = features(16).tokens
    torch.testing.assert_close(trunk(maps)[1:], trunk(maps[1:]), atol=1e-6, rtol=1e-5)


def test_the_place_of_a_feature_matters():
    trunk = ConvTrunk(in_dim=5, out_dim=7, options=LIGHT)
    maps = features(16).tokens
    assert (trunk(maps) - trunk(maps.flip(-1))).abs().max() > 1e-3


def test_texture_reads_tokens_and_geometry_reads_keys():
    torch.manual_seed(0)
    embedder = ImageEmbedder(token_dim=5, key_dim=5, embedding_dim=4, trunk=LIGHT, normalize=False)
    given = features(16)
    other = Features(given.global_, given.tokens, given.keys + 1.0)
    before, after = embedder(given), embedder(other)
    assert torch.equal(before.texture, after.texture)
    assert (before.geometry - after.geometry).abs().max() > 1e-4


def test_normalized_embeddings_have_zero_mean_and_unit_variance():
    embedder = ImageEmbedder(token_dim=5, key_dim=5, embedding_dim=64, trunk=SMALL_PAPER, normalize=True)
    embedding = embedder(features(32))
    for part in (embedding.texture, embedding.geometry):
        torch.testing.assert_close(part.mean(1), torch.zeros(2), atol=1e-5, rtol=0)
        torch.testing.assert_close(part.var(1, unbiased=False), torch.ones(2), atol=2e-2, rtol=0)


def test_paper_trunk_resizes_other_maps():
    trunk = ConvTrunk(in_dim=5, out_dim=7, options=SMALL_PAPER)
    tokens = features(16).tokens
    resized = torch.nn.functional.interpolate(tokens, (32, 32), mode="bilinear", align_corners=False)
    torch.testing.assert_close(trunk(tokens), trunk(resized))


def test_a_map_that_is_too_small_is_refused():
    with pytest.raises(FaunaError, match="from 8x8, got 7x7"):
        ConvTrunk(in_dim=5, out_dim=7, options=LIGHT)(features(7).tokens)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hidden_dim": 10}, "multiple of channels_per_group"),
        ({"reduce_dim": None}, "variant=light only"),
        ({"variant": "paper"}, "variant=light only"),
    ],
)
def test_bad_options(options, message):
    values = {"variant": "light", "hidden_dim": 8, "channels_per_group": 4, "reduce_dim": 6}
    with pytest.raises(FaunaError, match=message):
        TrunkOptions(**{**values, **options})
