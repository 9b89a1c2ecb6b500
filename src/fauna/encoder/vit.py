"""A frozen vision transformer of the Hugging Face library: tokens, attention keys and the class token of its last layer."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.encoder.base import Encoder
from fauna.encoder.registry import HUB_MODELS, EncoderUnavailable, offline_requested, require_weights
from fauna.types import Features

KEY_PROJECTIONS = (".k_proj", ".key")  # names in transformers 5 and 4


class FrozenViT(Encoder):
    """Wraps ``ViTModel`` or ``Dinov2Model``.

    Tokens: patch tokens after the final LayerNorm. Keys: output of the last layer's key projection, heads concatenated.
    Global: the class token after the final LayerNorm.

    Args:
        name: of the config group.
        model: the transformer; only its configuration, embeddings and layers are used.
        input_size: image side in pixels, a multiple of the patch size; position codes are interpolated.
        mean: subtracted per colour channel of images in [0, 1].
        std: divides afterwards.
        dtype: ``"float32"``, or ``"bfloat16"``: faster where it is native, but features are coarser.
        forward_options: further arguments of the model's forward pass.
    """

    keys_are_tokens = False

    def __init__(
        self,
        *,
        name: str,
        model: nn.Module,
        input_size: int,
        mean: Sequence[float],
        std: Sequence[float],
        dtype: Literal["float32", "bfloat16"],
        forward_options: dict[str, bool],
    ):
        config: Any = model.config
        super().__init__(
            name=name,
            network=model.to(dtype=getattr(torch, dtype)),
            input_size=input_size,
            stride=config.patch_size,
            global_dim=config.hidden_size,
            token_dim=config.hidden_size,
            settings=f"mean{tuple(mean)}std{tuple(std)}-{dtype}".replace(" ", ""),
        )
        self.forward_options = dict(forward_options)
        self.mean: Tensor
        self.std: Tensor
        self.register_buffer("mean", torch.tensor(mean)[:, None, None], persistent=False)
        self.register_buffer("std", torch.tensor(std)[:, None, None], persistent=False)

    def _encode(self, images: Float[Tensor, "batch 3 height width"]) -> Features:
        weights_dtype = next(self.network.parameters()).dtype
        caught: list[Tensor] = []
        handle = last_key_projection(self.network).register_forward_hook(lambda *call: caught.append(call[-1]))
        try:
            hidden = self.network(
                pixel_values=((images - self.mean) / self.std).to(weights_dtype), **self.forward_options
            ).last_hidden_state
        finally:
            handle.remove()
        hidden, keys = hidden.to(images.dtype), caught[0].to(images.dtype)
        return Features(global_=hidden[:, 0], tokens=self._grid(hidden), keys=self._grid(keys))

    def _grid(self, sequence: Float[Tensor, "batch token chan"]) -> Float[Tensor, "batch chan grid grid"]:
        """Drop the class token and lay the patch tokens out as a map."""
        grid = sequence[:, 1:].transpose(1, 2)
        return grid.reshape(*grid.shape[:2], self.grid_size, self.grid_size).contiguous()


def last_key_projection(model: nn.Module) -> nn.Module:
    """The linear layer that computes the attention keys of the last layer."""
    return [module for name, module in model.named_modules() if name.endswith(KEY_PROJECTIONS)][-1]


def load_hub_model(name: str, load: Callable[..., nn.Module]) -> nn.Module:
    """Load a pretrained transformer from the local cache, or download it if the hub answers.

    Args:
        name: key of ``HUB_MODELS``.
        load: the model class's ``from_pretrained``.

    Raises:
        EncoderUnavailable: if the weights can neither be found nor fetched.
    """
    local_only = require_weights(name) == "cached" or offline_requested()
    try:
        return load(HUB_MODELS[name], local_files_only=local_only)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise EncoderUnavailable(
            f"encoder={name} expects the weights of {HUB_MODELS[name]}, which could not be loaded ({reason}); "
            "check the download or use encoder=efficientnet_lite0"
        ) from error
