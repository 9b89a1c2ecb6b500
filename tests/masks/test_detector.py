"""The real loading code on a tiny random detector."""

import json

import numpy as np
import pytest

from fauna.errors import FaunaError
from fauna.masks.base import Segmenter
from fauna.masks.boxes import overlap
from fauna.masks.detector import SAME, Detector


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    from transformers import (
        CLIPTokenizer,
        OwlViTConfig,
        OwlViTForObjectDetection,
        OwlViTImageProcessor,
        OwlViTProcessor,
        OwlViTTextConfig,
        OwlViTVisionConfig,
    )

    folder = tmp_path_factory.mktemp("detector")
    letters = "abcdefghijklmnopqrstuvwxyz."
    words = ["!", "<|startoftext|>", "<|endoftext|>", *letters, *(f"{letter}</w>" for letter in letters)]
    (folder / "vocab.json").write_text(json.dumps({word: place for place, word in enumerate(words)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokenizer = CLIPTokenizer(str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=16)
    small = {"hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2}
    text = OwlViTTextConfig(
        **small, vocab_size=len(words), bos_token_id=1, eos_token_id=2, pad_token_id=2, max_position_embeddings=16
    )
    vision = OwlViTVisionConfig(**small, image_size=32, patch_size=16)
    config = OwlViTConfig(text_config=text.to_dict(), vision_config=vision.to_dict(), projection_dim=16)
    import torch

    torch.manual_seed(0)
    OwlViTForObjectDetection(config).save_pretrained(folder)
    OwlViTProcessor(OwlViTImageProcessor(size={"height": 32, "width": 32}), tokenizer).save_pretrained(folder)
    return folder


def test_boxes_are_inside_sure_enough_and_different(weights):
    image = np.random.default_rng(0).integers(0, 255, (90, 120, 3), dtype=np.uint8)
    detector = Detector(weights=str(weights), score=0.0)
    boxes = detector.boxes(image, "plains_zebra")
    assert boxes
    assert boxes == detector.boxes(image, "plains_zebra")
    assert all(right > left and bottom > top for left, top, right, bottom in boxes)
    assert all(overlap(a, b) < SAME for place, a in enumerate(boxes) for b in boxes[:place])
    assert Detector(weights=str(weights), score=0.999).boxes(image, "zebra") == []


def test_missing_weights_are_told(tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(FaunaError, match="detector: expected weights of a zero-shot object detector"):
        Detector(weights=str(tmp_path), score=0.3)


class Everything(Segmenter):
    name = "everything"

    def __init__(self):
        self.shapes = []

    def segment(self, image):
        self.shapes.append(image.shape[:2])
        return np.ones(image.shape[:2], bool)


@pytest.mark.parametrize("box", [(20.0, 10.0, 60.0, 40.0), (-30.0, -9.0, 50.0, 30.0), (90.0, 70.0, 400.0, 300.0)])
def test_a_segmenter_in_a_box_sees_its_surroundings_and_marks_nothing_there(box):
    image = np.zeros((80, 100, 3), np.uint8)
    segmenter = Everything()
    mask = segmenter.segment_in(image, box)
    left, top, right, bottom = (int(side) for side in box)
    expected = np.zeros((80, 100), bool)
    expected[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = True
    assert (mask == expected).all()
    assert segmenter.shapes[0][0] > expected.any(axis=1).sum() or segmenter.shapes[0][0] == 80


def test_a_box_outside_of_the_picture_gives_nothing():
    assert not Everything().segment_in(np.zeros((10, 10, 3), np.uint8), (20.0, 20.0, 30.0, 30.0)).any()
