"""Every experiment and every option of every component group trains, made small enough for a test."""

import pytest

from fauna._conf import CONF_DIR
from fauna.configuration import MODEL_GROUPS
from tests.runs import run, tiny

MAPS_OF_32 = ("encoder.input_size=64", "encoder.stride=2", "encoder.grid_size=32")
SMALL = {
    "shape=paper": (
        "shape.grid_resolution=24",
        "shape.sdf.hidden_dim=16",
        "shape.eikonal_points=20",
        "shape.jitter=0.5",
    ),
    "shape=laptop": ("shape.grid_resolution=32", "shape.sdf.hidden_dim=16", "shape.eikonal_points=20"),
    "embedder=paper": (*MAPS_OF_32, "embedder.trunk.hidden_dim=16", "embedder.embedding_dim=16"),
    "viewpoint=paper": (
        *MAPS_OF_32,
        "viewpoint.trunk.hidden_dim=16",
    ),
    "deformation=paper": ("deformation.hidden_dim=16",),
    "articulation=paper": ("articulation.hidden_dim=16",),
    "articulation=published": ("articulation.hidden_dim=16",),
    "appearance=paper": (
        "appearance.albedo_field.hidden_dim=16",
        "appearance.feature_field.hidden_dim=16",
        "appearance.light_network.hidden_dim=16",
    ),
    "encoder=efficientnet_lite0": ("encoder.input_size=256", "encoder.grid_size=8"),
}
GROUPS = ("encoder", *MODEL_GROUPS, "discriminator", "losses", "optimizer")
NEEDS_MORE_THAN_A_CPU = {"renderer=nvdiffrast", "encoder=dino_vits8", "encoder=dinov2_vits14"}
OPTIONS = [f"{group}={path.stem}" for group in GROUPS for path in sorted((CONF_DIR / group).glob("*.yaml"))]
EVERYTHING_ON = (
    "trainer.max_steps=2",
    "trainer.val_every=2",
    "trainer.val_photos=1",
    "schedule.articulation=[0,null]",
    "schedule.deformation=[0,null]",
    "schedule.adversarial=[0,null]",
    "schedule.all_hypotheses=[1,null]",
)


def check(result: dict) -> None:
    assert result["steps"] == 2
    assert 0 <= result["trained"]["iou"] <= 1
    assert result["trained"]["losses"]["mask"] > 0


def test_small_settings_name_options():
    assert set(SMALL) <= set(OPTIONS)
    assert set(OPTIONS) > NEEDS_MORE_THAN_A_CPU
    assert len(OPTIONS) >= 35


@pytest.mark.parametrize("option", [option for option in OPTIONS if option not in NEEDS_MORE_THAN_A_CPU])
def test_option_trains(tmp_path, option):
    check(run(tmp_path, *tiny(option, *SMALL.get(option, ()), *EVERYTHING_ON)))


@pytest.mark.parametrize("schedule", sorted(path.stem for path in (CONF_DIR / "schedule").glob("*.yaml")))
def test_schedule_trains_late_in_its_course(tmp_path, schedule):
    late = 900_000 if schedule in ("paper", "published", "released") else 1_000
    small = ("schedule.grid_resolution=32",) if schedule == "released" else ()
    options = ("trainer.max_steps=2", "trainer.val_every=2", "trainer.val_photos=1", f"schedule.start_at={late}")
    check(run(tmp_path, *tiny(f"schedule={schedule}", *options, *small)))


@pytest.mark.parametrize(
    "experiment", ["quadruped", "laptop", "quickstart", "[tiny,magicpony]", "[quadruped,magicpony]"]
)
def test_experiment_trains_with_small_numbers(tmp_path, experiment):
    options = tiny(*EVERYTHING_ON)
    options[0] = f"+experiment={experiment}"
    if "tiny" not in experiment:
        options += ["encoder=tiny", "trainer.devices=1", "trainer.accelerator=cpu", "trainer.threads=1"]
    if "quadruped" in experiment:
        keys = ("shape", "embedder", "viewpoint", "deformation", "articulation", "appearance")
        options += [override for key in keys for override in SMALL[f"{key}=paper"]]
    elif "tiny" not in experiment:
        options += SMALL["shape=laptop"]
    check(run(tmp_path, *options))


def test_feature_lookup_at_pixels_trains(tmp_path):
    check(run(tmp_path, *tiny("feature_lookup=pixels", *EVERYTHING_ON)))


def test_features_need_no_cache(tmp_path):
    check(run(tmp_path, *tiny("data.cache_features=false", *EVERYTHING_ON)))
