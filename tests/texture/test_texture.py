"""Baking, projecting, fitting colour and pose, on a small model whose geometry is exact."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fauna.data.single import single_photo
from fauna.errors import FaunaError
from fauna.geometry.camera import make_camera
from fauna.geometry.mesh import build_topology
from fauna.io.contact_sheet import VIEWS
from fauna.losses.reconstruction import values_at
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.texture import BakedLight, bake, baking_psnr, finetune, refine, render_textured
from fauna.texture.atlas import fill, texels_of, unwrap
from fauna.texture.fitting import FreePose
from fauna.texture.projection import mirror_places
from fauna.texture.refinement import RefineOptions
from fauna.texture.replay import at, psnr, render_network
from fauna.texture.visible import see
from fauna.zoo import Zoo

SIZE = 96


@pytest.fixture(scope="module")
def model():
    from fauna.model import FaunaModel

    return FaunaModel.from_pretrained()


@pytest.fixture(scope="module")
def batch(model):
    sample = Zoo(seed=5, image_size=SIZE).sample("zebra", 1)
    return single_photo(model.encoder, sample.image, sample.mask, crop=False, size=SIZE)


@pytest.fixture(scope="module")
def out(model, batch):
    with torch.no_grad():
        return model(batch)


@pytest.fixture(scope="module")
def texture(model, out):
    return bake(model, out, size=256)


def inside(batch, seen):
    return batch.masks[0].flatten()[seen.pixels] > 0.5


# --- atlas -----------------------------------------------------------------------------------------------------------


def test_atlas_keeps_the_mesh(out, texture):
    faces = out.base.faces.numpy()
    np.testing.assert_array_equal(texture.vertex[texture.faces], faces)
    assert texture.uv.min() >= 0
    assert texture.uv.max() <= 1
    assert texture.image.shape == (256, 256, 3)
    corners = texture.uv[texture.faces].astype(np.float64)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    assert (np.abs(area) > 0).mean() > 0.99
    assert np.abs(area).sum() / 2 > 0.3, "charts fill too little of the image"


def test_charts_do_not_overlap(out, texture):
    """Each texel centre lies in one triangle at most, whatever order they are drawn in."""
    flat = torch.from_numpy(texture.uv)
    clip = torch.cat((2 * flat - 1, torch.zeros_like(flat[:, :1]), torch.ones_like(flat[:, :1])), dim=1)[None]
    faces = torch.from_numpy(texture.faces)
    first = NumbaRenderer().rasterize(clip, faces, 256, 256).face_index
    last = len(faces) - 1 - NumbaRenderer().rasterize(clip, faces.flip(0), 256, 256).face_index
    last = torch.where(last == len(faces), -1, last)
    assert float((first != last).float().mean()) < 1e-3


def test_texels_name_the_point_they_show(out):
    atlas = unwrap(out.instance.verts[0], out.base.faces, out.base.topology, size=128)
    texels = texels_of(NumbaRenderer(), atlas, 128)
    centre = torch.stack((texels.index % 128 + 0.5, texels.index // 128 + 0.5), dim=1) / 128
    again = torch.einsum("tk,tkc->tc", texels.barycentrics, atlas.uv[atlas.faces[texels.face]])
    torch.testing.assert_close(again, centre, atol=2e-5, rtol=0)
    torch.testing.assert_close(
        texels.interpolate(out.base.verts), (out.base.verts[texels.corners] * texels.barycentrics[..., None]).sum(1)
    )


def test_fill_takes_the_nearest_known_texel():
    generator = np.random.default_rng(0)
    known = generator.random((12, 12)) < 0.1
    image = generator.random((12, 12, 3)) * known[..., None]
    filled = fill(image, known)
    places = np.argwhere(known)
    for i in range(12):
        for j in range(12):
            distance = ((places - (i, j)) ** 2).sum(1)
            near = places[distance == distance.min()]
            assert any(np.array_equal(filled[i, j], image[tuple(place)]) for place in near)


def test_baking_is_repeatable(model, out, texture):
    again = bake(model, out, size=256)
    np.testing.assert_array_equal(again.image, texture.image)
    np.testing.assert_array_equal(again.uv, texture.uv)


@pytest.mark.parametrize("size", [63, 8193])
def test_senseless_sizes_are_refused(model, out, size):
    with pytest.raises(FaunaError, match=f"got {size}"):
        bake(model, out, size=size)


def test_a_mesh_without_faces_is_refused():
    faces = torch.zeros(0, 3, dtype=torch.long)
    with pytest.raises(FaunaError, match="got none"):
        unwrap(torch.zeros(0, 3), faces, build_topology(faces), size=128)


def test_other_rows_and_sources_are_refused(model, out):
    with pytest.raises(FaunaError, match="row from 0 to 0, got 1"):
        bake(model, out, row=1, size=128)
    with pytest.raises(FaunaError, match="photo with a batch"):
        bake(model, out, size=128, source="photo")


# --- seen again ------------------------------------------------------------------------------------------------------


def test_baked_texture_gives_the_networks_picture(model, out, texture):
    assert baking_psnr(model, out, texture, size=SIZE) > 50


def test_picture_of_the_network_is_the_renderers(model, out):
    picture, seen = render_network(model, out, size=SIZE)
    shading = out.renders.shading
    whole = out.renders.image(shading.rgb)[0]
    interior = torch.nn.functional.avg_pool2d(seen.fragments.covered.float(), 3, stride=1, padding=1)[0] > 0.99
    assert interior.sum() > 100
    error = (picture - whole).abs().amax(0)[interior]
    assert float(error.median()) < 1e-6
    assert float((error < 1e-4).float().mean()) > 0.8, "only pixels at inner contours are blended by the renderer"


def test_light_is_in_the_world_frame(out, texture):
    direction = torch.tensor(texture.light.direction)
    torch.testing.assert_close(out.camera.camera_from_world[0, :3, :3] @ direction, out.light.direction[0])
    assert texture.light.extras()["ambient"] == pytest.approx(float(out.light.ambient[0]))


def test_exposure_is_undone(model, out, texture):
    """Another exposure, the same picture: the image holds albedo * exposure."""
    light = replace(texture.light, exposure=texture.light.exposure / 2)
    brighter, seen = render_textured(model, out, replace(texture, light=light), size=SIZE)
    picture, _ = render_textured(model, out, texture, size=SIZE)
    torch.testing.assert_close(brighter, 2 * picture)
    assert isinstance(light, BakedLight)
    assert float(seen.intensity.mean()) == pytest.approx(texture.light.exposure, rel=1e-5)


# --- the photograph --------------------------------------------------------------------------------------------------


def test_mirror_places_lie_on_the_mirrored_surface(out):
    corners, weights = mirror_places(out.base.verts, out.base.faces)
    places = torch.einsum("vk,vkc->vc", weights, out.base.verts[corners])
    torch.testing.assert_close(weights.sum(1), torch.ones(len(weights)))
    distance = (places * torch.tensor([-1.0, 1.0, 1.0]) - out.base.verts).norm(dim=1)
    assert float(distance.max()) < 0.05, "the base shape is symmetric up to its tessellation"


def test_photo_is_nearer_to_the_photograph_than_the_network(model, batch, out, texture):
    projected = bake(model, out, size=512, source="photo", batch=batch)
    found = {}
    for name, each in (("network", texture), ("photo", projected)):
        picture, seen = render_textured(model, out, each, size=SIZE)
        chosen = inside(batch, seen)
        found[name] = psnr(at(picture, seen)[chosen], at(batch.images[0], seen)[chosen])
    assert found["photo"] > found["network"] + 3
    assert not np.array_equal(projected.image[:256, :256], texture.image)


def test_the_unseen_side_mirrors_the_seen_one(model, batch, out):
    """Seen from one side, a photograph of horizontal places: both flanks show them alike."""
    rest = replace(out.posed, verts=out.instance.verts)
    camera = make_camera(torch.tensor(VIEWS["side"]).T[None], torch.zeros(1, 3), fov_deg=25.0, distance=10.0)
    light = replace(out.light, ambient=torch.ones(1), diffuse=torch.zeros(1))
    side = replace(out, posed=rest, camera=camera, light=light)
    everywhere, ramp = torch.ones(1, SIZE, SIZE), torch.linspace(0.1, 0.9, SIZE).expand(1, 3, SIZE, SIZE)
    photo = replace(batch, images=ramp, masks=everywhere, valid=everywhere, distance_inside=everywhere)
    texture = bake(model, side, size=256, source="photo", batch=photo)
    texel = (texture.uv * 256).astype(int).clip(max=255)
    value = texture.image[texel[:, 1], texel[:, 0], 0] / 255.0
    x, y, z = out.base.verts.numpy()[texture.vertex].T
    flank = (np.abs(y) < 0.3) & (np.abs(z) < 1.0)
    slopes = [np.polyfit(z[each], value[each], 1)[0] for each in (flank & (x > 0.3), flank & (x < -0.3))]
    assert abs(slopes[0]) == pytest.approx(0.8 / (2 * 2.217), rel=0.1)
    assert slopes[1] == pytest.approx(slopes[0], rel=0.1)


# --- fine-tuning -----------------------------------------------------------------------------------------------------


def test_finetuning_changes_the_copys_albedo_only(model, batch, out):
    before = {name: value.clone() for name, value in model.state_dict().items() if isinstance(value, torch.Tensor)}
    fitted = finetune(model, batch, out, iterations=3)
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items() if name in before)
    changed = {
        name for name, value in fitted.state_dict().items() if name in before and not torch.equal(value, before[name])
    }
    assert changed
    assert all(name.startswith("appearance.albedo_field") for name in changed)
    assert all(parameter.grad is None for parameter in model.parameters())


def test_finetuning_comes_nearer_to_the_photograph(model, batch, out):
    seen = see(model.renderer, out, (SIZE, SIZE))
    chosen = inside(batch, seen)
    target = values_at(batch.images, seen.row, seen.pixels)[chosen]

    def error(each):
        picture, _ = render_network(each, out, size=SIZE)
        return float((at(picture, seen)[chosen] - target).abs().mean())

    with torch.no_grad():  # as a caller may
        fitted = [finetune(model, batch, out, iterations=count) for count in (0, 10, 50)]
    assert error(fitted[0]) == error(model)
    assert error(fitted[2]) < error(fitted[1]) < error(fitted[0])


def test_nothing_in_common_is_refused(model, batch, out):
    empty = replace(batch, masks=torch.zeros_like(batch.masks))
    with pytest.raises(FaunaError, match="no common pixel"):
        finetune(model, empty, out, iterations=1)
    with pytest.raises(FaunaError, match="got -1"):
        finetune(model, batch, out, iterations=-1)


# --- refinement ------------------------------------------------------------------------------------------------------


def test_refinement_fits_the_mask_within_the_limits(model, batch, out):
    refined = refine(model, batch, out, steps=15)
    assert refined.steps == 15
    assert refined.iou_after[0] > refined.iou_before[0]
    limits = model.articulation.limits(model.stage.leg_limits)
    assert (refined.out.pose.angles.abs() <= limits + 1e-6).all()
    torch.testing.assert_close(refined.out.base.verts, out.base.verts, rtol=0, atol=0)
    rotation = refined.out.camera.camera_from_world[0, :3, :3]
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3), atol=1e-5, rtol=0)
    assert torch.equal(refined.out.hypotheses.rotations[0, refined.out.selection.hypothesis[0]], rotation)
    assert not refined.out.posed.verts.requires_grad
    again = refine(model, batch, out, steps=15)
    assert torch.equal(again.out.posed.verts, refined.out.posed.verts)


def test_no_steps_leave_the_reconstruction(model, batch, out):
    refined = refine(model, batch, out, steps=0)
    torch.testing.assert_close(refined.out.posed.verts, out.posed.verts, atol=2e-3, rtol=0)
    assert refined.iou_after[0] == pytest.approx(refined.iou_before[0], abs=0.01)
    with pytest.raises(FaunaError, match="got -3"):
        refine(model, batch, out, steps=-3)


def test_photographs_of_a_batch_are_fitted_alone(model, batch, out):
    """Two photographs in a batch are fitted like each by itself."""
    other = replace(batch, masks=batch.masks.roll(3, dims=2))
    pair = {name: torch.cat((getattr(batch, name), getattr(other, name))) for name in ("images", "masks", "valid")}
    distances = {name: torch.cat((getattr(batch, name),) * 2) for name in ("distance_inside", "distance_outside")}
    features = model.encode(batch).rows(torch.tensor([0, 0]))
    both = replace(batch, **pair, **distances, names=("a", "b"), features=features, encoder_images=None)
    with torch.no_grad():
        start = model(both)
    refined = refine(model, both, start, steps=4)
    assert len(refined.iou_after) == 2
    for row in range(2):
        assert refined.iou_after[row] >= refined.iou_before[row] - 0.02


def test_kept_angles_move_less(model, batch, out):
    far, near = (
        refine(model, batch, out, steps=10, options=RefineOptions(keep=keep)).out.pose.angles for keep in (0.0, 100.0)
    )
    start = FreePose(model=model, start=out, free="angles").at({})[2].angles
    assert (near - start).square().mean() < (far - start).square().mean()
