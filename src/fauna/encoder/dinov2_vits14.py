"""DINOv2 ViT-S/14 (Oquab et al., 2023), whose features 3D-Fauna uses as targets (supplement, "Implementation details")."""

from typing import Literal

from transformers import Dinov2Model

from fauna.encoder.vit import FrozenViT, load_hub_model

NAME = "dinov2_vits14"
IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


class Dinov2Vits14(FrozenViT):
    """384 channels, patches of 14 pixels: 252 px give an 18 x 18 grid.

    Args:
        input_size: image side in pixels, a multiple of 14.
        dtype: ``"float32"`` or ``"bfloat16"``.

    Raises:
        EncoderUnavailable: if the weights are neither cached nor downloadable.
    """

    def __init__(self, *, input_size: int, dtype: Literal["float32", "bfloat16"]):
        super().__init__(
            name=NAME,
            model=load_hub_model(NAME, load_dinov2),
            input_size=input_size,
            mean=IMAGENET_MEAN,
            std=IMAGENET_STD,
            dtype=dtype,
            forward_options={},
        )


def load_dinov2(repo_id: str, *, local_files_only: bool) -> Dinov2Model:
    """Read a ``Dinov2Model``."""
    return Dinov2Model.from_pretrained(repo_id, local_files_only=local_files_only)
