"""Every YAML file composes, names what it says it names, and fits the signature of what it configures."""

from pathlib import Path

import pytest
import yaml
from hydra.utils import get_object

from fauna._conf import CONF_DIR
from fauna.configuration import validate
from fauna.errors import FaunaError
from tests.runs import composed

FILES = sorted(path.relative_to(CONF_DIR) for path in CONF_DIR.rglob("*.yaml"))
COMPONENTS = (
    "encoder",
    "bank",
    "shape",
    "deformation",
    "viewpoint",
    "articulation",
    "appearance",
    "renderer",
    "discriminator",
)
GROUPS = sorted({str(f.parent) for f in FILES if str(f.parent) not in (".", "experiment", "queue", "sweep")})
OPTIONS = [(group, f.stem) for group in GROUPS for f in FILES if str(f.parent) == group]
EXPERIMENTS = sorted(f.stem for f in FILES if str(f.parent) == "experiment")


def test_files_are_found():
    assert len(FILES) > 40
    assert {"quadruped", "laptop", "quickstart", "magicpony", "tiny"} <= set(EXPERIMENTS)


@pytest.mark.parametrize(("group", "option"), OPTIONS)
def test_every_option_composes_and_binds(group, option):
    validate(composed(f"{group}={option}"))


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_composes_and_binds(experiment):
    needs = {name: ["init_from=pretrained"] for name in ("laptop_bodies", "ablation_bodies")}  # go on from another run
    validate(composed(f"+experiment={experiment}", *needs.get(experiment, [])))


@pytest.mark.parametrize(("group", "option"), [pair for pair in OPTIONS if pair[0] in COMPONENTS])
def test_component_groups_mirror_packages(group, option):
    target = composed(f"{group}={option}")[group]._target_
    assert target.startswith(f"fauna.{group}."), target
    get_object(target)


def test_quadruped_is_the_papers_table():
    """Tab. 6 of the paper, row by row."""
    cfg = composed("+experiment=quadruped")
    assert cfg.optimizer._target_.endswith("OptimizerOptions")
    assert (cfg.optimizer.prior_lr, cfg.optimizer.lr) == (1e-3, 1e-4)
    assert cfg.trainer.max_steps == 800_000
    schedule = cfg.schedule
    assert schedule.articulation == [20_000, None]
    assert schedule.deformation == [500_000, None]
    assert schedule.adversarial == [80_000, 300_000]
    assert cfg.data.batch_size == 6
    weights = schedule.weights
    assert weights.mask == 10
    assert weights.image == 1
    assert [value for _, value in weights.feature] == [10, 1]
    assert weights.eikonal == 0.01
    assert weights.deformation == 10
    assert [value for _, value in weights.articulation] == [0, 0.2]
    for (start, feature), (same, target) in zip(weights.feature, schedule.target_weights.feature, strict=True):
        assert start == same
        assert target / feature == {0: 50, 300_000: 500}[start]  # lambda_hyp
    assert weights.adversarial == 0.1
    assert cfg.data.image_size == 256
    assert cfg.camera.fov_deg == 25
    assert cfg.camera.distance == 10
    assert cfg.shape.grid_resolution == 256
    assert (cfg.viewpoint.max_translation_xy, cfg.viewpoint.max_translation_z) == (0.4, 1.0)
    assert (schedule.temperature.stop, schedule.temperature.start) == (0.01, 1.0)
    assert (cfg.rig.skin_temperature, cfg.rig.skin_distance) == (0.5, "squared")
    assert (cfg.bank.num_slots, cfg.bank.top_k, cfg.bank.value_dim) == (60, 10, 128)
    assert cfg.encoder.name == "dino_vits8"


def test_light_ranges_and_bones_of_the_table():
    import torch

    from fauna.appearance.lighting import LightNetwork
    from fauna.geometry import skeleton

    torch.manual_seed(0)
    light = LightNetwork(texture_dim=4, num_layers=2, hidden_dim=8)(torch.randn(500, 4) * 100)
    assert 0 <= light.ambient.min() < 0.1 < 0.9 < light.ambient.max() <= 1
    assert 0.5 <= light.diffuse.min() < 0.55 < 0.95 < light.diffuse.max() <= 1
    assert (skeleton.NUM_BODY_BONES, skeleton.BONES_PER_LEG) == (8, 3)


def test_command_line_wins_over_experiments():
    assert composed("+experiment=laptop", "bank=none").bank._target_.endswith("NoBank")
    assert composed("+experiment=[laptop,magicpony]").bank._target_.endswith("SingleBank")
    assert composed("+experiment=[laptop,magicpony]", "bank=semantic").bank._target_.endswith("SemanticBank")
    assert composed("+experiment=quadruped", "schedule.weights.eikonal=0.1").schedule.weights.eikonal == 0.1


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("bank.num_slots=abc", r"bank.num_slots: expected a whole number, got 'abc' \(str\); e.g. bank.num_slots=60"),
        ("bank.num_slots=2.5", "bank.num_slots: expected a whole number, got 2.5"),
        ("+bank.num_slot=3", "bank.num_slot: expected a key of .*SemanticBank.*did you mean bank.num_slots"),
        ("~bank.top_k", "bank.top_k: expected a value for .*SemanticBank, got none"),
        ("seed=-1", "seed: expected a whole number >= 0, got -1"),
        ("seed=a", "seed: expected a whole number, got 'a'"),
        ("data.on_bad=perhaps", "data.on_bad: expected one of skip, error, got 'perhaps'"),
        ("shape.half_extents=[1,x,2]", "shape.half_extents: expected .*"),
        ("bank._target_=fauna.bank.semantic.Nothing", "bank._target_: expected an importable class"),
    ],
)
def test_bad_values_name_key_expected_received_remedy(override, message):
    with pytest.raises(FaunaError, match=message):
        validate(composed(override))


def test_schedule_weights_name_known_terms():
    from fauna.losses.objective import IMAGE_TERMS, TERMS

    for path in (CONF_DIR / "schedule").glob("*.yaml"):
        schedule = composed(f"schedule={path.stem}").schedule
        assert set(schedule.weights) <= set(TERMS), path
        assert set(schedule.target_weights) <= set(IMAGE_TERMS), path
    paper = yaml.safe_load((CONF_DIR / "schedule" / "paper.yaml").read_text())
    assert set(paper["weights"]) == set(TERMS)


def test_conf_ships_with_the_package():
    assert (CONF_DIR / "train.yaml").is_file()
    assert Path(CONF_DIR).is_absolute()


def test_every_run_of_every_queue_composes_and_binds():
    from fauna.queue.plan import read_plan

    for path in (CONF_DIR / "queue").glob("*.yaml"):
        plan = read_plan(path.stem, [])
        for run in plan.runs():
            validate(composed(f"+experiment={plan.experiment}", *run.overrides))
