"""The interface of the frozen image encoders."""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.errors import FaunaError
from fauna.types import Features


class Encoder(nn.Module, ABC):
    """A frozen network that turns photos into :class:`~fauna.types.Features`.

    The network is deliberately *not* a registered submodule: its weights appear neither in ``parameters()`` (no optimiser,
    no gradient synchronisation) nor in ``state_dict()`` (they are public files, identified by :attr:`fingerprint`). It follows
    ``.to(...)`` and always stays in evaluation mode. Every forward pass runs without gradient.

    Attributes:
        name: the config group's name.
        global_dim: channels of ``Features.global_``.
        token_dim: channels of ``Features.tokens`` and ``Features.keys``.
        input_size: side of the expected square images, pixels.
        grid_size: side of the token grid, cells.
        fingerprint: identifies weights and preprocessing; equal fingerprints mean equal features up to rounding.
        keys_are_tokens: True when the encoder has no attention and returns one map for both.
    """

    keys_are_tokens: bool

    def __init__(
        self,
        *,
        name: str,
        network: nn.Module,
        input_size: int,
        stride: int,
        global_dim: int,
        token_dim: int,
        settings: str,
    ):
        super().__init__()
        if input_size < stride or input_size % stride:
            raise FaunaError(
                f"encoder={name}: input_size must be a positive multiple of {stride}, got {input_size}; set encoder.input_size"
            )
        self.name = name
        self.input_size = input_size
        self.grid_size = input_size // stride
        self.global_dim = global_dim
        self.token_dim = token_dim
        self.fingerprint = f"{name}-{input_size}-{settings}-{weights_digest(network)}"
        self._frozen = (network.eval().requires_grad_(False),)  # a tuple hides it from nn.Module's registry

    @property
    def network(self) -> nn.Module:
        """The frozen network."""
        return self._frozen[0]

    def forward(self, images: Float[Tensor, "batch 3 height width"]) -> Features:
        """Encode square images.

        On a CPU one by one, so that what else is in the batch cannot change the rounding of a photo's features; it costs
        nothing, because the activations of one photo use the caches better.

        Args:
            images: (batch, 3, input_size, input_size) in [0, 1]; each encoder normalises them its own way.

        Returns:
            Features with a ``grid_size`` x ``grid_size`` grid, without gradient history.

        Raises:
            FaunaError: if the images do not have the side ``input_size``.
        """
        if self.device.type != "cpu" or len(images) == 1:
            return self.encode_together(images)
        singles = [self.encode_together(image[None]) for image in images]
        tokens = torch.cat([each.tokens for each in singles])
        keys = tokens if self.keys_are_tokens else torch.cat([each.keys for each in singles])
        return Features(torch.cat([each.global_ for each in singles]), tokens, keys)

    @torch.no_grad()
    def encode_together(self, images: Float[Tensor, "batch 3 height width"]) -> Features:
        """The same in one pass of the network: the last bits may depend on how many images there are.

        The feature cache encodes a photo and its mirror image so: always two, and its files are made of that.
        """
        size = tuple(images.shape[-2:])
        if size != (self.input_size, self.input_size):
            raise FaunaError(
                f"encoder={self.name} expects {self.input_size}x{self.input_size} images, got {size[0]}x{size[1]}; "
                "resize them or set encoder.input_size"
            )
        return self._encode(images.to(self.device))

    @property
    def device(self) -> torch.device:
        """Where the network is; inputs are brought there."""
        return next(self.network.parameters()).device

    @property
    def dtype(self) -> str:
        """Number format of the network's weights, e.g. ``float32``; features are returned in that of the images."""
        return str(next(self.network.parameters()).dtype).removeprefix("torch.")

    @abstractmethod
    def _encode(self, images: Float[Tensor, "batch 3 height width"]) -> Features:
        """Encode images of the right size; called without gradient."""

    def train(self, mode: bool = True) -> "Encoder":
        """Ignored: a frozen network has no training mode."""
        del mode
        return super().train(False)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> "Encoder":
        self.network._apply(fn, recurse)
        return super()._apply(fn, recurse)


def weights_digest(network: nn.Module) -> str:
    """Hexadecimal digest (16 digits) of names, types and bytes of all weights and buffers."""
    digest = hashlib.blake2b(digest_size=8)
    for name, tensor in sorted(network.state_dict().items()):
        digest.update(f"{name}:{tensor.dtype}:{tuple(tensor.shape)}".encode())
        digest.update(tensor.detach().cpu().reshape(-1).contiguous().view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()
