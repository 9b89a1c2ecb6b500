import sys
from types import ModuleType

import numpy as np
import pytest
import torch
from PIL import Image, ImageDraw

from fauna.errors import FaunaError
from fauna.masks.base import Segmenter
from fauna.masks.grabcut import GrabCut, best_parts
from fauna.masks.registry import build_segmenter
from fauna.masks.saliency import rate
from fauna.reconstruct.settings import default_settings

OPTIONS = default_settings().mask


def scene(seed=0, where=(150, 90)):
    """A brown beast of ellipses on mottled grass, and its mask."""
    rng = np.random.default_rng(seed)
    grass = np.asarray(Image.fromarray(rng.integers(60, 140, (24, 32, 3), dtype=np.uint8)).resize((320, 240)))
    grass = (grass * (0.5, 1.0, 0.4)).astype(np.uint8)
    shape = Image.new("L", (320, 240))
    pen = ImageDraw.Draw(shape)
    x, y = where
    pen.ellipse((x - 60, y - 25, x + 60, y + 30), fill=255)
    pen.ellipse((x + 45, y - 50, x + 85, y - 10), fill=255)
    for leg in (-50, -30, 25, 45):
        pen.rectangle((x + leg, y, x + leg + 10, y + 75), fill=255)
    mask = np.array(shape) > 0
    fur = np.clip(rng.normal((150, 90, 40), 12, (240, 320, 3)), 0, 255).astype(np.uint8)
    return np.where(mask[..., None], fur, grass), mask


@pytest.fixture(scope="module")
def grabcut():
    from fauna.build import build_encoder, stored_config
    from fauna.io.checkpoint import read_weights
    from fauna.pretrained.shipped import shipped_weights

    encoder = build_encoder(stored_config(read_weights(shipped_weights())[1]["config"]))
    return GrabCut(encoder=encoder, saliency=OPTIONS.saliency, options=OPTIONS.grabcut)


class Rough(Segmenter):
    name = "rough"

    def __init__(self, mask):
        self.mask = mask

    def segment(self, image):
        return self.mask


def test_ratings_single_out_what_differs_from_the_border():
    tokens = torch.randn(12, 16, 16, generator=torch.Generator().manual_seed(0)) * 0.3
    inside = np.zeros((16, 16), bool)
    inside[5:11, 4:12] = True
    tokens[:, torch.from_numpy(inside)] += 2.0
    rating = rate(tokens, OPTIONS.saliency)
    assert rating[inside].min() > rating[~inside].max()
    assert rating.mean() == pytest.approx(0.0, abs=1e-9)
    assert rating.std() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("where", [(150, 90), (90, 130)])
def test_grabcut_finds_an_animal_and_finds_it_again(grabcut, where):
    image, mask = scene(where=where)
    found = grabcut.segment(image)
    assert (found & mask).sum() / (found | mask).sum() > 0.75
    assert (grabcut.segment(image) == found).all()


@pytest.mark.parametrize("value", [0, 128, 255])
def test_nothing_is_found_where_nothing_is(grabcut, value):
    assert not grabcut.segment(np.full((100, 150, 3), value, np.uint8)).any()


@pytest.mark.parametrize("shape", [(16, 400), (400, 16), (17, 17)])
def test_odd_shapes_are_taken(grabcut, shape):
    noise = np.random.default_rng(0).integers(0, 255, (*shape, 3), dtype=np.uint8)
    assert grabcut.segment(noise).shape == shape


def test_the_best_part_is_not_the_largest_but_the_most_salient():
    mask = np.zeros((20, 60), bool)
    mask[2:18, 2:30] = mask[5:15, 35:45] = mask[5:8, 50:53] = True
    over = np.full(mask.shape, -1.0)
    over[5:15, 35:45] = 2.0
    found = best_parts(mask, over, 0.3)
    assert found[10, 40]
    assert found[10, 10]
    assert not found[6, 51]
    assert not best_parts(mask & False, over, 0.3).any()


@pytest.fixture(scope="module")
def tiny_sam(tmp_path_factory):
    """A SAM of random weights in a folder."""
    from transformers import SamConfig, SamImageProcessor, SamModel, SamProcessor

    vision = {
        "hidden_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "image_size": 64, "patch_size": 8,
        "output_channels": 16,
        "num_pos_feats": 8, "mlp_dim": 16, "window_size": 4, "global_attn_indexes": [0],
    }  # fmt: skip
    prompt = {"hidden_size": 16, "image_size": 64, "patch_size": 8, "image_embedding_size": 8, "mask_input_channels": 4}
    decoder = {
        "hidden_size": 16,
        "mlp_dim": 16,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "iou_head_hidden_dim": 16,
    }
    folder = tmp_path_factory.mktemp("sam")
    torch.manual_seed(0)
    SamModel(
        SamConfig(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    ).save_pretrained(folder)
    sizes = {"size": {"longest_edge": 64}, "pad_size": {"height": 64, "width": 64}}
    SamProcessor(
        SamImageProcessor(**sizes, mask_size={"longest_edge": 16}, mask_pad_size={"height": 16, "width": 16})
    ).save_pretrained(folder)
    return folder


def test_sam_is_loaded_and_asked_with_a_box(tiny_sam, grabcut):
    image, mask = scene()
    sam = build_segmenter(f"sam:{tiny_sam}", grabcut)
    sam.guide = Rough(mask)
    found = sam.segment(image)
    assert (found.shape, found.dtype) == (mask.shape, bool)
    assert (sam.segment(image) == found).all()
    assert sam.name == f"sam:{tiny_sam}"
    sam.guide = Rough(mask & False)
    assert not sam.segment(image).any()


def test_missing_weights_and_packages_are_told(grabcut, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(FaunaError, match=r"weights of the SAM family.*sam:FOLDER"):
        build_segmenter(f"sam:{tmp_path}", grabcut)
    monkeypatch.setitem(sys.modules, "rembg", None)
    with pytest.raises(FaunaError, match=r"pip install -e '\.\[rembg\]'"):
        build_segmenter("rembg", grabcut)
    for unknown in ("magic", "grabcut:x", ""):
        with pytest.raises(FaunaError, match="expected grabcut, sam"):
            build_segmenter(unknown, grabcut)


def test_rembg_by_its_interface(grabcut, monkeypatch):
    package = ModuleType("rembg")
    package.new_session = lambda name: {"model": name}

    def remove(image, *, session, only_mask):
        assert only_mask
        assert session == {"model": "u2net"}
        return np.where(image[..., 0] > 100, 200, 20).astype(np.uint8)

    package.remove = remove
    monkeypatch.setitem(sys.modules, "rembg", package)
    image, _ = scene()
    found = build_segmenter("rembg:u2net", grabcut).segment(image)
    assert (found == (image[..., 0] > 100)).all()
    package.new_session = lambda name: 1 / 0
    with pytest.raises(FaunaError, match="check the name and the network"):
        build_segmenter("rembg", grabcut)
