"""Skinning, joints, implicit flesh and pose of the zoo against slow references."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fauna.kernels.zoo_raster import cone_distances, value_noise
from fauna.zoo.body import KEYPOINTS
from fauna.zoo.build import build_body
from fauna.zoo.palette import COATS
from fauna.zoo.poses import sample_pose
from fauna.zoo.skinning import bone_transforms, skin
from fauna.zoo.surface import build_surface, vertex_normals
from fauna.zoo.zoo import ANATOMY, vary


def _slow_cone(point: np.ndarray, cone: np.ndarray) -> float:
    """Distance to a union of 20,000 spheres along the segment."""
    t = np.linspace(0, 1, 20001)[:, None]
    centres = cone[:3] + t * (cone[3:6] - cone[:3])
    radii = cone[6] + t[:, 0] * (cone[7] - cone[6])
    return float((np.linalg.norm(point - centres, axis=1) - radii).min())


def test_round_cone_is_a_swept_sphere():
    rng = np.random.default_rng(0)
    cones = np.concatenate([rng.uniform(-1, 1, (12, 6)), rng.uniform(0.1, 0.6, (12, 2)), np.ones((12, 1))], 1)
    cones[0, 3:6] = cones[0, :3]  # a ball
    cones[1, 6:8] = (2.9, 0.1)  # one ball swallows the other
    points = rng.uniform(-2, 2, (40, 3))
    fast = cone_distances(points, cones)
    slow = np.array([[_slow_cone(p, c) for c in cones] for p in points])
    np.testing.assert_allclose(fast, slow, atol=1e-4)


def test_flattened_cone_keeps_its_outline_in_the_mirror_plane():
    round_, flat = np.array([[0, 0, 0, 0, 0, 1.0, 0.3, 0.2, 1.0]]), np.array([[0, 0, 0, 0, 0, 1.0, 0.3, 0.2, 0.5]])
    points = np.random.default_rng(0).uniform(-1, 2, (50, 3)) * [0, 1, 1]
    np.testing.assert_allclose(cone_distances(points, flat), cone_distances(points, round_))
    side = np.array([[0.15, 0.0, 0.0]])
    assert cone_distances(side, flat)[0, 0] == pytest.approx(0, abs=0.02)


def test_value_noise_is_smooth_and_bounded():
    points = np.random.default_rng(0).uniform(-20, 20, (2000, 3))
    noise = value_noise(points, 3, 5)
    assert 0 <= noise.min() < 0.4 < 0.6 < noise.max() <= 1
    np.testing.assert_allclose(value_noise(points + 1e-7, 3, 5), noise, atol=1e-5)
    assert np.abs(value_noise(points, 3, 6) - noise).mean() > 0.05


def test_no_rotation_is_no_motion():
    body = build_body(ANATOMY["horse"])
    surface = build_surface(body, cells=40, fleece=0.0)
    transforms = bone_transforms(body.joints, body.parents, {})
    posed = skin(surface.verts, surface.weights, np.stack([transforms[n] for n in body.joints]))
    np.testing.assert_allclose(posed, surface.verts, atol=1e-12)


def test_skin_moves_rigidly_with_one_bone_and_with_the_root():
    rng = np.random.default_rng(1)
    verts, weights = rng.normal(size=(30, 3)), rng.dirichlet(np.ones(3), 30)
    rigid = np.tile(np.eye(4), (3, 1, 1))
    rigid[:, :3, :3], rigid[:, :3, 3] = Rotation.from_euler("xyz", [0.7, -2.0, 0.3]).as_matrix(), [0.3, -1.0, 2.0]
    expected = verts @ rigid[0, :3, :3].T + rigid[0, :3, 3]
    np.testing.assert_allclose(skin(verts, weights, rigid), expected, atol=1e-12)
    different = np.stack([np.eye(4), rigid[0], np.eye(4)])
    np.testing.assert_allclose(skin(verts, np.tile([0, 1.0, 0], (30, 1)), different), expected, atol=1e-12)


def test_half_way_blend_keeps_the_length_of_a_twist():
    """Averaging 0 and 160 degrees linearly would collapse the limb; dual quaternions turn it by 80 degrees."""
    transforms = np.tile(np.eye(4), (2, 1, 1))
    transforms[1, :3, :3] = Rotation.from_euler("z", 160, degrees=True).as_matrix()
    moved = skin(np.array([[1.0, 0, 0]]), np.array([[0.5, 0.5]]), transforms)
    np.testing.assert_allclose(moved[0], [np.cos(np.radians(80)), np.sin(np.radians(80)), 0], atol=1e-12)


def test_children_follow_their_parents():
    joints = {"a": np.zeros(3), "b": np.array([0, -1.0, 0])}
    transforms = bone_transforms(joints, {"a": None, "b": "a"}, {"a": (np.pi / 2, 0.0, 0.0)})
    np.testing.assert_allclose(transforms["b"] @ [0, -2, 0, 1], [0, 0, -2, 1], atol=1e-12)  # hanging, swung back
    bent = bone_transforms(joints, {"a": None, "b": "a"}, {"b": (np.pi / 2, 0.0, 0.0)})
    np.testing.assert_allclose(bent["b"] @ [0, -2, 0, 1], [0, -1, -1, 1], atol=1e-12)
    np.testing.assert_allclose(bent["a"], np.eye(4))


def test_legs_do_not_pull_each_other():
    body = build_body(ANATOMY["cow"])
    surface = build_surface(body, cells=60, fleece=0.0)
    names = list(body.joints)
    np.testing.assert_allclose(surface.weights.sum(1), 1)
    feet = surface.weights[surface.verts[:, 1] < 0.12]
    for left, right in (("left_front_foot", "right_front_foot"), ("left_back_foot", "right_back_foot")):
        both = np.minimum(feet[:, names.index(left)], feet[:, names.index(right)])
        assert both.max() < 1e-6


@pytest.mark.parametrize("species", list(ANATOMY))
def test_bodies_are_complete(species):
    anatomy = vary(ANATOMY[species], np.random.default_rng(0))
    body = build_body(anatomy)
    assert set(body.keypoints) == set(KEYPOINTS)
    assert species in COATS
    for name, parent in body.parents.items():
        assert parent is None or list(body.joints).index(parent) < list(body.joints).index(name)
    for name, (place, bone, _) in body.keypoints.items():
        assert bone in body.joints
        if name.startswith("left"):
            np.testing.assert_allclose(place * [-1, 1, 1], body.keypoints["right" + name[4:]][0])
    rng = np.random.default_rng(0)
    for _ in range(20):
        _, angles = sample_pose(body, species, rng)
        assert set(angles) <= set(body.joints) | {f"proboscis{i}" for i in range(5)}


def test_grazing_brings_the_nose_down():
    body = build_body(ANATOMY["horse"])
    rng = np.random.default_rng(0)
    heights = {}
    for _ in range(60):
        activity, angles = sample_pose(body, "horse", rng)
        place, bone, _ = body.keypoints["nose"]
        heights.setdefault(activity, []).append(
            (bone_transforms(body.joints, body.parents, angles)[bone] @ np.append(place, 1))[1]
        )
    assert np.mean(heights["graze"]) < 0.35
    assert np.mean(heights["stand"]) > 0.7


def test_vertex_normals_of_a_ball_point_outwards():
    import trimesh

    ball = trimesh.creation.icosphere(3)
    np.testing.assert_allclose(vertex_normals(np.array(ball.vertices), np.array(ball.faces)), ball.vertices, atol=0.02)
