"""From the model's own output to a file."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fauna.errors import FaunaError
from fauna.export import glb_bytes, rig_reconstruction, vertex_colours
from fauna.stages import Stage
from fauna.types import Pose
from tests.export.reader import Player
from tests.test_system import batch, cfg, system  # noqa: F401


@pytest.fixture
def model(system):  # noqa: F811
    return system.model.eval()


@pytest.fixture
def photos(system):  # noqa: F811
    return batch(system, photos=3)


def bent(model, out, seed=0):
    """The same reconstruction with bones bent as an untrained network never would."""
    angles = 0.4 * torch.randn(out.pose.angles.shape, generator=torch.Generator().manual_seed(seed))
    posed = model.rig.pose(out.base, out.instance, out.skeleton, Pose(angles))
    return replace(out, pose=Pose(angles), posed=posed)


@torch.no_grad()
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("deformation", [False, True])
@pytest.mark.parametrize("legs_attached", [False, True])
def test_each_rows_file_shows_that_rows_mesh(model, photos, turned, deformation, legs_attached):
    model.set_turned(turned)
    model.set_stage(Stage(articulation=True, deformation=deformation, legs_attached=legs_attached))
    out = bent(model, model(photos))
    for row in (0, 2):
        rigged = rig_reconstruction(model, out, row=row, name="blob")
        shown = Player.of(glb_bytes(rigged)).vertices("photo")
        apart = np.linalg.norm(rigged.to_world(shown) - out.posed.verts[row].numpy(), axis=1)
        apart = apart * rigged.metres_per_unit / rigged.body_length
        assert apart.max() == pytest.approx(rigged.skin_error_max, abs=1e-5)
        assert apart.mean() < 0.02
        assert np.median(apart) < 0.005


@torch.no_grad()
def test_a_model_that_does_not_articulate_yet(model, photos):
    model.set_stage(Stage(articulation=False))
    out = model(photos)
    rigged = rig_reconstruction(model, out, row=1, name="blob", back_height=0.5)
    assert rigged.skin_error_max < 1e-6
    np.testing.assert_allclose(rigged.pose(rigged.photo), rigged.vertices, atol=1e-9)


@torch.no_grad()
def test_colours_of_the_vertices(model, photos):
    model.set_stage(Stage(articulation=True))
    out = model(photos)
    embedding = model.embedder(model.mask_embedding(model.feature_space.normalize(model.encode(photos)), photos.masks))
    colours = vertex_colours(model, out, embedding.texture[1:2])
    row = torch.full((len(out.base.verts),), 1)
    expected = model.appearance.albedo(out.base.verts, embedding.texture, row)
    np.testing.assert_allclose(colours, expected.numpy(), atol=1e-6)
    rigged = rig_reconstruction(model, out, name="blob", colours=colours)
    assert Player.of(glb_bytes(rigged)).attribute("COLOR_0") is not None


@torch.no_grad()
@pytest.mark.parametrize("row", [-1, 3])
def test_a_row_that_is_not_there(model, photos, row):
    model.set_stage(Stage(articulation=True))
    with pytest.raises(FaunaError, match=f"row: expected one of 3 rows, got {row}"):
        rig_reconstruction(model, model(photos), row=row, name="blob")
