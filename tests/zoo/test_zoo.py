"""The zoo delivers what it promises: determinism, exact truth, sane meshes, no hint of the species outside the animal."""

from dataclasses import fields

import numpy as np
import pytest

from fauna.data.crop_window import crop_window
from fauna.errors import FaunaError
from fauna.kernels.zoo_raster import rasterise
from fauna.zoo import HELD_OUT, SPECIES, Zoo, ZooSample
from fauna.zoo.view import project, sample_azimuth_deg

SIZE = 96


@pytest.fixture(scope="module")
def samples() -> dict[str, ZooSample]:
    """One photo of every species."""
    zoo = Zoo(seed=3, image_size=SIZE)
    return {name: zoo.sample(name, 2) for name in SPECIES}


def test_species_list():
    assert len(SPECIES) >= 16
    assert len(HELD_OUT) == 2
    assert set(HELD_OUT) < set(SPECIES)


def test_sample_is_a_pure_function_of_seed_species_index(samples):
    fresh = Zoo(seed=3, image_size=SIZE)
    fresh.sample("cow", 9)  # history must not matter
    again, first = fresh.sample("fox", 2), samples["fox"]
    np.testing.assert_array_equal(again.image, first.image)
    for item in fields(first.truth):
        np.testing.assert_array_equal(getattr(again.truth, item.name), getattr(first.truth, item.name))
    other = Zoo(seed=4, image_size=SIZE).sample("fox", 2)
    assert not np.array_equal(other.image, first.image)


def test_every_species_is_seen_in_its_crop(samples):
    for name, sample in samples.items():
        assert sample.image.shape == (SIZE, SIZE, 3), name
        assert sample.image.dtype == np.uint8, name
        assert set(np.unique(sample.mask)) == {0, 255}, name
        assert 0.05 < (sample.mask > 0).mean() < 0.7, name
        inside = sample.image[sample.mask > 0].astype(float)
        assert inside.std() > 4, name


def test_keypoints_are_projected_by_the_matrix(samples):
    for sample in samples.values():
        truth = sample.truth
        homogeneous = np.concatenate([truth.keypoints, np.ones((20, 1))], 1)
        clip = np.array([truth.clip_from_world @ point for point in homogeneous])
        np.testing.assert_allclose(truth.keypoints_2d, clip[:, :2] / clip[:, 3:], atol=1e-12)


def test_clip_agrees_with_camera(samples):
    """What the camera sees to the right, upwards and in front lies right, up (negative y) and at positive w."""
    for sample in samples.values():
        truth = sample.truth
        rotation = truth.camera_from_world[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        seen = project(truth.camera_from_world, truth.posed_verts)
        clip = project(truth.clip_from_world, truth.posed_verts)
        np.testing.assert_allclose(clip[:, 3], -seen[:, 2], rtol=1e-12)
        ndc = clip[:, :2] / clip[:, 3:]
        slope = seen[:, :2] / -seen[:, 2:3]
        gain = [np.polyfit(slope[:, i], ndc[:, i], 1)[0] for i in (0, 1)]
        assert gain[0] > 0 > gain[1]
        assert 2 * np.degrees(np.arctan(1 / gain[0])) == pytest.approx(truth.fov_deg)


def test_mask_is_the_projected_mesh():
    zoo = Zoo(seed=1, image_size=256)
    for name in ("horse", "elephant", "deer", "fox", "cat"):
        sample = zoo.sample(name, 1)
        truth = sample.truth
        clip = project(truth.clip_from_world, truth.posed_verts)
        fine = 3 * 256
        coverage = (rasterise(clip, truth.faces, fine, fine)[0] >= 0).reshape(256, 3, 256, 3).mean((1, 3))
        drawn, mesh = sample.mask > 0, coverage >= 0.5
        assert (drawn & mesh).sum() / (drawn | mesh).sum() > 0.97, name


def _slow_cover(clip: np.ndarray, faces: np.ndarray, size: int) -> np.ndarray:
    """Nearest triangle by testing every pixel against every triangle; -1 for none."""
    pixels = (clip[:, :2] / clip[:, 3:] + 1) * 0.5 * size - 0.5
    out = np.full((size, size), -1)
    for i in range(size):
        for j in range(size):
            nearest = np.inf
            for f, face in enumerate(faces):
                edges = np.stack([pixels[face[[0, 1]]], pixels[face[[1, 2]]], pixels[face[[2, 0]]]])
                side = [(b[0] - a[0]) * (i - a[1]) - (b[1] - a[1]) * (j - a[0]) for a, b in edges]
                if max(side) > 0:  # outside, or turned away: y points down
                    continue
                share = np.array([side[1], side[2], side[0]]) / sum(side)
                depth = share @ (clip[face, 2] / clip[face, 3])
                if depth < nearest:
                    nearest, out[i, j] = depth, f
    return out


def test_rasteriser_against_brute_force():
    rng = np.random.default_rng(0)
    clip = rng.uniform(-1.2, 1.2, (30, 4))
    clip[:, 3] = rng.uniform(1, 2, 30)
    faces = np.arange(30).reshape(10, 3)
    index, bary, depth = rasterise(clip, faces, 24, 24)
    np.testing.assert_array_equal(index, _slow_cover(clip, faces, 24))
    assert (index >= 0).any()
    covered = index >= 0
    np.testing.assert_allclose(bary[covered].sum(-1), 1)
    row, column = np.nonzero(covered)
    point = (clip[faces[index[covered]]] * bary[covered][..., None]).sum(
        1
    )  # perspective-correct: must project to the pixel centre
    np.testing.assert_allclose(point[:, 0] / point[:, 3], (2 * column + 1) / 24 - 1, atol=1e-12)
    np.testing.assert_allclose(point[:, 1] / point[:, 3], (2 * row + 1) / 24 - 1, atol=1e-12)
    np.testing.assert_allclose(point[:, 2] / point[:, 3], depth[covered], atol=1e-12)


def test_left_is_plus_x_and_head_is_plus_z(samples):
    for name, sample in samples.items():
        truth = sample.truth
        at = dict(zip(truth.keypoint_names, truth.keypoints, strict=True))
        for part in ("eye", "ear"):
            assert at[f"left_{part}"] @ [1, 0, 0] > at[f"right_{part}"] @ [1, 0, 0] - 0.4 * abs(at["nose"][0]), name
        for part in ("front_paw", "back_paw", "front_elbow", "back_elbow"):
            assert at[f"left_{part}"][0] > 0 > at[f"right_{part}"][0], name
        assert at["withers"][2] > at["tailbase"][2], name
        assert truth.rest_verts[:, 1].min() == pytest.approx(0, abs=0.05), name


def test_azimuth_says_which_side_the_head_is_on(samples):
    for sample in samples.values():
        truth = sample.truth
        forward = truth.camera_from_world[:3, 2]
        assert np.degrees(np.arctan2(forward[0], forward[2])) == pytest.approx(truth.azimuth_deg, abs=4)  # roll
        eye = np.linalg.inv(truth.camera_from_world)[:3, 3]
        body = truth.posed_verts.mean(0)
        toward = eye - body
        assert np.degrees(np.arctan2(toward[1], np.hypot(toward[0], toward[2]))) == pytest.approx(
            truth.elevation_deg, abs=8
        )


def test_near_side_keypoints_are_the_visible_ones():
    """Seen from its left side (head to the image's left) an animal shows its left eye, not the right one."""
    zoo = Zoo(seed=0, image_size=SIZE)
    near, far = [], []
    for species in ("horse", "cow", "fox", "deer"):
        for index in range(8):
            truth = zoo.sample(species, index).truth
            if 60 < abs(truth.azimuth_deg) < 115:
                seen = dict(zip(truth.keypoint_names, truth.keypoint_visible, strict=True))
                sides = ("left", "right") if truth.azimuth_deg < 0 else ("right", "left")
                near.append(seen[f"{sides[0]}_eye"])
                far.append(seen[f"{sides[1]}_eye"])
    assert len(near) >= 8
    assert np.mean(near) > 0.75
    assert np.mean(far) < 0.25


def test_surroundings_know_no_species():
    """One species-free sequence feeds all: photos of two species see interchangeable colours and lights."""
    zoo = Zoo(seed=0, image_size=SIZE)
    drawn = [zoo.surroundings(number) for number in range(12 * len(SPECIES))]
    table = np.array([[*s.ground.mean(0), *s.sky.mean(0), *s.clutter, s.blur, s.softness, s.sun[0]] for s in drawn])
    per_species = table.reshape(12, len(SPECIES), -1).mean(0)
    error = table.std(0) / np.sqrt(12)
    assert (np.abs(per_species - table.mean(0)) < 4.5 * error).all()
    chosen = zoo.sample("dog", 1)
    number = len(SPECIES) + SPECIES.index("dog")
    repainted = Zoo(seed=0, image_size=SIZE)
    repainted.surroundings = lambda asked: drawn[0] if asked == number else pytest.fail(f"asked for {asked}")
    swapped = repainted.sample("dog", 1)
    np.testing.assert_array_equal(
        chosen.mask, swapped.mask
    )  # the animal and the camera do not depend on the surroundings
    assert not np.array_equal(chosen.image, swapped.image)


def test_crop_window_rule():
    x0, y0, side = crop_window(100.0**2, (500.0, 300.0), (420.0, 250.0, 580.0, 350.0))
    assert (x0, y0, side) == (400, 200, 200)
    x0, y0, side = crop_window(100.0**2, (500.0, 300.0), (350.0, 250.0, 620.0, 350.0))
    assert side == 312  # 1.04 * 2 * 150
    assert (x0, y0) == (344, 144)


def test_crop_is_centred_and_holds_the_animal(samples):
    for name, sample in samples.items():
        x0, y0, width, height, photo_width, photo_height = sample.box
        assert width == height, name
        clip = project(sample.truth.clip_from_world, sample.truth.posed_verts)
        ndc = clip[:, :2] / clip[:, 3:]
        assert np.abs(ndc).max() <= 1.02, name
        pixels = [x0, y0] + (ndc + 1) * 0.5 * width
        assert (pixels >= 0).all(), name
        assert (pixels <= [photo_width, photo_height]).all(), name
        row, column = np.nonzero(sample.mask)
        np.testing.assert_allclose([(column.mean() + 0.5) / SIZE, (row.mean() + 0.5) / SIZE], 0.5, atol=0.02)
        area = (sample.mask > 0).mean()
        assert area < 0.27, name
        if np.abs(ndc).max() < 0.94:  # not widened: side is 2 sqrt(area)
            assert area == pytest.approx(0.25, abs=0.02), name


def test_black_exactly_outside_the_photo():
    zoo = Zoo(seed=0, image_size=SIZE)
    padded = 0
    for species in ("fox", "zebra", "lion"):
        for index in range(10):
            sample = zoo.sample(species, index)
            x0, _, side, _, photo_width, _ = sample.box
            column = x0 + (np.arange(SIZE) + 0.5) / SIZE * side
            outside = (column < 0) | (column >= photo_width)
            assert (sample.image[:, outside] == 0).all()
            padded += outside.any()
    assert padded < 10


def test_meshes_are_closed_and_face_outwards(samples):
    for name, sample in samples.items():
        verts, faces = sample.truth.rest_verts, sample.truth.faces
        assert verts.shape == sample.truth.posed_verts.shape
        assert np.isfinite(sample.truth.posed_verts).all(), name
        assert 0 <= faces.min() <= faces.max() == len(verts) - 1, name
        directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        codes = directed[:, 0] * len(verts) + directed[:, 1]
        assert len(np.unique(codes)) == len(codes), name
        np.testing.assert_array_equal(
            np.sort(codes), np.sort(directed[:, 1] * len(verts) + directed[:, 0]), err_msg=name
        )
        for shape in (verts, sample.truth.posed_verts):
            a, b, c = (shape[faces[:, i]] for i in range(3))
            assert (a * np.cross(b, c)).sum() / 6 > 0.02, name


def test_rest_mesh_is_mirror_symmetric(samples):
    from scipy.spatial import KDTree

    for name, sample in samples.items():
        rest = sample.truth.rest_verts
        distance, _ = KDTree(rest).query(rest * [-1, 1, 1])
        assert np.quantile(distance, 0.95) < 0.03, name


def test_individuals_share_a_mesh_and_differ_from_others():
    zoo = Zoo(seed=0, image_size=SIZE)
    first, second = zoo.sample("dog", 0), zoo.sample("dog", 1)
    assert zoo.individual("dog", 0) == zoo.individual("dog", 1) == first.truth.individual
    np.testing.assert_array_equal(first.truth.rest_verts, second.truth.rest_verts)
    assert not np.array_equal(first.truth.posed_verts, second.truth.posed_verts)
    stranger = next(i for i in range(100) if zoo.individual("dog", i) != first.truth.individual)
    other = zoo.sample("dog", stranger).truth.rest_verts
    assert other.shape != first.truth.rest_verts.shape or not np.allclose(other, first.truth.rest_verts)


def test_views_are_biased_like_a_photographers():
    rng = np.random.default_rng(0)
    angles = np.abs([sample_azimuth_deg(rng) for _ in range(4000)])
    assert 0.05 < (angles > 122).mean() < 0.10
    assert ((angles > 60) & (angles < 122)).mean() > 0.45


def test_messages():
    zoo = Zoo(seed=0, image_size=SIZE)
    with pytest.raises(FaunaError, match="unknown species 'unicorn'; expected one of horse"):
        zoo.sample("unicorn", 0)
    with pytest.raises(FaunaError, match="received -1"):
        zoo.sample("horse", -1)
    with pytest.raises(FaunaError, match="image_size must be at least 16, received 8"):
        Zoo(seed=0, image_size=8)
