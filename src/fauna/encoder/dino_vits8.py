"""DINO ViT-S/8, the encoder of the paper (Caron et al., ICCV 2021; used in 3D-Fauna, Sec. 3.2)."""

from typing import Literal

from transformers import ViTModel

from fauna.encoder.vit import FrozenViT, load_hub_model

NAME = "dino_vits8"


class DinoVits8(FrozenViT):
    """384 channels, patches of 8 pixels: 256 px give a 32 x 32 grid.

    Images are scaled to [-1, 1], as 3D-Fauna does, and not with the ImageNet statistics of the original training.

    Args:
        input_size: image side in pixels, a multiple of 8.
        dtype: ``"float32"`` or ``"bfloat16"``.

    Raises:
        EncoderUnavailable: if the weights are neither cached nor downloadable.
    """

    def __init__(self, *, input_size: int, dtype: Literal["float32", "bfloat16"]):
        super().__init__(
            name=NAME,
            model=load_hub_model(NAME, load_vit),
            input_size=input_size,
            mean=(0.5, 0.5, 0.5),
            std=(0.5, 0.5, 0.5),
            dtype=dtype,
            forward_options={"interpolate_pos_encoding": True},
        )


def load_vit(repo_id: str, *, local_files_only: bool) -> ViTModel:
    """Read a ``ViTModel`` without its (unused) pooling layer."""
    return ViTModel.from_pretrained(repo_id, add_pooling_layer=False, local_files_only=local_files_only)
